"""Maximum a posteriori camera from upright segments: robust Gauss-Newton, heights eliminated.

Minimises over the camera θ = (log f, tilt, roll, log h, D) and one height per track

    Σᵢ wᵢ ρ(|rᵢ|²) + Σₜ ρ(δₜ² / σ_H²) + Σₖ (θₖ - θ̄ₖ)² / sₖ²

where rᵢ is the logarithm of predicted over seen length and the angle between the two, over their
noise, ρ is the Geman-McClure loss (children and cyclists are outliers as a track) and wᵢ counts a track by its distinct positions rather than by its
frames. The heights δₜ are eliminated track by track (Schur complement): O(n) per step. Noise and
height spread are re-estimated with a weak prior (expectation-maximisation of their posterior).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.calibrate.body import N_PARAMETERS, Points, predict_heads
from scene4d.calibrate.lines import Lines, LineTerms, line_terms
from scene4d.calibrate.prior import Prior

LOSS_WIDTH = 3.0
"""Geman-McClure width in standard deviations: weight ¼ at 3 σ, 1/14 at 5 σ."""
HEIGHT_SIGMA_M = 0.09
"""Spread of adults' heights (METHOD section 4)."""
_N = N_PARAMETERS + 1  # the camera, and the azimuth of the lines
_PRIOR_COUNT = 10.0
_NOISE_RANGE = (0.004, 0.15)
_HEIGHT_RANGE = (0.01, 0.2)


@dataclass(frozen=True)
class Noise:
    """Spread of log length and of direction (radians) of a person; heights in metres."""

    along: float = 0.03
    across: float = 0.045
    box_along: float = 0.05
    box_across: float = 0.09
    pixel: float = 0.0
    height_m: float = HEIGHT_SIGMA_M


@dataclass(frozen=True, eq=False)
class Problem:
    """Everything that stays fixed while the camera is refined."""

    points: Points
    track: Int[np.ndarray, "n"]
    weight: Float[np.ndarray, "n"]
    person_height_m: float
    prior: Prior
    lines: Lines | None = None

    @cached_property
    def n_tracks(self) -> int:
        """Number of tracks."""
        return int(self.track.max()) + 1 if len(self.track) else 0

    @cached_property
    def lone(self) -> Bool[np.ndarray, "n"]:
        """Who is seen once: its height cannot be told from noise, so it counts as noise."""
        return np.bincount(self.track, minlength=self.n_tracks)[self.track] == 1

    def select(self, rows: np.ndarray) -> "Problem":
        """The problem on some of its people; tracks are renumbered."""
        _, track = np.unique(self.track[rows], return_inverse=True)
        return replace(
            self, points=self.points.select(rows), track=track, weight=self.weight[rows]
        )


@dataclass(frozen=True, eq=False)
class State:
    """A point of the search: camera, heights above the mean (m), noise, azimuth of the lines."""

    parameters: Float[np.ndarray, "5"]
    delta_m: Float[np.ndarray, "t"]
    noise: Noise
    azimuth: float = 0.0


@dataclass(frozen=True, eq=False)
class Linearisation:
    """Residuals (2, n) in sigmas with derivatives at a state, robust weights, and the cost."""

    residual: Float[np.ndarray, "2 n"]
    by_parameter: Float[np.ndarray, "5 2 n"]
    by_height: Float[np.ndarray, "2 n"]
    robust: Float[np.ndarray, "n"]
    height_robust: Float[np.ndarray, "t"]
    cost: float
    lines: LineTerms | None


