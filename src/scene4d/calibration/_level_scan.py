"""Score test for a second ground level: which part of the picture would like its own ground?

People who stand z metres above the camera's ground are seen longer, since the camera stands lower
above their feet: ``log length`` grows by ``-log(1 - z / h)`` wherever they are. The forward model
has the exact derivative: z enters only through the clearance ``h - z - z_f`` of :mod:`._body`, so
that ``d/dz = -(1 / h) d/d(log h)`` for those who stand there.

At the solution without a second level, the gain of one is the score test (Rao 1948)

    T = g² / S,    g = Xᵀ W M r,    S = Xᵀ W M X,

where X is that derivative inside the region and zero outside, r are the residuals and M projects
out what else could explain them: the camera (with its prior), one height per track, and what all
people of real footage share (``fields``). T is the fall of the cost to first order. Products over
people are matrix products over hundreds of regions at once.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._body import HEIGHT
from scene4d.calibration._problem import Problem, State, spreads
from scene4d.calibration._refine import linearise

NARROW, WIDE = 3.0, 9.0
"""Widths of the robust loss, in standard deviations. The narrow one leaves out people whose legs
are hidden; a high step is an outlier to it as well, and only the wide one sees that."""
_TALL = 3.0
"""Heights beyond this many standard deviations pull no harder (Huber)."""
_DIRECTIONS = 16
"""Directions of cuts, 11° apart, in coordinates in which the feet are as wide as deep."""
_OFFSETS = 28
"""Offsets of cuts in each direction, at even shares of the sightings."""
_MOST_CUTS = 3
"""A region has at most so many sides of its own: a corner, a strip, or a strip that ends."""
_MOST_ROWS = 600
"""So many sightings are enough to choose a region; the decision is made on all."""


@dataclass(frozen=True, eq=False)
class Region:
    """Where every one of ``cuts`` (k, 3) holds: ``a u + b v > c`` in pixels of the footage."""

    cuts: Float[np.ndarray, "k 3"]
    score: float = 0.0

    def holds(self, uv: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "n"]:
        """Which feet lie in it."""
        return np.asarray(held(self.cuts, uv).all(axis=0))


def held(cuts: Float[np.ndarray, "k 3"], uv: Float[np.ndarray, "n 2"]) -> Bool[np.ndarray, "k n"]:
    """Which cuts hold for which pixels."""
    above: np.ndarray = cuts[:, :2] @ uv.T > cuts[:, 2:]
    return above


@dataclass(frozen=True, eq=False)
class Field:
    """An error that people share: log length by row (n,), of standard deviation ``sigma``."""

    shape: Float[np.ndarray, "n"]
    sigma: float


class Scores:
    """Score tests of regions at a solution, everything else projected out.

    ``within_tracks`` takes only differences between the places of one person: heights are then
    free, people who stay on one side tell nothing, and the camera's height, which sets the scale
    of all heights together, is held.
    """

    def __init__(
        self,
        problem: Problem,
        state: State,
        fields: list[Field],
        *,
        width: float = NARROW,
        within_tracks: bool = False,
    ) -> None:
        free = np.array([c for c in problem.columns if not (within_tracks and c == HEIGHT)])
        residual, weight, columns, base, by_height = _robust(problem, state, fields, width, free)
        precision, pull = _other_terms(problem, state, fields, free)
        flat = columns.reshape(len(columns), -1)
        hessian = (columns * weight).reshape(flat.shape) @ flat.T + precision
        gradient = flat @ (weight * residual).ravel() + pull
        stiffness = 1e-6 if within_tracks else 1 / state.noise.height_m**2
        pairs = [residual, base, *columns]
        self._all = np.stack([(weight * base * v).sum(axis=0) for v in pairs])
        heights = [(weight * by_height * v).sum(axis=0) for v in (by_height, *pairs)]
        self._pull = heights[2]  # what a row inside adds to its height's coupling
        per_track = problem.per_person(np.stack(heights))
        self._information = per_track[0] + stiffness
        self._height_gradient, self._coupling = per_track[1], per_track[3:]
        scaled = self._coupling / self._information
        self._inverse = np.linalg.inv(hessian - scaled @ self._coupling.T)
        self._problem, self._weight, self._columns = problem, weight, columns
        self._base, self._by_height = base, by_height
        self._along = spreads(problem, state.noise)[0]
        self._gradient = gradient - scaled @ self._height_gradient

    def of(
        self, inside: Bool[np.ndarray, "m n"] | Float[np.ndarray, "m n"]
    ) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
        """Score T, estimate of z (m) and its standard deviation, of each of m regions, or of ground
        that rises as stated from person to person.
        """
        shape = inside.astype(float)
        sums = shape @ self._all.T
        gradient, columns = sums[:, 0], sums[:, 2:]
        information = (shape * shape) @ self._all[1]
        tracks = self._problem.per_person(inside * self._pull)
        scaled = tracks / self._information
        gradient = gradient - scaled @ self._height_gradient
        information = information - (scaled * tracks).sum(axis=1)
        columns = columns - scaled @ self._coupling.T
        projected = columns @ self._inverse
        gradient = gradient - projected @ self._gradient
        information = np.maximum(information - (projected * columns).sum(axis=1), 1e-9)
        return gradient**2 / information, -gradient / information, information**-0.5

    def sigma_by_track(self, inside: Bool[np.ndarray, "n"], sigma: float) -> float:
        """Standard deviation of z (m) if every track's log length has an error of its own, of
        standard deviation ``sigma``, on this side.
        """
        sums = self._all @ inside
        tracks = self._problem.per_person(inside * self._pull)
        columns = sums[2:] - (tracks / self._information) @ self._coupling.T
        shared = self._inverse @ columns
        own = np.zeros(len(inside))
        per_track = (tracks - shared @ self._coupling) / self._information
        own[self._problem.tracked] = per_track[self._problem.person]
        left = self._base * inside - np.tensordot(shared, self._columns, 1) - self._by_height * own
        pull = np.where(inside, (self._weight * left)[0] / self._along, 0.0)
        summed = np.bincount(self._problem.track, pull)
        return sigma * float(np.sqrt((summed**2).sum()) * self.of(inside[None])[2][0] ** 2)


def _robust(
    problem: Problem, state: State, fields: list[Field], width: float, free: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Residuals (2, n) at the mean height, their weights, the columns (p, 2, n) of what else may
    explain them, and their derivatives by z and by a person's height.
    """
    own = linearise(problem, state).residual
    lin = linearise(problem, replace(state, delta_m=np.zeros(problem.n_heights)))
    along = spreads(problem, state.noise)[0]
    weight = problem.weight / (1 + (own / np.array([[width], [NARROW]])) ** 2) ** 2
    tall = _TALL * state.noise.height_m / np.maximum(np.abs(state.delta_m), 1e-9)
    weight[:, problem.tracked] *= np.minimum(1.0, tall)[problem.person]
    shared = [np.stack([-f.shape / along, np.zeros_like(along)]) for f in fields]
    rows = {column: row for row, column in enumerate(problem.columns)}
    drift = lin.by_parameter[len(rows) :]
    columns = np.stack([*(lin.by_parameter[rows[c]] for c in free), *drift, *shared])
    by_level = -lin.by_parameter[rows[HEIGHT]] / np.exp(state.parameters[HEIGHT])
    return lin.residual, weight, columns, by_level, lin.by_height


