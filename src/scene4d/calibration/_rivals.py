"""Do some of the people agree on another camera? A screen, a mirror, two views in one picture.

Whoever does not fit the camera is asked alone. Legs behind a car shorten people in no order, and
no other camera explains them; people on a screen, or those of a second view, make one of their own.
Children and people on another level keep the orientation, and are no contradiction.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration._body import HEIGHT, N_PARAMETERS
from scene4d.calibration._evidence import evidence, log_density
from scene4d.calibration._joint import most_agreeing, solve
from scene4d.calibration._problem import Problem, State
from scene4d.calibration._refine import linearise, minimise

# Synthetic screens, second views, levels, children and legs hidden at random, and 14 recordings
# with sub-samples of their tracks: a second view has 0.77 to 1.0 and more than 24, legs hidden at
# random 0.43 to 0.66, and no recording more than 5.
_LEAST_SHARE = 0.1
"""Of all sightings, by places: fewer hardly move the camera."""
_LEAST_PEOPLE = 3
_LEAST_AGREEING = 0.75
"""Share of them that the other camera must explain."""
_LEAST_EVIDENCE = 10.0
"""For the other camera (:func:`.evidence`): odds of 20,000 to 1."""
_TURNED = 5.0
"""Log likelihood by which it must be better than this camera at another height: those who stand
higher or lower, or are smaller, contradict nothing."""
_STRANGE_DRIFT = 2.5
_AT_EASE = 0.85
"""A drift beyond so many of its sigmas, or a smaller share that agrees, and the groups are looked
for without drift. Recordings have up to 1.9 sigmas, screens beside as many people 3.0 to 3.5."""


@dataclass(frozen=True, eq=False)
class Rival:
    """Who agrees on another camera (m rows), which share of all they are, and that camera."""

    rows: Int[np.ndarray, "m"]
    share: float
    parameters: Float[np.ndarray, "7"]


def find_rival(problem: Problem, state: State, *, seed: int = 0) -> Rival | None:
    """Another camera, on which those agree who do not fit this one; None where they do not."""
    weight, inlier = problem.weight, linearise(problem, state).inlier
    if _gives_way(problem, state, inlier):
        problem = replace(problem, drift=None)
        stiff = solve(problem, seed=seed)
        state = state if stiff is None else stiff
        inlier = linearise(problem, state).inlier
    fitting = np.bincount(problem.track, weight * inlier) / np.bincount(problem.track, weight)
    rows = np.flatnonzero((fitting < 0.5)[problem.track])
    share = float(weight[rows].sum() / weight.sum())
    if (fitting < 0.5).sum() < _LEAST_PEOPLE or share < _LEAST_SHARE:
        return None
    theirs = replace(problem.select(rows), lines=None, terms=())
    if most_agreeing(theirs) < _LEAST_AGREEING:
        return None
    other = solve(theirs, seed=seed)
    if other is None:
        return None
    agreeing = _agreeing(theirs, linearise(theirs, other).inlier)
    if agreeing < _LEAST_AGREEING or not evidence(theirs, other) > _LEAST_EVIDENCE:
        return None
    if _likelihood(theirs, other) < _at_another_height(theirs, state, other, seed) + _TURNED:
        return None
    return Rival(rows, share, other.parameters)


def _gives_way(problem: Problem, state: State, inlier: Float[np.ndarray, "n"]) -> bool:
    """Whether the drift that all people share may have made peace between two groups."""
    if problem.drift is None:
        return False
    strange = np.abs(state.drift) * np.sqrt(problem.drift.precision)
    return bool(strange.max() > _STRANGE_DRIFT or _agreeing(problem, inlier) < _AT_EASE)


def _agreeing(problem: Problem, inlier: Float[np.ndarray, "n"]) -> float:
    return float(problem.weight @ inlier / problem.weight.sum())


def _likelihood(problem: Problem, state: State) -> float:
    return float(problem.weight @ log_density(problem, state))


def _at_another_height(problem: Problem, state: State, other: State, seed: int) -> float:
    """Log likelihood of these people before the camera ``state``, of which only the height may
    change; searched for, and from the ``other`` camera's height.
    """
    mean, sigma = state.parameters.copy(), np.zeros(N_PARAMETERS)
    mean[HEIGHT], sigma[HEIGHT] = problem.prior.mean[HEIGHT], problem.prior.sigma[HEIGHT]
    kept = replace(problem, prior=replace(problem.prior, mean=mean, sigma=sigma))
    start = mean.copy()
    start[HEIGHT] = other.parameters[HEIGHT]
    found = [
        solve(kept, seed=seed),
        minimise(kept, replace(other, parameters=start), steps=10, tolerance=0.1),
    ]
    return max(_likelihood(problem, one) for one in found if one is not None)
