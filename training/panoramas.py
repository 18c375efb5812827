"""Upright equirectangular pictures, their split, and perspective crops of them.

The horizon is the middle row. Every crop's vertical field of view, tilt and roll are known exactly
because we chose them.
"""

import csv
import hashlib
import re
from dataclasses import dataclass
from pathlib import Path

import cv2
import numpy as np

from scene4d.core.geometry import rotation_from_tilt_roll

CROP_SIZE = (192, 144)
"""Width and height of what the network sees, pixels: 4:3."""
CELLS = (CROP_SIZE[0] // 16, CROP_SIZE[1] // 16)
"""Columns and rows of the network's dense head."""
SPLITS = ("train", "validation", "test")
_SHARES = (0.72, 0.86)
_NEIGHBOUR = re.compile(r"[\d_]*\d$")
LOWEST_RAD = np.radians(75.0)
"""The steepest ray of a crop below the horizon where what lies under the camera is no picture."""
# Hands, helmets, a tripod or a smear under the camera, seen by eye: nothing below this is looked
# at. All other panoramas are clean straight down.
_LOWEST_RAD = {
    "googlearchive_chichen_itza": LOWEST_RAD,
    "googlearchive_christ_redeemer": 0.7,
    "googlearchive_machu_picchu": 0.9,
    "googlearchive_petra": 0.9,
    "googlearchive_taj_mahal": 0.7,
    "npm-marble360_house_landing": 0.6,
    "npm-marble360_opera_house_night": 0.6,
    "npm-pannellum-2-4-1_backyard": 0.9,
    "npm-pannellum-2-4-1_foyer": 1.2,
    "npm-react-native-panorama_lawn_house": LOWEST_RAD,
    "pypi-geovisio_forest_path": 0.9,
    "pypi-geovisio_street1": 0.7,
    "pypi-geovisio_street2": 0.7,
    "pypi-geovisio_street3": 0.7,
    "pypi-geovisio_street4": 0.7,
}
UNLIMITED_RAD = np.pi
"""A crop may look straight down, and past it."""
WOODED = frozenset(
    {
        "0beqz_blue_grotto",
        "0beqz_crystal_falls",
        "deb-blender-data_ninomaru_teien",
        "gameknife_sunset_fairway",
        "gbvibecoder_noon_grass",
        "gkjohnson_narrow_moonlit_road",
        "gkjohnson_phalzer_forest_01",
        "happy358_je_gray_02",
        "happy358_rainforest_trail",
        "happy358_spaichingen_hill",
        "happy358_sunny_vondelpark",
        "happy358_tiergarten",
        "happy358_turning_area",
        "happy358_xanderklinge",
        "humus_park",
        "immersive-web_eilenriede-park",
        "naver_dry_hay_field",
        "naver_evening_meadow",
        "naver_london_park",
        "npm-hyperfy-client_park_parking",
        "pmndrs_forest_slope",
        "pmndrs_immenstadter_horn",
        "pypi-geovisio_forest_path",
        "tresjs_mossy_forest",
        "tresjs_snowy_forest_path_01",
    }
)
"""Places with trees and without houses or a far horizon, chosen by eye: sheared along the vertical,
so that their ground slopes and their trees stay upright, they are hillsides (:class:`View`)."""


@dataclass(frozen=True, eq=False)
class Panorama:
    """Levels of an equirectangular picture, finest first, and how far down it may be looked."""

    name: str
    levels: tuple[np.ndarray, ...]
    lowest_rad: float = UNLIMITED_RAD
    outdoors: bool = True

    @classmethod
    def of(
        cls,
        name: str,
        picture_bgr: np.ndarray,
        lowest_rad: float = UNLIMITED_RAD,
        outdoors: bool = True,
    ) -> "Panorama":
        """With levels of half the size each, down to 512 pixels."""
        levels = [np.ascontiguousarray(picture_bgr)]
        while levels[-1].shape[1] >= 1024:
            levels.append(cv2.pyrDown(levels[-1]))
        return cls(name, tuple(levels), lowest_rad, outdoors)

    def level(self, pixels_per_rad: float) -> np.ndarray:
        """The coarsest level that is still as fine as asked for."""
        fine_enough = [
            level for level in self.levels if level.shape[1] / (2 * np.pi) >= pixels_per_rad
        ]
        return fine_enough[-1] if fine_enough else self.levels[0]


def group(name: str) -> str:
    """Files whose names differ by a trailing number show neighbouring places: one group."""
    place = Path(name).stem.split("_", 1)[-1] if "_" in name else Path(name).stem
    return _NEIGHBOUR.sub("", place)


def split_of(name: str) -> str:
    """The split of a panorama, a function of its group's name alone."""
    share = int.from_bytes(hashlib.sha256(group(name).encode()).digest()[:4], "big") / 2**32
    return SPLITS[sum(share >= limit for limit in _SHARES)]


def read_panoramas(folder: Path, split: str) -> list[Panorama]:
    """The pictures of one split, as listed in SOURCES.csv.

    Raises :class:`FileNotFoundError` where the folder or one of its pictures is missing.
    """
    with (folder / "SOURCES.csv").open(newline="") as file:
        outdoors = {row["file"]: row["outdoor_indoor"] == "outdoor" for row in csv.DictReader(file)}
    found = []
    for name in sorted(outdoors):
        if split_of(name) != split:
            continue
        picture = cv2.imread(str(folder / name))
        if picture is None:
            raise FileNotFoundError(folder / name)
        stem = Path(name).stem
        lowest_rad = _LOWEST_RAD.get(stem, UNLIMITED_RAD)
        found.append(Panorama.of(stem, picture, lowest_rad, outdoors[name]))
    return found


@dataclass(frozen=True)
class View:
    """A camera inside a panorama: angles in radians, ``k1`` of the lens at the image's corner.

    ``slope``: rise of the ground per metre to the camera's right and ahead. The world is sheared
    along the vertical: what is upright stays upright, and what is level slopes.
    """

    vfov_rad: float
    tilt_rad: float
    roll_rad: float
    heading_rad: float
    k1: float = 0.0
    mirrored: bool = False
    slope: tuple[float, float] = (0.0, 0.0)


def pixel_rays(view: View, size: tuple[int, int] = CROP_SIZE) -> np.ndarray:
    """Rays of the pixels in the camera's frame, (height, width, 3), third coordinate one."""
    width, height = size
    focal = height / 2 / np.tan(view.vfov_rad / 2)
    x, y = np.meshgrid(
        (np.arange(width) + 0.5 - width / 2) / focal, (np.arange(height) + 0.5 - height / 2) / focal
    )
    corner2 = (width**2 + height**2) / (2 * focal) ** 2
    bend = 1 + view.k1 * (x**2 + y**2) / corner2
    return np.stack([x * bend, y * bend, np.ones_like(x)], axis=-1)


def crop(panorama: Panorama, view: View, size: tuple[int, int] = CROP_SIZE) -> np.ndarray:
    """The picture of a camera inside the panorama, (height, width, 3) uint8."""
    cam_from_world = rotation_from_tilt_roll(view.tilt_rad, view.roll_rad)
    world = pixel_rays(view, size).astype(np.float32) @ cam_from_world.astype(np.float32)
    azimuth = np.arctan2(world[..., 0], world[..., 1]) + view.heading_rad
    risen = world[..., :2] @ np.array(view.slope, np.float32)
    elevation = np.arctan2(world[..., 2] - risen, np.hypot(world[..., 0], world[..., 1]))
    level = panorama.level(size[1] / view.vfov_rad)
    rows, columns = level.shape[:2]
    u = np.mod(azimuth / (2 * np.pi), 1.0) * columns - 0.5
    v = (0.5 - elevation / np.pi) * rows - 0.5
    return cv2.remap(
        level,
        u.astype(np.float32),
        v.astype(np.float32),
        cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_WRAP,
    )


def fields(view: View, cells: tuple[int, int]) -> tuple[np.ndarray, np.ndarray]:
    """Direction of up in the image and latitude, at the centres of ``cells`` (columns, rows).

    Returns ``up_uv`` (rows, columns, 2), unit vectors, and ``latitude_rad`` (rows, columns),
    positive above the horizon (Jin et al. 2023, "Perspective Fields").
    """
    columns, rows = cells
    height = CROP_SIZE[1]
    focal = height / 2 / np.tan(view.vfov_rad / 2)
    step = CROP_SIZE[0] / columns
    x, y = np.meshgrid(
        ((np.arange(columns) + 0.5) * step - CROP_SIZE[0] / 2) / focal,
        ((np.arange(rows) + 0.5) * step - height / 2) / focal,
    )
    corner2 = (CROP_SIZE[0] ** 2 + height**2) / (2 * focal) ** 2
    bend = 1 + view.k1 * (x**2 + y**2) / corner2
    ray = np.stack([x * bend, y * bend, np.ones_like(x)], axis=-1)
    up = rotation_from_tilt_roll(view.tilt_rad, view.roll_rad)[:, 2]
    moved = up[:2] - ray[..., :2] * up[2]
    up_uv = moved / np.linalg.norm(moved, axis=-1, keepdims=True)
    latitude = np.arcsin((ray @ up) / np.linalg.norm(ray, axis=-1))
    return up_uv, latitude
