"""What is minimised: people before a camera, what else speaks of it, and a point of the search."""

from dataclasses import dataclass, field, replace
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.calibration._body import N_PARAMETERS, Points
from scene4d.calibration._drift import N_DRIFTS, Drift
from scene4d.calibration._lines import Lines
from scene4d.calibration._prior import Prior
from scene4d.core.body import HEIGHT_SIGMA_M

# Unknowns: the camera, the azimuth of lines, the drift.
AZIMUTH = N_PARAMETERS  # of the lines, behind the camera
OF_LINES = slice(0, AZIMUTH + 1)
DRIFTS = slice(AZIMUTH + 1, AZIMUTH + 1 + N_DRIFTS)
N_UNKNOWNS = AZIMUTH + 1 + N_DRIFTS

# Chosen by hand on PETS 2009 and TownCentre, like the rest of the noise.
SHORT_RANGE, TURN_RANGE = 1.2, 0.8
"""Range of log length (legs hidden down to 30 % of a person: -ln 0.3) and of direction (radians,
46°: more than anybody leans) of outliers."""
_SHORT_FROM, _SHORT_EDGE = 1.0, 0.5
"""Where "too short" begins and how softly, in sigmas: earlier it would take people as modelled."""


@dataclass(frozen=True)
class Noise:
    """Spread of log length, direction (radians) and height (m) of people; shares of outliers.

    Starting values: walking people on PETS 2009 and TownCentre (gait included), to about a third.
    """

    along: float = 0.03
    across: float = 0.045
    box_along: float = 0.05
    height_m: float = HEIGHT_SIGMA_M
    short: float = 0.12
    stray: float = 0.05

    def widened(self, factor: float) -> "Noise":
        """Larger spreads for the search, which starts far from the answer."""
        names = ("along", "across", "box_along", "height_m")
        return replace(self, **{name: factor * getattr(self, name) for name in names})


@dataclass(frozen=True)
class TermValue:
    """What something besides people says of the camera: its part of the cost (-2 log p, up to a
    constant), half its gradient (7,), and half its second derivative (7, 7), positive semidefinite.
    """

    cost: float
    gradient: Float[np.ndarray, "7"]
    hessian: Float[np.ndarray, "7 7"]


@runtime_checkable
class Term(Protocol):
    """Anything besides people that says something about the camera: known points, vehicles.

    What it alone depends on (a position, a size) it eliminates by itself.
    """

    def at(self, parameters: Float[np.ndarray, "7"]) -> TermValue:
        """Its value at a camera."""
        ...


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that stays fixed while the camera is refined; ``blur`` is by how much the noise of
    each sighting exceeds :class:`Noise`.
    """

    points: Points
    track: Int[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]
    person_height_m: float
    prior: Prior
    lines: Lines | None = None
    terms: tuple[Term, ...] = ()
    blur: Float[np.ndarray, "n"] | None = None
    drift: Drift | None = None

    @cached_property
    def columns(self) -> tuple[int, ...]:
        """Indices of the free parameters."""
        return tuple(np.flatnonzero(self.prior.free).tolist())

    @cached_property
    def of_people(self) -> list[int]:
        """Indices of all unknowns that people tell: free parameters and drift."""
        drifts = [] if self.drift is None else range(N_UNKNOWNS)[DRIFTS]
        return [*self.columns, *drifts]

    @cached_property
    def free(self) -> Bool[np.ndarray, "14"]:
        """What is estimated: of the camera, the azimuth of lines, the drift."""
        drifts = np.full(N_DRIFTS, self.drift is not None)
        return np.concatenate([self.prior.free, [self.lines is not None], drifts])

    @cached_property
    def lone(self) -> Bool[np.ndarray, "n"]:
        """Who is seen once: its height cannot be told from noise, so it counts as noise."""
        return np.bincount(self.track)[self.track] == 1

    @cached_property
    def tracked(self) -> Int[np.ndarray, "m"]:
        """Rows of people who are seen more than once."""
        return np.flatnonzero(~self.lone)

    @cached_property
    def person(self) -> Int[np.ndarray, "m"]:
        """Which height each of the ``tracked`` rows has, 0 to ``n_heights - 1``."""
        return np.unique(self.track[self.tracked], return_inverse=True)[1]

    @cached_property
    def n_heights(self) -> int:
        """Number of people who are seen more than once, hence have a height of their own."""
        return int(self.person.max()) + 1 if len(self.person) else 0

    @cached_property
    def _by_person(self) -> tuple[np.ndarray, np.ndarray]:
        """The ``tracked`` rows in the order of their people, and where each begins."""
        order = np.argsort(self.person, kind="stable")
        return self.tracked[order], np.searchsorted(self.person[order], np.arange(self.n_heights))

    def per_person(self, values: Float[np.ndarray, "*k n"]) -> Float[np.ndarray, "*k t"]:
        """Sums over the sightings of everybody who has a height."""
        rows, starts = self._by_person
        if len(starts) == 0:
            return np.zeros((*values.shape[:-1], 0))
        sums: np.ndarray = np.add.reduceat(values[..., rows], starts, axis=-1)
        return sums

    def heights_m(self, delta_m: Float[np.ndarray, "t"]) -> float | Float[np.ndarray, "n"]:
        """Height of every sighting's person: the mean, and its own where it has one."""
        if self.n_heights == 0:
            return self.person_height_m
        heights = np.full(len(self.track), self.person_height_m)
        heights[self.tracked] += delta_m[self.person]
        return heights

    def select(self, rows: np.ndarray) -> "Problem":
        """The problem on some of its people."""
        _, track = np.unique(self.track[rows], return_inverse=True)
        blur = None if self.blur is None else self.blur[rows]
        drift = None if self.drift is None else self.drift.select(rows)
        points, weight = self.points.select(rows), self.weight[rows]
        return replace(self, points=points, track=track, weight=weight, blur=blur, drift=drift)


