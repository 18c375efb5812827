"""What a user may say about a scene, and what came of it."""

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError

_DEFAULT_RATE_HZ = 10.0
"""Pictures looked at per second: people and cars move little in a tenth of one."""


@dataclass(frozen=True)
class TrackOptions:
    """What a user may say about a scene; the names are those of the command line.

    ``detector`` is the name of a registered detector, or an ONNX file of the YOLOX layout, for
    people and vehicles both; ``format`` names that of ``annotations`` where it is not clear; by
    default there is one for each. ``name`` is what the camera is called in the scene (by default
    the name of the footage), ``start`` when the footage began (UTC), ``rate_hz`` how many pictures
    per second are looked at.
    """

    camera: str | Path
    annotations: str | Path | None = None
    name: str | None = None
    start: datetime | None = None
    rate_hz: float = _DEFAULT_RATE_HZ
    fps: float | None = None
    person_height_m: float | None = None
    drop_invalid: bool = False
    format: str | None = None
    detector: str | Path | None = None

    def __post_init__(self) -> None:
        """Refuse before any work is done what cannot work; raises :class:`InputError`."""
        if not 0 < self.rate_hz <= 1000:
            raise InputError(f"rate must be a number of pictures per second, found {self.rate_hz}")
        if self.fps is not None and not 0 < self.fps <= 1000:
            raise InputError(f"fps must be a number of frames per second, found {self.fps}")
        if self.person_height_m is not None and not 0.5 <= self.person_height_m <= 2.5:
            raise InputError(
                f"person_height_m must lie in 0.5 to 2.5 metres, found {self.person_height_m}"
            )

    def height_m(self, calibration: Calibration) -> float:
        """Mean height of the people: what is said here, or what the calibration assumed."""
        return self.person_height_m or calibration.person_height_m


@dataclass
class TrackRun:
    """What was written: rows, tracks by class, sightings without a ground point, times by stage."""

    scene: Path
    camera: str
    run: str
    rows: int = 0
    tracks: dict[str, int] = field(default_factory=dict)
    without_position: int = 0
    begin_s: float = float("nan")
    end_s: float = float("nan")
    resumed: int = 0
    picture: Path | None = None
    warnings: list[str] = field(default_factory=list)
    timings: dict[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints."""
        return {
            "out": str(self.scene),
            "camera": self.camera,
            "run": self.run,
            "rows": self.rows,
            "tracks": self.tracks,
            "without_position": self.without_position,
            "begin_s": self.begin_s if self.rows else None,
            "end_s": self.end_s if self.rows else None,
            "resumed_chunks": self.resumed,
            "picture": None if self.picture is None else str(self.picture),
            "warnings": self.warnings,
            "timings_s": self.timings,
        }
