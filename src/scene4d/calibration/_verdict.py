"""Whether a solution may be called a camera, and what to warn of; every refusal has its reason."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._body import FOCAL, HEIGHT, ROLL, TILT, Points
from scene4d.calibration._prior import Prior
from scene4d.core.calibration import Calibration
from scene4d.core.orientation import Orientation

# The thresholds below were chosen by hand on the tuning cameras (PETS 2009, TownCentre, synthetic
# scenes of tests/calibration) so that no camera known to be right is refused, unless they say more.
MIN_PEOPLE = 3
"""With fewer people than this the answer is the prior: four unknowns, two equations a person."""
FEW_INLIERS = 0.6
"""Share of people as modelled below which a camera is suspicious."""
FOCAL_KNOWN = 0.3
"""A focal length known this well (relative) before anybody is seen needs no depth in the scene."""
_MAX_GROUND_ERROR = 0.35
"""Predicted position error over distance, in the median, above which a camera is no use."""
_MAX_FOCAL_SIGMA = 0.45
"""Relative focal length error above which the scene's shape is unknown."""
_TOLD_TILT = 0.2
"""A prior narrower than this (radians) was given by the user, and may be wrong."""
_MIN_DEPTH = 0.15
"""Spread of the feet towards the horizon, in lengths of a person, below which their own noise
(about 0.02) passes for distance: the horizon then comes out too far, and with confidence."""
_MIN_INLIERS = 0.3
"""Share of people as modelled below which the picture is not of upright people on a plane."""
_DIAGONAL_VIEW_DEG = (15.0, 150.0)
"""Angles across the picture's diagonal that fixed cameras have: 15° is a 30 mm lens before a 1/2"
sensor, and two standard deviations of the prior; a film cut out of PETS 2009 at one size and random
places gives 10 to 13°. 150° is a 2.1 mm lens before a 1/3" sensor, about the end of the pinhole."""
_HEIGHT_M = (0.3, 60.0)
"""Heights of cameras that watch people, in metres. Chosen: from knee-high to a block of flats."""
_SIGMAS = 4.0
"""Farther apart than this many standard deviations, one of the two must be wrong: by chance once in
16,000 times, and stated sigmas are up to 1.5 too small (docs/orientation.md)."""
_FEW_PEOPLE = 10
"""With this many people the mean of their heights is known to 0.03 m (0.09 m / √10), as well as
that of the population."""

BOXES_ALONE = (
    "boxes alone do not determine the focal length: a box has no lean, and its size changes with "
    "the viewing angle as it does with the focal length; needed: a lens file (lens), an "
    "orientation (orientation), or keypoints (run on the footage itself)"
)


def depth_of(points: Points, up: Float[np.ndarray, "3"], inlier: Bool[np.ndarray, "n"]) -> float:
    """Standard deviation of the feet (n,) across the horizon, in median lengths of a person."""
    foot, head = points.foot[:, inlier], points.head[:, inlier]
    if foot.shape[1] == 0:
        return 0.0
    down = -up[:2] / max(float(np.hypot(up[0], up[1])), 1e-9)
    return float(np.std(down @ foot) / np.median(np.hypot(*(head - foot))))


def refusal(
    points: Points,
    prior: Prior,
    parameters: Float[np.ndarray, "5"],
    depth: float,
    covariance: Float[np.ndarray, "5 5"],
    relative_ground_error: float,
    inlier_share: float,
) -> str | None:
    """Why the camera is undetermined and what would determine it, or None where it is."""
    if inlier_share < _MIN_INLIERS:
        told = prior.sigma[TILT] < _TOLD_TILT
        first = "an orientation that fits this footage, " if told else ""
        return (
            f"only {inlier_share:.0%} of the people agree with one camera over one flat ground; "
            f"needed: {first}people who stand upright on the same plane, or a lens file if the "
            "lens bends strongly"
        )
    focal_sigma = float(np.sqrt(covariance[FOCAL, FOCAL]))
    flat = depth < _MIN_DEPTH and bool(prior.sigma[FOCAL] > FOCAL_KNOWN)
    if flat:
        what = "the focal length is not determined"
    elif focal_sigma > _MAX_FOCAL_SIGMA:
        what = f"the focal length is not determined (± {focal_sigma:.0%})"
    elif not relative_ground_error <= _MAX_GROUND_ERROR:  # true for NaN
        what = f"ground positions would be wrong by {relative_ground_error:.0%} of their distance"
    else:
        return _implausible(parameters) if prior.sigma[FOCAL] > FOCAL_KNOWN else None
    where, needed = _lack(points, flat=flat)
    hint = " or a lens file (lens)" if prior.sigma[FOCAL] > 0 else ""
    return f"{what}: {where}; needed: {needed}{hint}"


