"""Which detectors look at the footage, and all that what they see depends on."""

import hashlib
import json
from collections.abc import Iterator
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.progress import Progress
from scene4d.tracking.options import TrackOptions, TrackRun
from scene4d.tracking.sampling import CHUNK_S
from scene4d.video.stream import without_password

if TYPE_CHECKING:
    from scene4d.perception.objects import ObjectDetector
    from scene4d.tracking.following import Look
    from scene4d.video.frames import Source

_LOGS = "detections"
"""Folder in a scene for what the detectors saw; it may be removed once a run is complete."""


def watched(
    footage: "Source",
    settings: dict[str, Any],
    calibration: Calibration,
    options: TrackOptions,
    run: TrackRun,
    progress: Progress,
) -> Iterator["Look"]:
    """Detect what the log lacks, and give back what it holds."""
    from scene4d.calibration.watching import fetch_weights, person_px
    from scene4d.store.log import DetectionLog
    from scene4d.tracking.looking import looks_of_log
    from scene4d.tracking.watching import watch_into

    log = DetectionLog(run.scene / _LOGS / run.run, settings)
    if log.finished:
        run.resumed = log.complete
        return looks_of_log(log)
    fetch_weights(progress, vehicles=options.detector is None)
    camera = calibration.camera
    height_m = options.height_m(calibration)
    assert camera is not None
    chosen = _make_objects(options.detector)
    objects = chosen.expecting(lambda rows: person_px(camera, rows, height_m))
    watch_into(log, footage, objects, options, run, progress)
    run.timings |= objects.timings
    run.warnings.extend(footage.warnings)
    return looks_of_log(log)


def _make_objects(chosen: str | Path | None) -> "ObjectDetector":
    """The detectors for people and vehicles; raises :class:`InputError` for an unknown name."""
    from scene4d.perception.objects import ObjectDetector

    if chosen is None:
        return ObjectDetector.default()
    from scene4d.perception.detectors import make_detector
    from scene4d.perception.detectors.onnx_yolox import OnnxYoloxDetector
    from scene4d.perception.keypoints import KeypointEstimator

    one = OnnxYoloxDetector(Path(chosen)) if _is_onnx(chosen) else make_detector(str(chosen))
    return ObjectDetector(one, KeypointEstimator())


def log_settings(
    footage: "Source", described: dict[str, Any], options: TrackOptions
) -> dict[str, Any]:
    """All that detections depend on."""
    from importlib.metadata import version

    from scene4d.perception.weights import WEIGHTS

    path = Path(footage.name)
    there = path.stat() if path.is_file() else None
    return {
        "source": str(path.resolve()) if there is not None else without_password(footage.name),
        "bytes": None if there is None else there.st_size,
        "modified_ns": None if there is None else there.st_mtime_ns,
        "image_size": list(footage.image_size),
        "rate_hz": options.rate_hz,
        "detector": _identity(options.detector),
        "chunk_s": CHUNK_S,
        "camera": f"{Path(options.camera).name} {_mark(described)}",
        "person_height_m": options.person_height_m,
        "weights": {weight.name: weight.sha256 for weight in WEIGHTS},
        "software": f"scene4d {version('scene4d')}",
    }


def _mark(values: dict[str, Any]) -> str:
    return hashlib.sha256(json.dumps(values, sort_keys=True).encode()).hexdigest()[:12]


def _is_onnx(chosen: str | Path) -> bool:
    return str(chosen).lower().endswith(".onnx")


def _identity(chosen: str | Path | None) -> str | None:
    """A detector's name, and of a file what is in it."""
    if chosen is None or not _is_onnx(chosen):
        return None if chosen is None else str(chosen)
    try:
        content = Path(chosen).read_bytes()
    except OSError as error:
        raise InputError(f"{chosen}: cannot be read: {error.strerror}") from error
    return f"{Path(chosen).name} {hashlib.sha256(content).hexdigest()}"
