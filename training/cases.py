"""Pictures to measure the network on: held-out panoramas, real cameras, and hopeless ones."""

import itertools
from collections.abc import Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import cv2
import numpy as np

from scene4d.core.camera import Camera
from scene4d.evaluation import pets, towncentre
from scene4d.formats.cameras import read_camera
from scene4d.perception.orientation.grid import crop_size
from scene4d.video.reader import open_source
from training.layout import random_slope
from training.panoramas import (
    CROP_SIZE,
    LOWEST_RAD,
    UNLIMITED_RAD,
    WOODED,
    Panorama,
    View,
    crop,
)
from training.samples import sample
from training.streets import scene_layout, street_panorama

VFOV_DEG = (20, 70)
"""Vertical fields of view of the held-out crops."""
CROPS_EACH = 24
"""Crops of one panorama."""
PETS_FRAMES = 12
_DRAWN_FIRST = 2 * 10**6
"""Number of the first invented scene; training and validation draw others."""
HILLSIDES = frozenset(
    {
        "gkjohnson_hilly_terrain_01",
        "gkjohnson_phalzer_forest_01",
        "humus_maskonaive",
        "humus_teide",
        "mistic100_sphere_mountain",
        "npm-marble360_barangaroo",
        "npm-webgl-operate_field",
        "pmndrs_forest_slope",
    }
)
"""Held-out panoramas whose ground slopes or whose skyline is not level, chosen by eye."""


@dataclass(frozen=True, eq=False)
class Case:
    """A picture and the roll, tilt and vertical field of view of its 4:3 crop, radians."""

    name: str
    picture_bgr: np.ndarray
    truth_rad: np.ndarray


def held_out(panoramas: list[Panorama], seed: int, *, each: int = CROPS_EACH) -> Iterator[Case]:
    """Undegraded crops: field of view 20-70°, tilt -10 to 50°, roll of 4° and up to 15°."""
    for panorama in panoramas:
        rng = np.random.default_rng([seed, *panorama.name.encode()])
        for _ in range(each):
            yield _case(panorama, _view(rng, (-10, 50), min(panorama.lowest_rad, LOWEST_RAD)))


def steep(panoramas: list[Panorama], seed: int, *, each: int = CROPS_EACH) -> Iterator[Case]:
    """Likewise with a tilt of 40 to 70°, of panoramas that are clean straight down."""
    for panorama in panoramas:
        rng = np.random.default_rng([seed, 1, *panorama.name.encode()])
        if panorama.lowest_rad == UNLIMITED_RAD:
            for _ in range(each):
                yield _case(panorama, _view(rng, (40, 70), panorama.lowest_rad))


def wooded_slopes(panoramas: list[Panorama], seed: int, *, each: int = 36) -> Iterator[Case]:
    """Wooded places made to slope by 3-20°, their trees upright; tilt -10 to 50°."""
    for panorama in panoramas:
        rng = np.random.default_rng([seed, 2, *panorama.name.encode()])
        if panorama.name in WOODED:
            for _ in range(each):
                view = _view(rng, (-10, 50), panorama.lowest_rad)
                yield _case(panorama, replace(view, slope=random_slope(rng)))


def drawn_slopes(panoramas: list[Panorama], seed: int, *, scenes: int = 15) -> Iterator[Case]:
    """Invented scenes on slopes of more than 5° below the skies of these panoramas."""
    backdrops = [panorama for panorama in panoramas if panorama.outdoors]
    found = 0
    for number in itertools.count(_DRAWN_FIRST):
        if np.hypot(*scene_layout(number).slope) < np.tan(np.radians(5)):
            continue
        scene = street_panorama(number, backdrops)
        yield from held_out([scene], seed, each=12)
        found += 1
        if found == scenes:
            return


def _view(rng: np.random.Generator, tilt_deg: tuple[float, float], lowest_rad: float) -> View:
    while True:
        vfov = np.radians(np.exp(rng.uniform(*np.log(VFOV_DEG))))
        tilt = np.radians(rng.uniform(*tilt_deg))
        if tilt + vfov / 2 <= lowest_rad:
            break
    roll = np.radians(np.clip(rng.normal(0, 5), -15, 15))
    return View(float(vfov), float(tilt), float(roll), rng.uniform(0, 2 * np.pi))


