"""Recordings with a true camera, and where people walked in them (layout: see the README)."""

from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scene4d.evaluate.correspondence import (
    CorrespondenceError,
    correspondence_error,
    spread_points,
)
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera
from scene4d.model import Camera, Detections


@dataclass(frozen=True, eq=False)
class Reference:
    """A true camera with the annotated feet (n, 2), in pixels of the footage as decoded."""

    name: str
    camera: Camera
    feet_uv: Float[np.ndarray, "n 2"]

    def score(self, estimated: Camera, *, undistorted: bool = False) -> CorrespondenceError:
        """Correspondence error of a calibration over points spread over where people walked.

        ``undistorted`` says that the calibrated footage had been undistorted with the true lens.
        """
        straight, seen = self.camera.undistort(self.feet_uv)
        true_xy, on_ground = self.camera.locate(straight)
        inside = self.feet_uv[:, 1] <= self.camera.image_size[1] - 1
        usable = np.flatnonzero(seen & on_ground & inside)
        rows = usable[spread_points(true_xy[usable])]
        uv = straight[rows] if undistorted else self.feet_uv[rows]
        estimated_xy, _ = estimated.locate(estimated.undistort(uv)[0])
        return correspondence_error(estimated_xy, true_xy[rows])


def _feet(detections: Detections) -> np.ndarray:
    x1, _, x2, y2 = detections.box_xyxy.T
    return np.column_stack([(x1 + x2) / 2, y2])


def _reference(name: str, camera_file: Path, annotations: Path) -> Reference:
    camera = read_camera(camera_file)
    assert isinstance(camera, Camera)
    boxes = read_annotations(annotations, image_size=camera.image_size)
    return Reference(name, camera, _feet(boxes))


def pets(data: str | Path) -> Reference:
    """PETS 2009 S2.L1 View_001: Tsai camera and hand-drawn boxes; ``data`` holds their files."""
    folder = Path(data)
    return _reference("PETS 2009", folder / "View_001.xml", folder / "PETS2009-S2L1.xml")


def towncentre(data: str | Path) -> Reference:
    """TownCentre: camera and annotated feet. The boxes' heights are circular and not used."""
    folder = Path(data)
    return _reference(
        "TownCentre", folder / "TownCentre-calibration.ci", folder / "TownCentreGTHalfRes.csv"
    )
