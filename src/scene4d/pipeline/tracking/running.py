"""``track_scene``: the stages of a scene, one after the other."""

import hashlib
import json
from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scene4d.errors import InputError
from scene4d.model import GIVEN, Calibration, Tracks, read_json
from scene4d.pipeline.progress import Progress, timed
from scene4d.pipeline.tracking.options import TrackOptions, TrackRun
from scene4d.pipeline.tracking.sampling import CHUNK_S

if TYPE_CHECKING:
    from scene4d.perception.objects import ObjectDetector
    from scene4d.pipeline.tracking.counting import TrackCount
    from scene4d.pipeline.tracking.following import Look
    from scene4d.pipeline.tracking.sketch import Sketch
    from scene4d.scene.log import DetectionLog
    from scene4d.video.frames import Source

FIGURES = "figures"
LOGS = "detections"
"""Folder in a scene for what the detectors saw; it may be removed once a run is complete."""


def track_scene(
    source: str | Path | None, scene: str | Path, options: TrackOptions, progress: Progress
) -> TrackRun:
    """Follow people and vehicles through footage of a calibrated camera, and write the scene.

    ``source`` is a video or a stream, None with annotations. A run that was killed goes on after
    its last complete chunk of footage, and its result is that of a run that was not. Raises
    :class:`InputError` for bad input (a camera that moved is one), :class:`UnavailableError` where
    weights cannot be had, and :class:`OutputError` where the scene cannot be written.
    """
    from scene4d.formats.cameras import read_calibration

    calibration = read_calibration(options.camera)
    made_here = calibration.method != GIVEN
    described = read_json(options.camera) if made_here else calibration.to_dict()
    if source is None and options.annotations is None:
        raise InputError("nothing to track: give a SOURCE, or --annotations FILE")
    seen = Path(str(options.annotations)) if source is None else Path(str(source))
    run = TrackRun(Path(scene), options.name or seen.stem, _run_name(seen))
    with ExitStack() as opened:
        footage = None if source is None else opened.enter_context(_footage(source, calibration))
        if options.annotations is not None:
            looks, provenance = _annotated(footage, calibration, options, run)
        else:
            assert footage is not None
            looks, provenance = _watched(footage, described, calibration, options, run, progress)
        _write(looks, provenance, calibration, described, options, run, progress)
    return run


def _run_name(seen: Path) -> str:
    """The footage's name, and a mark that tells it from others of the same name."""
    place = str(seen) if "://" in str(seen) else str(seen.resolve())
    return f"{seen.stem}-{hashlib.sha256(place.encode()).hexdigest()[:6]}"


def _footage(source: str | Path, calibration: Calibration) -> "Source":
    from scene4d.video.reader import open_source

    footage = open_source(source)
    if footage.image_size != calibration.image_size:
        footage.close()
        (w, h), (cw, ch) = footage.image_size, calibration.image_size
        raise InputError(
            f"{footage.name}: is {w}x{h}, but the camera was calibrated on {cw}x{ch}: give footage "
            "of that size, or calibrate on this"
        )
    return footage


def _annotated(
    footage: "Source | None", calibration: Calibration, options: TrackOptions, run: TrackRun
) -> tuple[Iterator["Look"], dict[str, Any]]:
    from scene4d.pipeline.tracking.looking import looks_of_annotations

    path = Path(str(options.annotations))
    fps = options.fps or (None if footage is None else footage.fps)
    looks = looks_of_annotations(path, calibration.image_size, fps, options, run)
    return looks, {"annotations": str(path), "fps": fps, "rate_hz": options.rate_hz}


def _watched(
    footage: "Source",
    described: dict[str, Any],
    calibration: Calibration,
    options: TrackOptions,
    run: TrackRun,
    progress: Progress,
) -> tuple[Iterator["Look"], dict[str, Any]]:
    """Detect what the log lacks, and give back what it holds."""
    from scene4d.pipeline.tracking.looking import looks_of_log
    from scene4d.pipeline.tracking.watching import watch_into
    from scene4d.pipeline.watching import fetch_weights, person_px

    settings = log_settings(footage, described, options)
    log = _log(run, settings)
    if not log.finished:
        fetch_weights(progress, vehicles=True)
        camera, height_m = calibration.camera, _height(calibration, options)
        assert camera is not None
        objects = _detector(options.detector).expecting(
            lambda rows: person_px(camera, rows, height_m)
        )
        watch_into(log, footage, objects, options, run, progress)
        for stage, seconds in objects.timings.items():
            run.timings[stage] = seconds
        run.warnings.extend(footage.warnings)
    else:
        run.resumed = log.complete
    return looks_of_log(log), settings


