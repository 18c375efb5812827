"""What a user may say about a calibration, and what comes of it."""

from dataclasses import dataclass, field
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np

from scene4d.calibration import check_asked
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import PERSON_HEIGHT_M, Detections

if TYPE_CHECKING:
    from scene4d.calibration.orienting import OrientationReading


@dataclass(frozen=True)
class Options:
    """What a user may say about a calibration; the names are those of the command line."""

    lens: str | Path | None = None
    annotations: str | Path | None = None
    image_size: tuple[int, int] | None = None
    person_height_m: float = PERSON_HEIGHT_M
    method: str = "joint"
    orientation: str | Path | Orientation = "auto"
    estimate_focal: bool = False
    frames: int | None = None
    seed: int = 0
    drop_invalid: bool = False
    lines: bool = True

    def __post_init__(self) -> None:
        """Refuse before any work is done what cannot work; raises :class:`InputError`."""
        check_asked(self.method, self.person_height_m, has_orientation=self.orientation != "people")
        if self.frames is not None and self.frames < 1:
            raise InputError(f"frames must be at least 1, found {self.frames}")

    @property
    def uses_network(self) -> bool:
        """Whether pictures are shown to the orientation network."""
        return self.orientation in ("auto", "network")

    @property
    def needs_network(self) -> bool:
        """Whether nothing can be done without it: the paper's method is told the orientation."""
        return self.orientation == "network" or (self.uses_network and self.method == "paper")


@dataclass
class Run:
    """A calibration with what its report shows: the scene, a frame with people, times by stage,
    and what the orientation network read, where it was asked.
    """

    calibration: Calibration
    source_name: str
    image_bgr: np.ndarray | None = None
    people_bgr: np.ndarray | None = None
    reading: "OrientationReading | None" = None
    timings: dict[str, float] = field(default_factory=dict)


@dataclass
class Seen:
    """What the footage showed; ``reading`` is None where the orientation network did not look."""

    detections: Detections
    frames: int
    edges: np.ndarray | None = None
    image_bgr: np.ndarray | None = None
    people_bgr: np.ndarray | None = None
    reading: "OrientationReading | None" = None
    notes: list[str] = field(default_factory=list)
