"""Does the footage show upright people on a plane at all? A test on people who are held out.

The camera says how large people appear where. The rival says nothing of the kind: people appear in
any size anywhere (cut-outs, advertisements, a film with cuts), upright in the picture. Both are
fitted to four fifths of the people and predict the last fifth, in turns. A camera with parameters
to spare explains any footage that it was fitted to; of people whom it has not seen it says nothing
true where there is no ground.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration._problem import SHORT_RANGE, TURN_RANGE, Problem, State, spreads
from scene4d.calibration._refine import descend, linearise, updated_noise

_FOLDS = 5
_STEPS = 3
"""Of Gauss-Newton for each fold: it starts at the answer from all people."""
_SEED = 0
_ENOUGH = 300
"""So many sightings say clearly whether there is a ground; of more, these are drawn."""
_STRAYS = (0.05, 0.15, 0.3, 0.5, 0.75, 1.0)
"""Shares of strays that the rival may have."""
_LEAST_SPREAD = 0.02
"""Of the rival's log length and direction (radians): a pixel of a person of 50."""


def evidence(problem: Problem, state: State) -> float:
    """Logarithm of how much better the camera predicts held-out people than "any size anywhere"
    does: sum over people, who count by the places in which they are seen.

    Negative where the rival is better; NaN where there are too few sightings to hold some out.
    """
    if len(problem.track) > _ENOUGH:
        drawn = np.random.default_rng(_SEED).permutation(len(problem.track))[:_ENOUGH]
        problem = problem.select(np.sort(drawn))
    fold = _folds(problem.track)
    if fold.max(initial=0) + 1 < _FOLDS:
        return float("nan")
    gains = [_gain(problem, state, fold == k) for k in range(_FOLDS)]
    return float(sum(gains))


def _folds(track: Int[np.ndarray, "n"]) -> Int[np.ndarray, "n"]:
    """Which fold holds each sighting out: whole people, or stretches of a few people's walks."""
    people = int(track.max(initial=-1)) + 1
    if people >= _FOLDS:
        return np.random.default_rng(_SEED).permutation(people)[track] % _FOLDS
    out = np.empty(len(track), int)
    out[np.argsort(track, kind="stable")] = np.arange(len(track)) * _FOLDS // len(track)
    return out


def _gain(problem: Problem, state: State, held: np.ndarray) -> float:
    seen, unseen = problem.select(np.flatnonzero(~held)), problem.select(np.flatnonzero(held))
    # Heights of people held out are unknown, hence part of the noise.
    unseen = replace(unseen, track=np.arange(int(held.sum())))
    fitted = replace(state, delta_m=np.zeros(seen.n_heights))
    fitted, lin = descend(seen, fitted, steps=_STEPS, tolerance=0.05)
    noise = updated_noise(seen, fitted, lin)
    fitted = replace(fitted, delta_m=np.zeros(0), noise=noise)
    gain = log_density(unseen, fitted) - _any_size(seen, unseen)
    return float(unseen.weight @ gain)


def log_density(problem: Problem, state: State) -> Float[np.ndarray, "n"]:
    """Of log length and direction (of boxes: of log length) of everybody, by the camera."""
    along, across = spreads(problem, state.noise)
    scale = np.where(problem.points.from_box, along, np.sqrt(2 * np.pi) * along * across)
    return -linearise(problem, state).loss / 2 - np.log(np.sqrt(2 * np.pi) * scale)


def _any_size(seen: Problem, unseen: Problem) -> Float[np.ndarray, "n"]:
    """The same where neither depends on the place: usual ones, and strays as the camera has them,
    in the proportion that is best for those seen.
    """
    density, trained = _usual(seen, unseen), _usual(seen, seen)
    flat, flat_trained = (
        np.where(p.points.from_box, 1.0, 1 / TURN_RANGE) / SHORT_RANGE for p in (unseen, seen)
    )
    likelihood = [seen.weight @ np.log((1 - s) * trained + s * flat_trained) for s in _STRAYS]
    strays = _STRAYS[int(np.argmax(likelihood))]
    gained: np.ndarray = np.log((1 - strays) * density + strays * flat)
    return gained


def _usual(seen: Problem, asked: Problem) -> Float[np.ndarray, "n"]:
    """Density of log length and direction where both are normal, as fitted to those seen."""
    length, turn = (
        _normal(there, here, seen.weight)
        for there, here in zip(_length_and_turn(seen), _length_and_turn(asked), strict=True)
    )
    return length * np.where(asked.points.from_box, 1.0, turn)


def _normal(there: np.ndarray, here: np.ndarray, weight: np.ndarray) -> np.ndarray:
    """Density of ``here`` under the normal distribution of ``there``, robustly fitted."""
    middle = _weighted_median(there, weight)
    spread = max(1.48 * _weighted_median(np.abs(there - middle), weight), _LEAST_SPREAD)
    density: np.ndarray = np.exp(-0.5 * ((here - middle) / spread) ** 2)
    return density / (np.sqrt(2 * np.pi) * spread)


def _length_and_turn(problem: Problem) -> tuple[np.ndarray, np.ndarray]:
    seen = problem.points.seen
    return 0.5 * np.log(problem.points.seen2), np.arctan2(seen[0], -seen[1])


def _weighted_median(values: Float[np.ndarray, "n"], weight: Float[np.ndarray, "n"]) -> float:
    order = np.argsort(values)
    below = np.cumsum(weight[order])
    return float(values[order][np.searchsorted(below, below[-1] / 2)])