def _other_terms(
    problem: Problem, state: State, fields: list[Field], free: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Information and gradient of what is not people: prior, further terms, lines, the drift of
    boxes, and fields.
    """
    lin = linearise(problem, state)
    known = problem.prior.precision.copy()
    pull = known @ (state.parameters - problem.prior.mean)
    for other in lin.others:
        known, pull = known + other.hessian, pull + other.gradient
    if lin.lines is not None:
        pulled = lin.lines.derivative * lin.lines.weight
        hessian, gradient = pulled @ lin.lines.derivative.T, pulled @ lin.lines.residual
        turned = hessian[:-1, -1] / max(float(hessian[-1, -1]), 1e-9)  # the azimuth eliminated
        known = known + hessian[:-1, :-1] - np.outer(turned, hessian[-1, :-1])
        pull = pull + gradient[:-1] - turned * gradient[-1]
    n = len(free)
    drift = np.zeros(0) if problem.drift is None else problem.drift.precision
    precision = np.diag([0.0] * n + drift.tolist() + [f.sigma**-2 for f in fields])
    precision[:n, :n] = known[np.ix_(free, free)]
    pulls = [pull[free], drift * state.drift[: len(drift)], np.zeros(len(fields))]
    return precision, np.concatenate(pulls)


def best_regions(
    foot_uv: Float[np.ndarray, "n 2"],
    weight: Float[np.ndarray, "n"],
    scores: Scores,
    *,
    least_weight: float,
    keep: int,
) -> list[Region]:
    """The regions of highest score, less the price of their sides, best first.

    Cuts are added one after the other; each must gain its price, as its two numbers cost.
    """
    seen = _Sightings(foot_uv, weight, scores, least_weight)
    price = 2 * float(np.log(weight.sum()))
    best: list[Region] = []
    for region in seen.cut(Region(np.empty((0, 3))), keep):
        for now in (region, Region(-region.cuts, region.score)):
            for _ in range(_MOST_CUTS - 1):
                more = seen.cut(now, 1)
                if not more or more[0].score < now.score + price:
                    break
                now = more[0]
            best.append(now)
    best.sort(key=lambda r: price * len(r.cuts) - r.score)
    return best[:keep]


@dataclass(frozen=True, eq=False)
class _Sightings:
    """What regions are chosen among."""

    foot_uv: Float[np.ndarray, "n 2"]
    weight: Float[np.ndarray, "n"]
    scores: Scores
    least_weight: float

    def cut(self, region: Region, keep: int) -> list[Region]:
        """The region with one more cut: the best ``keep`` of them that differ."""
        rows = region.holds(self.foot_uv)
        cuts = _candidates(self.foot_uv[rows], self.weight[rows])
        if len(region.cuts):
            cuts = np.concatenate([cuts, -cuts])
        inside = held(cuts, self.foot_uv) & rows
        share = inside @ self.weight
        rest = self.weight.sum() - share
        large = (share >= self.least_weight) & (rest >= self.least_weight)
        if len(region.cuts):  # most people around a few would be an error of the lens
            large &= share <= rest
        cuts, inside = cuts[large], inside[large]
        if len(cuts) == 0:
            return []
        score = self.scores.of(inside)[0]
        return [
            Region(np.vstack([region.cuts, cuts[k]]), float(score[k]))
            for k in self._different(inside, np.argsort(-score), keep)
        ]

    def _different(self, inside: np.ndarray, order: np.ndarray, keep: int) -> list[int]:
        """The first ``keep`` rows of ``inside`` in order that are not nearly the same."""
        chosen: list[int] = []
        for index in order:
            apart = [float((inside[index] ^ inside[k]) @ self.weight) for k in chosen]
            rest = float(self.weight.sum())
            if all(min(a, rest - a) > self.least_weight for a in apart):
                chosen.append(int(index))
            if len(chosen) == keep:
                break
        return chosen


def _candidates(uv: Float[np.ndarray, "n 2"], weight: Float[np.ndarray, "n"]) -> np.ndarray:
    """Cuts (m, 3) at even shares of the weight, in every direction over half a turn."""
    if len(uv) < 2:
        return np.empty((0, 3))
    angle = np.arange(_DIRECTIONS) * np.pi / _DIRECTIONS
    normal = np.column_stack([np.cos(angle), np.sin(angle)]) / np.maximum(uv.std(axis=0), 1e-9)
    at = normal @ uv.T
    order = np.argsort(at, axis=1)
    share = np.cumsum(weight[order], axis=1) / weight.sum()
    wanted = (np.arange(_OFFSETS) + 0.5) / _OFFSETS
    k = np.minimum((share[:, :, None] < wanted).sum(axis=1), len(uv) - 2)
    ranked = np.take_along_axis(at, order, axis=1)
    left, right = (np.take_along_axis(ranked, i, axis=1) for i in (k, k + 1))
    new = np.diff(k, axis=1, prepend=-1) > 0  # few people: several shares end at the same one
    return np.column_stack([np.repeat(normal, new.sum(axis=1), axis=0), ((left + right) / 2)[new]])


def thinned(problem: Problem, state: State) -> tuple[np.ndarray, Problem, State]:
    """An even sample of the sightings: rows, problem and state. They weigh as much as all, but none
    of them more than a sighting in a place of its own.
    """
    n = len(problem.track)
    rows = np.unique(np.linspace(0, n - 1, min(n, _MOST_ROWS)).astype(int))
    if len(rows) == n:
        return rows, problem, state
    few = problem.select(rows)
    few = replace(few, weight=np.minimum(few.weight * (n / len(rows)), 1.0))
    own_m = np.zeros(len(problem.track))
    own_m[problem.tracked] = state.delta_m[problem.person]
    delta_m = np.zeros(few.n_heights)
    delta_m[few.person] = own_m[rows][few.tracked]
    return rows, few, replace(state, delta_m=delta_m)
