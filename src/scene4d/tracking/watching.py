"""Runs the detectors over footage, once, in chunks.

Detections in recorded footage go into a log, so a killed run can resume. A stream cannot be
replayed, so it has no log; its results are added to the scene second by second.
"""

import hashlib
import json
from collections.abc import Callable, Iterator
from itertools import groupby
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np
from jaxtyping import Int

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.progress import Advance, timed
from scene4d.store.log import DetectionLog, Look
from scene4d.store.runs import camera_identity, file_name
from scene4d.tracking._options import Job
from scene4d.tracking._view import View
from scene4d.video.frames import Frame, Source
from scene4d.video.stream import without_password

if TYPE_CHECKING:
    from scene4d.perception.objects import Moment, ObjectDetector

_CHUNK_S = 30.0
"""Length of a chunk: the most that is lost when a run over a recording is killed. Each begins with
looks at everything."""
_LOGS = "detections"
"""Folder in a scene for the detections; it may be removed once a run is complete."""
_EARLY_S = 1e-6
"""A frame this much before a slot still belongs to it, because times carry rounding errors."""


def watched(footage: Source, job: Job) -> Iterator[Look]:
    """Detections in recorded footage: first those an earlier run logged, then new ones.

    Raises :class:`InputError` if the camera moved, within the footage or since it was calibrated,
    or if the footage has no clock.
    """
    run = job.run
    folder = run.scene / _LOGS / file_name(run.run, "run")
    log = DetectionLog(folder, watch_settings(footage, job))
    done = run.resumed = log.complete
    yield from log.chunks()
    if log.finished:
        return
    chunks = _chunks(footage, job.options.rate_hz)
    objects, view = detectors(job), View(footage, job, live=False)
    if done:
        view.resume(footage, np.concatenate(chunks[:done]))
    ends = np.array([chunk[-1] for chunk in chunks])
    ahead = np.concatenate(chunks[done:]).tolist() if chunks[done:] else []
    with job.progress.stage("Watching people and vehicles", len(ahead)) as step:
        frames = _timed_frames(footage.frames(ahead) if ahead else iter(()), job, step)

        def chunk_of(frame: Frame) -> int:
            return int(np.searchsorted(ends, frame.index)) - done

        for look in _recorded(frames, chunk_of, objects, view):
            log.append(look)
            yield look
    log.finish()
    run.timings |= objects.timings
    run.warnings.extend(footage.warnings)


def watched_live(
    frames: Iterator[Frame | None], job: Job, objects: "ObjectDetector", view: View
) -> Iterator[Look]:
    """Detections in the frames of a stream until they end or Ctrl-C is pressed (the command line
    treats SIGTERM the same). None among the frames says that for a second none came.
    """
    yield from _live(frames, objects, view)
    job.run.timings |= objects.timings


def streamed(stream: Source, job: Job) -> Iterator[Look]:
    """Detections in every frame of a stream, however late."""
    objects, view = detectors(job), View(stream, job, live=True)
    with job.progress.stage("Watching people and vehicles", None) as step:
        frames = _timed_frames(_thinned(stream.frames(), job.options.rate_hz), job, step)
        yield from watched_live(frames, job, objects, view)
    job.run.warnings.extend(stream.warnings)


def watch_settings(footage: Source, job: Job) -> dict[str, Any]:
    """Everything that the detections depend on."""
    from importlib.metadata import version

    from scene4d.perception.weights import WEIGHTS, engine_name

    path, options = Path(footage.name), job.options
    there = path.stat() if path.is_file() else None
    described = json.dumps(camera_identity(job.described), sort_keys=True).encode()
    return {
        "source": str(path.resolve()) if there is not None else without_password(footage.name),
        "bytes": None if there is None else there.st_size,
        "modified_ns": None if there is None else there.st_mtime_ns,
        "image_size": list(footage.image_size),
        "rate_hz": options.rate_hz,
        "detector": _identity(options.detector),
        "looks_at": "what changed; what moves is followed, keypoints with its box; who crosses",
        "colours": "of upper and lower bodies and of vehicles",
        "chunk_s": _CHUNK_S,
        "camera": hashlib.sha256(described).hexdigest()[:12],
        "person_height_m": options.person_height_m,
        "engine": engine_name(options.device),
        "weights": {weight.name: weight.sha256 for weight in WEIGHTS},
        "software": f"scene4d {version('scene4d')}",
    }