def linearise(problem: Problem, state: State) -> Linearisation:
    """Residuals, derivatives, weights and cost at ``state``."""
    points, noise = problem.points, state.noise
    heights = problem.person_height_m + state.delta_m[problem.track]
    predicted = predict_heads(state.parameters, points, heights)
    seen = points.head - points.foot
    length = np.sqrt((seen * seen).sum(axis=0))
    blur = (noise.pixel / length) ** 2
    along = np.sqrt(np.where(points.from_box, noise.box_along, noise.along) ** 2 + blur)
    along = np.where(problem.lone, np.hypot(along, noise.height_m / problem.person_height_m), along)
    across = np.sqrt(np.where(points.from_box, noise.box_across, noise.across) ** 2 + blur)

    expected = predicted.head - points.foot
    expected2 = np.maximum((expected * expected).sum(axis=0), 1e-18)
    dot = (expected * seen).sum(axis=0)
    cross = seen[0] * expected[1] - seen[1] * expected[0]
    residual = np.stack(
        [0.5 * np.log(expected2 / length**2) / along, np.arctan2(cross, dot) / across]
    )

    def in_sigmas(v: np.ndarray) -> np.ndarray:
        """Derivatives of (log length, direction) from those of the predicted head."""
        stretch = (v * expected).sum(axis=-2)
        turn = expected[0] * v[..., 1, :] - expected[1] * v[..., 0, :]
        return np.stack([stretch / (expected2 * along), turn / (expected2 * across)], axis=-2)

    chi2 = (residual * residual).sum(axis=0)
    chi2 = np.where(predicted.valid, np.minimum(chi2, 1e12), 1e12)
    shrink = 1 / (1 + chi2 / LOSS_WIDTH**2)
    # Invalid people weigh nothing, but cost the full loss: no camera may win by losing people.
    robust = np.where(predicted.valid, shrink**2, 0.0)
    loss = float(problem.weight @ (LOSS_WIDTH**2 * (1 - shrink)))
    gap = state.parameters - problem.prior.mean
    cost = loss + float((problem.prior.precision * gap**2).sum())
    height_shrink = 1 / (1 + (state.delta_m / (LOSS_WIDTH * noise.height_m)) ** 2)
    cost += LOSS_WIDTH**2 * float((1 - height_shrink).sum())
    terms = None
    if problem.lines is not None:
        terms = line_terms(np.append(state.parameters, state.azimuth), problem.lines)
        cost += terms.cost
    ok = predicted.valid
    return Linearisation(
        np.where(ok, residual, 0.0),
        np.where(ok, in_sigmas(predicted.by_parameter), 0.0),
        np.where(ok & ~problem.lone, in_sigmas(predicted.by_height), 0.0),
        robust,
        height_shrink**2,
        cost,
        terms,
    )


@dataclass(frozen=True, eq=False)
class NormalEquations:
    """Gauss-Newton system over camera and azimuth, with the heights eliminated."""

    hessian: Float[np.ndarray, "6 6"]
    gradient: Float[np.ndarray, "6"]
    height_information: Float[np.ndarray, "t"]
    height_gradient: Float[np.ndarray, "t"]
    coupling: Float[np.ndarray, "6 t"]


def normal_equations(problem: Problem, state: State, lin: Linearisation) -> NormalEquations:
    """``Jᵀ W J`` with one Schur complement per track."""
    weight = problem.weight * lin.robust
    weighted = lin.by_parameter * weight
    flat = lin.by_parameter.reshape(N_PARAMETERS, -1)
    hessian, gradient = np.zeros((_N, _N)), np.zeros(_N)
    camera = slice(0, N_PARAMETERS)
    hessian[camera, camera] = weighted.reshape(N_PARAMETERS, -1) @ flat.T
    hessian[camera, camera] += np.diag(problem.prior.precision)
    gradient[camera] = (weighted * lin.residual).sum(axis=(1, 2))
    gradient[camera] += problem.prior.precision * (state.parameters - problem.prior.mean)
    if lin.lines is not None:
        pulled = lin.lines.derivative * lin.lines.weight
        hessian += pulled @ lin.lines.derivative.T
        gradient += pulled @ lin.lines.residual

    def per_track(values: np.ndarray) -> np.ndarray:
        return np.bincount(problem.track, values, problem.n_tracks)

    stiffness = lin.height_robust / state.noise.height_m**2
    information = per_track(weight * (lin.by_height**2).sum(axis=0)) + stiffness
    height_gradient = per_track(weight * (lin.by_height * lin.residual).sum(axis=0))
    height_gradient += stiffness * state.delta_m
    coupling = np.zeros((_N, problem.n_tracks))
    for row, values in enumerate(weighted):
        coupling[row] = per_track((values * lin.by_height).sum(axis=0))
    scaled = coupling / information
    return NormalEquations(
        hessian - scaled @ coupling.T,
        gradient - scaled @ height_gradient,
        information,
        height_gradient,
        coupling,
    )


