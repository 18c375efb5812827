"""What a user may say about a calibration, and what comes of it."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

from scene4d.calibration import METHODS
from scene4d.errors import InputError
from scene4d.model import Calibration, Detections, Orientation


@dataclass(frozen=True)
class Options:
    """What a user may say about a calibration; the names are those of the command line."""

    lens: str | Path | None = None
    annotations: str | Path | None = None
    image_size: tuple[int, int] | None = None
    person_height_m: float = 1.70
    method: str = "joint"
    orientation: str | Path | Orientation = "auto"
    estimate_focal: bool = False
    frames: int | None = None
    seed: int = 0
    drop_invalid: bool = False
    lines: bool = True

    def __post_init__(self) -> None:
        """Refuse before any work is done what cannot work; raises :class:`InputError`."""
        if self.method not in METHODS:
            raise InputError(f"method must be one of {METHODS}, found {self.method!r}")
        if not 0.5 <= self.person_height_m <= 2.5:
            raise InputError(
                f"person_height_m must lie in 0.5 to 2.5 metres, found {self.person_height_m}"
            )
        if self.frames is not None and self.frames < 1:
            raise InputError(f"frames must be at least 1, found {self.frames}")
        if self.method == "paper" and self.orientation in ("auto", "people"):
            raise InputError(
                "the paper's method needs the camera's orientation (focal length, tilt, roll): "
                "give --orientation FILE, or use --method joint"
            )


@dataclass
class Run:
    """A calibration with what its report shows: the scene, a frame with people, times by stage."""

    calibration: Calibration
    source_name: str
    image_bgr: np.ndarray | None = None
    people_bgr: np.ndarray | None = None
    timings: dict[str, float] = field(default_factory=dict)


@dataclass
class Seen:
    """What the footage showed."""

    detections: Detections
    frames: int
    edges: np.ndarray | None = None
    image_bgr: np.ndarray | None = None
    people_bgr: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)
