"""Tracking people in the image through sampled frames, for calibration.

Sampled frames can be seconds apart, so boxes of one walker need not overlap. Boxes are associated
by the predicted position of the foot, by size and by the colours of the clothes, in one assignment
per frame. The calibrator fits one height per track, so a track that mixes two people does more
harm than a person split in two: where two matches are about equally good, the tracks concerned end
and new ones begin.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from scene4d.core.errors import InputError

# Lengths are in heights of the person's box, so that near and far people are treated alike; costs
# are -2 log likelihood, up to a constant. Chosen by hand, for purity, on PETS S2L1 with frames 0.1
# to 1.6 s apart (tests/perception/test_tracking.py checks the result there).
_SPEED_SIGMA = np.array([0.6, 0.4])
"""Speed of people along the image's x and y, heights per second."""
_KEEP_S = 5.0
"""Correlation time of the velocity, seconds."""
_FOOT_SIGMA = 0.07
"""Jitter of a box's foot."""
_SIZE_SIGMA = 0.06
"""Jitter of the logarithm of a box's height."""
_SIZE_DRIFT = 0.08
"""Its change per second, as people approach or recede."""
_COLOUR_SIGMA = 0.15
"""Hellinger distance between colours of one person."""
_COLOUR_LIMIT = 0.4
"""Larger distances mean another person."""
_NEW_SHARE = 0.3
"""Weight of a new detection in a track's colours."""
_GATE = 4.0
"""Largest distance of foot or size, standard deviations."""
_COST_LIMIT = 14.0
"""Matches with a higher cost are considered chance."""
_MARGIN = 4.0
"""How much cheaper a match must be than any other match it excludes."""
_MEMORY_S = 2.0
_MEMORY_FRAMES = 2
"""A track ends when it is unseen for longer than both limits."""


@dataclass
class _Track:
    """Kalman filter per axis; lengths of ``covariance`` in heights."""

    label: int
    state: np.ndarray  # (2 axes, 2): foot px, velocity px/s
    covariance: np.ndarray  # (2 axes, 2, 2)
    height: float
    time_s: float
    update: int
    appearance: np.ndarray | None


@dataclass(frozen=True)
class _Sighting:
    foot: np.ndarray  # (n, 2)
    height: np.ndarray  # (n,)
    appearance: np.ndarray | None  # (n, d)


class Tracker:
    """Assigns track numbers, from 0, to the boxes of successive frames; streaming."""

    def __init__(self) -> None:
        self._tracks: list[_Track] = []
        self._next = 0
        self._updates = 0
        self._time_s = -np.inf

    def update(
        self,
        box_xyxy: Float[np.ndarray, "n 4"],
        time_s: float,
        appearance: Float[np.ndarray, "n d"] | None = None,
    ) -> Int[np.ndarray, "n"]:
        """Track numbers (n,) of the boxes of one frame.

        ``appearance`` holds histograms that each sum to 1 (``colour_histograms``); without them
        fewer matches are certain and tracks are shorter. Frames may be any time apart. Raises
        :class:`InputError` if the time is not finite or goes backwards.
        """
        if not np.isfinite(time_s) or time_s < self._time_s:
            raise InputError(
                f"tracker: found time {time_s} s, expected a finite one not before "
                f"{self._time_s} s; give the frames in order"
            )
        self._time_s = time_s
        self._updates += 1
        seen = _Sighting(
            foot=np.column_stack([box_xyxy[:, [0, 2]].mean(axis=1), box_xyxy[:, 3]]),
            height=np.maximum(box_xyxy[:, 3] - box_xyxy[:, 1], 1.0),
            appearance=appearance,
        )
        return self._associate(seen, time_s)

    def _associate(self, seen: _Sighting, time_s: float) -> np.ndarray:
        self._tracks = [
            t
            for t in self._tracks
            if time_s - t.time_s <= _MEMORY_S or self._updates - t.update <= _MEMORY_FRAMES
        ]
        predicted = [_predict(t, time_s) for t in self._tracks]
        cost = np.empty((len(self._tracks), len(seen.foot)))
        for row, t, (state, covariance) in zip(cost, self._tracks, predicted, strict=True):
            row[:] = _costs(t, state, covariance, seen, time_s - t.time_s)
        pairs, doubtful = clear_matches(cost)
        label = np.full(len(seen.foot), -1)
        for i, j in pairs:
            track = self._tracks[i]
            _correct(track, *predicted[i], seen, j)
            track.time_s, track.update = time_s, self._updates
            label[j] = track.label
        self._tracks = [t for t, ends in zip(self._tracks, doubtful, strict=True) if not ends]
        for new in np.flatnonzero(label < 0):
            label[new] = self._start(seen, int(new), time_s)
        return label

    def _start(self, seen: _Sighting, j: int, time_s: float) -> int:
        track = _Track(
            label=self._next,
            state=np.column_stack([seen.foot[j], np.zeros(2)]),
            covariance=np.array([np.diag([_FOOT_SIGMA**2, v**2]) for v in _SPEED_SIGMA]),
            height=float(seen.height[j]),
            time_s=time_s,
            update=self._updates,
            appearance=None if seen.appearance is None else seen.appearance[j],
        )
        self._tracks.append(track)
        self._next += 1
        return track.label


