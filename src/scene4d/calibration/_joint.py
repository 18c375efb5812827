"""The joint method: from segments (and lines) to the most probable camera, with its search.

It starts on a coarse grid over focal length, tilt and roll. For one orientation every person tells
its own ``κ`` in closed form (:mod:`.body`: the head's ray is ``d + κ up``), hence its own camera
height; the median is the height, and what is left over is how badly the people agree. Thousands of
orientations are tried at once on a few people, and the best are refined.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration._body import (
    CORNER,
    FOCAL,
    HEIGHT,
    N_PARAMETERS,
    ROLL,
    TILT,
    undistort,
)
from scene4d.calibration._equidistant import ray_gain
from scene4d.calibration._lines import best_azimuths
from scene4d.calibration._prior import Prior, inverse_of
from scene4d.calibration._problem import Noise, Problem, State
from scene4d.calibration._refine import (
    descend,
    linearise,
    minimise,
    normal_equations,
    updated_noise,
)

# The numbers of the search trade time for sureness. They were chosen by hand on the tuning cameras
# and the synthetic crowds of tests/calibration; nobody has measured that they are the best.
_SEARCH_PEOPLE = 100
"""So many people are enough to choose among starting points; all of them refine the winner."""
_GRID_PEOPLE = 64
"""So many people tell a good orientation from a bad one. Chosen by hand."""
_GRID_ALONG, _GRID_ACROSS = 0.07, 0.06
"""Spread of a head about its prediction on the grid, in lengths of the person: that of
:class:`.Noise` with the heights of people (0.09 m of 1.70 m) and half a step of the grid."""
_GRID_OUTLIER = 3.0
"""Width of the grid's robust loss, in sigmas."""
_WORST = 1e6
"""Chi square of whom no camera of that orientation shows."""
_NOISE_PEOPLE = 4_000
"""So many people tell a standard deviation to one per cent (1 / √(2 n))."""
_FEW_PEOPLE = 60
_STARTS, _STARTS_FOR_FEW = 2, 6
_SEARCH_WIDTH, _SEARCH_WIDTH_FOR_FEW = 2.0, 1.0
"""How many starts are tried, with how many times the usual noise. Many people lead from afar; among
few, outliers make valleys of their own, which only more and narrower starts tell apart."""
_MOST_AGREE = 0.8
"""Where such a share of many people agrees, there is no need to start anywhere else."""
_MODES = 3
"""So many starts of few people are followed to their minima."""
_VAGUE_FOCAL = 0.1
"""Relative spread of the focal length by people above which edges are tried from several cameras
along it, at so many standard deviations:"""
_VALLEY_SIGMAS = (-2.0, -1.0, 1.0, 2.0)
_MODE_COST = 4.0
"""A second minimum that costs less than this more (odds of 7 to 1) may be the true one. Chosen."""
_MODES_APART = np.array([0.1, np.radians(2.0), np.radians(2.0)])
"""Of log f, tilt and roll: minima that differ by less are one."""
_NOISE_ROUNDS = 4
"""Rounds of expectation-maximisation for the noise, camera and noise in turns."""
TRACK_CORRELATION = 0.12
"""Of one person's errors across the body in different places (gait, posture); PETS has 0.11
(benchmarks/keypoint_bias.py)."""
NEW_POSITION = 0.25
"""A track counts anew when its feet have moved by this fraction of the person's length: about half
a step, after which the posture is another one. Chosen by hand; docs/ablation.md has the effect."""


def position_weights(
    foot: Float[np.ndarray, "2 n"],
    length: Float[np.ndarray, "n"],
    track: Int[np.ndarray, "n"],
    correlation: float = 0.0,
) -> Float[np.ndarray, "n"]:
    """Weight of each sighting, so that a track counts as often as it is seen in a new place.

    The error of a person who stands still repeats itself from frame to frame; a thousand frames
    of it are one observation (METHOD section 2, lesson 4). ``correlation`` is that of a person's
    errors in different places (gait, posture, clothes): m places count as
    ``m / (1 + (m - 1) correlation)`` (Kish's design effect).
    """
    places = places_of(foot, length, track)
    counts = places / (1 + (places - 1) * correlation) / np.maximum(np.bincount(track), 1)
    weights: np.ndarray = counts[track]
    return weights


