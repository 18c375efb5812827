"""The paper's method: camera height from boxes, orientation given (Wagner et al. 2019)."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration import _verdict as verdict
from scene4d.calibration._body import FOCAL, HEIGHT, N_PARAMETERS, ROLL, TILT
from scene4d.calibration._case import Case, different_people
from scene4d.calibration._linear import HeightSystem, height_system
from scene4d.calibration.consensus import (
    TOLERANCE_PX,
    exact_consensus,
    inlier_intervals,
    ransac_consensus,
)
from scene4d.core.body import HEIGHT_SIGMA_M
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.geometry import locate, project, rotation_from_tilt_roll
from scene4d.core.ground_errors import ground_errors
from scene4d.core.orientation import Orientation

_BOX_SIGMA = 0.04
"""Relative bias of the lengths of boxes, which the paper takes for people: they change by 3 to 5 %
with the viewing angle (METHOD section 2)."""
_STEP = 1e-4
"""Of log f, tilt and roll (radians) in difference quotients."""


def paper_calibration(case: Case) -> Calibration:
    """The paper's method on a case with an orientation; raises where that has unknown parts.

    The covariance holds the spread of the orientation, what it does to the height, and the spread
    of the people.
    """
    asked, frame = case.asked, case.frame
    given = asked.known_orientation
    assert given is not None  # solve_segments
    if asked.fixed_focal_px is not None:
        given = replace(given, focal_px=asked.fixed_focal_px, focal_sigma_px=0.0)
    given_sigma = _given_sigmas(given)
    log_f = np.log(given.focal_px / frame.half_diagonal_px)
    parameters = np.zeros(N_PARAMETERS)
    parameters[[FOCAL, TILT, ROLL]] = log_f, given.tilt_rad, given.roll_rad
    people = _People.of(case, frame.camera(parameters).K, given)
    inlier = people.consensus(asked.consensus, asked.seed)
    if inlier.sum() < verdict.MIN_PEOPLE:
        return case.undetermined(
            f"only {inlier.sum()} of {len(inlier)} people agree with one camera height at this "
            'orientation; needed: an orientation that fits the footage, or method "joint"'
        )
    agreeing = people.select(inlier)
    parameters[HEIGHT] = np.log(agreeing.system().solve())
    by_given = np.eye(N_PARAMETERS)[:, :3]
    by_given[HEIGHT] = agreeing.sensitivity()
    covariance = by_given @ np.diag(given_sigma**2) @ by_given.T
    covariance[HEIGHT, HEIGHT] += _people_variance(case, agreeing.system().each, inlier)
    camera = frame.camera(parameters)
    found = case.found(
        camera=camera,
        covariance=covariance,
        inlier=case.over_all(inlier, False),
        residual=case.over_all(people.head_error(camera.P), np.nan),
        warnings=_few_inliers(inlier),
    )
    errors = ground_errors(found)
    return replace(
        found, ground_error_m=errors.within, ground_error_from_camera_m=errors.from_camera
    )


def _few_inliers(inlier: np.ndarray) -> tuple[str, ...]:
    if inlier.mean() >= 0.5:
        return ()
    return (
        f"Only {inlier.mean():.0%} of the {len(inlier)} sightings have their heads within "
        f"{TOLERANCE_PX:g} pixels of where this camera expects them.",
    )


def _given_sigmas(given: Orientation) -> np.ndarray:
    """Spread of log f, tilt and roll (3,); raises where one of them is said to be unknown."""
    names = "focal_px", "tilt_deg", "roll_deg"
    for name, sigma in zip(names, given.spread, strict=True):
        if not np.isfinite(sigma):
            raise InputError(
                f"orientation: {name} is unknown (infinite sigma), and the paper's method "
                'estimates the height alone: give a finite sigma, or use method "joint"'
            )
    return np.array(given.spread)


def _people_variance(case: Case, own_height_m: np.ndarray, inlier: np.ndarray) -> float:
    """Relative variance of the height by the people: of the mean of their own answers (n,), each
    different person counted once, of the population's mean, and of boxes as bodies.
    """
    asked, segments = case.asked, case.segments.select(case.usable)
    spread = 1.4826 * float(np.median(np.abs(own_height_m / np.median(own_height_m) - 1)))
    tallness = HEIGHT_SIGMA_M / asked.person_height_m
    variance = (spread**2 + tallness**2) / different_people(segments.select(inlier))
    variance += (asked.population_sigma_m / asked.person_height_m) ** 2
    if asked.systematics and segments.from_box.any():
        variance += _BOX_SIGMA**2
    return float(variance)


@dataclass(frozen=True, eq=False)
class _People:
    """Undistorted feet at Z = 0 and heads at ``person_height_m``, before a camera with ``K`` whose
    tilt and roll are ``given``.
    """

    foot_uv: Float[np.ndarray, "n 2"]
    head_uv: Float[np.ndarray, "n 2"]
    K: Float[np.ndarray, "3 3"]
    person_height_m: float
    given: Orientation

    @classmethod
    def of(cls, case: Case, K: np.ndarray, given: Orientation) -> "_People":
        ends = [uv[case.usable] for uv in (case.segments.foot_uv, case.segments.head_uv)]
        lens = case.frame.lens
        foot, head = ends if lens is None else [lens.undistort(uv)[0] for uv in ends]
        return cls(foot, head, K, case.asked.person_height_m, given)

    def select(self, rows: np.ndarray) -> "_People":
        return replace(self, foot_uv=self.foot_uv[rows], head_uv=self.head_uv[rows])

    def consensus(self, how: str, seed: int) -> Bool[np.ndarray, "n"]:
        """The largest set that agrees on one height, exactly or by RANSAC."""
        R = rotation_from_tilt_roll(self.given.tilt_rad, self.given.roll_rad)
        people = self.foot_uv, self.head_uv, self.person_height_m
        intervals = inlier_intervals(self.K, R, *people)
        if how == "exact":
            return exact_consensus(intervals)
        own = 1 / self.system().each
        return ransac_consensus(intervals, own, rng=np.random.default_rng(seed))

    def system(self, log_f: float = 0.0, tilt: float = 0.0, roll: float = 0.0) -> HeightSystem:
        """The equations of the camera's height, the orientation changed by so much."""
        K = self.K.copy()
        K[:2, :2] *= np.exp(log_f)
        R = rotation_from_tilt_roll(self.given.tilt_rad + tilt, self.given.roll_rad + roll)
        return height_system(K, R, self.foot_uv, self.head_uv, self.person_height_m)

    def sensitivity(self) -> Float[np.ndarray, "3"]:
        """Derivative of log height by log f, tilt and roll, by central differences."""
        steps = [(self.system(*step), self.system(*-step)) for step in _STEP * np.eye(3)]
        rise = [np.log(more.solve()) - np.log(less.solve()) for more, less in steps]
        return np.array(rise) / (2 * _STEP)

    def head_error(self, P: Float[np.ndarray, "3 4"]) -> Float[np.ndarray, "n"]:
        """Distance between seen and predicted head over the length of the person."""
        xy, _ = locate(P, self.foot_uv)
        uv, _ = project(P, np.column_stack([xy, np.full(len(xy), self.person_height_m)]))
        length = np.hypot(*(self.foot_uv - self.head_uv).T)
        return np.hypot(*(uv - self.head_uv).T) / np.maximum(length, 1e-9)
