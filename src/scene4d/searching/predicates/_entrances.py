"""Where people come from and go to: doors, known by their use.

Nothing in a track shows a door. But of those who come to one many begin or end there, one after the
other, while past a place in the open everybody goes on (sources and sinks of a scene: Makris and
Ellis 2005).
"""

from weakref import WeakKeyDictionary

import numpy as np
from jaxtyping import Float, Int

from scene4d.searching.predicates._meeting import runs
from scene4d.searching.predicates._visibility import unexplained_ends
from scene4d.searching.predicates.stage import Stage, StageRows

_RADIUS_M = 0.5
"""Half the width of a door."""
_WIDEST = 16
"""A place is as wide as its error at most, and no wider than so many radii."""
_SQUARES = 2
"""Places are counted by squares of the ground: so many of them to a radius."""
_ENDED, _CAME = 0.5, 5.0
"""What is taken of a place before anybody was seen there: half of one ended, of five who came."""


def at_entrance(a: StageRows, *, radius_m: float = _RADIUS_M) -> Float[np.ndarray, "m"]:
    """P(who comes where a is begins or ends there): a door, or another way in and out of view.

    Of the people other than a who ever came within r, the share of those whose track begins or ends
    there, each with the probability that neither the border of the picture nor the clip nor an
    obstacle explains that end (:func:`.disappears`); with half of one in five added. ``r`` is
    ``√(radius² + s²)`` with the standard error s of a's position, to the nearest of steps of √2.
    Places are counted by squares of r / 2. NaN where a has no position.
    """
    stage = a.stage
    kept = _KEPT.setdefault(stage, {})
    out = np.full(len(a), np.nan)
    variance = a.covariance_m2.trace(axis1=1, axis2=2) / 2
    wide = np.sqrt(np.clip(1 + variance / radius_m**2, 1.0, _WIDEST**2))
    step = np.round(2 * np.log2(np.where(np.isfinite(wide), wide, _WIDEST)))
    for one in np.unique(step):
        rows = np.flatnonzero(step == one)
        r_m = float(radius_m * 2 ** (one / 2))
        if r_m not in kept:
            kept[r_m] = _Uses(stage, r_m)
        out[rows] = kept[r_m].share(a.xy_m[rows], stage.track_of_row[a.index[rows]])
    return out


class _Uses:
    """Which people came within a radius of each square of the ground, and which of them ended
    there: sorted numbers of (square, track), and the probability of the end of each.
    """

    def __init__(self, stage: Stage, radius_m: float) -> None:
        self._square_m, self._tracks = radius_m / _SQUARES, len(stage.first_row)
        track, xy_m = stage.track_of_row, stage.tracks.xy_m
        people = stage.tracks.class_name[stage.first_row] == "person"
        placed = people[track] & np.isfinite(xy_m).all(axis=1)
        rows = np.flatnonzero(placed)
        square = self._square_of(xy_m[rows])
        rows = rows[runs(track[rows], *square.T)]
        number = self._around(xy_m[rows]).ravel()
        self._square, place = np.unique(number, return_inverse=True)
        who = np.repeat(track[rows], len(number) // max(len(rows), 1))
        self._pair = np.unique(place * self._tracks + who)
        self._ends = np.zeros(len(self._pair))
        for last in (False, True):
            row, p = unexplained_ends(stage, last)
            row, p = row[placed[row]], p[placed[row]]
            place = np.searchsorted(self._square, self._around(xy_m[row]))
            at = np.searchsorted(self._pair, place * self._tracks + track[row, None])
            np.maximum.at(self._ends, at, p[:, None])
        square_of_pair = self._pair // max(self._tracks, 1)
        self._came = np.bincount(square_of_pair, minlength=len(self._square))
        self._ended = np.bincount(square_of_pair, self._ends, len(self._square))

    def share(
        self, xy_m: Float[np.ndarray, "n 2"], track: Int[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n"]:
        """Of those who came, without ``track`` itself, the share who ended."""
        known = np.isfinite(xy_m).all(axis=1)
        out = np.full(len(xy_m), np.nan)
        number, track = _number(self._square_of(xy_m[known])), track[known]
        came, ended = np.zeros((2, len(number)))
        if len(self._square):
            at = np.minimum(np.searchsorted(self._square, number), len(self._square) - 1)
            seen = self._square[at] == number
            pair = at * self._tracks + track
            own = np.minimum(np.searchsorted(self._pair, pair), len(self._pair) - 1)
            mine = self._pair[own] == pair
            came = np.where(seen, self._came[at] - mine, 0.0)
            ended = np.where(seen, self._ended[at] - mine * self._ends[own], 0.0)
        out[known] = (ended + _ENDED) / (came + _CAME)
        return out

    def _square_of(self, xy_m: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "n 2"]:
        return np.floor(xy_m / self._square_m).astype(np.int64)

    def _around(self, xy_m: Float[np.ndarray, "n 2"]) -> Int[np.ndarray, "n k"]:
        """Numbers of the squares whose middles are within the radius of those of some places."""
        side = np.arange(-_SQUARES, _SQUARES + 1)
        offset = np.stack(np.meshgrid(side, side), axis=-1).reshape(-1, 2)
        offset = offset[(offset**2).sum(axis=1) <= _SQUARES**2]
        return _number(self._square_of(xy_m)[:, None] + offset)


_KEPT: "WeakKeyDictionary[Stage, dict[float, _Uses]]" = WeakKeyDictionary()


def _number(square: Int[np.ndarray, "*n 2"]) -> Int[np.ndarray, "*n"]:
    """One number for each square within 2³⁰ of the origin."""
    return square[..., 0] * 2**31 + square[..., 1]