def _case(panorama: Panorama, view: View) -> Case:
    # Larger than the network's input, as real pictures are.
    picture = crop(panorama, view, (2 * CROP_SIZE[0], 2 * CROP_SIZE[1]))
    return Case(panorama.name, picture, np.array([view.roll_rad, view.tilt_rad, view.vfov_rad]))


def degraded_like_training(panoramas: list[Panorama], seed: int, count: int) -> Iterator[Case]:
    """As in training, all ranges and all weathers, without the hopeless ones."""
    made, index = 0, 0
    while made < count:
        picture, truth = sample(np.random.default_rng([seed, index]), panoramas, [])
        index += 1
        if truth.hopeless:
            continue
        view = truth.view
        pose = np.array([view.roll_rad, view.tilt_rad, view.vfov_rad])
        yield Case("degraded", picture, pose)
        made += 1


def blurred(cases: list[Case], sigma_px: float) -> list[Case]:
    """The same, out of focus by this much at the network's resolution."""
    shrunk = [cv2.resize(c.picture_bgr, CROP_SIZE, interpolation=cv2.INTER_AREA) for c in cases]
    soft = [cv2.GaussianBlur(picture, (0, 0), sigma_px) for picture in shrunk]
    return [Case(c.name, picture, c.truth_rad) for c, picture in zip(cases, soft, strict=True)]


def _truth(camera: Camera) -> np.ndarray:
    _, height = crop_size(camera.image_size)
    vfov = 2 * np.arctan(height / 2 / camera.focal_px)
    return np.array([camera.roll_rad, camera.tilt_rad, vfov])


def real_cameras(data: Path) -> Iterator[tuple[str, list[Case]]]:
    """PETS, TownCentre and MEVA's four: several frames of each where there are any."""
    truth = _truth(pets(data / "pets2009").camera)
    with open_source(data / "pets2009" / "vtest.avi") as video:
        picked = np.linspace(0, (video.frame_count or 1) - 1, PETS_FRAMES).astype(int)
        yield (
            "PETS View_001",
            [Case("pets", frame.image_bgr, truth) for frame in video.frames(picked.tolist())],
        )
    truth = _truth(towncentre(data / "towncentre").camera)
    paths = sorted((data / "towncentre" / "frames").iterdir())
    yield "TownCentre", [Case(path.stem, cv2.imread(str(path)), truth) for path in paths]
    for path in sorted((data / "meva" / "frames").glob("*.jpg")):
        picture = cv2.imread(str(path))
        size = (picture.shape[1], picture.shape[0])
        camera = read_camera(data / "meva" / "cameras" / f"{path.stem}.krtd", image_size=size)
        yield f"MEVA {path.stem}", [Case(path.stem, picture, _truth(camera))]


def hopeless(panoramas: list[Panorama]) -> Iterator[tuple[str, np.ndarray]]:
    """Pictures that tell nothing about a camera."""
    rng = np.random.default_rng(3)
    size = (480, 640, 3)
    yield "black", np.zeros(size, np.uint8)
    yield "white", np.full(size, 255, np.uint8)
    yield "grey", np.full(size, 128, np.uint8)
    yield "noise", rng.integers(0, 256, size).astype(np.uint8)
    ramp = np.linspace(0, 255, 480).astype(np.uint8)
    yield "brightness ramp", np.repeat(np.repeat(ramp[:, None], 640, axis=1)[..., None], 3, axis=2)
    sample_case = next(held_out(panoramas[:1], 9))
    whole = sample_case.picture_bgr
    yield "tiny (43x32)", cv2.resize(whole, (43, 32), interpolation=cv2.INTER_AREA)


def turned(panoramas: list[Panorama], seed: int, *, each: int = 6) -> Iterator[Case]:
    """Held-out crops on their left side, upside down, and on their right side in turn.

    Their roll lies outside of the grid; the truth is that of the crop before it was turned.
    """
    for n, case in enumerate(held_out(panoramas, seed, each=each)):
        picture = np.ascontiguousarray(np.rot90(case.picture_bgr, 1 + n % 3))
        yield Case(case.name, picture, case.truth_rad)
