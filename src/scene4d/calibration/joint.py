"""The joint method: from segments (and lines) to the most probable camera, with its search."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration.initial import starting_points
from scene4d.calibration.lines import best_azimuths
from scene4d.calibration.refine import Noise, Problem, State, descend, minimise, updated_noise

_SEARCH_PEOPLE = 100
"""So many people are enough to choose among starting points; all of them refine the winner."""
_NOISE_PEOPLE = 4_000
"""So many people tell the noise to one per cent."""
_FEW_PEOPLE = 60
STARTS, STARTS_FOR_FEW = 2, 6
SEARCH_WIDTH, SEARCH_WIDTH_FOR_FEW = 2.0, 1.0
"""How many starts are tried, with how many times the usual noise. Many people lead from afar; among
few, outliers make valleys of their own, which only more and narrower starts tell apart."""
_NOISE_ROUNDS = 4
NEW_POSITION = 0.25
"""A track counts anew when its feet have moved by this fraction of the person's length."""


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
    weights = np.ones(len(track))
    repeated = np.flatnonzero(np.bincount(track)[track] > 1)
    order = repeated[np.argsort(track[repeated], kind="stable")]
    starts = np.flatnonzero(np.diff(track[order], prepend=-1))
    for rows in np.split(order, starts[1:]) if len(order) else []:
        places = _places(foot[:, rows], length[rows])
        weights[rows] = places / (1 + (places - 1) * correlation) / len(rows)
    return weights


def _places(foot: np.ndarray, length: np.ndarray) -> int:
    """How often a walk (2, n) gets a new position away from the last counted one."""
    places, (x0, y0) = 1, foot[:, 0].tolist()
    reach2 = ((NEW_POSITION * length) ** 2).tolist()
    for x, y, reach in zip(foot[0].tolist(), foot[1].tolist(), reach2, strict=True):
        if (x - x0) ** 2 + (y - y0) ** 2 > reach:
            places, x0, y0 = places + 1, x, y
    return places


def solve(problem: Problem, *, seed: int = 0) -> State | None:
    """The best camera found, or None where no starting point is possible at all."""
    small = _thinned(problem, _SEARCH_PEOPLE, seed)
    people_only = replace(small, lines=None)
    few = len(small.track) < _FEW_PEOPLE
    width = SEARCH_WIDTH_FOR_FEW if few else SEARCH_WIDTH
    starts = starting_points(
        small.points,
        small.weight,
        small.person_height_m,
        small.prior,
        keep=STARTS_FOR_FEW if few else STARTS,
    )
    if len(starts) == 0:
        return None
    candidates: list[tuple[float, int, State]] = []
    for parameters in starts:
        state = State(parameters, np.zeros(small.n_heights), Noise().widened(width))
        state, lin = descend(people_only, state, steps=4, tolerance=0.1)
        candidates.append((lin.cost, len(candidates), state))
    state = minimise(people_only, min(candidates)[2], steps=6, tolerance=0.1)
    state = replace(state, noise=Noise())
    if problem.lines is not None:
        state = _with_azimuth(small, state)
    middle = _thinned(problem, _NOISE_PEOPLE, seed)
    if middle is not small:
        state = _with_noise(small, state, _NOISE_ROUNDS - 1)
        state = replace(state, delta_m=np.zeros(middle.n_heights))
    state = _with_noise(middle, state, _NOISE_ROUNDS if middle is small else 1)
    if middle is not problem:
        state = replace(state, delta_m=np.zeros(problem.n_heights))
    return minimise(problem, state, steps=20, tolerance=1e-4)


def _with_noise(problem: Problem, state: State, rounds: int) -> State:
    """Refine camera and noise in turns."""
    for _ in range(rounds):
        state, lin = descend(problem, state, steps=4, tolerance=0.1)
        state = replace(state, noise=updated_noise(problem, state, lin))
    return state


def _with_azimuth(problem: Problem, state: State) -> State:
    """Refine with the lines from the best few azimuths; the lowest cost wins."""
    assert problem.lines is not None
    candidates: list[tuple[float, int, State]] = []
    for azimuth in best_azimuths(state.parameters, problem.lines):
        trial, lin = descend(problem, replace(state, azimuth=azimuth), steps=15, tolerance=1e-2)
        candidates.append((lin.cost, len(candidates), trial))
    return min(candidates)[2] if candidates else state


def _thinned(problem: Problem, people: int, seed: int) -> Problem:
    n = len(problem.track)
    if n <= people:
        return problem
    rng = np.random.default_rng(seed)
    return problem.select(np.sort(rng.choice(n, people, replace=False)))
