"""Covariance of the refined camera: the data's noise, and what the model itself may get wrong."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Float

from scene4d.calibration._body import N_PARAMETERS, Points
from scene4d.calibration._prior import inverse_of
from scene4d.calibration._problem import Problem, State
from scene4d.calibration._refine import (
    Linearisation,
    NormalEquations,
    linearise,
    normal_equations,
    observed_weights,
)

_OUTLIER_LEAK = 0.03
"""Bias of length (and of length against distance) for a share 1 of shortened people: those cut by
little pass for people. Read off synthetic scenes with 10 to 40 % of them (tests/calibration)."""
_GROUPS = 40
"""More tracks than this are left out in groups: so many tell a standard deviation to a ninth."""
_MODEL_TRACKS = 5.0
"""The model's own variance counts as that of so many tracks. Chosen: with five the jackknife tells
a standard deviation to a third, about as well as the model is known to hold."""


def covariance(problem: Problem, state: State) -> Float[np.ndarray, "7 7"]:
    """Posterior covariance of the camera with everything else marginalised.

    The inverse of the Gauss-Newton matrix with heights eliminated, at the information that the
    mixture of people and outliers leaves; then what :func:`_shared` effects add. Fixed parameters
    have zero rows.
    """
    lin = linearise(problem, state)
    inverse = _inverse_hessian(problem, state, lin)
    leak = _OUTLIER_LEAK * state.noise.short
    effects: list[_Effect] = [
        (leak, _growing),  # outliers taken for people: size and length
        (leak, _longer),
        (problem.points.ground_sigma_m, _raised),
    ]
    own = inverse[:N_PARAMETERS, :N_PARAMETERS]
    if len(problem.track) == 0:
        return own
    system = normal_equations(problem, state, lin)
    scatter = _beyond_the_model(problem, lin, system, inverse)
    shared = _shared(problem, state, system.gradient, inverse, effects)
    return own + scatter + shared + _of_rivals(state)


def _of_rivals(state: State) -> Float[np.ndarray, "7 7"]:
    """What other minima of nearly the same cost add: the spread of a mixture about the best one."""
    total = np.zeros((N_PARAMETERS, N_PARAMETERS))
    odds = [np.exp(-cost / 2) for cost, _ in state.rivals]
    for share, (_, parameters) in zip(odds, state.rivals, strict=True):
        away = parameters - state.parameters
        total += share / (1 + sum(odds)) * np.outer(away, away)
    return total


def most_probable(problem: Problem, state: State) -> Float[np.ndarray, "7"]:
    """The camera at the minimum of the quadratic that fits the cost at ``state``."""
    lin = linearise(problem, state)
    system = normal_equations(problem, state, lin)
    free = np.flatnonzero(problem.free)
    found = state.parameters.copy()
    step = np.linalg.solve(system.hessian[np.ix_(free, free)], system.gradient[free])
    camera = free < N_PARAMETERS
    found[free[camera]] -= step[camera]
    return found


def data_covariance(problem: Problem, state: State) -> Float[np.ndarray, "7 7"]:
    """The part of :func:`covariance` that the cost at ``state`` tells."""
    inverse = _inverse_hessian(problem, state, linearise(problem, state))
    return inverse[:N_PARAMETERS, :N_PARAMETERS]


def _inverse_hessian(problem: Problem, state: State, lin: Linearisation) -> np.ndarray:
    lin = replace(lin, weight=observed_weights(problem, lin))
    return inverse_of(normal_equations(problem, state, lin).hessian, problem.free)


def _beyond_the_model(
    problem: Problem,
    lin: Linearisation,
    system: NormalEquations,
    inverse: Float[np.ndarray, "14 14"],
) -> Float[np.ndarray, "7 7"]:
    """Variance that a jackknife over tracks shows beyond that of independent errors.

    Leaving out track t moves the camera by ``(A - A_t)⁻¹ g_t``, with its part ``A_t`` of the normal
    matrix and ``g_t`` of the gradient: one step of Newton's method for each track, heights
    eliminated, so that no camera is solved anew. The sum of squares is the delete-one jackknife
    (CR3 of Bell and McCaffrey 2002). It is compared with what the model says of people's errors,
    direction by direction; a few tracks tell a variance badly, so the model counts as
    :data:`_MODEL_TRACKS` of them (the mean of an inverse Wishart posterior). It never narrows.
    """
    gradient, information = _of_tracks(problem, lin, system)
    count = len(gradient)
    if count < 2:
        return np.zeros((N_PARAMETERS, N_PARAMETERS))
    free = problem.of_people
    camera = np.ix_(free, free)
    without = np.linalg.inv(inverse[camera]) - information
    steps = np.linalg.solve(without, gradient[:, :, None])[:, :, 0]
    jackknife = (count - 1) / count * steps.T @ steps
    people = inverse[camera] @ information.sum(axis=0) @ inverse[camera]
    size, axes = np.linalg.eigh(people)
    if not size.max() > 0:  # nobody says anything
        return np.zeros((N_PARAMETERS, N_PARAMETERS))
    root = axes * np.sqrt(np.maximum(size, 0.0))
    flat = axes / np.sqrt(np.maximum(size, 1e-9 * size.max()))
    ratio = (_MODEL_TRACKS * np.eye(len(free)) + count * flat.T @ jackknife @ flat) / (
        _MODEL_TRACKS + count
    )
    more, turned = np.linalg.eigh(ratio)
    wide = root @ turned * np.sqrt(np.maximum(more - 1.0, 0.0))
    total = np.zeros_like(inverse)
    total[camera] = wide @ wide.T
    return total[:N_PARAMETERS, :N_PARAMETERS]


def _of_tracks(
    problem: Problem, lin: Linearisation, system: NormalEquations
) -> tuple[np.ndarray, np.ndarray]:
    """Gradient (t, p) and normal matrix (t, p, p) by the free parameters of every track, or group
    of tracks, with its own height eliminated.
    """
    group = np.unique(problem.track % _GROUPS, return_inverse=True)[1]
    count, p = int(group.max(initial=-1)) + 1, len(problem.of_people)
    by = lin.by_parameter
    gradient = np.zeros((count, p))
    np.add.at(gradient, group, (by * lin.force).sum(axis=1).T)
    information = np.zeros((count, p, p))
    np.add.at(information, group, np.einsum("pan,an,qan->npq", by, lin.weight, by))
    if problem.n_heights:
        owner = np.zeros(problem.n_heights, int)
        owner[problem.person] = group[problem.tracked]
        coupling = system.coupling[problem.of_people]
        hidden = np.einsum("pt,qt->tpq", coupling / system.height_information, coupling)
        np.subtract.at(information, owner, hidden)
    return gradient, information


def _gradient(problem: Problem, state: State) -> np.ndarray:
    return normal_equations(problem, state, linearise(problem, state)).gradient


_Effect = tuple[float, Callable[[Points, float], Points]]
"""An effect that all people share: its spread, and what so much of it does to the points."""


def _longer(points: Points, fraction: float | np.ndarray) -> Points:
    """Everybody seen longer by a fraction, of each its own where it is (n,)."""
    return replace(points, head=points.foot + points.seen * (1 + fraction))


def _raised(points: Points, amount: float) -> Points:
    """Everybody on another level than the camera's ground stands higher (m)."""
    return replace(points, ground_m=np.where(points.ground_m != 0, points.ground_m + amount, 0.0))


def _growing(points: Points, amount: float) -> Points:
    """Everybody seen longer by a fraction that grows with the logarithm of their length."""
    size = 0.5 * np.log(points.seen2)
    return _longer(points, amount * (size - np.median(size)))


def _shared(
    problem: Problem,
    state: State,
    here: np.ndarray,
    inverse: np.ndarray,
    effects: list[_Effect],
) -> np.ndarray:
    """What shared effects add to the covariance (Schmidt's consider covariance).

    ``here`` is the gradient without them. Each effect b moves the minimum by ``-A⁻¹ ∂g/∂b``; the
    gradient's change is taken by a difference quotient over the disturbed points.
    """
    total = np.zeros((N_PARAMETERS, N_PARAMETERS))
    for sigma, disturb in effects:
        if sigma == 0:
            continue
        disturbed = replace(problem, points=disturb(problem.points, sigma))
        shift = -(inverse @ (_gradient(disturbed, state) - here))[:N_PARAMETERS]
        total += np.outer(shift, shift)
    return total