def places_of(
    foot: Float[np.ndarray, "2 n"], length: Float[np.ndarray, "n"], track: Int[np.ndarray, "n"]
) -> Int[np.ndarray, "t"]:
    """In how many different places each track is seen (:data:`NEW_POSITION`)."""
    places = np.ones(int(track.max(initial=-1)) + 1, int)
    repeated = np.flatnonzero(np.bincount(track)[track] > 1)
    order = repeated[np.argsort(track[repeated], kind="stable")]
    starts = np.flatnonzero(np.diff(track[order], prepend=-1))
    for rows in np.split(order, starts[1:]) if len(order) else []:
        places[track[rows[0]]] = _places(foot[:, rows], length[rows])
    return places


def _places(foot: np.ndarray, length: np.ndarray) -> int:
    """How often a walk (2, n) gets a new position away from the last counted one."""
    places, (x0, y0) = 1, foot[:, 0].tolist()
    reach2 = ((NEW_POSITION * length) ** 2).tolist()
    for x, y, reach in zip(foot[0].tolist(), foot[1].tolist(), reach2, strict=True):
        if (x - x0) ** 2 + (y - y0) ** 2 > reach:
            places, x0, y0 = places + 1, x, y
    return places


_LOG_FOCALS = (-0.6, -0.25, 0.1, 0.45, 0.8, 1.15, 1.5)
"""Diagonal views of 123° down to 25°."""
_FISHEYE_LOG_FOCALS = (-1.0, -0.75, -0.5, -0.25, 0.0, 0.25)
"""Angles of the corners from the axis of 156° (a circle in the picture) down to 45°."""


def orientation_grid(
    prior: Prior, focal: tuple[float, ...] = _LOG_FOCALS
) -> Float[np.ndarray, "m 7"]:
    """The prior's mean with other orientations: the fixed values where fixed, else a spread."""
    tilt = np.radians([0, 5, 10, 16, 23, 31, 40, 50, 62, 75])
    roll = prior.mean[ROLL] + np.radians([-10, -3, 3, 10])
    axes: list[np.ndarray] = []
    for index, full in ((FOCAL, focal), (TILT, tilt), (ROLL, roll)):
        mean, sigma = prior.mean[index], prior.sigma[index]
        values = np.asarray(full)
        if sigma == 0:
            values = np.array([mean])
        elif sigma < 0.3:
            # A told value: its neighbourhood, unless the general grid is finer than that.
            near = mean + sigma * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
            values = near if index != ROLL or sigma < 0.05 else values
        axes.append(values)
    orientations = np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)
    parameters = np.tile(prior.mean, (len(orientations), 1))
    parameters[:, [FOCAL, TILT, ROLL]] = orientations
    return parameters


def _starting_points(problem: Problem, keep: int) -> Float[np.ndarray, "m 7"]:
    """The best ``keep`` distinct parameter vectors of the grid, best first."""
    problem = _evenly(problem, _GRID_PEOPLE)
    parameters, chi2 = _grid(problem)
    robust = _GRID_OUTLIER**2 * chi2 / (_GRID_OUTLIER**2 + chi2)
    cost = robust @ problem.weight + problem.prior.costs(parameters)
    return parameters[distinct(parameters, np.argsort(cost), keep)]


def most_agreeing(problem: Problem) -> float:
    """The largest share of the people, by weight, that fits one camera of the coarse grid: a cheap
    upper bound of what a search finds.
    """
    problem = _evenly(problem, _GRID_PEOPLE)
    fitting = (_grid(problem)[1] < _GRID_OUTLIER**2) @ problem.weight
    return float(fitting.max(initial=0.0) / problem.weight.sum())


