"""Smoothing a stream: rows become final once they are older than a lag, and are forgotten.

What a final row may differ in from :func:`.smooth` over the whole recording:

- its position knows no sightings more than ``lag_s`` later. For moving objects these say nothing
  (the difference is below 2 mm at 10 Hz); the average of a standing vehicle goes on improving;
- its class is the most frequent so far;
- sightings that have been forgotten keep the weight that they had.

Gaps are bridged at the same frames: ``lag_s`` is longer than ``max_gap_s``.
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
    """Takes the sightings of one frame after another, and gives back what has become final.

    Holds the rows of about ``2 lag_s`` and one state per track seen within ``forget_s``: memory
    does not grow with the length of the video. A track that comes back later than that is
    smoothed anew.
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
        """Rows that are held, final or not."""
        return sum(map(len, self._sightings))

    @property
    def remembered(self) -> int:
        """Tracks of which a state is held."""
        return len(self._memory.track)

    def update(self, time_s: float, frame: int, sightings: Sightings) -> Smoothed | None:
        """Add a frame that was looked at, with its sightings (perhaps none), in order of time.

        Returns rows that have become final, about every ``lag_s``, else None; their ``source``
        counts sightings from the first one ever given. Raises :class:`InputError` where time or
        frame does not rise or a sighting is of another frame.
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

    def finish(self) -> Smoothed:
        """All that is left; nothing is remembered afterwards."""
        found = self._release(np.inf)
        self._sightings, self._source, self._time_s, self._frame = [], [], [], []
        self._memory, self._counts, self._done_s = Memory.none(), {}, -np.inf
        return found

    def _count(self, sightings: Sightings) -> None:
        kinds = class_numbers(sightings.class_name)
        for track, kind in zip(sightings.track.tolist(), kinds, strict=True):
            self._counts.setdefault(track, np.zeros(len(CLASSES), np.int64))[kind] += 1

    def _release(self, until_s: float) -> Smoothed:
        s = self.settings
        held = _none() if not self._sightings else Sightings.joined(self._sightings)
        frame = np.array(self._frame, np.int64)
        found = estimate(held, frame, np.array(self._time_s), self._memory, s)
        time = found.rows.time_s
        wanted = (time > self._done_s) & (time <= until_s)
        track = np.array(sorted(self._counts), np.int64)
        counts = np.array([self._counts[t] for t in track.tolist()], np.int64)
        counts = counts.reshape(-1, len(CLASSES))
        out = finished(found, wanted, track, counts)
        # A mark of a bridged row (-1) takes the last entry, which is the mark itself.
        source = np.concatenate([*self._source, [BRIDGED]])[out.source]
        if np.isfinite(until_s):
            # What stands is told from half a window on both sides of a row.
            self._forget(found, until_s - s.standing_window_s / 2)
            self._done_s = until_s
        return replace(out, source=source)

    def _forget(self, found: Estimates, until_s: float) -> None:
        """Keep rows after ``until_s``, and of those before what they say about each track."""
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
