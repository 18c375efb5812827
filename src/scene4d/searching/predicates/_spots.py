"""Where somebody else was, at another time: spots of a whole scene, seen from one run of it."""

from dataclasses import dataclass
from functools import cached_property
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.columns import Columns
from scene4d.core.errors import InputError
from scene4d.core.text import nearest
from scene4d.searching.predicates._distance import Separation
from scene4d.searching.predicates._meeting import BOUND_SIGMA, MOST_SPREAD_M, runs
from scene4d.searching.predicates._when import When
from scene4d.searching.predicates.stage import CameraFactor, Factors, Stage, StageRows

SAME_SPOT_M = 1.5
SAME_SPOT_SIGMA_M = 0.5
"""A step or two, and less than from one parking space to the next (2.5 m); chosen by hand."""
_CELL_M = 0.5
"""Rows of one such square ask for their nearest spots together."""
_NEAREST = 8
"""Spots that are looked at first; where none of them fits in time, four times as many."""
_AT_ONCE = 1 << 19
"""Pairs of a row and a spot that are held at a time: 4 MB for each number of theirs."""


@dataclass(frozen=True, eq=False)
class SpotTable(Columns):
    """A spot per row: where a track was while it did as is asked, for as long as it stayed there.

    ``xy_m`` and ``covariance_m2`` are the mean position and its covariance, in the ground of
    ``frame``; ``begin_s`` and ``end_s`` are seconds on the clock ``clock`` (0 is UTC since 1970).
    ``run`` counts the runs of the scene; ``score`` is that of the event.
    """

    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]
    begin_s: Float[np.ndarray, "n"]
    end_s: Float[np.ndarray, "n"]
    clock: Int[np.ndarray, "n"]
    frame: Int[np.ndarray, "n"]
    run: Int[np.ndarray, "n"]
    track: Int[np.ndarray, "n"]
    score: Float[np.ndarray, "n"]


