"""A running camera whose view has moved is calibrated again, and is another camera from then on.

    SCENE/recalibrated/NAME-2/    camera.json, report.html, background.jpg ..., as of ``calibrate``

When it is turned to a view that it had before, also in an earlier process, its camera is taken
again.
"""

import logging
import threading
from collections.abc import Iterable, Iterator
from dataclasses import dataclass, replace
from itertools import count, takewhile
from pathlib import Path

import numpy as np

from scene4d.calibration.calibrating import run_footage
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.writing import write
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.store.runs import camera_path, file_name
from scene4d.tracking._options import Job
from scene4d.tracking._pulse import Pulse
from scene4d.tracking._running import calibrated
from scene4d.video.background import calibrated_view
from scene4d.video.frames import Frame, Source
from scene4d.video.live import LiveSource
from scene4d.video.motion import MotionMonitor

_LOG = logging.getLogger(__name__)
_FRAMES, _MOST_FRAMES = 100, 1600
"""Frames, one a second, for the first attempt: as many as ``calibrate`` takes of a stream. Each
further attempt takes twice as many, up to the second number."""
_EVERY_S = 1.0
_SAME = 3
"""An earlier view is back when so many frames after each other show it."""


@dataclass(frozen=True)
class Known:
    """A camera by its name in the scene, and its calibration, as ``watch`` takes it."""

    name: str
    camera: str | Path | Calibration | Camera


def calibrated_again(
    live: LiveSource, job: Job, first: Known, stop: threading.Event, pulse: Pulse
) -> Job | None:
    """The job with the camera of the view that is seen now; None when the stream or ``stop`` ends
    it. Where the camera is refused the reason is told, and more people are watched.
    """
    frames = _FRAMES
    live.is_counting = False  # nobody is tracked meanwhile
    pulse.say("calibrating")
    try:
        while True:
            earlier = [first, *_made(job.run.scene, first.name)]
            spell = _Spell(live, earlier, stop, pulse)
            _LOG.warning("%s: %d s of people are watched to calibrate again", live.name, frames)
            found = _attempt(spell, job, _free(job.run.scene, first.name), frames)
            if isinstance(found, Known):
                return _with(job, found)
            pulse.say("refused", found)
            frames = min(2 * frames, _MOST_FRAMES)
    except _BackError as back:
        _LOG.warning("%s: the view of camera %s is back", live.name, back.known.name)
        return _with(job, back.known)
    except (_EndedError, KeyboardInterrupt):
        return None
    finally:
        live.is_counting = True


class _BackError(Exception):
    """A view that the camera had before is back."""

    def __init__(self, known: Known) -> None:
        self.known = known


class _EndedError(Exception):
    """There will be no more frames."""


class _Spell(Source):
    """Frames of a running camera, one a second."""

    timeline = None
    warnings = ()

    def __init__(
        self, live: LiveSource, earlier: list[Known], stop: threading.Event, pulse: Pulse
    ) -> None:
        self.name, self.image_size, self.fps = live.name, live.image_size, 1 / _EVERY_S
        self._live, self._stop, self._pulse = live, stop, pulse
        monitors = [(known, _monitor_of(known, live.image_size)) for known in earlier]
        self._earlier = [(known, found) for known, found in monitors if found is not None]

    def frames(self, indices: Iterable[int] | None = None) -> Iterator[Frame]:
        """As many as there are ``indices``. Raises :class:`_BackError` and :class:`_EndedError`."""
        next_s = -np.inf
        for _ in indices or ():
            frame = self._next(next_s)
            next_s = frame.time_s + _EVERY_S
            for known, monitor in self._earlier:
                monitor.add(frame.image_bgr, frame.time_s)
                found = monitor.verdict()
                if found.frames_checked == _SAME and not found.frames_moved:
                    raise _BackError(known)
            yield frame

    def _next(self, from_s: float) -> Frame:
        while not self._live.ended and not self._stop.is_set():
            self._pulse.beat()
            frame = self._live.take(_EVERY_S)
            if frame is not None and frame.time_s >= from_s:
                return frame
        self._live.stop()
        raise _EndedError


def _monitor_of(known: Known, image_size: tuple[int, int]) -> MotionMonitor | None:
    """Compares the last frames with a camera's view; None where that was not kept."""
    image = calibrated_view(calibrated(known.camera)[2], image_size)
    if image is None:
        return None
    monitor = MotionMonitor(image_size, keep=_SAME)
    monitor.add(image, 0.0)
    return monitor


def _attempt(spell: _Spell, job: Job, to: tuple[str, Path], frames: int) -> Known | str:
    """A new camera, written; or the reason why not, which is told."""
    options = CalibrateOptions(
        person_height_m=job.person_height_m, frames=frames, device=job.options.device
    )
    try:
        result = run_footage(spell, options, job.progress)
        reason = result.calibration.reason
    except InputError as error:  # the view moves, or hangs upside down
        result, reason = None, str(error)
    if result is None or not result.calibration:
        _LOG.warning("%s: its new view cannot be calibrated: %s", spell.name, reason)
        return str(reason)
    name, file = to
    write(result, file.parent, progress=job.progress)
    _LOG.warning("%s: calibrated again; from here on it is camera %s", spell.name, name)
    return Known(name, file)


def _made(scene: Path, name: str) -> Iterator[Known]:
    """The cameras that were made of this one's later views."""
    made = takewhile(lambda one: one[1].exists(), _numbered(scene, name))
    return (Known(*one) for one in made)


def _free(scene: Path, name: str) -> tuple[str, Path]:
    """The next name that no camera has, and its file."""
    return next(
        (called, file)
        for called, file in _numbered(scene, name)
        if not file.exists() and not camera_path(scene, called).exists()
    )


def _numbered(scene: Path, name: str) -> Iterator[tuple[str, Path]]:
    for number in count(2):
        called = f"{name}-{number}"
        yield called, scene / "recalibrated" / file_name(called, "camera") / "camera.json"


def _with(job: Job, known: Known) -> Job:
    calibration, described, background = calibrated(known.camera)
    job.run.camera = known.name
    return replace(job, calibration=calibration, described=described, background=background)