def _grid(problem: Problem) -> tuple[Float[np.ndarray, "m 7"], Float[np.ndarray, "m n"]]:
    """Parameters of every orientation of the grid, with the height that most people tell, and by
    how much (chi square, at most 10⁶) everybody misses the prediction.
    """
    points, prior = problem.points, problem.prior
    if len(problem.weight) == 0:
        return np.empty((0, N_PARAMETERS)), np.empty((0, 0))
    corner = prior.mean[CORNER]
    foot, head = undistort(points.foot, corner)[0], undistort(points.head, corner)[0]
    focals = _FISHEYE_LOG_FOCALS if points.fisheye else _LOG_FOCALS
    parameters = orientation_grid(prior, focals)
    focal = np.exp(parameters[:, FOCAL])[:, None]
    tilt, roll = parameters[:, TILT], parameters[:, ROLL]
    up = np.stack(
        [np.sin(roll) * np.cos(tilt), -np.cos(roll) * np.cos(tilt), -np.sin(tilt)], axis=1
    )
    up = up[:, :, None]
    to_foot = to_head = 1 / focal
    if points.fisheye:
        to_foot, to_head = ray_gain(foot, focal), ray_gain(head, focal)
    x, y = foot[0] * to_foot, foot[1] * to_foot
    a, b = head[0] * to_head, head[1] * to_head

    # Head: (x + κ up_x, y + κ up_y) = (a, b) (1 + κ up_z); least squares over the two rows.
    row_x, row_y = up[:, 0] - a * up[:, 2], up[:, 1] - b * up[:, 2]
    gap_x, gap_y = a - x, b - y
    norm2 = row_x**2 + row_y**2 + 1e-12
    kappa = (row_x * gap_x + row_y * gap_y) / norm2
    across = (row_x * gap_y - row_y * gap_x) / norm2 / np.where(kappa > 1e-9, kappa, np.nan)
    down = -(up[:, 0] * x + up[:, 1] * y + up[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        log_ratio = np.log(np.where((kappa > 0) & (down > 1e-6), kappa / down, np.nan))

    usable = np.isfinite(log_ratio).mean(axis=1) > 0.3
    parameters, log_ratio, across = parameters[usable], log_ratio[usable], across[usable]
    # Median of what is finite, log H / h: sorting puts NaN last.
    middle = np.isfinite(log_ratio).sum(axis=1) // 2
    level = np.sort(log_ratio, axis=1)[np.arange(len(log_ratio)), middle]
    chi2 = ((log_ratio - level[:, None]) / _GRID_ALONG) ** 2 + (across / _GRID_ACROSS) ** 2
    parameters[:, HEIGHT] = np.log(problem.person_height_m) - level
    return parameters, np.nan_to_num(np.minimum(chi2, _WORST), nan=_WORST)


def distinct(parameters: np.ndarray, order: np.ndarray, keep: int) -> list[int]:
    """Indices of the first ``keep`` candidates that differ clearly from one another."""
    apart = np.array([0.5, 0.2, 0.2])  # log f, tilt, roll: more than a step of the grid
    chosen: list[int] = []
    for index in order:
        gap = np.abs(parameters[chosen, :3] - parameters[index, :3]) / apart
        if len(chosen) == 0 or (gap.max(axis=1) > 1).all():
            chosen.append(int(index))
        if len(chosen) == keep:
            break
    return chosen


def solve(
    problem: Problem, *, seed: int = 0, more_starts: Float[np.ndarray, "m 7"] | None = None
) -> State | None:
    """The best camera found, or None where no starting point is possible at all; ``more_starts``
    are tried besides those that the people suggest.
    """
    small = _thinned(problem, _SEARCH_PEOPLE, seed)
    people_only = replace(small, lines=None)
    few = len(small.track) < _FEW_PEOPLE
    width = _SEARCH_WIDTH_FOR_FEW if few else _SEARCH_WIDTH
    starts = _starting_points(small, keep=_STARTS_FOR_FEW if few else _STARTS)
    if more_starts is not None:
        starts = np.concatenate([starts, more_starts])
    if len(starts) == 0:
        return None
    candidates: list[tuple[float, int, State]] = []
    for parameters in starts:
        state = State(parameters, np.zeros(small.n_heights), Noise().widened(width))
        state, lin = descend(people_only, state, steps=4, tolerance=0.1)
        candidates.append((lin.cost, len(candidates), state))
        sure = lin.inlier @ small.weight > _MOST_AGREE * small.weight.sum()
        if sure and not few and more_starts is None:
            break
    state = replace(min(candidates)[2], noise=Noise())
    if problem.lines is not None:
        state = _with_azimuth(small, [state, *_valley(people_only, state)])
    elif few:
        others = [other for _, _, other in sorted(candidates)[1:_MODES]]
        state = _best(small, [state, *(replace(other, noise=Noise()) for other in others)], 8)
    middle = _thinned(problem, _NOISE_PEOPLE, seed)
    if middle is not small:
        state = _with_noise(small, state, _NOISE_ROUNDS - 1)
        state = replace(state, delta_m=np.zeros(middle.n_heights))
    state = _with_noise(middle, state, _NOISE_ROUNDS if middle is small else 1)
    if middle is not problem:
        state = replace(state, delta_m=np.zeros(problem.n_heights))
    return minimise(problem, state, steps=20, tolerance=1e-3)


def _with_noise(problem: Problem, state: State, rounds: int) -> State:
    """Refine camera and noise in turns."""
    for _ in range(rounds):
        state, lin = descend(problem, state, steps=4, tolerance=0.1)
        state = replace(state, noise=updated_noise(problem, state, lin))
    return state


def _with_azimuth(problem: Problem, states: list[State]) -> State:
    """Refine with the lines from several cameras, each with the best few azimuths."""
    assert problem.lines is not None
    trials = [
        replace(state, azimuth=azimuth)
        for state in states
        for azimuth in best_azimuths(state.parameters, problem.lines)
    ]
    return _best(problem, trials or states[:1], steps=15)


def _valley(problem: Problem, state: State) -> list[State]:
    """Cameras that people can hardly tell from ``state``, along the direction that they tell least;
    none where they tell the focal length well. Edges may hold one of them (a valley of cost between
    focal length and tilt has several low points).
    """
    system = normal_equations(problem, state, linearise(problem, state))
    by_focal = inverse_of(system.hessian, problem.free)[FOCAL, :N_PARAMETERS]
    if by_focal[FOCAL] < _VAGUE_FOCAL**2:
        return []
    along = by_focal / np.sqrt(by_focal[FOCAL])  # as the focal length takes the others
    return [
        replace(state, parameters=state.parameters + sigmas * along) for sigmas in _VALLEY_SIGMAS
    ]


def _best(problem: Problem, states: list[State], steps: int) -> State:
    """The lowest minimum from several states; clearly different ones that are nearly as low are
    its ``rivals``.
    """
    found = [descend(problem, state, steps=steps, tolerance=1e-2) for state in states]
    costs = np.array([lin.cost for _, lin in found])
    best = found[int(costs.argmin())][0]
    rivals: list[tuple[float, np.ndarray]] = []
    for cost, (state, _) in sorted(zip(costs, found, strict=True), key=lambda pair: pair[0]):
        known = [best.parameters, *(parameters for _, parameters in rivals)]
        gap = np.abs(state.parameters[:3] - np.array(known)[:, :3]) / _MODES_APART
        if cost - costs.min() < _MODE_COST and (gap.max(axis=1) > 1).all():
            rivals.append((float(cost - costs.min()), state.parameters))
    return replace(best, rivals=tuple(rivals))


def _evenly(problem: Problem, people: int) -> Problem:
    n = len(problem.track)
    if n <= people:
        return problem
    return problem.select(np.linspace(0, n - 1, people).astype(int))


def _thinned(problem: Problem, people: int, seed: int) -> Problem:
    n = len(problem.track)
    if n <= people:
        return problem
    rng = np.random.default_rng(seed)
    return problem.select(np.sort(rng.choice(n, people, replace=False)))
