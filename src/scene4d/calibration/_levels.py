"""A second ground level: people who stand on a platform, behind a step, or down a flight of stairs.

One plane and one camera are solved for. Where part of the people stand z metres above or below it,
the camera is bent to suit both, and says nothing (R20). So after the solve :mod:`._level_scan`
looks for the part of the picture that gains most from a ground of its own. Camera, heights and z
are then refined together, and the level is believed if

    min(fall of the cost, z² / σ_z²) > (1 + 2 sides) log(places)

the Bayesian information criterion (Schwarz 1978): z and two numbers for every side of the region
are bought at the price of the number of independent sightings. The fall of the cost is that of the
whole mixture; σ_z allows for what else may make people longer in one part of the picture than in
another (lens, detector). Both have to pay, since either alone is fooled: the first by people whose
legs are hidden, the second by a smooth error.

Feet and heads alone cannot tell a lower level from people who are shorter: children, or a wall that
hides the legs. A level is therefore believed if people who are seen on both sides say the same by
themselves, each with a height of its own; a raised level also if enough different people do.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._body import CORNER, FOCAL, HEIGHT
from scene4d.calibration._joint import TRACK_CORRELATION, position_weights
from scene4d.calibration._level_scan import (
    NARROW,
    WIDE,
    Field,
    Region,
    Scores,
    best_regions,
    thinned,
)
from scene4d.calibration._problem import Problem, State, spreads
from scene4d.calibration._refine import descend, linearise, updated_noise
from scene4d.core.body import HEIGHT_SIGMA_M, PERSON_HEIGHT_M

_LEAST_PLACES = 4.0
"""A region holds sightings in at least so many places, or a share of :data:`_LEAST_SHARE`."""
_LEAST_SHARE = 0.03
_LEAST_PEOPLE = 2
"""At least so many different people are seen on either level: one may stoop, or carry a child."""
_PEOPLE_WITHOUT_CROSSING = 6
"""So many different people on a raised level are believed without anybody walking up to it. Their
mean height is known to 0.04 m (0.09 m / √6): a level shows them taller by more than that."""
_SHORTEST = 3.0
"""Adults are at most so many standard deviations shorter than the mean: a few who are seen shorter
still are children, or walk with their legs hidden, and as many are asked for as above."""
_SEEN_ON_BOTH = 6.6
"""z² / σ_z² from people who are seen on both levels, each by itself: the 99th percentile of χ²."""
_AGREE = 0.6
"""Share of the people who must fit two levels, in the region and elsewhere: hidden legs scatter,
and through a lens that is not modelled nobody fits. Chosen by hand: up to a fifth of the sightings
in crowds are outliers anyway."""
_SIZE_SIGMA, _ASIDE_SIGMA = 0.04, 0.02
"""Errors of length of second order, per e-fold of size and per half diagonal across the picture:
half of what :mod:`._drift` allows in first order. A step has an edge, an error of lens or detector
has none. Chosen by hand: PETS 2009, which is flat, needs them."""
_PROMISING = 0.5
"""Share of its price that a region's score must reach to be tried: a linear test at a camera that
is bent by the level falls short of the gain (chosen by hand on synthetic crowds)."""
_WIDEST_FOCAL = 1.0
"""Focal length, in half diagonals (a diagonal view of 90°), below which the one coefficient of an
unknown lens leaves errors of length like those of a level: the best such model of a lens of equal
angles is off by 1.3 % of the radius there, and at the rim by a quarter of lengths along it."""
_LEAST_PLACES_PAID = 150.0
"""The price is that of at least so many places: 15.1 for one side, which χ² of one degree of
freedom exceeds once in 10,000 times, while some hundred regions are really different."""
_ROUNDS = 4
_MOST_STEP_M = 0.6


@dataclass(frozen=True, eq=False)
class Level:
    """A ground z = ``height_m`` above the camera's, for the people ``inside`` (n,).

    ``problem`` has their ground, ``state`` is its solution. ``cuts`` (k, 3) bound the region in
    pixels of the footage. Not ``believed`` if all this could as well be shorter people.
    """

    problem: Problem
    state: State
    inside: Bool[np.ndarray, "n"]
    cuts: Float[np.ndarray, "k 3"]
    height_m: float
    sigma_m: float
    people: int
    believed: bool


def second_level(
    problem: Problem, state: State, foot_uv: Float[np.ndarray, "n 2"], *, systematics: bool
) -> Level | None:
    """The second level of the ground that the solution ``state`` would gain by, or None.

    ``foot_uv`` are the feet in pixels of the footage; ``systematics`` as for the covariance.
    """
    wide = state.parameters[FOCAL] < np.log(_WIDEST_FOCAL)
    if wide and problem.prior.free[CORNER] and not problem.points.fisheye:
        return None
    length = np.sqrt(problem.points.seen2)
    places = position_weights(problem.points.foot, length, problem.track)
    counted = replace(problem, weight=places)
    rows, few, there = thinned(counted, state)
    trials = [
        _Trial.of(few, there, region, region.holds(foot_uv[rows]), systematics)
        for region in _regions(few, there, foot_uv[rows], systematics)
    ]
    trials = [t for t in trials if t.gain > 0]
    if not trials:
        return None
    best = max(trials, key=lambda t: t.gain)
    return _level(problem, state, best.region.holds(foot_uv), best, systematics)


def _regions(
    problem: Problem, state: State, foot_uv: np.ndarray, systematics: bool
) -> list[Region]:
    """The most promising regions, narrowly and widely seen."""
    least = max(_LEAST_PLACES, _LEAST_SHARE * float(problem.weight.sum()))
    if problem.weight.sum() < 2 * least:
        return []
    fields, found = _fields(problem, state, systematics), []
    for width in (NARROW, WIDE):
        scores = Scores(problem, state, fields, width=width)
        found += best_regions(foot_uv, problem.weight, scores, least_weight=least, keep=1)
    return [r for r in found if r.score > _PROMISING * _price(problem, r)]


def _fields(problem: Problem, state: State, systematics: bool) -> list[Field]:
    """Smooth errors of length beyond the drift that the problem has, over the size that people of
    mean height would have (the size seen holds what is tested) and over the picture.
    """
    if not systematics:
        return []
    lin = linearise(problem, replace(state, delta_m=np.zeros(problem.n_heights)))
    along = spreads(problem, state.noise)[0]
    size = 0.5 * np.log(problem.points.seen2) + lin.residual[0] * along
    size = size - np.median(size)
    aside = problem.points.foot[0]
    return [
        Field(size**2, _SIZE_SIGMA),
        Field(size * aside, _SIZE_SIGMA),
        Field(aside**2, _ASIDE_SIGMA),
    ]


def _track_sigma(state: State, systematics: bool) -> float:
    """How much longer a person is seen on one level than on the other for reasons of its own."""
    return np.sqrt(2 * TRACK_CORRELATION) * state.noise.along if systematics else 0.0


def _price(problem: Problem, region: Region) -> float:
    """What z and the sides of a region cost."""
    places = max(float(problem.weight.sum()), _LEAST_PLACES_PAID)
    return (1 + 2 * len(region.cuts)) * float(np.log(places))


@dataclass(frozen=True, eq=False)
class _Trial:
    """A level tried out: where, how high, and what is gained beyond its price."""

    problem: Problem
    state: State
    region: Region
    inside: Bool[np.ndarray, "n"]
    height_m: float
    sigma_m: float
    gain: float

    @classmethod
    def of(
        cls,
        problem: Problem,
        state: State,
        region: Region,
        inside: Bool[np.ndarray, "n"],
        systematics: bool,
    ) -> "_Trial":
        """Camera, heights and z refined together, against the camera and heights alone."""
        before, flat = descend(problem, state, steps=20, tolerance=1e-2)
        fields = _fields(problem, before, systematics)
        raised, after, height_m = problem, before, 0.0
        for _ in range(_ROUNDS):
            scores = Scores(raised, after, fields)
            _, more, own = (float(v[0]) for v in scores.of(inside[None]))
            height_m += float(np.clip(more, -_MOST_STEP_M, _MOST_STEP_M))
            height_m = min(height_m, 0.7 * float(np.exp(after.parameters[HEIGHT])))
            raised = on_ground(problem, inside, height_m)
            after, lin = descend(raised, after, steps=8, tolerance=1e-2)
        # The search may have ended in another valley, which has nothing to do with the level.
        back = descend(problem, after, steps=20, tolerance=1e-2)[1]
        fall = min(flat.cost, back.cost) - lin.cost
        each = scores.sigma_by_track(inside, _track_sigma(state, systematics))
        sigma = float(np.hypot(own, each))
        gain = min(fall, (height_m / sigma) ** 2) - _price(problem, region)
        return cls(raised, after, region, inside, height_m, sigma, gain)


def on_ground(problem: Problem, inside: Bool[np.ndarray, "n"], height_m: float) -> Problem:
    """The problem with some of its people on a ground of their own."""
    ground_m = np.where(inside, height_m, 0.0)
    return replace(problem, points=replace(problem.points, ground_m=ground_m))


def _level(
    problem: Problem,
    state: State,
    inside: Bool[np.ndarray, "n"],
    trial: _Trial,
    systematics: bool,
) -> Level | None:
    """The level of a trial that gains, as seen from where most people stand; None where too few
    people are on it.
    """
    height_m, parameters = trial.height_m, trial.state.parameters
    cuts = trial.region.cuts
    if trial.problem.weight[trial.inside].sum() > trial.problem.weight.sum() / 2:
        assert len(cuts) == 1  # further cuts keep to the minority
        lower = np.log1p(-height_m / np.exp(parameters[HEIGHT]))
        parameters = parameters + lower * (np.arange(len(parameters)) == HEIGHT)
        cuts, inside, height_m = -cuts, ~inside, -height_m
    there = trial.state
    state = replace(state, parameters=parameters, azimuth=there.azimuth, drift=there.drift)
    on_level = on_ground(problem, inside, height_m)
    for _ in range(2):
        state, lin = descend(on_level, state, steps=8, tolerance=1e-3)
        state = replace(state, noise=updated_noise(on_level, state, lin))
    state, lin = descend(on_level, state, steps=20, tolerance=1e-4)
    people, agree = [], []
    for rows in (inside, ~inside):
        people.append(len(np.unique(problem.track[rows & (lin.inlier > 0.5)])))
        agree.append(float(lin.inlier[rows] @ problem.weight[rows] / problem.weight[rows].sum()))
    if min(people) < _LEAST_PEOPLE or min(agree) < _AGREE:
        return None
    crossed = _crossed(trial, systematics)
    enough = people[0] >= _PEOPLE_WITHOUT_CROSSING
    if not enough and (not crossed or _like_children(height_m, state)):
        return None
    points = replace(on_level.points, ground_sigma_m=trial.sigma_m)
    return Level(
        replace(on_level, points=points),
        state,
        inside,
        cuts,
        height_m,
        trial.sigma_m,
        people[0],
        crossed or height_m > 0,
    )


def _like_children(height_m: float, state: State) -> bool:
    """Whether adults on such a level are seen as short as hardly any adult is."""
    camera_m = float(np.exp(state.parameters[HEIGHT]))
    return camera_m / (camera_m - height_m) < 1 - _SHORTEST * HEIGHT_SIGMA_M / PERSON_HEIGHT_M


def _crossed(trial: _Trial, systematics: bool) -> bool:
    """Whether people who are seen on both levels tell the same by themselves."""
    flat = on_ground(trial.problem, trial.inside, 0.0)
    fields = _fields(flat, trial.state, systematics)
    scores = Scores(trial.problem, trial.state, fields, within_tracks=True)
    _, more, sigma = (float(v[0]) for v in scores.of(trial.inside[None]))
    own_m = trial.height_m + more
    return own_m * trial.height_m > 0 and (own_m / sigma) ** 2 > _SEEN_ON_BOTH
