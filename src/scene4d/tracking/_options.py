"""What a user may say about a run of ``track``, and what comes of it."""

from dataclasses import dataclass, field
from datetime import datetime
from pathlib import Path
from typing import Any

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.progress import Progress


@dataclass(frozen=True)
class TrackOptions:
    """What a user may say about a run.

    ``annotations`` is a file of boxes to use instead of the detectors: ``format`` names its format
    where that is not clear, ``fps`` its frame rate where no footage tells it, and ``drop_invalid``
    leaves out impossible boxes. ``name`` is what the camera is called in the scene (by default the
    name of the footage), ``start`` when the footage began (UTC), ``rate_hz`` how many frames per
    second are looked at: people and cars move little in a tenth of a second. ``person_height_m`` is
    the people's mean height (by default what the calibration assumed). ``detector`` is the name of
    a registered detector, or an ONNX file of the YOLOX layout, for people and vehicles both; by
    default there is one for each.
    """

    annotations: str | Path | None = None
    name: str | None = None
    start: datetime | None = None
    rate_hz: float = 10.0
    fps: float | None = None
    person_height_m: float | None = None
    drop_invalid: bool = False
    format: str | None = None
    detector: str | Path | None = None

    def __post_init__(self) -> None:
        """Refuse before any work is done what cannot work; raises :class:`InputError`."""
        ranges = {"rate_hz": (0.001, 1000), "fps": (0.001, 1000), "person_height_m": (0.5, 2.5)}
        for name, (least, most) in ranges.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise InputError(f"{name}: found {value}, expected {least} to {most}")


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


@dataclass(frozen=True, eq=False)
class Job:
    """One run: what it works with. ``described`` is the camera as the scene stores it,
    ``background`` a picture of the scene as it was calibrated, if somebody kept one.
    """

    calibration: Calibration
    described: dict[str, Any]
    background: Path | None
    options: TrackOptions
    run: TrackRun
    progress: Progress

    @property
    def camera(self) -> Camera:
        """The calibrated camera."""
        assert self.calibration.camera is not None
        return self.calibration.camera

    @property
    def person_height_m(self) -> float:
        """Mean height of the people."""
        return self.options.person_height_m or self.calibration.person_height_m