def _lack(points: Points, *, flat: bool) -> tuple[str, str]:
    """What the people's places lack, and what would make up for it."""
    size = np.hypot(*(points.head - points.foot))
    reach = float(np.ptp(points.foot, axis=1).max() / np.median(size))
    if reach < 1.0:
        return (
            "all people stand in one spot",
            "people in other places of the picture, near and far",
        )
    if flat or np.quantile(size, 0.95) < 1.25 * np.quantile(size, 0.05):
        return (
            "all people are at one distance from the camera",
            "people who also walk nearer to the camera and farther from it",
        )
    return (
        "the people seen are too few, or too alike in size and place",
        "more people, nearer and farther and to both sides",
    )


def _implausible(parameters: np.ndarray) -> str | None:
    """Why no camera is like this; only for a focal length that nobody gave."""
    view_deg = float(np.degrees(2 * np.arctan(np.exp(-parameters[FOCAL]))))
    height_m = float(np.exp(parameters[HEIGHT]))
    needed = (
        "needed: footage of one fixed camera over flat ground, or a lens file (lens) or an "
        "orientation (orientation) if this is right"
    )
    if not _DIAGONAL_VIEW_DEG[0] <= view_deg <= _DIAGONAL_VIEW_DEG[1]:
        return (
            f"the people's sizes and places suggest a view of {view_deg:.1f}° across the picture's "
            f"diagonal, which hardly any fixed camera has; {needed}"
        )
    if not _HEIGHT_M[0] <= height_m <= _HEIGHT_M[1]:
        return (
            f"the people's sizes and places suggest a camera {height_m:.1f} m above the ground, "
            f"where hardly any hangs; {needed}"
        )
    return None


def warnings(
    n_sightings: int, n_people: int, inlier_share: float, prior: Prior,
    covariance: Float[np.ndarray, "5 5"],
) -> list[str]:  # fmt: skip
    """What a reader of an accepted camera should know, in sentences."""
    said = []
    if n_people < _FEW_PEOPLE:
        who = f"{n_people} different people" if n_people > 1 else "what may be one person"
        said.append(
            f"The camera rests on {who}; with ten or more the scale of the scene would depend less "
            "on how tall they happen to be."
        )
    if inlier_share < FEW_INLIERS:
        said.append(
            f"Only {inlier_share:.0%} of the {n_sightings} sightings agree with the camera; look "
            "at the red ones in the picture."
        )
    if prior.sigma[FOCAL] > 0 and covariance[FOCAL, FOCAL] > 0.15**2:
        said.append(
            f"The focal length is known to ± {np.sqrt(covariance[FOCAL, FOCAL]):.0%} only; "
            "a lens file (lens) or people nearer and farther would pin it down."
        )
    return said


def disagreements(alone: Calibration, given: Orientation) -> Iterator[tuple[str, str, str]]:
    """Where a camera that was found without the orientation ``given`` contradicts it: the name of
    the value, what was given, what was found. An undetermined camera contradicts nothing.
    """
    camera = alone.camera
    if not alone or camera is None or alone.covariance is None:
        return
    sigma = np.sqrt(np.diag(alone.covariance))
    focal, relative = given.focal_px, given.focal_sigma_px / given.focal_px
    apart = np.log(focal / camera.focal_px)
    if _contradict(apart, sigma[FOCAL], relative):
        found = f"{camera.focal_px:.0f} ± {camera.focal_px * sigma[FOCAL]:.0f} px"
        yield "focal length", f"{focal:.0f} ± {given.focal_sigma_px:.0f} px", found
    for name, index, stated, stated_sigma, value in (
        ("tilt", TILT, given.tilt_rad, given.tilt_sigma_rad, camera.tilt_rad),
        ("roll", ROLL, given.roll_rad, given.roll_sigma_rad, camera.roll_rad),
    ):
        if _contradict(stated - value, sigma[index], stated_sigma):
            yield name, _angle(stated, stated_sigma), _angle(value, sigma[index])


def _contradict(apart: float, sigma: float, other_sigma: float) -> bool:
    # Both are 0 where the same lens gave both.
    both = float(np.hypot(sigma, other_sigma))
    return both > 0 and bool(abs(apart) > _SIGMAS * both)


def _angle(angle_rad: float, sigma_rad: float) -> str:
    return "{:.1f} ± {:.1f}°".format(*np.degrees([angle_rad, sigma_rad]))
