"""Maximum a posteriori camera from upright segments: robust Gauss-Newton, heights eliminated.

Minimises over the camera θ = (log f, tilt, roll, log h, D, cu, cv) and one height per track

    Σᵢ wᵢ (-2 log p(aᵢ, cᵢ)) + Σₜ ρ(δₜ² / σ_H²) + Σₖ (θₖ - θ̄ₖ)² / sₖ² + further terms

where aᵢ is the logarithm of predicted over seen length and cᵢ the angle between the two, in sigmas,
and wᵢ counts a track by its distinct positions rather than by its frames; both hold the drift
(:mod:`._drift`) that everybody shares. p is a mixture of

    people as modelled          N(a) N(c)
    people seen too short       uniform in a > 1, N(c): truncated, occluded, seated, children
    no people                   uniform in both

whose gradient is that of weighted least squares, with the posterior probability of being as
modelled for a, and of being upright for c. ρ is the Geman-McClure loss: a child or a cyclist is an
outlier as a track. The heights δₜ are eliminated track by track (Schur complement): O(n) per step.
Noise, height spread and shares are re-estimated by expectation-maximisation with a weak prior.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from scene4d.calibration._body import N_PARAMETERS, Prediction, predict_heads
from scene4d.calibration._drift import N_DRIFTS, Drifted
from scene4d.calibration._lines import LineTerms, line_terms
from scene4d.calibration._lower_edge import LowerEdge, lowered
from scene4d.calibration._problem import (
    AZIMUTH,
    DRIFTS,
    N_UNKNOWNS,
    OF_LINES,
    Noise,
    Problem,
    State,
    TermValue,
    mixture,
    spreads,
)

# These constants were chosen by hand on the tuning cameras (PETS 2009, TownCentre); with them
# synthetic crowds of known noise have the coverage that tests/calibration/test_coverage.py demands.
# Expectation-maximisation moves all of ``Noise``.
_HEIGHT_LOSS_WIDTH = 3.0
"""Geman-McClure width of a track's height, in standard deviations: adults lie within, children and
cyclists beyond."""
_AZIMUTH_RIDGE = 1e-2
"""Information about an azimuth that no line tells: the system must not become singular."""
_PRIOR_COUNT = 10.0
"""So many sightings outweigh the starting values of the noise: a handful cannot tell it."""
_NOISE_RANGE = (0.004, 0.15)
"""Of log length and direction (radians): half a pixel of a person of 125 px, and a box half cut."""
_HEIGHT_RANGE = (0.01, 0.2)
"""Of the spread of heights (m): a drill team, and a crowd of adults with children."""


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals (2, n) in sigmas with derivatives by the free parameters (and the drift, if there
    is one) at a state, their weights, and the cost.

    ``inlier`` (n,) is the probability that a person is as modelled, ``weight`` (2, n) what the
    two residuals count, ``force`` (2, n) half the gradient of the loss by the residuals,
    ``height_weight`` (t,) what a track's height counts, ``loss`` (n,) a person's -2 log p,
    ``pull`` (p,) and (n,) what the lower edges of boxes add to the gradient.
    """

    residual: Float[np.ndarray, "2 n"]
    by_parameter: Float[np.ndarray, "p 2 n"]
    by_height: Float[np.ndarray, "2 n"]
    inlier: Float[np.ndarray, "n"]
    weight: Float[np.ndarray, "2 n"]
    force: Float[np.ndarray, "2 n"]
    height_weight: Float[np.ndarray, "t"]
    cost: float
    lines: LineTerms | None
    others: tuple[TermValue, ...]
    loss: Float[np.ndarray, "n"]
    pull: tuple[Float[np.ndarray, "p"], Float[np.ndarray, "n"]] | None