class Spots:
    """Those spots of a ``table`` that share ground and clock with the run, or the part of a site,
    that is searched.

    ``start_s`` is what its times begin with on that clock; ``span_s`` its first and last moment, on
    its own; ``factor`` is the camera's. Tracks of one number are one in the same ``run``; without
    one, in a site, everywhere.
    """

    def __init__(
        self,
        table: SpotTable,
        when: When,
        *,
        run: int | None,
        start_s: float,
        span_s: tuple[float, float],
        factor: CameraFactor | None = None,
    ) -> None:
        self.table, self.start_s = table, start_s
        self._when, self._run = when, run
        self._span = span_s[0] + start_s, span_s[1] + start_s
        self._factors = None if factor is None else Factors(factor, table.xy_m)
        self._trees: dict[int, Any] = {}

    def probability(
        self, a: StageRows, tau_m: float, sigma_m: float
    ) -> tuple[Float[np.ndarray, "m"], Int[np.ndarray, "m"]]:
        """P(near) of each row to its nearest spot that fits, times the spot's score, and which
        spot that is; 0 and -1 where none fits, NaN without a position.
        """
        at, p = self._nearest(a, self._reach_m(a, tau_m, sigma_m)), np.zeros(len(a))
        p[~np.isfinite(a.xy_m).all(axis=1)] = np.nan
        known = np.flatnonzero(at >= 0)
        spot = at[known]
        rows = a.stage.rows(a.index[known])
        way = Separation.of(
            self.table.xy_m[spot] - rows.xy_m,
            own_covariance_m2(a.stage, rows.index) + self.table.covariance_m2[spot],
            rows.camera_factor,
            None if self._factors is None else self._factors[spot],
        )
        p[known] = self.table.score[spot] * way.near(tau_m, sigma_m)
        return p, at

    def _reach_m(self, a: StageRows, tau_m: float, sigma_m: float) -> Float[np.ndarray, "m"]:
        """Distances beyond which P(near) is below 0.01."""
        own, theirs = (
            one[:, 0, 0] + one[:, 1, 1]
            for one in (own_covariance_m2(a.stage, a.index), self.table.covariance_m2)
        )
        spread_m = np.fmin(np.sqrt(own + theirs.max(initial=0.0)), MOST_SPREAD_M)
        return np.asarray(tau_m + BOUND_SIGMA * np.hypot(sigma_m, spread_m))

    def _nearest(self, a: StageRows, reach_m: Float[np.ndarray, "m"]) -> Int[np.ndarray, "m"]:
        """The nearest spot that fits, for each row; -1 where there is none within reach."""
        from scipy.spatial import cKDTree  # slow to load

        found = np.full(len(a), -1)
        apart = np.full(len(a), np.inf)
        xy, time_s = a.xy_m, a.time_s + self.start_s
        own = a.stage.tracks.track[a.index]
        placed = np.isfinite(xy).all(axis=1)
        for number, (begin_s, end_s, spots) in enumerate(self._parts):
            here = np.flatnonzero(placed & (time_s >= begin_s) & (time_s < end_s))
            if len(here) == 0 or len(spots) == 0:
                continue
            if number not in self._trees:
                self._trees[number] = cKDTree(self.table.xy_m[spots])
            cell, group = _cells(xy[here])
            step = min(_NEAREST, len(spots))
            left = np.arange(len(here))
            while len(left):
                which, used = np.unique(group[left], return_inverse=True)
                tree = self._trees[number]
                away_m, near = tree.query(cell[which], k=np.arange(1, step + 1))
                within = away_m[used, 0] <= reach_m[here[left]] + _CELL_M
                left, used = left[within], used[within]
                for part in np.array_split(np.arange(len(left)), len(left) * step // _AT_ONCE + 1):
                    rows = here[left[part]]
                    best, away = self._fitting(
                        spots[near[used[part]]], xy[rows], time_s[rows], own[rows]
                    )
                    closer = away < apart[rows]
                    found[rows[closer]], apart[rows[closer]] = best[closer], away[closer]
                if step == len(spots):
                    break
                # Where none fits, one that is further away may.
                further = away_m[used, -1] <= reach_m[here[left]] + _CELL_M
                left = left[further & ~np.isfinite(apart[here[left]])]
                step = min(4 * step, len(spots))
        found[apart > reach_m] = -1
        return found

    def _fitting(
        self,
        spots: Int[np.ndarray, "m k"],
        xy: Float[np.ndarray, "m 2"],
        time_s: Float[np.ndarray, "m"],
        track: Int[np.ndarray, "m"],
    ) -> tuple[Int[np.ndarray, "m"], Float[np.ndarray, "m"]]:
        """Of each row's spots the nearest that fits, and its distance; infinite where none does."""
        table = self.table
        away = np.hypot(
            table.xy_m[spots, 0] - xy[:, None, 0], table.xy_m[spots, 1] - xy[:, None, 1]
        )
        fits = self._when.fits(time_s[:, None], table.begin_s[spots], table.end_s[spots])
        mine = table.track[spots] == track[:, None]
        if self._run is not None:
            mine &= table.run[spots] == self._run
        fits &= ~mine
        away = np.where(fits, away, np.inf)
        best = away.argmin(axis=1)[:, None]
        return (
            np.take_along_axis(spots, best, axis=1)[:, 0],
            np.take_along_axis(away, best, axis=1)[:, 0],
        )

    @cached_property
    def _parts(self) -> list[tuple[float, float, Int[np.ndarray, "k"]]]:
        """Parts of the run's time, and the spots that may fit within each; those that fit all the
        time come first, once for the whole run.
        """
        begin_s, end_s = self.table.begin_s, self.table.end_s
        low, high = self._span
        always = self._when.always(self._span, begin_s, end_s)
        parts = [(low, np.inf, np.flatnonzero(always))] if always.any() else []
        for start, stop in self._when.parts(low, high):
            maybe = self._when.possible((start, min(stop, high)), begin_s, end_s) & ~always
            parts.append((start, stop, np.flatnonzero(maybe)))
        return parts


def own_covariance_m2(stage: Stage, rows: Int[np.ndarray, "m"]) -> Float[np.ndarray, "m 2 2"]:
    """Covariance of positions that were seen at different times, but for the camera's factor. In a
    site without one, others may have been seen by another camera: all errors count.
    """
    tracks = stage.tracks
    if stage.camera is not None or stage.camera_factor is not None:
        return tracks.covariance_m2[rows]
    return tracks.covariance_m2[rows] + np.nan_to_num(tracks.shared_covariance_m2[rows])


def near_spot(
    a: StageRows, *, spot: str, tau_m: float = SAME_SPOT_M, sigma_m: float = SAME_SPOT_SIGMA_M
) -> Float[np.ndarray, "m"]:
    """P(a is near where somebody else was, at the time that is asked for).

    ``spot`` names what the other did and when; of all such spots the nearest that fits in time
    counts: P(near) of the distance, with both covariances and the camera's (:class:`Separation`),
    times the score of what the other did. Nobody is another to himself. NaN without a position.
    Raises :class:`InputError` for a spot that the stage does not have.
    """
    if spot not in a.stage.spots:
        raise InputError(f"no spot {spot!r}{nearest(spot, a.stage.spots)}")
    return a.stage.spots[spot].probability(a, tau_m, sigma_m)[0]


def _cells(
    xy: Float[np.ndarray, "m 2"],
) -> tuple[Float[np.ndarray, "k 2"], Int[np.ndarray, "m"]]:
    """The middles of the squares in which points lie, and the square of each."""
    index = np.floor(xy / _CELL_M).astype(np.int64)
    order = np.lexsort((index[:, 1], index[:, 0]))
    first = runs(index[order, 0], index[order, 1])
    group = np.empty(len(xy), np.int64)
    group[order] = np.repeat(np.arange(len(first)), np.diff(np.append(first, len(xy))))
    return (index[order][first] + 0.5) * _CELL_M, group
