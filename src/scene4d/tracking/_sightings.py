"""The smoother's input in order: detections, frames between them, and earlier states."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.columns import Columns
from scene4d.core.errors import InputError
from scene4d.tracking._motion_model import class_numbers


@dataclass(frozen=True, eq=False)
class Sightings(Columns):
    """Associated detections, in any order. ``xy_m`` and ``covariance_m2`` (m², of one detection,
    without the calibration error) are NaN where a row has no ground point. ``from_hiding`` marks
    who was hidden since the row before; by default nobody.
    """

    track: Int[np.ndarray, "n"]
    class_name: np.ndarray
    time_s: Float[np.ndarray, "n"]
    frame: Int[np.ndarray, "n"]
    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]
    from_hiding: Bool[np.ndarray, "n"] | None = None

    def __post_init__(self) -> None:
        if self.from_hiding is None:
            object.__setattr__(self, "from_hiding", np.zeros(len(self.track), bool))
        self.check_rows("sightings")
        if not np.isfinite(self.time_s).all():
            raise InputError("sightings: time_s must be finite; give frames a time first")
        known = np.isfinite(self.xy_m).all(axis=1)
        a, b, d = (self.covariance_m2[known][:, i, j] for i, j in ((0, 0), (0, 1), (1, 1)))
        bad = ~((a > 0) & (a * d - b * b > 0))
        if bad.any():
            row = int(np.flatnonzero(known)[bad][0])
            raise InputError(
                f"sightings: covariance_m2 of row {row} (track {self.track[row]}, frame "
                f"{self.frame[row]}) must be positive definite, found "
                f"{self.covariance_m2[row].tolist()}"
            )


@dataclass(frozen=True, eq=False)
class Memory(Columns):
    """State from which a stream continues: each track's last row, given all detections up to it.

    ``measured_s`` is the time of the track's last position, NaN if it never had one.
    """

    track: Int[np.ndarray, "k"]
    kind: Int[np.ndarray, "k"]
    time_s: Float[np.ndarray, "k"]
    frame: Int[np.ndarray, "k"]
    measured_s: Float[np.ndarray, "k"]
    mean: Float[np.ndarray, "k 6"]
    covariance: Float[np.ndarray, "k 6 6"]

    @classmethod
    def none(cls) -> "Memory":
        """Nothing remembered."""
        no, none = np.empty(0), np.empty(0, np.int64)
        mean, cov = np.empty((0, 6)), np.empty((0, 6, 6))
        return cls(none, none, no, none, no, mean, cov)


BRIDGED, REMEMBERED = -1, -2


@dataclass(frozen=True, eq=False)
class TrackRows(Columns):
    """Detections, bridged frames and remembered states by (track, frame).

    ``source`` is the row of the detections, or one of the marks above; ``kind`` the class number.
    ``measured_s`` is the time of the row's position, NaN if it has none; ``xy_m`` and
    ``covariance_m2`` are NaN where nothing was measured. ``max_gap_s`` is the longest gap before
    the row that is bridged.
    """

    source: Int[np.ndarray, "n"]
    track: Int[np.ndarray, "n"]
    kind: Int[np.ndarray, "n"]
    time_s: Float[np.ndarray, "n"]
    frame: Int[np.ndarray, "n"]
    measured_s: Float[np.ndarray, "n"]
    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]
    max_gap_s: Float[np.ndarray, "n"]

    @property
    def first(self) -> Bool[np.ndarray, "n"]:
        """Where a track begins."""
        return np.diff(self.track, prepend=self.track[:1] - 1) != 0

    def placed(self) -> Bool[np.ndarray, "n"]:
        """Rows that get a position: measured ones, and those in a gap that is short enough."""
        measured, row = np.isfinite(self.measured_s), np.arange(len(self.track))
        before = np.maximum.accumulate(np.where(measured, row, -1))
        after = np.minimum.accumulate(np.where(measured, row, len(row))[::-1])[::-1]
        inside = (before >= 0) & (after < len(row))
        b, a = before[inside], after[inside]
        short = self.measured_s[a] - self.measured_s[b] <= self.max_gap_s[a]
        inside[inside] = short & (self.track[a] == self.track[b])
        return inside & (self.source != REMEMBERED)


def in_order(
    sightings: Sightings,
    frame: Int[np.ndarray, "m"],
    frame_time_s: Float[np.ndarray, "m"],
    memory: Memory,
    max_gap_s: float,
    max_hidden_s: float,
) -> TrackRows:
    """Everything in order, gaps bridged: those of up to ``max_gap_s``, and where somebody was
    hidden up to ``max_hidden_s``. Raises :class:`InputError` as :func:`.smooth`.
    """
    _check_frames(frame, frame_time_s)
    assert sightings.from_hiding is not None  # it has a default
    gap_s = np.where(sightings.from_hiding, max_hidden_s, max_gap_s)
    found = TrackRows.joined([_remembered(memory), _seen(sightings, gap_s)])
    order = np.lexsort((found.frame, found.track))
    found = found.select(order)
    _check_order(found)
    if not len(frame):
        return found
    both = TrackRows.joined([found, _bridges(found, frame, frame_time_s)])
    # A detection without a position replaces the bridge of the same frame.
    order = np.lexsort((both.source == BRIDGED, both.frame, both.track))
    both = both.select(order)
    again = (np.diff(both.track) == 0) & (np.diff(both.frame) == 0)
    both = both.select(np.append(True, ~again)[: len(order)])
    _check_order(both)
    return both


def _check_frames(frame: np.ndarray, time_s: np.ndarray) -> None:
    if len(time_s) != len(frame):
        raise InputError(f"smoothing: {len(time_s)} frame times for {len(frame)} frames")
    if not (np.isfinite(time_s).all() and (np.diff(time_s) > 0).all()):
        raise InputError("smoothing: frame_time_s must be finite and ascending")
    if not (np.diff(frame) > 0).all():
        raise InputError("smoothing: frame must be ascending")


def _seen(s: Sightings, max_gap_s: Float[np.ndarray, "n"]) -> TrackRows:
    known = np.isfinite(s.xy_m).all(axis=1)
    return TrackRows(
        source=np.arange(len(s)),
        track=s.track,
        kind=class_numbers(s.class_name),
        time_s=s.time_s,
        frame=s.frame,
        measured_s=np.where(known, s.time_s, np.nan),
        xy_m=np.where(known[:, None], s.xy_m, np.nan),
        covariance_m2=np.where(known[:, None, None], s.covariance_m2, np.nan),
        max_gap_s=max_gap_s,
    )


def _remembered(m: Memory) -> TrackRows:
    k = len(m)
    return TrackRows(
        source=np.full(k, REMEMBERED),
        track=m.track,
        kind=m.kind,
        time_s=m.time_s,
        frame=m.frame,
        measured_s=m.measured_s,
        xy_m=np.full((k, 2), np.nan),
        covariance_m2=np.full((k, 2, 2), np.nan),
        max_gap_s=np.zeros(k),
    )


def _check_order(found: TrackRows) -> None:
    same = np.diff(found.track) == 0
    wrong = same & ~((np.diff(found.time_s) > 0) & (np.diff(found.frame) > 0))
    if wrong.any():
        k = int(np.flatnonzero(wrong)[0])
        raise InputError(
            f"sightings: track {found.track[k]} has frame {found.frame[k]} at "
            f"{found.time_s[k]} s and then frame {found.frame[k + 1]} at {found.time_s[k + 1]} s; "
            "expected one row per track and frame, with times that rise"
        )


def _bridges(found: TrackRows, frame: np.ndarray, frame_time_s: np.ndarray) -> TrackRows:
    """Rows for the frames between two measured positions of a track."""
    known = np.flatnonzero(np.isfinite(found.measured_s))
    a, b = known[:-1], known[1:]
    near = found.measured_s[b] - found.measured_s[a] <= found.max_gap_s[b]
    near &= found.track[a] == found.track[b]
    a, b = a[near], b[near]
    low = np.searchsorted(frame, found.frame[a], "right")
    count = np.maximum(np.searchsorted(frame, found.frame[b], "left") - low, 0)
    start = np.repeat(low - np.concatenate([[0], np.cumsum(count)[:-1]])[: len(low)], count)
    at, n = start + np.arange(len(start)), len(start)
    return TrackRows(
        source=np.full(n, BRIDGED),
        track=np.repeat(found.track[a], count),
        kind=np.repeat(found.kind[a], count),
        time_s=frame_time_s[at],
        frame=frame[at],
        measured_s=np.full(n, np.nan),
        xy_m=np.full((n, 2), np.nan),
        covariance_m2=np.full((n, 2, 2), np.nan),
        max_gap_s=np.zeros(n),
    )