def linearise(problem: Problem, state: State) -> Linearisation:
    """Residuals, derivatives, weights and cost at ``state``."""
    points, noise = problem.points, state.noise
    heights_m = problem.heights_m(state.delta_m)
    predicted = predict_heads(state.parameters, points, heights_m, problem.columns)
    seen = points.seen
    along, across = spreads(problem, noise)

    expected = predicted.head - points.foot
    by_parameter, by_height = predicted.by_parameter, predicted.by_height
    if points.has_boxes:
        # The sides of a box are upright whatever leans in it: only its height is an observation.
        expected[0] = np.where(points.from_box, seen[0], expected[0])
        by_parameter[:, 0, points.from_box] = 0.0
        by_height[0, points.from_box] = 0.0
    expected2 = np.maximum(expected[0] ** 2 + expected[1] ** 2, 1e-18)
    dot = expected[0] * seen[0] + expected[1] * seen[1]
    cross = seen[0] * expected[1] - seen[1] * expected[0]
    residual = np.empty_like(seen)
    log_length = 0.5 * np.log(expected2)
    drifted, edge, spread = None, None, along
    if problem.drift is not None:
        lean = np.arctan2(expected[0], -expected[1])
        drifted = problem.drift.at(state.drift, log_length, lean, points)
        if points.has_boxes:
            edge = _lower_edge(problem, state, predicted, drifted, spread)
            along = spread * edge.narrowing
    both = np.stack([along, across])
    residual[0] = log_length - 0.5 * np.log(points.seen2)
    residual[1] = np.arctan2(cross, dot)
    gain = 1 / (expected2 * both)
    if drifted is not None:
        residual += drifted.added
        gain *= drifted.gain
    residual /= both
    stretch, turn = expected * gain[0], np.stack([-expected[1], expected[0]]) * gain[1]

    def in_sigmas(v: np.ndarray) -> np.ndarray:
        """Derivatives of (log length, direction) from those of the predicted head."""
        out = v[..., :1, :] * np.stack([stretch[0], turn[0]])
        out += v[..., 1:, :] * np.stack([stretch[1], turn[1]])
        return out

    inlier, upright, push, loss = mixture(residual, predicted.valid, spread, across, noise)
    cost = float(problem.weight @ loss)
    by_parameter = in_sigmas(by_parameter)
    if drifted is not None:
        by_parameter = np.concatenate([by_parameter, drifted.by / both])
    if not predicted.valid.all():
        residual = np.where(predicted.valid, residual, 0.0)
        by_parameter = np.where(predicted.valid, by_parameter, 0.0)
    weight = problem.weight * np.stack([inlier, upright])
    force = weight * residual
    force[0] -= problem.weight * push
    gap = state.parameters - problem.prior.mean
    cost += float(gap @ problem.prior.precision @ gap)
    if problem.drift is not None:
        cost += float(state.drift**2 @ problem.drift.precision)
    height_shrink = 1 / (1 + (state.delta_m / (_HEIGHT_LOSS_WIDTH * noise.height_m)) ** 2)
    cost += _HEIGHT_LOSS_WIDTH**2 * float((1 - height_shrink).sum())
    terms = None
    if problem.lines is not None:
        terms = line_terms(np.append(state.parameters, state.azimuth), problem.lines)
        cost += terms.cost
    others = tuple(term.at(state.parameters) for term in problem.terms)
    cost += sum(other.cost for other in others)
    return Linearisation(
        residual,
        by_parameter,
        in_sigmas(by_height) if problem.n_heights else np.zeros_like(seen),
        inlier,
        weight,
        force,
        height_shrink**2,
        cost,
        terms,
        others,
        loss,
        None if edge is None else edge.pull(force[0] * residual[0]),
    )


