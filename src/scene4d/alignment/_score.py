"""How much better two cameras' tracks are explained as the same people than as different ones.

A hypothesis maps camera b onto camera a. At every tick, each person of a and each of b are either
one (their distance is that of two measurements) or two (the second is anywhere that people are,
by how often they are there). The logarithm of that ratio is summed over the time two tracks share;
positive sums are matches, each track with one other at a time. Who should have been seen by the
other camera as well and was not counts against.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.alignment._paths import STEP_S, Paths, ranges

_NOISE_M = 0.25
"""What two measurements of one person differ by beside the rows' own noise (m): feet from two
sides, and bias of the track. Chosen between the errors of benchmarks.people_positions near and
far."""
_LEFT = 0.35
"""Share of the cameras' own errors that shift, turn and scale leave (read off made worlds)."""
_FACT_S = 4.0
"""Time (s) after which two walkers' distance is a new fact: before, they keep their velocity."""
_STILL = 0.1
"""Worth of a moment in which nobody moves, as a share: the same fact again."""
_WALK_MPS = 0.5
"""Speed from which a moment counts in full (m/s)."""
_WORST = -3.0
"""Least log-ratio of one moment: tracks swap identities and detectors err."""
_MISSED = 0.7
"""Cost of a fact that only one camera saw where both see people: half of all people are missed at
some moment by one of two cameras, ln 2."""
_APART_M, APART_S = 1.5, 1.5
"""Alignments that put people further apart than this, or at other times, are rivals."""
_CELL_M = 1.0
_MOST_CELLS = 300
_MOST_MEETINGS = 40_000
"""Moments looked at for one hypothesis; of more, whole minutes are left out."""


