"""Covariance of the refined camera: the data's noise, and what the model itself may get wrong."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from scene4d.calibrate.body import N_PARAMETERS, Points
from scene4d.calibrate.refine import (
    VARIANCE_FACTOR,
    Problem,
    State,
    linearise,
    normal_equations,
)


def covariance(problem: Problem, state: State) -> Float[np.ndarray, "5 5"]:
    """Posterior covariance of the camera with the heights (and the azimuth) marginalised.

    The inverse of the Gauss-Newton matrix with heights eliminated; the share that comes from
    people is scaled by the efficiency of the robust loss. Fixed parameters have zero rows.
    """
    inverse, _ = _inverse_hessian(problem, state)
    return inverse[:N_PARAMETERS, :N_PARAMETERS]


def _inverse_hessian(problem: Problem, state: State) -> tuple[np.ndarray, np.ndarray]:
    system = normal_equations(problem, state, linearise(problem, state))
    free = np.append(problem.prior.free, problem.lines is not None)
    inverse = np.zeros_like(system.hessian)
    prior = np.diag(np.append(problem.prior.precision, 0.0))
    hessian = (system.hessian - prior) / VARIANCE_FACTOR + prior
    inverse[np.ix_(free, free)] = np.linalg.inv(hessian[np.ix_(free, free)])
    return inverse, system.gradient


@dataclass(frozen=True)
class Systematic:
    """An effect that all people share: its spread, and what one unit of it does to the points."""

    name: str
    sigma: float
    disturb: Callable[[Points, float], Points]


def _shifted(axis: int) -> Callable[[Points, float], Points]:
    def disturb(points: Points, amount: float) -> Points:
        offset = np.zeros((2, 1))
        offset[axis] = amount
        return replace(points, foot=points.foot + offset, head=points.head + offset)

    return disturb


def _leaning(points: Points, amount: float) -> Points:
    """Everybody seen more upright than they are, by a fraction of their lean in the image."""
    span = points.head - points.foot
    turn = amount * np.arctan2(span[0], -span[1])
    turned = np.stack([span[0] - turn * -span[1], span[1] - turn * span[0]])
    return replace(points, head=points.foot + turned)


def _growing(points: Points, amount: float) -> Points:
    """Everybody seen longer by a fraction that grows with the logarithm of their length."""
    span = points.head - points.foot
    size = np.log(np.sqrt((span * span).sum(axis=0)))
    return replace(points, head=points.foot + span * (1 + amount * (size - np.median(size))))


SYSTEMATICS: tuple[Systematic, ...] = (
    Systematic("principal point, u", 0.03, _shifted(0)),
    Systematic("principal point, v", 0.03, _shifted(1)),
    Systematic("lean of people", 0.08, _leaning),
    Systematic("size against distance", 0.02, _growing),
)
"""Found on real footage: lenses are off centre by some per cent of the half diagonal, networks
and crowds show a few per cent of error in lean, and in size with distance and viewing angle."""


def systematic_covariance(
    problem: Problem, state: State, systematics: tuple[Systematic, ...] = SYSTEMATICS
) -> Float[np.ndarray, "5 5"]:
    """What the shared effects add to the covariance (Schmidt's consider covariance).

    Each effect b moves the minimum by ``-A⁻¹ ∂g/∂b``; the gradient's change is taken by a
    difference quotient over the disturbed points.
    """
    inverse, _ = _inverse_hessian(problem, state)
    total = np.zeros((N_PARAMETERS, N_PARAMETERS))
    for effect in systematics:
        gradients = []
        for sign in (-0.5, 0.5):
            disturbed = replace(
                problem, points=effect.disturb(problem.points, sign * effect.sigma)
            )
            gradients.append(_inverse_hessian(disturbed, state)[1])
        shift = -(inverse @ (gradients[1] - gradients[0]))[:N_PARAMETERS] / VARIANCE_FACTOR
        total += np.outer(shift, shift)
    return total
