"""Recordings with true cameras, and what is seen in them."""

import json
import tarfile
import tempfile
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from functools import partial
from pathlib import Path

import numpy as np

from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.watching import Seen, watch
from scene4d.core.camera import Camera, Lens
from scene4d.core.people import Detections
from scene4d.core.progress import Silent
from scene4d.evaluation import pets, towncentre
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera
from scene4d.video.reader import open_source

FRAMES = 200
MEVA_CLIPS, MEVA_FPS, MEVA_STEP = 6, 30.0, 15
EXACT = np.zeros(4)
SLOPING = np.array([0.005, np.radians(1.0), np.radians(1.0), 0.0])
"""MEVA: lens as published; its ground falls by a degree or two where people walk, and the cameras'
height over it is known to half a metre."""
MEVA_HEIGHT_SIGMA_M = 0.5


@dataclass(frozen=True, eq=False)
class Recording:
    """A true camera with the uncertainty of its (log f, tilt, roll, log height), the annotated feet
    (n, 2) if there are any, which points people give, and what may be given besides.
    """

    name: str
    camera: Camera
    points: tuple[str, ...]
    given: tuple[str, ...]
    feet_uv: np.ndarray
    truth_sigma: np.ndarray

    @property
    def lens(self) -> Lens:
        return self.camera.lens


Maker = Callable[[Path], tuple[Recording, Callable[[], Seen]]]
NO_FEET = np.empty((0, 2))
BOTH, WITH_AND_WITHOUT = ("keypoints", "boxes"), ("nothing", "lens")


def footage(path: Path) -> Seen:
    """Watched as ``calibrate`` does, with more frames."""
    with open_source(path) as source:
        options = CalibrateOptions(frames=FRAMES).read(source.image_size)
        return watch(source, options, Silent(), {})


def pets_video(data: Path) -> tuple[Recording, Callable[[], Seen]]:
    known = pets(data / "pets2009")
    feet = known.walked_uv
    recording = Recording("PETS 2009", known.camera, BOTH, WITH_AND_WITHOUT, feet, EXACT)
    return recording, partial(footage, data / "pets2009" / "vtest.avi")


def towncentre_video(name: str, file: str, data: Path) -> tuple[Recording, Callable[[], Seen]]:
    known = towncentre(data / "towncentre")
    path = data / "footage" / "towncentre" / file
    with open_source(path) as source:
        size = source.image_size
    lens = known.camera.lens.scaled_to(size)
    camera = replace(known.camera, image_size=size, K=lens.K)
    feet = (known.walked_uv + 0.5) * size[0] / known.image_size[0] - 0.5
    recording = Recording(name, camera, BOTH, WITH_AND_WITHOUT, feet, EXACT)
    return recording, partial(footage, path)


def lab(number: int, data: Path) -> tuple[Recording, Callable[[], Seen]]:
    folder = data / "footage" / "lab"
    fields = json.loads((folder / f"{number}.json").read_text())
    world = np.array(fields["extrinsic"][0]["tf"]["doubles"]).reshape(4, 4)
    size = fields["resolution"]["width"], fields["resolution"]["height"]
    camera = Camera(
        image_size=size,
        K=np.array(fields["intrinsic"]["doubles"]).reshape(3, 3),
        distortion=np.array(fields["distortion"]["doubles"]),
        R=world[:3, :3],
        t=world[:3, 3],
    )
    recording = Recording(f"lab {number}", camera, BOTH, WITH_AND_WITHOUT, NO_FEET, EXACT)
    return recording, partial(footage, folder / f"cam{number}.mp4")


def pets_boxes(data: Path) -> tuple[Recording, Callable[[], Seen]]:
    known = pets(data / "pets2009")
    recording = Recording(
        "PETS hand-drawn", known.camera, ("boxes",), ("lens",), known.walked_uv, EXACT
    )
    file = data / "pets2009" / "PETS2009-S2L1.xml"

    def read() -> Seen:
        found = read_annotations(file, image_size=known.image_size, fps=10.0)
        return Seen(found.select(found.frame % 4 == 0), FRAMES)

    return recording, read


def meva(name: str, data: Path) -> tuple[Recording, Callable[[], Seen]]:
    camera = read_camera(data / "meva" / "cameras" / f"{name}.krtd")
    assert isinstance(camera, Camera)
    sigma = SLOPING + np.array([0, 0, 0, MEVA_HEIGHT_SIGMA_M / meva_height_m(camera)])
    camera = over_ground(camera)
    recording = Recording(f"MEVA {name}", camera, ("boxes",), ("lens",), NO_FEET, sigma)
    return recording, partial(meva_boxes, name, camera, data / "meva" / "annotations.tar.xz")


def meva_height_m(camera: Camera) -> float:
    return camera.height_m - MEVA_GROUND_M


MEVA_GROUND_M = 1.0
"""The ground lies at 0.5 to 1.5 m in the frame of the MEVA cameras."""


def over_ground(camera: Camera) -> Camera:
    centre = camera.centre_m - np.array([0, 0, MEVA_GROUND_M])
    return replace(camera, t=-camera.R @ centre)


def meva_boxes(name: str, camera: Camera, archive_path: Path) -> Seen:
    parts: list[Detections] = []
    with tempfile.TemporaryDirectory() as scratch, tarfile.open(archive_path) as archive:
        archive.extractall(scratch, filter="data")
        for file in sorted(Path(scratch).rglob(f"*{name}*.geom.yml"))[:MEVA_CLIPS]:
            with warnings.catch_warnings():
                warnings.simplefilter("ignore")
                part = read_annotations(
                    file, image_size=camera.image_size, fps=MEVA_FPS, classes=["person"],
                    drop_invalid=True,
                )  # fmt: skip
            part = part.select(part.frame % MEVA_STEP == 0)
            named = np.where(part.track >= 0, part.track + 1_000_000 * len(parts), -1)
            later = 300.0 * len(parts)
            parts.append(replace(part, track=named, time_s=part.time_s + later))
    return Seen(Detections.concatenate(parts), sum(len(np.unique(p.frame)) for p in parts))


RECORDINGS: tuple[Maker, ...] = (
    pets_video,
    partial(towncentre_video, "TownCentre 1080p", "tc_1080p_orig0-251.mp4"),
    partial(towncentre_video, "TownCentre 720p", "tc_720p_orig249-776.avi"),
    partial(lab, 0),
    partial(lab, 2),
    pets_boxes,
    *(partial(meva, name) for name in ("G328", "G341", "G424", "G506")),
)
