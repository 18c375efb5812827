"""The joint method: from segments (and lines) to the most probable camera, with its search."""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration.initial import starting_points
from scene4d.calibration.lines import best_azimuths
from scene4d.calibration.refine import Noise, Problem, State, linearise, minimise, updated_noise

SEARCH_PEOPLE = 250
"""So many people are enough to choose among starting points; all of them refine the winner."""
NOISE_PEOPLE = 4_000
"""So many people tell the noise to one per cent."""
STARTS = 3
SEARCH_WIDTH = 2.0
"""The search believes in so many times the usual noise, so that it sees far people too."""
NOISE_ROUNDS = 3
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
    reach2 = (NEW_POSITION * length) ** 2
    places, last = 1, 0
    while True:
        gap = foot[:, last + 1 :] - foot[:, last, None]
        moved = (gap * gap).sum(axis=0) > reach2[last + 1 :]
        if not moved.any():
            return places
        last += 1 + int(moved.argmax())
        places += 1


def solve(problem: Problem, *, seed: int = 0) -> State | None:
    """The best camera found, or None where no starting point is possible at all."""
    small = _thinned(problem, SEARCH_PEOPLE, seed)
    people_only = replace(small, lines=None)
    starts = starting_points(
        small.points, small.weight, small.person_height_m, small.prior, keep=STARTS
    )
    if len(starts) == 0:
        return None
    candidates: list[tuple[float, int, State]] = []
    for parameters in starts:
        state = State(parameters, np.zeros(small.n_heights), Noise().widened(SEARCH_WIDTH))
        state = minimise(people_only, state, steps=4, tolerance=0.1)
        candidates.append((linearise(people_only, state).cost, len(candidates), state))
    state = minimise(people_only, min(candidates)[2], steps=6, tolerance=0.1)
    state = replace(state, noise=Noise())
    if problem.lines is not None:
        state = _with_azimuth(small, state)
    state = _with_noise(small, state, NOISE_ROUNDS)
    middle = _thinned(problem, NOISE_PEOPLE, seed)
    if middle is not small:
        state = _with_noise(middle, replace(state, delta_m=np.zeros(middle.n_heights)), 2)
    if middle is not problem:
        state = replace(state, delta_m=np.zeros(problem.n_heights))
    return minimise(problem, state, steps=20, tolerance=1e-5)


def _with_noise(problem: Problem, state: State, rounds: int) -> State:
    """Refine camera and noise in turns."""
    for _ in range(rounds):
        state = minimise(problem, state, steps=4, tolerance=1e-2)
        state = replace(state, noise=updated_noise(problem, state))
    return state


def _with_azimuth(problem: Problem, state: State) -> State:
    """Refine with the lines from the best few azimuths; the lowest cost wins."""
    assert problem.lines is not None
    candidates: list[tuple[float, int, State]] = []
    for azimuth in best_azimuths(state.parameters, problem.lines):
        trial = minimise(problem, replace(state, azimuth=azimuth), steps=15, tolerance=1e-2)
        candidates.append((linearise(problem, trial).cost, len(candidates), trial))
    return min(candidates)[2] if candidates else state


def _thinned(problem: Problem, people: int, seed: int) -> Problem:
    n = len(problem.track)
    if n <= people:
        return problem
    rng = np.random.default_rng(seed)
    return problem.select(np.sort(rng.choice(n, people, replace=False)))
