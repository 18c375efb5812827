"""Smoothing a stream: rows older than a lag become final and are dropped from memory.

A final row may differ from :func:`.smooth` over the whole recording:

- its position uses no detections more than ``lag_s`` later. For moving objects the difference is
  below 2 mm at 10 Hz; the average of a standing vehicle would still improve;
- its class is the most frequent one so far;
- detections dropped from memory keep the weight they had.

Gaps are bridged at the same frames, since ``lag_s`` is at least ``max_gap_s`` and ``max_hidden_s``.
"""

from dataclasses import replace

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.tracks import CLASSES
from scene4d.tracking._motion_model import class_numbers
from scene4d.tracking._sightings import BRIDGED, Memory, Sightings
from scene4d.tracking._smoothing import (
    Estimates,
    Smoothed,
    SmoothingSettings,
    estimate,
    finished,
    remembered,
)


class FixedLagSmoother:
    """Takes the detections frame by frame, and returns rows that have become final.

    Holds the rows of about ``2 lag_s`` and one state per track seen within ``forget_s``: memory
    does not grow with the length of the video. A track that returns later is smoothed as a new
    one.
    """

    def __init__(
        self, settings: SmoothingSettings | None = None, *, forget_s: float = 900.0
    ) -> None:
        self.settings = SmoothingSettings() if settings is None else settings
        self._forget_s = forget_s
        self._sightings: list[Sightings] = []
        self._source: list[np.ndarray] = []
        self._time_s: list[float] = []
        self._frame: list[int] = []
        self._memory = Memory.none()
        self._counts: dict[int, np.ndarray] = {}
        self._rows = 0
        self._done_s = -np.inf

    @property
    def pending(self) -> int:
        """Number of rows held, final or not."""
        return sum(map(len, self._sightings))

    @property
    def remembered(self) -> int:
        """Number of tracks with a stored state."""
        return len(self._memory.track)

    def update(self, time_s: float, frame: int, sightings: Sightings) -> Smoothed | None:
        """Add an analysed frame with its detections (perhaps none), in order of time.

        Returns rows that have become final, about every ``lag_s``, else None; their ``source``
        counts all detections given so far. Raises :class:`InputError` if time or frame does not
        increase or a detection belongs to another frame.
        """
        if not np.isfinite(time_s):
            raise InputError(f"smoothing: found time {time_s} s of frame {frame}")
        if self._time_s and not (time_s > self._time_s[-1] and frame > self._frame[-1]):
            raise InputError(
                f"smoothing: found frame {frame} at {time_s} s after frame {self._frame[-1]} at "
                f"{self._time_s[-1]} s; give the frames in order"
            )
        if (sightings.frame != frame).any() or (sightings.time_s != time_s).any():
            raise InputError(f"smoothing: sightings of another frame or time given with {frame}")
        begun = self._time_s[0] if self._time_s else time_s
        self._time_s.append(time_s)
        self._frame.append(frame)
        if len(sightings):
            self._sightings.append(sightings)
            self._source.append(self._rows + np.arange(len(sightings)))
            self._rows += len(sightings)
            self._count(sightings)
        lag = self.settings.lag_s
        if time_s - max(begun, self._done_s) < 2 * lag:
            return None
        return self._release(time_s - lag)

    def provisional(self) -> Smoothed:
        """The rows that are not yet final, as detections so far tell them."""
        return self._smoothed(self._estimated(), np.inf)

    def finish(self) -> Smoothed:
        """The remaining rows; clears the memory."""
        found = self._release(np.inf)
        self._sightings, self._source, self._time_s, self._frame = [], [], [], []
        self._memory, self._counts, self._done_s = Memory.none(), {}, -np.inf
        return found

    def _count(self, sightings: Sightings) -> None:
        kinds = class_numbers(sightings.class_name)
        for track, kind in zip(sightings.track.tolist(), kinds, strict=True):
            self._counts.setdefault(track, np.zeros(len(CLASSES), np.int64))[kind] += 1

    def _release(self, until_s: float) -> Smoothed:
        found = self._estimated()
        out = self._smoothed(found, until_s)
        if np.isfinite(until_s):
            # Whether a row stands depends on half a window on both sides of it.
            self._forget(found, until_s - self.settings.standing_window_s / 2)
            self._done_s = until_s
        return out

    def _estimated(self) -> Estimates:
        held = _none() if not self._sightings else Sightings.joined(self._sightings)
        frame = np.array(self._frame, np.int64)
        return estimate(held, frame, np.array(self._time_s), self._memory, self.settings)

    def _smoothed(self, found: Estimates, until_s: float) -> Smoothed:
        """Rows after those that are final, up to ``until_s``."""
        time = found.rows.time_s
        wanted = (time > self._done_s) & (time <= until_s)
        track = np.array(sorted(self._counts), np.int64)
        counts = np.array([self._counts[t] for t in track.tolist()], np.int64)
        counts = counts.reshape(-1, len(CLASSES))
        out = finished(found, wanted, track, counts)
        # A mark of a bridged row (-1) takes the last entry, which is the mark itself.
        source = np.concatenate([*self._source, [BRIDGED]])[out.source]
        return replace(out, source=source)

    def _forget(self, found: Estimates, until_s: float) -> None:
        """Keep rows after ``until_s``, and one state per track for those before."""
        memory = remembered(found, self._memory, until_s)
        self._memory = memory.select(memory.time_s > self._time_s[-1] - self._forget_s)
        frames = [k for k, part in enumerate(self._sightings) if part.time_s[0] > until_s]
        self._sightings = [self._sightings[k] for k in frames]
        self._source = [self._source[k] for k in frames]
        late = [k for k, t in enumerate(self._time_s) if t > until_s]
        self._time_s = [self._time_s[k] for k in late]
        self._frame = [self._frame[k] for k in late]
        alive = {t for p in self._sightings for t in p.track.tolist()}
        alive.update(self._memory.track.tolist())
        self._counts = {t: c for t, c in self._counts.items() if t in alive}


def _none() -> Sightings:
    number, value = np.empty(0, np.int64), np.empty(0)
    names = np.empty(0, dtype="<U10")
    return Sightings(number, names, value, number, np.empty((0, 2)), np.empty((0, 2, 2)))
