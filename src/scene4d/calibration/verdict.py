"""Whether a solution may be called a camera, and what to warn of; every refusal has its reason."""

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration.body import FOCAL, TILT, Points
from scene4d.calibration.prior import Prior

MIN_PEOPLE = 3
"""Fewer people than this leave the camera to the prior."""
_MAX_GROUND_ERROR = 0.35
"""Predicted position error over distance, in the median, above which a camera is no use."""
_MAX_FOCAL_SIGMA = 0.45
"""Relative focal length error above which the scene's shape is unknown."""
FOCAL_KNOWN = 0.3
"""A focal length known this well (relative) before anybody is seen needs no depth in the scene."""
_TOLD_TILT = 0.2
"""A prior this narrow (radians) was told by the user, and may be wrong."""
_MIN_DEPTH = 0.15
"""Spread of the feet towards the horizon, in lengths of a person, below which their own noise
(about 0.02) passes for distance: the horizon then comes out too far, and with confidence."""
_MIN_INLIERS = 0.3
"""Share of people as modelled below which the picture is not of upright people on a plane."""

BOXES_ALONE = (
    "boxes alone do not determine the focal length: a box has no lean, and its size changes with "
    "the viewing angle as it does with the focal length; needed: a lens file (--lens), an "
    "orientation (--orientation FILE), or keypoints (run on the footage itself)"
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
    depth: float,
    covariance: Float[np.ndarray, "5 5"],
    relative_ground_error: float,
    inlier_share: float,
) -> str | None:
    """Why the camera is undetermined and what would determine it, or None where it is."""
    focal_sigma = float(np.sqrt(covariance[FOCAL, FOCAL]))
    if inlier_share < _MIN_INLIERS:
        told = prior.sigma[TILT] < _TOLD_TILT
        first = "an orientation that fits this footage, " if told else ""
        return (
            f"only {inlier_share:.0%} of the people agree with one camera over one flat ground; "
            f"needed: {first}people who stand upright on the same plane, or a lens file if the "
            "lens bends strongly"
        )
    flat = depth < _MIN_DEPTH and prior.sigma[FOCAL] > FOCAL_KNOWN
    vague = focal_sigma > _MAX_FOCAL_SIGMA
    if not flat and not vague and relative_ground_error <= _MAX_GROUND_ERROR:  # false for NaN
        return None
    size = np.hypot(*(points.head - points.foot))
    size_ratio = float(np.quantile(size, 0.95) / np.quantile(size, 0.05))
    reach = float(np.ptp(points.foot, axis=1).max() / np.median(size))
    if reach < 1.0:
        where = "all people stand in one spot"
        needed = "people in other places of the picture, near and far"
    elif flat or size_ratio < 1.25:
        where = "all people are at one distance from the camera"
        needed = "people who also walk nearer to the camera and farther from it"
    else:
        where = "the people seen are too few, or too alike in size and place"
        needed = "more people, nearer and farther and to both sides"
    what = (
        "the focal length is not determined"
        if flat
        else f"the focal length is not determined (± {focal_sigma:.0%})"
        if vague
        else f"ground positions would be wrong by {relative_ground_error:.0%} of their distance"
    )
    hint = " or a lens file (--lens)" if prior.sigma[FOCAL] > 0 else ""
    return f"{what}: {where}; needed: {needed}{hint}"


def warnings(
    n_people: int, n_tracks: int, inlier_share: float, prior: Prior,
    covariance: Float[np.ndarray, "5 5"],
) -> list[str]:  # fmt: skip
    """What a reader of an accepted camera should know, in sentences."""
    said = []
    if n_tracks < 10:
        said.append(
            f"The camera rests on {n_tracks} different people; with ten or more the scale of the "
            "scene would depend less on how tall they happen to be."
        )
    if inlier_share < 0.6:
        said.append(
            f"Only {inlier_share:.0%} of the {n_people} sightings agree with the camera; look at "
            "the blue ones in the picture."
        )
    if prior.sigma[FOCAL] > 0 and covariance[FOCAL, FOCAL] > 0.15**2:
        said.append(
            f"The focal length is known to ± {np.sqrt(covariance[FOCAL, FOCAL]):.0%} only; "
            "a lens file (--lens) or people nearer and farther would pin it down."
        )
    return said
