"""Whether footage still shows the calibrated view."""

import logging

import numpy as np
from jaxtyping import Int

from scene4d.core.errors import InputError
from scene4d.core.progress import timed
from scene4d.tracking._options import Job
from scene4d.video.background import calibrated_view
from scene4d.video.frames import Frame, Source
from scene4d.video.motion import MotionMonitor

_LOG = logging.getLogger(__name__)
_EVERY_S = 1.0
"""A frame in each such time is compared."""
_COMPARED = 5
"""Of a running camera so many comparisons count, the last ones: a view that moved is noticed after
a few seconds however long it stood still before."""
_MOVED, _BACK = 3, 1
"""Of these, so many other views say that it has moved, and so few that it is back. One alone may be
a truck or a hand. Chosen by hand."""


class View:
    """Compares a frame a second with the calibrated view, or with the first frame if that is not
    known. Of recorded footage another view is an error; while a running camera shows one, its
    frames are not right. ``away_s`` is how long that was, and ``is_settled`` whether the other view
    has itself stood still for some comparisons.
    """

    def __init__(self, source: Source, job: Job, *, live: bool) -> None:
        self.image_size, self._name = source.image_size, source.name
        self._live, self._timings = live, job.run.timings
        self._monitor = self._new_monitor()
        known = calibrated_view(job.background, source.image_size)
        self._is_known = known is not None
        if known is not None:
            self._monitor.add(known, 0.0)
        else:
            name = "background image" if job.background is None else job.background.name
            job.run.warnings.append(
                f"There is no {name} beside the camera file, so it was not checked whether the "
                "camera has moved since it was calibrated."
            )
        self._slot = -1
        self._last_s, self._moved_s, self._ended_s = 0.0, np.nan, 0.0
        self._other: MotionMonitor | None = None  # of the view that is another

    @property
    def is_away(self) -> bool:
        """Whether a running camera shows another view now."""
        return bool(np.isfinite(self._moved_s))

    @property
    def away_s(self) -> float:
        """Seconds for which the view was another."""
        return self._ended_s + (self._last_s - self._moved_s if self.is_away else 0.0)

    @property
    def is_settled(self) -> bool:
        """Whether the view is another, and that one stands still."""
        if self._other is None:
            return False
        found = self._other.verdict()
        return found.frames_checked >= _COMPARED and not found.frames_moved

    def is_right(self, frame: Frame) -> bool:
        """Whether people in this frame can be placed on the ground."""
        slot = int(frame.time_s / _EVERY_S)
        if slot > self._slot:
            self._slot = slot
            self._compare(frame)
        return not self.is_away

    def resume(self, source: Source, indices: Int[np.ndarray, "n"]) -> None:
        """Compare the frames of an earlier run again, so that the verdict is the same."""
        assert source.timeline is not None
        slots = (source.timeline.time_s[indices] / _EVERY_S).astype(int)
        _, first = np.unique(slots, return_index=True)
        for frame in source.frames(indices[first].tolist()):
            self.is_right(frame)

    def check(self) -> None:
        """Judge the comparisons so far: raises :class:`InputError` for recorded footage whose view
        is another; of a running camera a change is told.
        """
        found = self._monitor.verdict()
        far = found.max_shift_px
        how = f"by {far:.0f} px" if np.isfinite(far) else "away"
        if self._live:
            self._tell(found.frames_moved, found.frames_checked, how)
        elif found.moved and self._is_known and found.frames_moved == found.frames_checked:
            raise InputError(
                f"{self._name}: the view has moved {how} since the camera was calibrated: "
                "calibrate it again on this footage"
            )
        elif found.moved:
            against = "the calibrated view" if self._is_known else "the first"
            raise InputError(f"{self._name}: {found.reason}".replace("the first", against))

    def _new_monitor(self) -> MotionMonitor:
        return MotionMonitor(self.image_size, keep=_COMPARED if self._live else None)

    def _compare(self, frame: Frame) -> None:
        with timed(self._timings, "does it move"):
            self._last_s = frame.time_s
            self._monitor.add(frame.image_bgr, frame.time_s)
            if self._live:
                self.check()
            if self.is_away and (self._other is None or self._other.verdict().frames_moved):
                self._other = self._new_monitor()
            if self._other is not None:
                self._other.add(frame.image_bgr, frame.time_s)

    def _tell(self, moved: int, compared: int, how: str) -> None:
        if not self.is_away and (moved >= _MOVED or 0 < moved == compared):
            self._moved_s = self._last_s
            since = "the camera was calibrated" if self._is_known else "watching began"
            _LOG.warning(
                "%s: the view has moved %s since %s; nobody is tracked until it is back, or the "
                "camera is calibrated again",
                self._name,
                how,
                since,
            )
        elif self.is_away and moved <= _BACK:
            _LOG.warning("%s: the view is back", self._name)
            self._ended_s += self._last_s - self._moved_s
            self._moved_s, self._other = np.nan, None
