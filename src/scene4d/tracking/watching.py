"""Runs the detectors over footage, once, in chunks.

Detections in recorded footage go into a log, so a killed run can resume. A stream cannot be
replayed, so it has no log; its results are added to the scene chunk by chunk.
"""

import hashlib
import json
from collections.abc import Callable, Iterator
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
from scene4d.video.frames import Frame, Source
from scene4d.video.stream import without_password

if TYPE_CHECKING:
    from scene4d.perception.objects import ObjectDetector

_CHUNK_S = 10.0
"""Length of a chunk: the most that is lost when a run over a recording is killed."""
LIVE_CHUNK_S = 1.0
"""The same of a stream: as often are its rows published."""
_LOGS = "detections"
"""Folder in a scene for the detections; it may be removed once a run is complete."""
_CHECK_EVERY = 10
"""Every tenth frame is compared with the calibrated view."""
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
    objects, monitor = detectors(job), _ViewMonitor(footage, job)
    if done:
        monitor.resume(footage, np.concatenate(chunks[:done]))
    ends = np.array([chunk[-1] for chunk in chunks])
    ahead = np.concatenate(chunks[done:]).tolist() if chunks[done:] else []
    with job.progress.stage("Watching people and vehicles", len(ahead)) as step:
        frames = _timed_frames(footage.frames(ahead) if ahead else iter(()), job, step)

        def chunk_of(frame: Frame) -> int:
            return int(np.searchsorted(ends, frame.index)) - done

        for look in _looks(frames, chunk_of, objects, monitor):
            log.append(look)
            yield look
    log.finish()
    run.timings |= objects.timings
    run.warnings.extend(footage.warnings)


def watched_live(stream: Source, job: Job) -> Iterator[Look]:
    """Detections in a stream until it ends or Ctrl-C is pressed (the command line treats SIGTERM
    the same). Raises :class:`InputError` if the camera moved.
    """
    objects, monitor = detectors(job), _ViewMonitor(stream, job)
    with job.progress.stage("Watching people and vehicles", None) as step:
        frames = _timed_frames(_thinned(stream.frames(), job.options.rate_hz), job, step)
        yield from _looks(
            frames, lambda frame: int(frame.time_s / LIVE_CHUNK_S), objects, monitor, endless=True
        )
    job.run.timings |= objects.timings
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
        "looks_at": "what changed",
        "chunk_s": _CHUNK_S,
        "camera": hashlib.sha256(described).hexdigest()[:12],
        "person_height_m": options.person_height_m,
        "engine": engine_name(),
        "weights": {weight.name: weight.sha256 for weight in WEIGHTS},
        "software": f"scene4d {version('scene4d')}",
    }


def calibrated_view(path: Path | None, image_size: tuple[int, int]) -> np.ndarray | None:
    """The view as calibrated; None if it was not kept or its size differs."""
    if path is None or not path.is_file():
        return None
    import cv2

    image = cv2.imread(str(path))
    if image is None or image.shape[1::-1] != image_size:
        return None
    return np.asarray(image)


def detectors(job: Job) -> "ObjectDetector":
    """The detectors for people and vehicles, told how large people are where.

    Raises :class:`InputError` for an unknown name.
    """
    from scene4d.calibration.watching import fetch_weights, person_px
    from scene4d.perception.objects import ObjectDetector

    chosen = job.options.detector
    fetch_weights(job.progress, vehicles=chosen is None)
    if chosen is None:
        found = ObjectDetector.default()
    else:
        from scene4d.perception.detectors import make_detector
        from scene4d.perception.detectors.yolox import OnnxYoloxDetector
        from scene4d.perception.keypoints import KeypointEstimator

        onnx = _is_onnx(chosen)
        one = OnnxYoloxDetector(Path(chosen)) if onnx else make_detector(str(chosen))
        found = ObjectDetector(one, KeypointEstimator())
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


def _looks(
    frames: Iterator[Frame],
    chunk_of: Callable[[Frame], int],
    objects: "ObjectDetector",
    monitor: "_ViewMonitor",
    *,
    endless: bool = False,
) -> Iterator[Look]:
    """Detections, chunk by chunk, with an empty look for a chunk without frames.

    For ``endless`` frames Ctrl-C ends the loop normally; otherwise it ends the run.
    """
    seen: list[Moment] = []
    chunk = 0
    try:
        for frame in frames:
            while chunk_of(frame) > chunk:
                monitor.check()
                yield look_of(seen, monitor.image_size)
                seen, chunk = [], chunk + 1
                objects.begin()
            monitor.add(frame)
            seen.append((frame, *objects.look(frame)))
    except KeyboardInterrupt:
        if not endless:
            raise
    monitor.check()
    if seen:
        yield look_of(seen, monitor.image_size)


Moment = tuple[Frame, Detections, np.ndarray]
"""A frame, its detections, and their appearance."""


def look_of(seen: list[Moment], image_size: tuple[int, int]) -> Look:
    """The detections in some frames, or in none."""
    index = np.array([frame.index for frame, _, _ in seen], np.int64)
    time_s = np.array([frame.time_s for frame, _, _ in seen], float)
    if not seen:
        return Look(index, time_s, Detections.from_boxes(image_size, index, np.empty((0, 4))))
    detections = Detections.concatenate([found for _, found, _ in seen])
    return Look(index, time_s, detections, np.concatenate([colours for _, _, colours in seen]))


class _ViewMonitor:
    """Checks that the view is still the calibrated one."""

    def __init__(self, source: Source, job: Job) -> None:
        from scene4d.video.motion import MotionMonitor

        self.image_size = source.image_size
        self._name = source.name
        self._timings = job.run.timings
        self._seen = 0
        self._within = MotionMonitor(source.image_size)
        self._since = MotionMonitor(source.image_size)
        calibrated = calibrated_view(job.background, source.image_size)
        self._is_known = calibrated is not None
        if calibrated is not None:
            self._since.add(calibrated, 0.0)
            return
        name = "background" if job.background is None else job.background.name
        job.run.warnings.append(
            f"There is no {name} beside the camera file, so it was not checked whether the camera "
            "has moved since it was calibrated."
        )

    def add(self, frame: Frame) -> None:
        """Compare every tenth frame with the calibrated view."""
        with timed(self._timings, "does it move"):
            if self._seen % _CHECK_EVERY == 0:
                self._compare(frame)
        self._seen += 1

    def resume(self, source: Source, indices: Int[np.ndarray, "n"]) -> None:
        """Compare the frames of an earlier run again, so that the verdict is the same."""
        for frame in source.frames(indices[::_CHECK_EVERY].tolist()):
            self._compare(frame)
        self._seen = len(indices)

    def _compare(self, frame: Frame) -> None:
        self._within.add(frame.image_bgr, frame.time_s)
        if self._is_known:
            self._since.add(frame.image_bgr, frame.time_s)

    def check(self) -> None:
        """Raise :class:`InputError` if the view has changed."""
        within, since = self._within.verdict(), self._since.verdict()
        if within.moved:
            raise InputError(f"{self._name}: {within.reason}")
        if self._is_known and since.moved:
            how = f"by {since.max_shift_px:.0f} px" if np.isfinite(since.max_shift_px) else "away"
            raise InputError(
                f"{self._name}: the view has moved {how} since the camera was calibrated: "
                "calibrate it again on this footage"
            )
