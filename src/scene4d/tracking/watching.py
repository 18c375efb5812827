"""Looking at footage, once: what the detectors see goes into a log that survives a kill."""

from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from scene4d.calibration.writing import BACKGROUND
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.progress import Progress, timed
from scene4d.tracking.options import TrackOptions, TrackRun
from scene4d.tracking.sampling import chosen_frames, chunks_of, numbered_frames

if TYPE_CHECKING:
    from scene4d.perception.objects import ObjectDetector
    from scene4d.store.log import DetectionLog, Logged
    from scene4d.video.frames import Frame, Source

_CHECK_EVERY = 10
"""One in so many frames is compared with the calibrated scene."""
_Numbered = tuple[int, "Frame"]
_Moment = tuple[int, float, Detections, np.ndarray]
"""Number and time of a frame, what was detected in it, and what that looks like."""


def watch_into(
    log: "DetectionLog",
    source: "Source",
    objects: "ObjectDetector",
    options: TrackOptions,
    run: TrackRun,
    progress: Progress,
) -> None:
    """Detect in every frame that is looked at, from the first chunk that the log lacks.

    Raises :class:`InputError` where the camera moved, within the footage or since it was
    calibrated.
    """
    monitor = ViewMonitor(source, Path(options.camera).with_name(BACKGROUND), run)
    done = run.resumed = log.complete
    total = None
    if source.timeline is not None:
        chunks = chunks_of(source, chosen_frames(source, options.rate_hz))
        total = sum(map(len, chunks[done:]))
        if done:
            monitor.resume(source, np.concatenate(chunks[:done]))
    seen: list[_Moment] = []
    chunk = done
    with progress.stage("Watching people and vehicles", total) as step, until_interrupted(source):
        frames = _timed_frames(numbered_frames(source, options.rate_hz, done), run)
        for number, frame in frames:
            while number > chunk:
                monitor.check(source.name)
                log.append(_logged(seen, source.image_size))
                seen, chunk = [], chunk + 1
            with timed(run.timings, "does it move"):
                monitor.add(frame.image_bgr, frame.time_s)
            detections, appearance = objects.look(frame)
            seen.append((frame.index, frame.time_s, detections, appearance))
            step(1)
    monitor.check(source.name)
    if seen:
        log.append(_logged(seen, source.image_size))
    log.finish()


@contextmanager
def until_interrupted(source: "Source") -> Iterator[None]:
    """Ctrl-C ends the watching of a stream, which has no other end; elsewhere it ends the run."""
    try:
        yield
    except KeyboardInterrupt:
        if source.timeline is not None:
            raise


def _timed_frames(frames: Iterator[_Numbered], run: TrackRun) -> Iterator[_Numbered]:
    """The frames, with the time that it took to have them."""
    while True:
        with timed(run.timings, "decode"):
            frame = next(frames, None)
        if frame is None:
            return
        yield frame


def _logged(seen: list[_Moment], image_size: tuple[int, int]) -> "Logged":
    """A chunk of what was seen; nobody where a stream gave no frame for so long."""
    from scene4d.store.log import Logged

    index = np.array([moment[0] for moment in seen], np.int64)
    time_s = np.array([moment[1] for moment in seen], float)
    if not seen:
        return Logged(index, time_s, Detections.from_boxes(image_size, index, np.empty((0, 4))))
    detections = Detections.concatenate([moment[2] for moment in seen])
    return Logged(index, time_s, detections, np.concatenate([moment[3] for moment in seen]))


class ViewMonitor:
    """Whether the view stays that which was calibrated."""

    def __init__(self, source: "Source", background: Path, run: TrackRun) -> None:
        from scene4d.video.motion import MotionMonitor

        self._seen = 0
        self._within = MotionMonitor(source.image_size)
        self._since = MotionMonitor(source.image_size)
        self._run = run
        self._calibrated = calibrated_view(background, source.image_size)
        if self._calibrated is None:
            run.warnings.append(
                f"There is no {background.name} beside the camera file, so whether the camera has "
                "moved since it was calibrated was not checked."
            )
        else:
            self._since.add(self._calibrated, 0.0)

    def add(self, image_bgr: np.ndarray, time_s: float) -> None:
        """Compare some of the frames."""
        if self._seen % _CHECK_EVERY == 0:
            self._compare(image_bgr, time_s)
        self._seen += 1

    def resume(self, source: "Source", indices: Int[np.ndarray, "n"]) -> None:
        """Compare again what an earlier run compared, so that it is judged alike."""
        for frame in source.frames(indices[::_CHECK_EVERY].tolist()):
            self._compare(frame.image_bgr, frame.time_s)
        self._seen = len(indices)

    def _compare(self, image_bgr: np.ndarray, time_s: float) -> None:
        self._within.add(image_bgr, time_s)
        if self._calibrated is not None:
            self._since.add(image_bgr, time_s)

    def check(self, name: str) -> None:
        """Raise :class:`InputError` where the view is another one."""
        within, since = self._within.verdict(), self._since.verdict()
        if within.moved:
            raise InputError(f"{name}: {within.reason}")
        if self._calibrated is not None and since.moved:
            how = f"by {since.max_shift_px:.0f} px" if np.isfinite(since.max_shift_px) else "away"
            raise InputError(
                f"{name}: the view has moved {how} since the camera was calibrated: calibrate it "
                "again on this footage"
            )


def calibrated_view(path: Path, image_size: tuple[int, int]) -> np.ndarray | None:
    """The scene as it was calibrated, or None where nobody kept it or its size is another."""
    if not path.is_file():
        return None
    import cv2

    image = cv2.imread(str(path))
    if image is None or image.shape[1::-1] != image_size:
        return None
    return np.asarray(image)
