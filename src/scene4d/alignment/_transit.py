"""Who leaves one view and appears in the next: how much more likely one person is than two.

A walker's velocity wanders (an Ornstein-Uhlenbeck process about standing): for seconds it stays
what it was, later only how far one can have come is known. Against that stand the people who would
begin there at any time: their rate is learned from where and how often tracks of that camera begin.
"""

import numpy as np
from jaxtyping import Float, Int

from scene4d.alignment._paths import ranges
from scene4d.alignment._sameness import TICK_S, Pairs, Passages, colour_log_ratio, size_log_ratio

LONGEST_S = 120.0
"""Longest time out of sight. Chosen: farther away in time everybody could be anybody."""
_SHORTEST_S = -1.0
"""Views that touch lose and find somebody at the same time: this much overlap is no conflict."""
_STEADY_S = np.array([10.0, 10.0, 10.0])
"""How long people, cycles, vehicles keep speed and direction (s)."""
_SPEED_MPS = np.array([1.0, 3.0, 6.0])
"""Standard deviation of their velocity along each axis (m/s)."""
_BAND_M = 2.0
"""Depth of the border in which somebody who enters a view is found first (m); over as much the
rate of beginnings is smoothed."""
_LEAST = -7.0
"""Log-ratio of pairs that are not even rivals: one in a thousand."""
_FASTEST_MPS = np.array([4.0, 12.0, 35.0])
_SLACK_M = 5.0
"""Nobody comes farther than at this speed, and cameras err by no more than this (m)."""
_FARTHEST = 25.0
"""Squared distance (in standard deviations, four dimensions) beyond which nobody is compared."""


def transits(
    a: Passages,
    b: Passages,
    span_s: float,
    open_ends: tuple[Int[np.ndarray, "n"], Int[np.ndarray, "m"]],
) -> Pairs:
    """Pairs of a track of one camera that ends and one of another that begins later, if whoever
    leaves the first surely came to the second.

    ``span_s`` is how long camera b was watching; ``open_ends`` are the tracks of a that end and
    those of b that begin somebody's time in view. ``ticks`` is the time in between.
    """
    i, j = _later(a, b, open_ends)
    ends, starts = _last_rows(a)[i], _first_rows(b)[j]
    gap_s = np.maximum((b.begin[j] - a.end[i]) * TICK_S, TICK_S)
    q, log_det, speed = _foreseen(a, b, ends, starts, a.kind[i], gap_s)
    arrival = _log_rates(b, span_s)[j]
    there = -(q + log_det) / 2 - 2 * np.log(2 * np.pi)
    here = -_stationary(b, starts, b.kind[j]) / 2
    ratio = there - here + np.log(speed / _BAND_M) - arrival
    ratio = ratio + size_log_ratio(a, b, i, j) + colour_log_ratio(a, b, i, j)
    kept = (q < _FARTHEST) & (ratio > _LEAST)
    return Pairs(i[kept], j[kept], ratio[kept], (b.begin[j] - a.end[i])[kept])


def _later(
    a: Passages, b: Passages, open_ends: tuple[Int[np.ndarray, "n"], Int[np.ndarray, "m"]]
) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
    """Ends of a and beginnings of b that one could reach from there."""
    ends, starts = open_ends
    order = starts[np.argsort(b.begin[starts], kind="stable")]
    begin = b.begin[order]
    first = np.searchsorted(begin, a.end[ends] + _SHORTEST_S / TICK_S)
    last = np.searchsorted(begin, a.end[ends] + LONGEST_S / TICK_S, side="right")
    of, at = ranges(first, last - first)
    i, j = ends[of], order[at]
    way = b.rows.xy_m[_first_rows(b)[j]] - a.rows.xy_m[_last_rows(a)[i]]
    gap_s = np.maximum(b.begin[j] - a.end[i], 0) * TICK_S
    near = np.hypot(*way.T) < _FASTEST_MPS[a.kind[i]] * gap_s + _SLACK_M
    kept = near & (a.kind[i] == b.kind[j]) & (b.end[j] > a.end[i])
    return i[kept], j[kept]


def _first_rows(one: Passages) -> Int[np.ndarray, "t"]:
    return np.flatnonzero(np.diff(one.of, prepend=-1))


def _last_rows(one: Passages) -> Int[np.ndarray, "t"]:
    return np.flatnonzero(np.diff(one.of, append=len(one)))


def _foreseen(
    a: Passages,
    b: Passages,
    ends: Int[np.ndarray, "n"],
    starts: Int[np.ndarray, "n"],
    kind: Int[np.ndarray, "n"],
    gap_s: Float[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Squared distance of where and how a track begins from what the one that ended foresees, the
    logarithm of the determinant, and the speed (m/s) with which the border is crossed.
    """
    steady, sigma = _STEADY_S[kind], _SPEED_MPS[kind]
    left = np.exp(-gap_s / steady)
    v, w = np.nan_to_num(a.rows.velocity_mps[ends]), np.nan_to_num(b.rows.velocity_mps[starts])
    way = b.rows.xy_m[starts] - a.rows.xy_m[ends] - v * (steady * (1 - left))[:, None]
    turn = w - v * left[:, None]
    place = (sigma * steady) ** 2 * (2 * gap_s / steady - 3 + 4 * left - left**2)
    pace = sigma**2 * (1 - left**2)
    both = sigma**2 * steady * (1 - left) ** 2
    covariance = np.zeros((len(gap_s), 4, 4))
    eye = np.eye(2)
    error = sum(
        one.rows.covariance_m2[rows] + one.rows.shared_covariance_m2[rows]
        for one, rows in ((a, ends), (b, starts))
    )
    slip = sum(
        np.nan_to_num(one.rows.velocity_covariance[rows]) for one, rows in ((a, ends), (b, starts))
    )
    covariance[:, :2, :2] = place[:, None, None] * eye + error
    covariance[:, 2:, 2:] = pace[:, None, None] * eye + slip + 0.1**2 * eye
    covariance[:, :2, 2:] = covariance[:, 2:, :2] = both[:, None, None] * eye
    d = np.concatenate([way, turn], axis=1)
    q = np.einsum("ni,ni->n", d, np.linalg.solve(covariance, d[:, :, None])[:, :, 0])
    return q, np.linalg.slogdet(covariance)[1], np.maximum(np.hypot(*w.T), 0.3)


def _stationary(
    b: Passages, starts: Int[np.ndarray, "n"], kind: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """Minus twice the log density of the velocity of anybody who begins, without the place."""
    w = np.nan_to_num(b.rows.velocity_mps[starts])
    spread = _SPEED_MPS[kind] ** 2 + 0.1**2
    found: np.ndarray = (w**2).sum(axis=1) / spread + 2 * np.log(spread) + 2 * np.log(2 * np.pi)
    return found


def _log_rates(b: Passages, span_s: float) -> Float[np.ndarray, "t"]:
    """Logarithm of the rate (per m² and second) at which tracks begin where each of them does."""
    xy = b.rows.xy_m[_first_rows(b)]
    rates = np.empty(len(xy))
    scale = 1 / (2 * np.pi * _BAND_M**2 * max(span_s, 1.0))
    for k, (at, kind) in enumerate(zip(xy, b.kind, strict=True)):
        others = xy[b.kind == kind]
        rates[k] = np.exp(-((others - at) ** 2).sum(axis=1) / (2 * _BAND_M**2)).sum() * scale
    return np.log(rates)