def detectors(job: Job) -> "ObjectDetector":
    """The detectors for people and vehicles, told how large people are where.

    Raises :class:`InputError` for an unknown name.
    """
    from scene4d.calibration.watching import fetch_weights, person_px
    from scene4d.perception.objects import ObjectDetector

    chosen, device = job.options.detector, job.options.device
    fetch_weights(job.progress, vehicles=chosen is None)
    if chosen is None:
        found = ObjectDetector.default(device=device)
    else:
        from scene4d.perception.detectors import make_detector
        from scene4d.perception.detectors.yolox import OnnxYoloxDetector
        from scene4d.perception.keypoints import KeypointEstimator

        keypoints = KeypointEstimator(device)
        if _is_onnx(chosen):
            found = ObjectDetector(OnnxYoloxDetector(Path(chosen), device=device), keypoints)
        else:
            found = ObjectDetector(make_detector(str(chosen), device), keypoints)
    found = found.expecting(lambda rows: person_px(job.camera, rows, job.person_height_m))
    return found.attentive()


def _is_onnx(chosen: str | Path) -> bool:
    return str(chosen).lower().endswith(".onnx")


def _identity(chosen: str | Path | None) -> str | None:
    """A detector's name, and for a file the hash of its content."""
    if chosen is None or not _is_onnx(chosen):
        return None if chosen is None else str(chosen)
    try:
        content = Path(chosen).read_bytes()
    except OSError as error:
        raise InputError(f"{chosen}: cannot be read: {error.strerror}") from error
    return f"{Path(chosen).name} {hashlib.sha256(content).hexdigest()}"


def _chunks(source: Source, rate_hz: float) -> list[Int[np.ndarray, "m"]]:
    """Indices of the sampled frames (the first in each 1/rate of a second), by chunk, without
    empty chunks. Raises :class:`InputError` if the source has no clock.
    """
    timeline = source.timeline
    assert timeline is not None
    if not timeline.has_clock:
        raise InputError(
            f"{source.name}: images have no times, and tracking needs them: make a video of them, "
            "or give annotations with their fps"
        )
    slot = np.floor(timeline.time_s * rate_hz + _EARLY_S)
    indices = np.flatnonzero(np.diff(slot, prepend=-1) > 0)
    number = np.floor(timeline.time_s[indices] / _CHUNK_S)
    _, starts = np.unique(number, return_index=True)
    return np.split(indices, starts[1:])


def _thinned(frames: Iterator[Frame], rate_hz: float) -> Iterator[Frame]:
    """The first frame in each 1/rate of a second."""
    slot = -1
    for frame in frames:
        now = int(np.floor(frame.time_s * rate_hz + _EARLY_S))
        if now > slot:
            slot = now
            yield frame


def _timed_frames(frames: Iterator[Frame], job: Job, step: Advance) -> Iterator[Frame]:
    """The frames; records the decoding time and reports progress."""
    while True:
        with timed(job.run.timings, "decode"):
            frame = next(frames, None)
        if frame is None:
            return
        yield frame
        step(1)


def _recorded(
    frames: Iterator[Frame],
    chunk_of: Callable[[Frame], int],
    objects: "ObjectDetector",
    view: View,
) -> Iterator[Look]:
    """Detections, chunk by chunk, with an empty look for a chunk that has lost its frames; a chunk
    depends on nothing before it.
    """
    chunk = 0
    for now, part in groupby(frames, chunk_of):
        for _ in range(now - chunk):
            yield _look_of([], view.image_size)
        seen = list(objects.looks(frame for frame in part if view.is_right(frame)))
        objects.begin()
        view.check()
        yield _look_of(seen, view.image_size)
        chunk = now + 1


def _live(frames: Iterator[Frame | None], objects: "ObjectDetector", view: View) -> Iterator[Look]:
    """Detections, second by second; None among the frames says that for a second none came. Ctrl-C
    ends them normally.
    """
    seen: list[Moment] = []
    second = 0
    try:
        for frame in frames:
            now = second if frame is None else max(second, int(frame.time_s))
            if frame is None or now > second:
                view.check()
                yield _look_of(seen, view.image_size)
                seen = []
            if frame is None:
                objects.begin()  # what was seen before a gap is old
                continue
            second = now
            if view.is_right(frame):
                seen.append((frame.index, frame.time_s, *objects.look(frame)))
    except KeyboardInterrupt:
        pass
    view.check()
    if seen:
        yield _look_of(seen, view.image_size)


def _look_of(seen: list["Moment"], image_size: tuple[int, int]) -> Look:
    """The detections in some frames, or in none."""
    index = np.array([number for number, *_ in seen], np.int64)
    time_s = np.array([time for _, time, *_ in seen], float)
    if not seen:
        return Look(index, time_s, Detections.from_boxes(image_size, index, np.empty((0, 4))))
    detections = Detections.concatenate([found for *_, found, _, _ in seen])
    appearance, colours = (np.concatenate([one[k] for one in seen]) for k in (3, 4))
    return Look(index, time_s, detections, appearance, colours)