def minimise(problem: Problem, state: State, *, steps: int, tolerance: float = 1e-6) -> State:
    """Levenberg-Marquardt from ``state``, with the noise held at the state's."""
    free = np.append(problem.prior.free, problem.lines is not None)
    lin = linearise(problem, state)
    damping = 1e-3
    for _ in range(steps):
        system = normal_equations(problem, state, lin)
        for _ in range(8):
            step = _damped_step(system, free, damping)
            delta = -(system.height_gradient + system.coupling.T @ step) / system.height_information
            trial = replace(
                state,
                parameters=state.parameters + step[:N_PARAMETERS],
                delta_m=state.delta_m + delta,
                azimuth=state.azimuth + float(step[N_PARAMETERS]),
            )
            attempt = linearise(problem, trial)
            if attempt.cost <= lin.cost:
                break
            damping *= 6
        else:
            return state
        gain = lin.cost - attempt.cost
        state, lin, damping = trial, attempt, max(damping / 8, 1e-9)
        if gain < tolerance * (1 + lin.cost):
            break
    return state


_LARGEST_STEP = np.array([0.5, 0.25, 0.25, 0.6, 0.05, 0.1])


def _damped_step(system: NormalEquations, free: np.ndarray, damping: float) -> np.ndarray:
    step = np.zeros(_N)
    matrix = system.hessian[np.ix_(free, free)]
    matrix = matrix + damping * np.diag(np.diag(matrix) + 1e-9)
    step[free] = -np.linalg.solve(matrix, system.gradient[free])
    return step / max(1.0, float((np.abs(step) / _LARGEST_STEP).max()))


def updated_noise(problem: Problem, state: State) -> Noise:
    """Noise and height spread that the residuals support, each with a prior worth 10 people.

    A step of expectation-maximisation: a height that is only partly known hides part of the
    residual, which its posterior variance puts back. People seen once tell the sum of noise and
    height spread alone; it is split in the proportion believed so far. Truncation and occlusion
    only ever shorten a person, so the spread along it is read off those who are seen longer.
    """
    lin = linearise(problem, state)
    system = normal_equations(problem, state, lin)
    weight = problem.weight * lin.robust
    longer = lin.residual[0] <= 0
    noise, box, lone = state.noise, problem.points.from_box, problem.lone
    hidden = (1 / system.height_information)[problem.track] * lin.by_height[0] ** 2
    along2, across2 = lin.residual[0] ** 2 * _UNSHRINK + hidden, lin.residual[1] ** 2 * _UNSHRINK

    def spread(squares: np.ndarray, rows: np.ndarray, now: float, start: float) -> float:
        total, seen = float(weight[rows].sum()), float((weight * squares)[rows].sum())
        value = np.sqrt((_PRIOR_COUNT * start**2 + seen * now**2) / (_PRIOR_COUNT + total))
        return float(np.clip(value, *_NOISE_RANGE))

    first = Noise()
    tracked = np.zeros(problem.n_tracks, bool)
    tracked[problem.track[~lone & (weight > 0.25)]] = True
    trust = np.where(tracked, lin.height_robust, 0.0)
    height2 = float((trust * (state.delta_m**2 + 1 / system.height_information)).sum())
    height2 += float((weight * along2)[lone & longer].sum()) * noise.height_m**2
    count = _PRIOR_COUNT + float(trust.sum()) + float(weight[lone & longer].sum())
    height = np.sqrt((_PRIOR_COUNT * first.height_m**2 + height2) / count)
    return Noise(
        along=spread(along2, ~box & longer, noise.along, first.along),
        across=spread(across2, ~box, noise.across, first.across),
        box_along=spread(along2, box & longer, noise.box_along, first.box_along),
        box_across=spread(across2, box, noise.box_across, first.box_across),
        pixel=noise.pixel,
        height_m=float(np.clip(height, *_HEIGHT_RANGE)),
    )


def _loss_constants() -> tuple[float, float]:
    """For Gaussian residuals (|r|² ~ χ²₂): how much the robust weight shrinks the mean square,
    and by how much ``(Jᵀ W J)⁻¹`` must be scaled to be the estimate's variance.
    """
    s = np.linspace(0, 60, 60001)
    density = 0.5 * np.exp(-s / 2)
    c2 = LOSS_WIDTH**2
    w = 1 / (1 + s / c2) ** 2
    slope = -2 / c2 / (1 + s / c2) ** 3

    def mean(values: np.ndarray) -> float:
        return float(np.trapezoid(values * density, s))

    unshrink = mean(w) / (mean(w * s) / 2)
    psi2, bend = mean(w * w * s) / 2, mean(w + s * slope)
    return unshrink, psi2 * mean(w) / bend**2


_UNSHRINK, VARIANCE_FACTOR = _loss_constants()
