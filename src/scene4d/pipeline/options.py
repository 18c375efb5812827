"""What a user may say about a calibration, and what comes of it."""

from dataclasses import dataclass, field
from pathlib import Path

import numpy as np

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


@dataclass
class Run:
    """A calibration with what its report shows: a picture, times by stage, what was noticed."""

    calibration: Calibration
    source_name: str
    image_bgr: np.ndarray | None = None
    timings: dict[str, float] = field(default_factory=dict)


@dataclass
class Seen:
    """What the footage showed."""

    detections: Detections
    frames: int
    edges: np.ndarray | None = None
    image_bgr: np.ndarray | None = None
    notes: list[str] = field(default_factory=list)