def _lower_edge(
    problem: Problem, state: State, here: Prediction, drifted: Drifted, along: np.ndarray
) -> LowerEdge:
    points, heights_m = problem.points, problem.heights_m(state.delta_m)
    below = predict_heads(state.parameters, lowered(points), heights_m, problem.columns)
    share = (state.noise.box_along / along) ** 2
    return LowerEdge.of(here, below, points, drifted, float(state.drift[2]), share)


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Gauss-Newton system over camera, azimuth and drift, with the heights eliminated."""

    hessian: Float[np.ndarray, "14 14"]
    gradient: Float[np.ndarray, "14"]
    height_information: Float[np.ndarray, "t"]
    height_gradient: Float[np.ndarray, "t"]
    coupling: Float[np.ndarray, "14 t"]


def normal_equations(problem: Problem, state: State, lin: Linearisation) -> NormalEquations:
    """``Jᵀ W J`` with one Schur complement per track."""
    columns = problem.of_people
    weighted = lin.by_parameter * lin.weight
    flat = lin.by_parameter.reshape(len(columns), -1)
    hessian, gradient = np.zeros((N_UNKNOWNS, N_UNKNOWNS)), np.zeros(N_UNKNOWNS)
    hessian[np.ix_(columns, columns)] = weighted.reshape(len(columns), -1) @ flat.T
    gradient[columns] = flat @ lin.force.ravel()
    if lin.pull is not None:
        gradient[columns] += lin.pull[0]
    camera = slice(0, N_PARAMETERS)
    hessian[camera, camera] += problem.prior.precision
    gradient[camera] += problem.prior.precision @ (state.parameters - problem.prior.mean)
    for other in lin.others:
        hessian[camera, camera] += other.hessian
        gradient[camera] += other.gradient
    if lin.lines is not None:
        pulled = lin.lines.derivative * lin.lines.weight
        hessian[OF_LINES, OF_LINES] += pulled @ lin.lines.derivative.T
        gradient[OF_LINES] += pulled @ lin.lines.residual
        hessian[AZIMUTH, AZIMUTH] += _AZIMUTH_RIDGE
    if problem.drift is not None:
        hessian[DRIFTS, DRIFTS] += np.diag(problem.drift.precision)
        gradient[DRIFTS] += problem.drift.precision * state.drift

    stiffness = lin.height_weight / state.noise.height_m**2
    information = stiffness.copy()
    height_gradient = stiffness * state.delta_m
    coupling = np.zeros((N_UNKNOWNS, problem.n_heights))
    if problem.n_heights:
        information += problem.per_person((lin.weight * lin.by_height**2).sum(axis=0))
        pulled = (lin.by_height * lin.force).sum(axis=0)
        height_gradient += problem.per_person(pulled if lin.pull is None else pulled + lin.pull[1])
        coupling[columns] = problem.per_person((weighted * lin.by_height).sum(axis=1))
    scaled = coupling / information
    return NormalEquations(
        hessian - scaled @ coupling.T,
        gradient - scaled @ height_gradient,
        information,
        height_gradient,
        coupling,
    )


def minimise(problem: Problem, state: State, *, steps: int, tolerance: float) -> State:
    """Levenberg-Marquardt from ``state``, with the noise held at the state's.

    Stops when a step gains less than ``tolerance``. The cost is twice a negative logarithm of a
    probability, so that a gain of 0.01 is a tenth of a standard deviation, whatever n.
    """
    return descend(problem, state, steps=steps, tolerance=tolerance)[0]


def descend(
    problem: Problem, state: State, *, steps: int, tolerance: float
) -> tuple[State, Linearisation]:
    """:func:`minimise`, with the linearisation at the state it returns."""
    lin = linearise(problem, state)
    damping = 1e-3
    for _ in range(steps):
        system = normal_equations(problem, state, lin)
        for _ in range(8):
            step = _damped_step(system, problem.free, damping)
            delta = -(system.height_gradient + system.coupling.T @ step) / system.height_information
            trial = replace(
                state,
                parameters=state.parameters + step[:N_PARAMETERS],
                delta_m=state.delta_m + delta,
                azimuth=state.azimuth + float(step[AZIMUTH]),
                drift=state.drift + step[DRIFTS],
            )
            attempt = linearise(problem, trial)
            if attempt.cost <= lin.cost:
                break
            damping *= 6
        else:
            return state, lin
        gain = lin.cost - attempt.cost
        state, lin, damping = trial, attempt, max(damping / 8, 1e-9)
        if gain < tolerance:
            break
    return state, lin


_LARGEST_STEP = np.array([0.5, 0.25, 0.25, 0.6, 0.05, 0.05, 0.05, 0.1, *[0.1] * N_DRIFTS])
"""Of log f, tilt, roll, log h, D, principal point, azimuth, drift: about the starts' spacing."""


