"""Covariance of the refined camera: the data's noise, and what the model itself may get wrong."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from scene4d.calibration._body import N_PARAMETERS, Points
from scene4d.calibration._refine import (
    Problem,
    State,
    linearise,
    normal_equations,
    observed_weights,
)

_OUTLIER_LEAK = 0.03
"""Bias of length (and of length against distance) for a share 1 of shortened people: those cut by
little pass for people. Read off synthetic scenes with 10 to 40 % of them (tests/calibration)."""


def covariance(
    problem: Problem, state: State, *, systematics: bool = False
) -> Float[np.ndarray, "7 7"]:
    """Posterior covariance of the camera with the heights (and the azimuth) marginalised.

    The inverse of the Gauss-Newton matrix with heights eliminated, at the information that the
    mixture of people and outliers leaves; then what :func:`_shared` effects add. Fixed parameters
    have zero rows. ``systematics`` counts those of real footage.
    """
    inverse = _inverse_hessian(problem, state)
    leak = _OUTLIER_LEAK * state.noise.short
    effects = [
        Systematic("outliers taken for people: size", leak, _growing),
        Systematic("outliers taken for people: length", leak, _stretched),
    ]
    if systematics and problem.drift is None:
        effects += _SYSTEMATICS
    own = inverse[:N_PARAMETERS, :N_PARAMETERS]
    return own + _shared(problem, state, inverse, effects)


def _inverse_hessian(problem: Problem, state: State) -> np.ndarray:
    lin = linearise(problem, state)
    lin = replace(lin, weight=observed_weights(problem, lin))
    hessian = normal_equations(problem, state, lin).hessian
    free = problem.free
    inverse = np.zeros_like(hessian)
    inverse[np.ix_(free, free)] = np.linalg.inv(hessian[np.ix_(free, free)])
    return inverse


def _gradient(problem: Problem, state: State) -> np.ndarray:
    return normal_equations(problem, state, linearise(problem, state)).gradient


@dataclass(frozen=True)
class Systematic:
    """An effect that all people share: its spread, and what one unit of it does to the points."""

    name: str
    sigma: float
    disturb: Callable[[Points, float], Points]


def _leaning(points: Points, amount: float) -> Points:
    """Everybody seen more upright than they are, by a fraction of their lean in the image."""
    span = points.seen
    turn = amount * np.arctan2(span[0], -span[1])
    turned = np.stack([span[0] - turn * -span[1], span[1] - turn * span[0]])
    return replace(points, head=points.foot + turned)


def _longer(points: Points, fraction: float | np.ndarray) -> Points:
    """Everybody seen longer by a fraction, of each its own where it is (n,)."""
    return replace(points, head=points.foot + points.seen * (1 + fraction))


def _stretched(points: Points, amount: float) -> Points:
    """Everybody seen longer by the same fraction."""
    return _longer(points, amount)


def _growing(points: Points, amount: float) -> Points:
    """Everybody seen longer by a fraction that grows with the logarithm of their length."""
    size = 0.5 * np.log(points.seen2)
    return _longer(points, amount * (size - np.median(size)))


def _growing_aside(points: Points, amount: float) -> Points:
    """Everybody seen longer by a fraction that grows across the picture, in half diagonals."""
    return _longer(points, amount * points.foot[0])


_SYSTEMATICS: tuple[Systematic, ...] = (
    Systematic("lean of people", 0.08, _leaning),
    Systematic("size against distance", 0.03, _growing),
    Systematic("size across the picture", 0.02, _growing_aside),
)
"""Found on real footage (benchmarks/keypoint_bias.py): lean seen 12 ± 5 % too small, size wrong by
4 % per e-fold of distance. Boxes have no lean, and their size drifts (:mod:`._drift`)."""


def _shared(
    problem: Problem, state: State, inverse: np.ndarray, effects: list[Systematic]
) -> np.ndarray:
    """What shared effects add to the covariance (Schmidt's consider covariance).

    Each effect b moves the minimum by ``-A⁻¹ ∂g/∂b``; the gradient's change is taken by a
    difference quotient over the disturbed points.
    """
    total = np.zeros((N_PARAMETERS, N_PARAMETERS))
    here = _gradient(problem, state)
    for effect in effects:
        disturbed = replace(problem, points=effect.disturb(problem.points, effect.sigma))
        shift = -(inverse @ (_gradient(disturbed, state) - here))[:N_PARAMETERS]
        total += np.outer(shift, shift)
    return total