@dataclass(frozen=True, eq=False)
class State:
    """A point of the search: camera, heights above the mean (m), noise, azimuth of the lines,
    drift. ``rivals`` are other minima of the search: what they cost more, and their cameras.
    """

    parameters: Float[np.ndarray, "7"]
    delta_m: Float[np.ndarray, "t"]
    noise: Noise
    azimuth: float = 0.0
    drift: Float[np.ndarray, "6"] = field(default_factory=lambda: np.zeros(N_DRIFTS))
    rivals: tuple[tuple[float, Float[np.ndarray, "7"]], ...] = ()


def spreads(problem: Problem, noise: Noise) -> tuple[np.ndarray, np.ndarray]:
    """Standard deviations of log length and direction of every person (n,)."""
    box = problem.points.from_box
    along = np.where(box, noise.box_along, noise.along)
    across = np.full(len(box), noise.across)
    if problem.blur is not None:
        along, across = along * problem.blur, across * problem.blur
    height = noise.height_m / problem.person_height_m
    along = np.where(problem.lone, np.hypot(along, height), along)
    return along, across


def mixture(
    residual: np.ndarray, valid: np.ndarray, along: np.ndarray, across: np.ndarray, noise: Noise
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Who is as modelled, who is seen too short, and who is no person: a mixture over log length
    and direction (:mod:`._refine`).

    Per person the probability of being as modelled, of being upright, the push of the soft edge of
    "too short" on a, and ``-2 log p``. People whose prediction is invalid are strays: no camera may
    win by losing people.
    """
    a = np.where(valid, np.clip(residual[0], -1e3, 1e3), -1e3)
    upright = np.exp(-0.5 * np.where(valid, residual[1] ** 2, 1e6))
    edge = 1 / (1 + np.exp(np.clip((_SHORT_FROM - a) / _SHORT_EDGE, -40.0, 40.0)))  # logistic step
    flat_a = along * np.sqrt(2 * np.pi) / SHORT_RANGE
    flat_c = across * np.sqrt(2 * np.pi) / TURN_RANGE
    modelled = (1 - noise.short - noise.stray) * np.exp(-0.5 * a * a) * upright
    short = noise.short * flat_a * edge * upright
    total = modelled + short + noise.stray * flat_a * flat_c
    inlier, too_short = modelled / total, short / total
    push = np.where(valid, too_short * (1 - edge) / _SHORT_EDGE, 0.0)
    return inlier, inlier + too_short, push, -2 * np.log(total)
