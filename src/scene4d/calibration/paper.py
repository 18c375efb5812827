"""The paper's method: camera height from boxes, orientation given (Wagner et al. 2019)."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float, Int

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
from scene4d.errors import InputError
from scene4d.geometry import locate, project, rotation_from_tilt_roll
from scene4d.model import Calibration, Orientation

CONSENSUS = ("exact", "ransac")


def paper_calibration(case: Case) -> Calibration:
    """The paper's method on a case; raises :class:`InputError` where no orientation is given.

    The covariance knows the orientation's own spread, the people's, and nothing between them.
    """
    asked, frame, usable = case.asked, case.frame, case.usable
    orientation = asked.orientation
    if orientation is None:
        raise InputError(
            "the paper's method needs the camera's orientation (focal length, tilt, roll): "
            "give --orientation FILE, or use --method joint"
        )
    if asked.fixed_focal_px is not None:
        orientation = replace(orientation, focal_px=asked.fixed_focal_px, focal_sigma_px=0.0)
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
    if solution is None:
        return case.undetermined("no person agrees with any camera height at this orientation")
    parameters[HEIGHT] = np.log(solution.height_m)
    camera = frame.camera(parameters)
    population = asked.population_sigma_m / asked.person_height_m
    sigma = [
        orientation.focal_sigma_px / orientation.focal_px,
        orientation.tilt_sigma_rad,
        orientation.roll_sigma_rad,
        np.hypot(solution.relative_sigma, population),
        0.0,
    ]
    values = {
        "camera": camera,
        "covariance": np.diag(np.where(np.isfinite(sigma), sigma, 0.0) ** 2),
        "inlier": case.over_all(solution.inlier, False),
        "residual": case.over_all(_head_error(camera.P, foot, head, asked.person_height_m), np.nan),
    }
    return case.found(**values, ground_error_m=ground_error(case.found(**values))[0])


def _head_error(
    P: np.ndarray, foot: np.ndarray, head: np.ndarray, person_height_m: float
) -> np.ndarray:
    """Distance between seen and predicted head over the length of the person."""
    xy, _ = locate(P, foot)
    uv, _ = project(P, np.column_stack([xy, np.full(len(xy), person_height_m)]))
    return np.hypot(*(uv - head).T) / np.maximum(np.hypot(*(foot - head).T), 1e-9)


@dataclass(frozen=True, eq=False)
class PaperSolution:
    """Camera height (m) with the people who agree, and its relative standard deviation."""

    height_m: float
    relative_sigma: float
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
    counts a track once, and adds that of the orientation where it is given. None where nobody
    agrees with any height; raises :class:`InputError` for an unknown ``consensus``.
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
        relative_sigma=_relative_sigma(
            foot_uv[inlier], head_uv[inlier], K, orientation, person_height_m, person_sigma_m,
            track[inlier], 1 / own[inlier], height,
        ),
        inlier=inlier,
    )  # fmt: skip


def _relative_sigma(
    foot: np.ndarray, head: np.ndarray, K: np.ndarray, orientation: Orientation,
    person_height_m: float, person_sigma_m: float, track: np.ndarray, own_height_m: np.ndarray,
    height_m: float,
) -> float:  # fmt: skip
    """Of people's own answers about their mean (by track), of body heights, of the orientation."""
    people = len(np.unique(track[track >= 0])) + int((track < 0).sum())
    spread = 1.4826 * float(np.median(np.abs(own_height_m / height_m - 1)))
    variance = (spread**2 + (person_sigma_m / person_height_m) ** 2) / people
    for name in ("focal", "tilt", "roll"):
        sigma = getattr(orientation, f"{name}_sigma_{'px' if name == 'focal' else 'rad'}")
        if not (0 < sigma < np.inf):
            continue
        heights = []
        for sign in (-0.5, 0.5):
            shifted = K.copy()
            tilt, roll = orientation.tilt_rad, orientation.roll_rad
            if name == "focal":
                shifted[[0, 1], [0, 1]] *= 1 + sign * sigma / orientation.focal_px
            tilt += sign * sigma * (name == "tilt")
            roll += sign * sigma * (name == "roll")
            R = rotation_from_tilt_roll(tilt, roll)
            heights.append(height_system(shifted, R, foot, head, person_height_m).solve())
        variance += ((heights[1] - heights[0]) / height_m) ** 2
    return float(np.sqrt(variance))
