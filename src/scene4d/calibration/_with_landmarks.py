"""People and landmarks together: starting points, the joint answer, and what contradicts what.

The errors that all people share (the lean that keypoints show, the mean height of a population) do
not go down with their number, so people must not outvote landmarks by it. What they tell is hence
taken as their answer with its whole covariance P, linearised where the answer comes to lie,

    (θ - θ_p)ᵀ P⁻¹ (θ - θ_p) + cost of the landmarks,     θ_p = θ₀ - A⁻¹ g at θ₀,

with gradient g and normal matrix A of the people at θ₀; repeated with the answer as the next θ₀.
"""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from scene4d.calibration._body import CORNER, FOCAL, HEIGHT, Points
from scene4d.calibration._joint import distinct, orientation_grid
from scene4d.calibration._landmarks import LandmarkTerm
from scene4d.calibration._prior import Prior, inverse_of
from scene4d.calibration._problem import Noise, Problem, State, TermValue
from scene4d.calibration._refine import descend
from scene4d.calibration._verdict import SIGMAS
from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.errors import InputError

_BLURS = (0.05, 0.01, 0.0)
"""Half diagonals by which pixels are blurred during the search: a step of the grid, then less."""
_STARTS = 4
_GRID_BEST = 40
_GRID_SPREAD, _GRID_OUTLIER = 0.1, 3.0
"""Spread of the log heights that landmarks tell at a node of the grid next to the answer, and how
many spreads count at most."""
_ROUNDS = 8
_SETTLED = 0.02
"""The rounds end when the answer moves by so many standard deviations."""
_MIRRORED_GAIN = 20.0
"""Cost (-2 log p) by which mirrored coordinates must fit better: odds of e^10."""


@dataclass(frozen=True, eq=False)
class Belief:
    """A Gaussian over the camera as a :class:`.refine.Term`; silent on fixed parameters."""

    mean: Float[np.ndarray, "7"]
    precision: Float[np.ndarray, "7 7"]

    @classmethod
    def of(cls, mean: Float[np.ndarray, "7"], covariance: Float[np.ndarray, "7 7"]) -> "Belief":
        """The belief with this covariance, zero for fixed parameters."""
        return cls(mean, inverse_of(covariance, np.diag(covariance) > 0))

    def at(self, parameters: Float[np.ndarray, "7"]) -> TermValue:
        """Its value at a camera."""
        gap = parameters - self.mean
        pull = self.precision @ gap
        return TermValue(float(gap @ pull), pull, self.precision)


def nobody(prior: Prior, *terms: LandmarkTerm | Belief) -> Problem:
    """A problem without people."""
    none = np.zeros((2, 0))
    points = Points(none, none, np.zeros(0, bool), 0.0)
    return Problem(points, np.zeros(0, int), np.zeros(0), PERSON_HEIGHT_M, prior, terms=terms)