def _damped_step(system: NormalEquations, free: np.ndarray, damping: float) -> np.ndarray:
    step = np.zeros(N_UNKNOWNS)
    rows = np.flatnonzero(free)
    matrix = system.hessian[rows[:, None], rows]
    matrix.flat[:: len(rows) + 1] *= 1 + damping
    step[rows] = -np.linalg.solve(matrix, system.gradient[rows])
    return step / max(1.0, float((np.abs(step) / _LARGEST_STEP).max()))


def updated_noise(problem: Problem, state: State, lin: Linearisation) -> Noise:
    """Noise, height spread and shares that the residuals support, each with a weak prior.

    A step of expectation-maximisation: a height that is only partly known hides part of the
    residual, which its posterior variance puts back. People seen once tell the sum of noise and
    height spread alone; it is split in the proportion believed so far. ``lin`` is the
    linearisation at ``state``.
    """
    system = normal_equations(problem, state, lin)
    noise, box, lone = state.noise, problem.points.from_box, problem.lone
    hidden = np.zeros(len(problem.track))
    hidden[problem.tracked] = (
        lin.by_height[0, problem.tracked] ** 2 / system.height_information[problem.person]
    )
    along2, across2 = lin.residual[0] ** 2 + hidden, lin.residual[1] ** 2
    weight_along, weight_across = lin.weight

    def spread(
        squares: np.ndarray, weight: np.ndarray, rows: np.ndarray, now: float, start: float
    ) -> float:
        total, found = float(weight[rows].sum()), float((weight * squares)[rows].sum())
        value = np.sqrt((_PRIOR_COUNT * start**2 + found * now**2) / (_PRIOR_COUNT + total))
        return float(np.clip(value, *_NOISE_RANGE))

    first = Noise()
    seen = np.zeros(problem.n_heights, bool)
    seen[problem.person[lin.inlier[problem.tracked] > 0.5]] = True
    trust = np.where(seen, lin.height_weight, 0.0)
    height2 = float((trust * (state.delta_m**2 + 1 / system.height_information)).sum())
    height2 += float((weight_along * along2)[lone].sum()) * noise.height_m**2
    count = _PRIOR_COUNT + float(trust.sum()) + float(weight_along[lone].sum())
    height = np.sqrt((_PRIOR_COUNT * first.height_m**2 + height2) / count)
    everybody = _PRIOR_COUNT + float(problem.weight.sum())
    short = float((weight_across - weight_along).sum())
    stray = float((problem.weight - weight_across).sum())
    return Noise(
        along=spread(along2, weight_along, ~box, noise.along, first.along),
        across=spread(across2, weight_across, ~box, noise.across, first.across),
        box_along=spread(along2, weight_along, box, noise.box_along, first.box_along),
        height_m=float(np.clip(height, *_HEIGHT_RANGE)),
        short=(_PRIOR_COUNT * first.short + short) / everybody,
        stray=(_PRIOR_COUNT * first.stray + stray) / everybody,
    )


def observed_weights(problem: Problem, lin: Linearisation) -> Float[np.ndarray, "2 n"]:
    """Weights that give the information of the mixture instead of the least squares' one.

    Not knowing who is an outlier costs information: where the probability is q, the second
    derivative of ``-log p`` is ``q - q (1 - q) r²`` and not q (Louis 1982); averaged over people.
    """
    share = lin.weight / np.maximum(problem.weight, 1e-12)
    lost = (lin.weight * (1 - share) * np.minimum(lin.residual**2, 9.0)).sum(axis=1)
    kept = 1 - lost / np.maximum(lin.weight.sum(axis=1), 1e-9)
    return lin.weight * np.clip(kept, 0.3, 1.0)[:, None]