@dataclass(frozen=True, eq=False)
class Crowd:
    """Paths in order of time, with where people are found at all."""

    paths: Paths

    @classmethod
    def of(cls, paths: Paths) -> "Crowd":
        """Sorted by tick."""
        return cls(paths.select(np.argsort(paths.tick, kind="stable")))

    @cached_property
    def worth(self) -> Float[np.ndarray, "n"]:
        """How much of a fact each row is."""
        speed = np.linalg.norm(self.paths.velocity_mps, axis=1)
        return STEP_S / _FACT_S * np.clip(speed / _WALK_MPS, _STILL, 1.0)

    @cached_property
    def _grid(self) -> tuple[Float[np.ndarray, "2"], float, Float[np.ndarray, "w h"]]:
        """Lower corner, cell (m) and people per m² (sums to 1), smoothed over three cells."""
        xy = self.paths.xy_m
        low, high = np.quantile(xy, [0.001, 0.999], axis=0) if len(xy) else np.zeros((2, 2))
        cell = max(_CELL_M, float((high - low).max()) / _MOST_CELLS)
        low = low - 2 * cell
        size = np.ceil((high - low) / cell).astype(int) + 3
        at = np.floor((xy - low) / cell).astype(int)
        inside = ((at >= 0) & (at < size)).all(axis=1)
        count = np.zeros(tuple(size))
        np.add.at(count, tuple(at[inside].T), 1.0)
        padded = np.pad(count, 1)
        w, h = count.shape
        smooth = sum(padded[i : i + w, j : j + h] for i in range(3) for j in range(3)) / 9.0
        return low, cell, smooth / max(count.sum(), 1.0) / cell**2

    def density(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """People per square metre at points: where a random one of this camera's would be."""
        low, cell, grid = self._grid
        at = np.floor((xy - low) / cell).astype(int)
        inside = ((at >= 0) & (at < grid.shape)).all(axis=1)
        found = np.zeros(len(xy))
        found[inside] = grid[tuple(at[inside].T)]
        return found

    @cached_property
    def own_density(self) -> Float[np.ndarray, "n"]:
        """The density at each row."""
        return np.maximum(self.density(self.paths.xy_m), 1e-6)


@dataclass(frozen=True, eq=False)
class Fit:
    """A map from b to a: x, y, heading, log-scale, offset, as in a placement."""

    parameters: Float[np.ndarray, "5"]
    score: float = -np.inf

    def mapped(self, xy: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
        """Points of b in a's ground."""
        mapped: np.ndarray = xy @ self.linear.T + self.parameters[:2]
        return mapped

    @property
    def linear(self) -> Float[np.ndarray, "2 2"]:
        """Rotation times scale."""
        c, s = np.cos(self.parameters[2]), np.sin(self.parameters[2])
        return float(np.exp(self.parameters[3])) * np.array([[c, -s], [s, c]])


def different(fits: list[Fit], xy_m: Float[np.ndarray, "n 2"], share: float = 1.0) -> list[Fit]:
    """Best first, without those that put people at about the same places and times as a better one;
    ``xy_m`` are where these are before they are mapped.
    """
    corners = np.array([[-1, -1], [1, -1], [1, 1], [-1, 1]])
    around = xy_m.mean(axis=0) + corners * xy_m.std(axis=0)
    fits = sorted(fits, key=lambda one: -one.score)
    where = np.array([fit.mapped(around) for fit in fits]).reshape(-1, 4, 2)
    when = np.array([fit.parameters[4] for fit in fits])
    kept: list[int] = []
    for k in range(len(fits)):
        late = np.abs(when[kept] - when[k]) > share * APART_S
        step = ((where[kept] - where[k]) ** 2).sum(axis=2).mean(axis=1)
        if (late | (step > (share * _APART_M) ** 2)).all():
            kept.append(k)
    return [fits[k] for k in kept]


@dataclass(frozen=True, eq=False)
class Matching:
    """What a fit matches: rows of the two crowds, in moments of matched pairs of tracks."""

    score: float
    row_a: Int[np.ndarray, "m"]
    row_b: Int[np.ndarray, "m"]
    pair: Int[np.ndarray, "m"]
    gain: Float[np.ndarray, "p"]
    missed: float

    @property
    def pairs(self) -> int:
        """How many pairs of tracks match."""
        return len(self.gain)


class Meetings:
    """Rows of two cameras at one time, for whole shifts of the clocks, kept once worked out."""

    def __init__(self, a: Crowd, b: Crowd, most: int = _MOST_MEETINGS) -> None:
        self.a, self.b, self._most = a, b, most
        self._kept: dict[int, tuple[np.ndarray, ...]] = {}

    def at(self, shift: int) -> tuple[np.ndarray, ...]:
        """Rows of a and b that meet, the number of their pair of tracks, and all rows of a and of
        b in the minutes that are looked at while both cameras record.
        """
        if shift not in self._kept:
            self._kept[shift] = self._met(shift)
        return self._kept[shift]

    def _met(self, shift: int) -> tuple[np.ndarray, ...]:
        tick_a, tick_b = self.a.paths.tick, self.b.paths.tick + shift
        all_a, all_b = _during(tick_a, tick_b), _during(tick_b, tick_a)
        first = np.searchsorted(tick_b, tick_a[all_a], side="left")
        count = np.searchsorted(tick_b, tick_a[all_a], side="right") - first
        if count.sum() > self._most:
            every = int(np.ceil(count.sum() / self._most))
            looked = _minute(tick_a[all_a]) % every == 0
            all_a, first, count = all_a[looked], first[looked], count[looked]
            all_b = all_b[_minute(tick_b[all_b]) % every == 0]
        of, j = ranges(first, count)
        i = all_a[of]
        same = self.a.paths.kind[i] == self.b.paths.kind[j]
        i, j = i[same], j[same]
        who = self.a.paths.track[i].astype(np.int64) * (1 << 31) + self.b.paths.track[j]
        _, pair = np.unique(who, return_inverse=True)
        return i, j, pair, all_a, all_b

    def matching(self, fit: Fit, wide: float = 1.0) -> Matching:
        """The matches of a fit, and its score; ``wide`` multiplies the variance of distances, for
        fits that are not yet at their best.
        """
        offset = fit.parameters[4]
        shift = round(offset / STEP_S)
        i, j, pair, all_a, all_b = self.at(shift)
        a, b = self.a.paths, self.b.paths
        at_b = np.zeros((len(b), 2))
        seen = b.xy_m[all_b] + b.velocity_mps[all_b] * (shift * STEP_S - offset)
        at_b[all_b] = fit.mapped(seen)
        step = a.xy_m[i] - at_b[j]
        variance = (
            _NOISE_M**2
            + a.noise_m2[i]
            + b.noise_m2[j]
            + _LEFT**2 * (a.shared_m2[i] + b.shared_m2[j])
        )
        common = np.maximum(self.a.own_density[i], self.b.own_density[j])
        variance = wide * variance
        ratio = -0.5 * (step**2).sum(axis=1) / variance - np.log(2 * np.pi * variance * common)
        worth = np.maximum(self.a.worth[i], self.b.worth[j])
        gain = np.bincount(pair, worth * np.maximum(ratio, _WORST))
        row, of = self._one_to_one(i, j, pair, gain)
        total = float(gain[np.unique(of)].sum())
        alone_a, alone_b = _others(len(a), all_a, i[row]), _others(len(b), all_b, j[row])
        missed = self._missed(alone_a, alone_b, at_b[alone_b], fit)
        named, numbers = np.unique(of, return_inverse=True)
        return Matching(total - missed, i[row], j[row], numbers, gain[named], missed)

    def seen_by_both(
        self, fit: Fit, matching: Matching
    ) -> tuple[Int[np.ndarray, "n"], Bool[np.ndarray, "n"]]:
        """Rows of a, in order of time, that lie where b sees people too while both record, and
        whether b saw this one.
        """
        *_, all_a, _ = self.at(round(fit.parameters[4] / STEP_S))
        back = (self.a.paths.xy_m[all_a] - fit.parameters[:2]) @ np.linalg.inv(fit.linear).T
        rows = all_a[self.b.density(back) > 0]
        return rows, np.isin(rows, matching.row_a)

    def _one_to_one(
        self, i: np.ndarray, j: np.ndarray, pair: np.ndarray, gain: np.ndarray
    ) -> tuple[np.ndarray, np.ndarray]:
        """Moments of pairs that gain, each row of a track in the pair that gains most for it, and
        only where it is so for both.
        """
        row = np.flatnonzero(gain[pair] > 0)
        worth = gain[pair[row]]
        best_a = np.zeros(len(self.a.paths))
        best_b = np.zeros(len(self.b.paths))
        np.maximum.at(best_a, i[row], worth)
        np.maximum.at(best_b, j[row], worth)
        kept = (worth >= best_a[i[row]]) & (worth >= best_b[j[row]])
        row = row[kept]
        # A pair that keeps but a remnant of its moments is no match.
        had = np.bincount(pair, minlength=len(gain))
        has = np.bincount(pair[row], minlength=len(gain))
        row = row[2 * has[pair[row]] >= had[pair[row]]]
        return row, pair[row]

    def _missed(
        self, alone_a: np.ndarray, alone_b: np.ndarray, at_b: np.ndarray, fit: Fit
    ) -> float:
        """What it costs that people were seen by one camera only, where both see people."""
        a, b = self.a, self.b
        cost = b.worth[alone_b][a.density(at_b) > 0].sum()
        back = (a.paths.xy_m[alone_a] - fit.parameters[:2]) @ np.linalg.inv(fit.linear).T
        cost += a.worth[alone_a][b.density(back) > 0].sum()
        return _MISSED * float(cost)


def _during(tick: np.ndarray, other: np.ndarray) -> Int[np.ndarray, "m"]:
    """Rows from the first to the last of the other camera's ticks; both are in order."""
    if not len(other):
        return np.zeros(0, int)
    return np.arange(*np.searchsorted(tick, [other[0], other[-1] + 1]))


def _minute(tick: np.ndarray) -> np.ndarray:
    minute: np.ndarray = np.floor(tick * (STEP_S / 60.0)).astype(int)
    return minute


def _others(n: int, of: np.ndarray, without: np.ndarray) -> Int[np.ndarray, "m"]:
    """These rows of n without some."""
    others = np.zeros(n, bool)
    others[of] = True
    others[without] = False
    return np.flatnonzero(others)


_FIT_SIGMA = np.array([np.inf, np.inf, np.inf, 0.1, np.inf])
"""Prior of a fit: the log-scale."""
_LONGEST_STEP_S = 1.0


_WIDE = (4.0, 4.0, 2.0, 1.0, 1.0)
"""Variances of the steps to the best fit: wide first, for what votes say is rough."""


def fitted(meetings: Meetings, fit: Fit, wide: tuple[float, ...] = _WIDE) -> Fit:
    """The fit moved to the nearest best one: Gauss-Newton over its matches, matched anew each time.

    Returns the better of where it began and where it ended, with its score.
    """
    after = _walked(meetings, fit, wide)
    before = Fit(fit.parameters, meetings.matching(fit).score)
    return after if after.score > before.score else before


def later(meetings: Meetings, fit: Fit, seconds: float) -> Fit:
    """The best fit with the clocks so much further apart: people walking one way allow it, for a
    shift along their way does the same.
    """
    matching = meetings.matching(fit)
    way = meetings.b.paths.velocity_mps[matching.row_b].mean(axis=0) @ fit.linear.T
    start = fit.parameters + np.array([*(way * seconds), 0.0, 0.0, seconds])
    return _walked(meetings, Fit(start), _WIDE, held=True)


def _walked(meetings: Meetings, fit: Fit, wide: tuple[float, ...], held: bool = False) -> Fit:
    """Where a step for each width of the noise leads, with its score."""
    for widen in wide:
        matching = meetings.matching(fit, widen)
        if len(matching.row_a) < 4:
            break
        fit = Fit(fit.parameters + _step(meetings, fit, matching, held))
    return Fit(fit.parameters, meetings.matching(fit).score)


def _step(meetings: Meetings, fit: Fit, matching: Matching, held: bool) -> Float[np.ndarray, "5"]:
    """Gauss-Newton's step over the matches; the offset stays where it is ``held``."""
    a, b = meetings.a.paths.select(matching.row_a), meetings.b.paths.select(matching.row_b)
    offset = fit.parameters[4]
    seen = b.xy_m + b.velocity_mps * (a.tick * STEP_S - offset - b.tick * STEP_S)[:, None]
    turned, moving = seen @ fit.linear.T, b.velocity_mps @ fit.linear.T
    step = a.xy_m - turned - fit.parameters[:2]
    turned = turned + step / 2  # between the two: else noise shrinks the scale
    jacobian = np.zeros((len(step), 2, 5))
    jacobian[:, 0, 0] = jacobian[:, 1, 1] = 1.0
    jacobian[:, 0, 2], jacobian[:, 1, 2] = -turned[:, 1], turned[:, 0]
    jacobian[:, :, 3] = turned
    jacobian[:, :, 4] = -moving
    variance = _NOISE_M**2 + a.noise_m2 + b.noise_m2 + _LEFT**2 * (a.shared_m2 + b.shared_m2)
    q = (step**2).sum(axis=1) / variance
    weight = (STEP_S / _FACT_S) / variance / (1 + q / 4)
    normal = np.einsum("nap,n,naq->pq", jacobian, weight, jacobian) + np.diag(_FIT_SIGMA**-2.0)
    # What nothing tells stays where it is.
    normal += np.diag([1e-3, 1e-3, 1e-2, 0.0, 1e9 if held else 1e-2])
    force = np.einsum("nap,n,na->p", jacobian, weight, step) - fit.parameters * _FIT_SIGMA**-2.0
    moved: np.ndarray = np.linalg.solve(normal, force)
    moved[4] = np.clip(moved[4], -_LONGEST_STEP_S, _LONGEST_STEP_S)
    return moved