def landmark_starts(term: LandmarkTerm, prior: Prior) -> Float[np.ndarray, "m 7"]:
    """The best distinct cameras of landmarks and prior alone, best first.

    For each orientation of the solver's grid, landmarks tell the height in closed form.
    """
    grid = orientation_grid(prior)
    told = term.log_heights(grid[:, :3], prior.mean[CORNER])
    known = np.isfinite(told).sum(axis=1)
    level = np.sort(told, axis=1)[np.arange(len(grid)), np.maximum(known - 1, 0) // 2]
    grid[known > 0, HEIGHT] = level[known > 0]
    apart2 = ((told - level[:, None]) / _GRID_SPREAD) ** 2
    cost = np.where(apart2 < _GRID_OUTLIER**2, apart2, _GRID_OUTLIER**2).sum(axis=1)
    cost = cost + prior.costs(grid)
    grid = grid[np.argsort(cost)[:_GRID_BEST]]
    blurred = term.blurred(_BLURS[0])
    order = np.argsort([blurred.rough_cost(parameters) for parameters in grid])
    refined = [_refined(term, prior, grid[i]) for i in distinct(grid, order, _STARTS)]
    best = min(refined, key=lambda pair: pair[0])[1]
    if term.robust and not term.right(best).min() > 0.5:
        refined += [_without_one(term, prior, best, i) for i in range(len(term.right(best)))]
    refined.sort(key=lambda pair: pair[0])
    return np.array([parameters for _, parameters in refined])


def _without_one(
    term: LandmarkTerm, prior: Prior, start: np.ndarray, index: int
) -> tuple[float, np.ndarray]:
    """As :func:`_refined`, from the answer of all landmarks but one."""
    state = State(start, np.zeros(0), Noise())
    others = replace(term.without(index), robust=False)
    for problem in (nobody(prior, others), nobody(prior, term)):
        state, lin = descend(problem, state, steps=12, tolerance=1e-3)
    return lin.cost, state.parameters


def _refined(term: LandmarkTerm, prior: Prior, start: np.ndarray) -> tuple[float, np.ndarray]:
    state = State(start, np.zeros(0), Noise())
    cost = np.inf
    for blur in _BLURS:
        problem = nobody(prior, term.blurred(blur) if blur else term)
        state, lin = descend(problem, state, steps=12, tolerance=1e-3)
        cost = lin.cost
    return cost, state.parameters


@dataclass(frozen=True, eq=False)
class Fused:
    """The most probable camera with its covariance, the belief of the people linearised there, and
    the term in force; ``stretch`` is the factor by which landmarks miss beyond what they state,
    which widened them (1 where they do not).
    """

    parameters: Float[np.ndarray, "7"]
    covariance: Float[np.ndarray, "7 7"]
    people: Belief
    term: LandmarkTerm
    prior: Prior
    stretch: float = 1.0

    def focal_sigma_without_people(self) -> float:
        """Relative standard deviation of the focal length by landmarks and prior alone."""
        told = self.prior.precision + self.term.at(self.parameters).hessian
        return float(np.sqrt(inverse_of(told, self.prior.free)[FOCAL, FOCAL]))


def fused(
    term: LandmarkTerm,
    prior: Prior,
    starts: Float[np.ndarray, "m 7"],
    people: Callable[[np.ndarray], Belief],
) -> Fused:
    """People and landmarks together, from the best of the starts.

    Landmarks that miss by more than they state are widened until they do not (Birge 1932). Raises
    :class:`InputError` where they fit as a mirror image alone.
    """
    found = _best(term, prior, starts, people)
    misses2, free = _misfit(found)
    badly = free > 0.5 and misses2 > _most_by_chance(free)
    if (badly or not term.right(found.parameters).min() > 0.5) and len(term.point_sigma_m) > 2:
        _check_handedness(term, prior, found)
    if not badly:
        return found
    stretch = float(np.sqrt(misses2 / free))
    again = _best(term.stretched(stretch), prior, found.parameters[None], people)
    return replace(again, stretch=stretch)


def _best(
    term: LandmarkTerm,
    prior: Prior,
    starts: np.ndarray,
    people: Callable[[np.ndarray], Belief],
) -> Fused:
    flat = replace(prior, sigma=np.where(prior.free, np.inf, 0.0))
    candidates: list[tuple[float, int, Fused]] = []
    for start in starts:
        parameters = start
        for _ in range(_ROUNDS):
            belief = people(parameters)
            state = State(parameters, np.zeros(0), Noise())
            state, lin = descend(nobody(flat, term, belief), state, steps=30, tolerance=1e-6)
            moved, parameters = state.parameters - parameters, state.parameters
            information = np.sum([other.hessian for other in lin.others], axis=0)
            if float(moved @ information @ moved) < _SETTLED**2:
                break
        covariance = inverse_of(information, prior.free)
        answer = Fused(parameters, covariance, belief, term, prior)
        candidates.append((lin.cost, len(candidates), answer))
    return min(candidates)[2]


def _misfit(found: Fused) -> tuple[float, float]:
    """Sum of squares of what landmarks miss by, and how many numbers of theirs are free to miss:
    all but those that the camera and their own frame take.
    """
    term, parameters = found.term, found.parameters
    right = term.right(parameters) > 0.5
    kinds = term.of_kinds(parameters, term.frame_at(parameters))
    squares = np.concatenate([residuals.off2 for residuals in kinds])
    numbers = np.concatenate([np.full(len(r.value), r.value.shape[1]) for r in kinds])
    taken = float(np.trace(term.at(parameters).hessian @ found.covariance))
    frame = 3 if len(term.point_sigma_m) else 0
    return float(squares[right].sum()), float(numbers[right].sum()) - frame - taken


def _most_by_chance(free: float) -> float:
    """The sum of so many squares that chance exceeds as it does four standard deviations, by the
    cube root that is nearly normal (Wilson and Hilferty 1931).
    """
    spread2 = 2 / (9 * free)
    return free * float(1 - spread2 + SIGMAS * np.sqrt(spread2)) ** 3


def _check_handedness(term: LandmarkTerm, prior: Prior, found: Fused) -> None:
    mirrored = term.mirrored()
    start = landmark_starts(mirrored, prior)[0]
    there = _best(mirrored, prior, start[None], lambda _: Belief(prior.mean, prior.precision))
    if mirrored.at(there.parameters).cost < term.at(found.parameters).cost - _MIRRORED_GAIN:
        raise InputError(
            "landmarks: the ground points fit as a mirror image alone; seen from above, y must be "
            "to the left of x (swap x and y, or change the sign of one)"
        )
