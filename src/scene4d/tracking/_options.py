"""Options and results of a ``track`` run."""

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
    """Options of a run.

    ``annotations`` is a file of boxes to use instead of the detectors: ``format`` names its format
    if ambiguous, ``fps`` its frame rate if there is no footage, and ``drop_invalid`` leaves out
    impossible boxes. ``name`` is the camera's name in the scene (default: the name of the footage),
    ``start`` the start time of the footage (UTC), ``rate_hz`` the number of frames analysed per
    second: people and cars move little in a tenth of a second. ``person_height_m`` is the people's
    mean height (default: as assumed by the calibration). ``detector`` is the name of a registered
    detector, or an ONNX file with the YOLOX layout, for both people and vehicles; by default each
    has its own. ``device`` says where the networks run: ``"auto"``, ``"cpu"``, ``"cuda"`` and other
    providers of ONNX Runtime, ``"openvino:cpu"`` and other devices of OpenVINO, as far as they are
    here.
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
    device: str = "auto"

    def __post_init__(self) -> None:
        """Check the ranges before any work is done; raises :class:`InputError`."""
        ranges = {"rate_hz": (0.001, 1000), "fps": (0.001, 1000), "person_height_m": (0.5, 2.5)}
        for name, (least, most) in ranges.items():
            value = getattr(self, name)
            if value is not None and not least <= value <= most:
                raise InputError(f"{name}: found {value}, expected {least} to {most}")


@dataclass
class TrackRun:
    """What was written: rows, tracks by class, rows without a position, seconds by stage.

    ``picture`` is the view from above; ``objects_picture`` shows the objects of one moment as
    solids, None for streams and without footage.
    """

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
    objects_picture: Path | None = None
    warnings: list[str] = field(default_factory=list)
    timings: dict[str, float] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The output of ``--json``."""
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
            "objects_picture": None if self.objects_picture is None else str(self.objects_picture),
            "warnings": self.warnings,
            "timings_s": self.timings,
        }


@dataclass(frozen=True, eq=False)
class Job:
    """The inputs of one run. ``described`` is the camera as stored in the scene, ``background``
    an image of the calibrated view, if there is one.
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
