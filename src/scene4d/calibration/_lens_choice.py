"""Whether the picture was taken with a fisheye lens, where no lens file says it.

The pinhole camera with one radial coefficient is the usual case and comes first. Where its answer
looks like one forced upon a stronger lens, the same problem is solved with the fisheye projection
(:mod:`._equidistant`), which has as many parameters, and the two are compared by what they leave
unexplained.
"""

from dataclasses import replace

import numpy as np

from scene4d.calibration._body import CORNER, FOCAL
from scene4d.calibration._joint import solve
from scene4d.calibration._prior import Prior
from scene4d.calibration._problem import Problem, State, spreads
from scene4d.calibration._refine import linearise, normal_equations

_STRONG_CORNER = -0.05
"""Displacement D of the image's corner beyond which the lens may be another one: barrel by more
than one standard deviation of the prior. Two of the four lenses of :data:`._prior.CENTRE_SIGMA`'s
cameras are below."""
_CLEARLY = 10.0
"""Least difference of ``-2 log p`` for the fisheye lens: odds of 150 to 1, "very strong" evidence
(Kass and Raftery 1995), since errors are less independent than the model has them."""
_FISHEYE_LOG_FOCAL, _FISHEYE_SIGMA = np.log(0.75), 0.4
"""Prior focal length of a fisheye lens, in half diagonals: two standard deviations reach corners 34
to 170 degrees off the axis, and so views of 70 degrees to a whole circle within the picture."""


def with_best_lens(problem: Problem, state: State, *, seed: int) -> tuple[Problem, State]:
    """The problem and its solution with the lens that explains the picture clearly better."""
    if not _worth_trying(problem, state):
        return problem, state
    other = as_fisheye(problem)
    found = solve(other, seed=seed)
    if found is None or unexplained(problem, state) - unexplained(other, found) < _CLEARLY:
        return problem, state
    return other, found


def as_fisheye(problem: Problem) -> Problem:
    """The same problem behind a fisheye lens."""
    lines = None if problem.lines is None else replace(problem.lines, fisheye=True)
    points = replace(problem.points, fisheye=True)
    return replace(problem, points=points, lines=lines, prior=_prior(problem.prior))


def _prior(prior: Prior) -> Prior:
    mean, sigma = prior.mean.copy(), prior.sigma.copy()
    if sigma[FOCAL] > _FISHEYE_SIGMA:
        mean[FOCAL], sigma[FOCAL] = _FISHEYE_LOG_FOCAL, _FISHEYE_SIGMA
    return replace(prior, mean=mean, sigma=sigma)


def _worth_trying(problem: Problem, state: State) -> bool:
    """Whether the lens is open, everything that is said can be asked about a fisheye, and the
    answer is not plainly that of an ordinary lens.
    """
    if problem.prior.sigma[CORNER] == 0 or problem.prior.sigma[FOCAL] == 0 or problem.terms:
        return False
    return bool(state.parameters[CORNER] < _STRONG_CORNER)


def unexplained(problem: Problem, state: State) -> float:
    """``-2 log p`` of what was seen, up to a constant that does not depend on camera, lens or
    noise: the minimised cost with the normalisation of its Gaussians, heights marginalised.
    """
    lin = linearise(problem, state)
    along, across = spreads(problem, state.noise)
    normal = 2 * float(problem.weight @ np.log(along * across))
    stiffness = normal_equations(problem, state, lin).height_information * state.noise.height_m**2
    return lin.cost + normal + float(np.log(stiffness).sum())