def _detector(chosen: str | Path | None) -> "ObjectDetector":
    """The detectors for people and vehicles; raises :class:`InputError` for an unknown name."""
    from scene4d.perception.objects import ObjectDetector

    if chosen is None:
        return ObjectDetector.default()
    from scene4d.perception.detectors import make_detector
    from scene4d.perception.detectors.onnx_yolox import OnnxYoloxDetector
    from scene4d.perception.keypoints import KeypointEstimator

    is_file = str(chosen).lower().endswith(".onnx")
    one = OnnxYoloxDetector(Path(chosen)) if is_file else make_detector(str(chosen))
    return ObjectDetector(one, KeypointEstimator())


def _log(run: TrackRun, settings: dict[str, Any]) -> "DetectionLog":
    from scene4d.scene.log import DetectionLog

    return DetectionLog(run.scene / LOGS / run.run, settings)


def log_settings(
    footage: "Source", described: dict[str, Any], options: TrackOptions
) -> dict[str, Any]:
    """All that detections depend on."""
    from importlib.metadata import version

    from scene4d.perception.weights import WEIGHTS

    path = Path(footage.name)
    there = path.stat() if path.is_file() else None
    return {
        "source": footage.name,
        "bytes": None if there is None else there.st_size,
        "modified_ns": None if there is None else there.st_mtime_ns,
        "image_size": list(footage.image_size),
        "rate_hz": options.rate_hz,
        "detector": None if options.detector is None else str(options.detector),
        "chunk_s": CHUNK_S,
        "camera": hashlib.sha256(json.dumps(described, sort_keys=True).encode()).hexdigest(),
        "person_height_m": options.person_height_m,
        "weights": {weight.name: weight.sha256 for weight in WEIGHTS},
        "software": f"scene4d {version('scene4d')}",
    }


def _height(calibration: Calibration, options: TrackOptions) -> float:
    return options.person_height_m or calibration.person_height_m


def _write(
    looks: Iterable["Look"],
    provenance: dict[str, Any],
    calibration: Calibration,
    described: dict[str, Any],
    options: TrackOptions,
    run: TrackRun,
    progress: Progress,
) -> None:
    from scene4d.pipeline.tracking.counting import TrackCount
    from scene4d.pipeline.tracking.following import Follower
    from scene4d.pipeline.tracking.sketch import Sketch
    from scene4d.scene.smoothing import SmoothingSettings
    from scene4d.scene.store import SceneWriter

    settings = SmoothingSettings(max_gap_s=options.max_gap_s)
    follower = Follower(calibration, _height(calibration, options), settings, run)
    count, sketch = TrackCount(), Sketch()
    writer = SceneWriter(
        run.scene,
        camera=run.camera,
        run=run.run,
        start_utc=options.start,
        camera_json=described,
        provenance=provenance,
    )
    with progress.stage("Placing and following", None), writer:
        for look in looks:
            for tracks in follower.follow(look):
                _put(writer, tracks, count, sketch, run)
        _put(writer, follower.finish(), count, sketch, run)
        with timed(run.timings, "write"):
            writer.close()
    run.tracks = count.by_class()
    assert calibration.camera is not None
    with timed(run.timings, "draw"), progress.stage("Drawing", None):
        picture = run.scene / FIGURES / f"{run.run}.png"
        if sketch.draw(picture, calibration.camera, Path(options.camera)):
            run.picture = picture


def _put(writer: Any, tracks: Tracks, count: "TrackCount", sketch: "Sketch", run: TrackRun) -> None:
    if not len(tracks):
        return
    with timed(run.timings, "write"):
        writer.write(tracks)
    sketch.add(tracks)
    run.rows += len(tracks)
    run.begin_s = float(np.fmin(run.begin_s, tracks.time_s.min()))
    run.end_s = float(np.fmax(run.end_s, tracks.time_s.max()))
    count.add(tracks)
