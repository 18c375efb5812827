"""The paper's method: camera height from boxes, orientation given (Wagner et al. 2019)."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.calibration import verdict
from scene4d.calibration.body import HEIGHT
from scene4d.calibration.case import Case, ground_error
from scene4d.calibration.consensus import (
    TOLERANCE_PX,
    exact_consensus,
    inlier_intervals,
    ransac_consensus,
)
from scene4d.calibration.linear import height_system
from scene4d.calibration.refine import HEIGHT_SIGMA_M
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.geometry import locate, project, rotation_from_tilt_roll
from scene4d.core.orientation import Orientation

CONSENSUS = ("exact", "ransac")
_BOX_SIGMA = 0.04
"""Relative bias of the lengths of boxes, which the paper takes for people: they change by 3 to 5 %
with the viewing angle (METHOD section 2)."""
_STEP = 1e-4


def paper_calibration(case: Case) -> Calibration:
    """The paper's method on a case with an orientation; raises where that has unknown parts.

    The covariance holds the spread of the orientation, what it does to the height, and the spread
    of the people.
    """
    asked, frame, usable = case.asked, case.frame, case.usable
    orientation = asked.orientation
    assert orientation is not None  # check_asked
    if asked.fixed_focal_px is not None:
        orientation = replace(orientation, focal_px=asked.fixed_focal_px, focal_sigma_px=0.0)
    told = _told_sigmas(orientation)
    log_f = np.log(orientation.focal_px / frame.half_diagonal_px)
    parameters = np.array([log_f, orientation.tilt_rad, orientation.roll_rad, 0.0, 0.0])
    foot, head = case.segments.foot_uv[usable], case.segments.head_uv[usable]
    if frame.lens is not None:
        foot, head = frame.lens.undistort(foot)[0], frame.lens.undistort(head)[0]
    solution = solve_paper(
        foot,
        head,
        frame.camera(parameters).K,
        orientation,
        person_height_m=asked.person_height_m,
        person_sigma_m=HEIGHT_SIGMA_M,
        track=case.segments.track[usable],
        consensus=asked.consensus,
        seed=asked.seed,
    )
    agreeing = 0 if solution is None else int(solution.inlier.sum())
    if solution is None or agreeing < verdict.MIN_PEOPLE:
        return case.undetermined(
            f"only {agreeing} of {int(usable.sum())} people agree with one camera height at this "
            "orientation; needed: an orientation that fits the footage, or --method joint"
        )
    parameters[HEIGHT] = np.log(solution.height_m)
    camera = frame.camera(parameters)
    by_told = np.eye(5)[:, :3]
    by_told[HEIGHT] = solution.sensitivity
    covariance = by_told @ np.diag(told**2) @ by_told.T
    covariance[HEIGHT, HEIGHT] += solution.relative_sigma**2
    covariance[HEIGHT, HEIGHT] += (asked.population_sigma_m / asked.person_height_m) ** 2
    if asked.systematics and case.segments.from_box[usable].any():
        covariance[HEIGHT, HEIGHT] += _BOX_SIGMA**2
    values = {
        "camera": camera,
        "covariance": covariance,
        "inlier": case.over_all(solution.inlier, False),
        "residual": case.over_all(_head_error(camera.P, foot, head, asked.person_height_m), np.nan),
    }
    said = []
    if solution.inlier.mean() < 0.5:
        said.append(
            f"Only {solution.inlier.mean():.0%} of the {len(foot)} sightings have their heads "
            f"within {TOLERANCE_PX:g} pixels of where this camera expects them."
        )
    return case.found(
        **values,
        ground_error_m=ground_error(case.found(**values))[0],
        warnings=tuple(said),
    )


def _told_sigmas(orientation: Orientation) -> np.ndarray:
    """Spread of log f, tilt and roll (3,); raises where one of them is said to be unknown."""
    spread = {
        "focal_px": orientation.focal_sigma_px / orientation.focal_px,
        "tilt_deg": orientation.tilt_sigma_rad,
        "roll_deg": orientation.roll_sigma_rad,
    }
    for name, sigma in spread.items():
        if not np.isfinite(sigma):
            raise InputError(
                f"orientation: {name} is unknown (infinite sigma), and the paper's method "
                "estimates the height alone: give a finite sigma, or use --method joint"
            )
    return np.array(list(spread.values()))


def _head_error(
    P: np.ndarray, foot: np.ndarray, head: np.ndarray, person_height_m: float
) -> np.ndarray:
    """Distance between seen and predicted head over the length of the person."""
    xy, _ = locate(P, foot)
    uv, _ = project(P, np.column_stack([xy, np.full(len(xy), person_height_m)]))
    return np.hypot(*(uv - head).T) / np.maximum(np.hypot(*(foot - head).T), 1e-9)


@dataclass(frozen=True, eq=False)
class PaperSolution:
    """Camera height (m), its relative spread by the people, and who agrees.

    ``sensitivity`` (3,) is the change of log height by log f, tilt and roll.
    """

    height_m: float
    relative_sigma: float
    sensitivity: Float[np.ndarray, "3"]
    inlier: Bool[np.ndarray, "n"]


def solve_paper(
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    K: Float[np.ndarray, "3 3"],
    orientation: Orientation,
    *,
    person_height_m: float,
    person_sigma_m: float,
    track: Int[np.ndarray, "n"],
    tolerance_px: float = TOLERANCE_PX,
    consensus: str = "exact",
    seed: int = 0,
) -> PaperSolution | None:
    """Height by consensus at ``tolerance_px`` and least squares over the inliers.

    Points are undistorted pixels, feet at Z = 0 and heads at ``person_height_m``. The spread
    counts a track once. None where nobody agrees with any height; raises :class:`InputError` for
    an unknown ``consensus``.
    """
    if consensus not in CONSENSUS:
        raise InputError(f"consensus must be one of {CONSENSUS}, found {consensus!r}")
    R = rotation_from_tilt_roll(orientation.tilt_rad, orientation.roll_rad)
    intervals = inlier_intervals(K, R, foot_uv, head_uv, person_height_m, tolerance_px)
    system = height_system(K, R, foot_uv, head_uv, person_height_m)
    with np.errstate(divide="ignore", invalid="ignore"):
        own = system.information / system.moment
    if consensus == "exact":
        inlier = exact_consensus(intervals)
    else:
        inlier = ransac_consensus(intervals, own, rng=np.random.default_rng(seed))
    if not inlier.any():
        return None
    height = system.solve(inlier)
    return PaperSolution(
        height_m=height,
        relative_sigma=_spread_of_people(
            1 / own[inlier] / height, track[inlier], person_sigma_m / person_height_m
        ),
        sensitivity=_sensitivity(foot_uv[inlier], head_uv[inlier], K, orientation, person_height_m),
        inlier=inlier,
    )


def _spread_of_people(ratio: np.ndarray, track: np.ndarray, height_sigma: float) -> float:
    """Of the mean of people's own answers (n,), over the answer: each track counts once."""
    people = len(np.unique(track[track >= 0])) + int((track < 0).sum())
    spread = 1.4826 * float(np.median(np.abs(ratio - 1)))
    return float(np.sqrt((spread**2 + height_sigma**2) / people))


def _sensitivity(
    foot: np.ndarray, head: np.ndarray, K: np.ndarray, told: Orientation, person_height_m: float
) -> np.ndarray:
    """Derivative of log height by log f, tilt and roll (3,), by central differences."""
    result = np.zeros(3)
    for index in range(3):
        ends = []
        for sign in (-1, 1):
            step = np.zeros(3)
            step[index] = sign * _STEP
            moved = K.copy()
            moved[:2, :2] *= np.exp(step[0])
            R = rotation_from_tilt_roll(told.tilt_rad + step[1], told.roll_rad + step[2])
            ends.append(np.log(height_system(moved, R, foot, head, person_height_m).solve()))
        result[index] = (ends[1] - ends[0]) / (2 * _STEP)
    return result
