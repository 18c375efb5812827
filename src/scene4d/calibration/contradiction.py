"""Does what was told about the camera agree with what the people show without it?"""

from dataclasses import replace

import numpy as np

from scene4d.calibration.body import CORNER, FOCAL, ROLL, TILT
from scene4d.calibration.case import Case
from scene4d.calibration.joint import solve
from scene4d.calibration.prior import default_prior
from scene4d.calibration.refine import Problem
from scene4d.calibration.uncertainty import covariance
from scene4d.core.calibration import Calibration
from scene4d.core.orientation import Orientation

_SIGMAS = 4.0
"""Farther apart than this many standard deviations, one of the two must be wrong."""
_LENS_AGREEMENT = 0.03
"""Relative difference of two told focal lengths that is worth a word."""


def disagreements(alone: Calibration, guess: Orientation) -> list[str]:
    """What a camera that was found without a guess says otherwise, each with both numbers: parts
    of a sentence, none where the two agree.

    Raises nothing: a camera that is undetermined contradicts nobody.
    """
    camera = alone.camera
    if not alone or camera is None or alone.covariance is None:
        return []
    sigma = np.sqrt(np.diag(alone.covariance))
    focal = guess.focal_px
    rows = (
        (
            "focal length",
            np.log(focal / camera.focal_px),
            sigma[FOCAL],
            guess.focal_sigma_px / focal,
        ),
        ("tilt", guess.tilt_rad - camera.tilt_rad, sigma[TILT], guess.tilt_sigma_rad),
        ("roll", guess.roll_rad - camera.roll_rad, sigma[ROLL], guess.roll_sigma_rad),
    )
    texts = {
        "focal length": (
            f"{focal:.0f} ± {guess.focal_sigma_px:.0f} px against "
            f"{camera.focal_px:.0f} ± {camera.focal_px * sigma[FOCAL]:.0f} px"
        ),
        "tilt": _angles(guess.tilt_rad, guess.tilt_sigma_rad, camera.tilt_rad, sigma[TILT]),
        "roll": _angles(guess.roll_rad, guess.roll_sigma_rad, camera.roll_rad, sigma[ROLL]),
    }
    return [
        f"{name} {texts[name]}"
        for name, apart, own, of_guess in rows
        # Both are 0 where the same lens told both.
        if np.hypot(own, of_guess) > 0 and abs(apart) > _SIGMAS * np.hypot(own, of_guess)
    ]


def _angles(guess: float, guess_sigma: float, found: float, sigma: float) -> str:
    return "{:.1f} ± {:.1f}° against {:.1f} ± {:.1f}°".format(
        *np.degrees([guess, guess_sigma, found, sigma])
    )


def contradictions(case: Case, problem: Problem) -> list[str]:
    """Sentences about told values that the people contradict; none where nothing was told.

    The people are asked again without them. Boxes alone cannot answer.
    """
    asked, unit = case.asked, case.frame.half_diagonal_px
    said = []
    orientation, fixed = asked.orientation, asked.fixed_focal_px
    if orientation is not None and fixed is not None:
        apart = abs(np.log(orientation.focal_px / fixed))
        if np.isfinite(orientation.focal_sigma_px) and apart > _LENS_AGREEMENT:
            said.append(
                f"The orientation's focal length ({orientation.focal_px:.0f} px) differs from the "
                f"lens file's ({fixed:.0f} px), which was used."
            )
    free = default_prior(estimate_distortion=bool(problem.prior.free[CORNER]))
    names = {FOCAL: "focal length", TILT: "tilt", ROLL: "roll"}
    told = [i for i in names if problem.prior.sigma[i] < free.sigma[i]]
    if not told or problem.points.from_box.all():
        return said
    alone = replace(problem, prior=free, lines=None)
    state = solve(alone, seed=asked.seed)
    if state is None:
        return said
    spread = covariance(alone, state, systematics=asked.systematics)
    for i in told:
        found, given = state.parameters[i], problem.prior.mean[i]
        sigma = float(np.sqrt(spread[i, i]))
        if abs(found - given) <= _SIGMAS * np.hypot(sigma, problem.prior.sigma[i]):
            continue
        if i == FOCAL:
            focal, told_px = np.exp(found) * unit, np.exp(given) * unit
            text = f"{focal:.0f} ± {focal * sigma:.0f} px and not {told_px:.0f} px"
        else:
            degrees = np.degrees([found, sigma, given])
            text = "{:.1f} ± {:.1f}° and not {:.1f}°".format(*degrees)
        said.append(
            f"The {names[i]} that was given contradicts the people, who by themselves say {text}."
        )
    return said