def _predict(t: _Track, time_s: float) -> tuple[np.ndarray, np.ndarray]:
    """State and covariance at ``time_s``; the velocity is an Ornstein-Uhlenbeck process.

    It persists over times well below ``_KEEP_S`` and decorrelates beyond, while its variance stays
    ``_SPEED_SIGMA``², so the predicted uncertainty is right for any interval.
    """
    dt, k = time_s - t.time_s, _KEEP_S
    decay = np.exp(-dt / k)
    step = np.array([[1.0, k * (1 - decay)], [0.0, decay]])
    corner = k * (1 - decay) ** 2
    # Exact integral; the first entry is about 2 dt³ / (3 k) for short steps.
    noise = np.array(
        [
            [k * k * (2 * dt / k - 3 + 4 * decay - decay**2), corner],
            [corner, 1 - decay**2],
        ]
    )
    speed = _SPEED_SIGMA[:, None, None]
    return t.state @ step.T, step @ t.covariance @ step.T + speed**2 * noise


def _costs(
    t: _Track,
    state: np.ndarray,
    covariance: np.ndarray,
    seen: _Sighting,
    dt: float,
) -> np.ndarray:
    """Cost (n,) of every box as the track's next; infinite where impossible."""
    variance = covariance[:, 0, 0] + _FOOT_SIGMA**2
    away = (((seen.foot - state[:, 0]) / t.height) ** 2 / variance).sum(axis=1)
    size = np.log(seen.height / t.height) ** 2 / (_SIZE_SIGMA**2 + (_SIZE_DRIFT * dt) ** 2)
    cost = away + size + np.log(variance.prod() / _FOOT_SIGMA**4)
    impossible = (away > _GATE**2) | (size > _GATE**2)
    if seen.appearance is not None and t.appearance is not None:
        colour = _hellinger(seen.appearance, t.appearance)
        cost = cost + (colour / _COLOUR_SIGMA) ** 2
        impossible |= colour > _COLOUR_LIMIT
    cost[impossible | (cost > _COST_LIMIT)] = np.inf
    return cost


def _correct(
    t: _Track,
    state: np.ndarray,
    covariance: np.ndarray,
    seen: _Sighting,
    j: int,
) -> None:
    gain = covariance[:, :, 0] / (covariance[:, 0, 0] + _FOOT_SIGMA**2)[:, None]
    t.state = state + gain * (seen.foot[j] - state[:, 0])[:, None]
    t.covariance = covariance - gain[:, :, None] * covariance[:, None, 0, :]
    t.height = float(seen.height[j])
    if seen.appearance is not None:
        now = seen.appearance[j]
        t.appearance = (
            now if t.appearance is None else (1 - _NEW_SHARE) * t.appearance + _NEW_SHARE * now
        )


def clear_matches(
    cost: Float[np.ndarray, "t n"],
) -> tuple[list[tuple[int, int]], Bool[np.ndarray, "t"]]:
    """Unambiguous pairs (track, box) of the minimum-cost assignment, and the ambiguous tracks.

    A pair is unambiguous if every other pair of the same track or box costs ``_MARGIN`` more. An
    ambiguous pair is left out, and all tracks that could claim its box are ambiguous.
    """
    pairs: list[tuple[int, int]] = []
    doubtful = np.zeros(len(cost), bool)
    # A finite value larger than any sum of costs: impossible pairs only as a last resort.
    possible = np.where(np.isfinite(cost), cost, 1e6)
    for i, j in zip(*linear_sum_assignment(possible), strict=True):
        if not np.isfinite(cost[i, j]):
            continue
        rival_tracks = cost[:, j] < cost[i, j] + _MARGIN
        rival_boxes = cost[i] < cost[i, j] + _MARGIN
        if rival_tracks.sum() + rival_boxes.sum() == 2:  # only the pair itself, counted twice
            pairs.append((int(i), int(j)))
        else:
            doubtful |= rival_tracks
    for i, _ in pairs:
        doubtful[i] = False
    return pairs, doubtful


def _hellinger(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    return np.sqrt(np.clip(1 - np.sqrt(a * b).sum(axis=-1), 0, 1))
