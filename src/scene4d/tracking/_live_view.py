"""Whether a running camera still shows the calibrated view."""

import logging

import numpy as np

from scene4d.core.progress import timed
from scene4d.tracking._options import Job
from scene4d.tracking.watching import calibrated_view
from scene4d.video.frames import Frame, Source
from scene4d.video.motion import MotionMonitor

_LOG = logging.getLogger(__name__)
_EVERY_S = 1.0
_COMPARED = 5
"""Number of comparisons that count, the last ones: a view that moved is noticed after a few seconds
however long it stood still before."""
_MOVED, _BACK = 3, 1
"""Of these, so many other views say that it has moved, and so few that it is back. One alone may be
a truck or a hand. Chosen by hand."""


class LiveView:
    """Compares a frame a second with the calibrated view, or with the first frame if that is not
    known. ``away_s`` is how long it was another.
    """

    def __init__(self, source: Source, job: Job) -> None:
        self._name, self._timings = source.name, job.run.timings
        self._monitor = MotionMonitor(source.image_size, keep=_COMPARED)
        known = calibrated_view(job.background, source.image_size)
        self._since = "watching began" if known is None else "the camera was calibrated"
        if known is not None:
            self._monitor.add(known, 0.0)
        else:
            job.run.warnings.append(
                "There is no background image beside the camera file, so it was not checked "
                "whether the camera has moved between its calibration and the first frame."
            )
        self._last_s = -np.inf
        self._moved_s: float | None = None
        self._ended_s = 0.0

    @property
    def away_s(self) -> float:
        """Seconds for which the view was another."""
        going_on = 0.0 if self._moved_s is None else self._last_s - self._moved_s
        return self._ended_s + going_on

    def is_right(self, frame: Frame) -> bool:
        """Whether people in this frame can be placed on the ground; a change is told."""
        if frame.time_s >= self._last_s + _EVERY_S:
            self._last_s = frame.time_s
            with timed(self._timings, "does it move"):
                self._monitor.add(frame.image_bgr, frame.time_s)
            self._judge(frame.time_s)
        return self._moved_s is None

    def _judge(self, time_s: float) -> None:
        found = self._monitor.verdict()
        if self._moved_s is None and found.frames_moved >= _MOVED:
            self._moved_s = time_s
            shift = found.max_shift_px
            how = f"by {shift:.0f} px" if np.isfinite(shift) else "away"
            _LOG.warning(
                "%s: the view has moved %s since %s; nobody is tracked until it is back, or the "
                "camera is calibrated again",
                self._name,
                how,
                self._since,
            )
        elif self._moved_s is not None and found.frames_moved <= _BACK:
            _LOG.warning("%s: the view is back", self._name)
            self._ended_s += time_s - self._moved_s
            self._moved_s = None
