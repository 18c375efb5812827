"""Acceptance of a solution: refusals with their reasons, and warnings."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.calibration._body import FOCAL, HEIGHT, ROLL, TILT, Points
from scene4d.calibration._prior import Prior
from scene4d.core.calibration import Calibration
from scene4d.core.orientation import Orientation

# Unless stated otherwise, the thresholds below were chosen by hand on the tuning cameras (PETS
# 2009, TownCentre, synthetic scenes of tests/calibration) so that no correct camera is refused.
MIN_PEOPLE = 3
"""With fewer people the result is only the prior: four unknowns, two equations per person."""
MIN_VEHICLES = 5
"""Different vehicles that may stand in for people: each tells two numbers after its position, and
their sizes vary by twice as much."""
FEW_INLIERS = 0.6
"""Share of inliers below which a camera is doubtful."""
FOCAL_KNOWN = 0.3
"""With a prior focal length this precise (relative), the scene needs no depth."""
_MAX_GROUND_ERROR = 0.35
"""Median of predicted position error over distance above which a camera is useless."""
_MAX_FOCAL_SIGMA = 0.45
"""Relative focal length error above which the scene's shape is unknown."""
_TOLD_TILT = 0.2
"""A prior narrower than this (radians) was given by the user, and may be wrong."""
_MIN_DEPTH = 0.15
"""Spread of the feet towards the horizon, in person lengths, below which their noise (about 0.02)
passes for distance: the horizon then comes out too far away, with false confidence."""
_ONE_SPOT = 1.0
"""Reach of the feet, in lengths of a person, below which they are one thing in one place: a flower
stand taken for a person, under several numbers. It is seen by one ray."""
_TILT_KNOWN = 0.02
"""With a prior tilt this precise (radians, 1°), one person in one spot gives the height."""
_MIN_INLIERS = 0.3
"""Share of inliers below which the footage does not show upright people on a plane."""
_DIAGONAL_VIEW_DEG = (15.0, 150.0)
"""Diagonal fields of view of fixed cameras: 15° is a 30 mm lens on a 1/2" sensor, and two standard
deviations of the prior; PETS 2009 frames, each cropped at a random place, give 10 to 13°. 150°
is a 2.1 mm lens on a 1/3" sensor, about the limit of the pinhole model."""
_FISHEYE_VIEW_DEG = 320.0
"""Of a fisheye lens: one of 190° whose image is a circle across the height of a 4:3 picture."""
_HEIGHT_M = (0.3, 60.0)
"""Plausible camera heights in metres. Chosen: from knee height to a block of flats."""
SIGMAS = 4.0
"""Values this many standard deviations apart contradict each other: by chance this happens once in
16,000 times, and stated sigmas are up to 1.5 times too small (docs/orientation.md)."""
_FEW_PEOPLE = 10
"""With this many people their mean height is known to 0.03 m (0.09 m / √10), as precisely as the
population mean."""

FISHEYE_FOUND = (
    "The lens is taken for a fisheye, with which people and straight edges agree clearly better "
    "than with an ordinary lens; a lens file (lens) would be surer."
)
BOXES_ALONE = (
    "boxes alone do not determine the focal length: a box has no lean, and its size changes with "
    "the viewing angle as it does with the focal length; needed: a lens file (lens), an "
    "orientation (orientation), or keypoints (run on the footage itself)"
)

NOBODY_WALKS = (
    "nobody walks, and a box does not show whether somebody stands, sits or is half hidden; "
    "needed: footage in which people walk, or keypoints (run on the footage itself)"
)

HANGING = (
    "most heads lie below the feet in the picture, and no camera above the ground explains them; "
    "needed: footage turned by 180°, or feet and heads exchanged if they were mixed up"
)


def standing(places: Int[np.ndarray, "n"]) -> str | None:
    """Why boxes do not tell the camera, in how many ``places`` their tracks were ever seen (0 of a
    person who was seen once only); None where somebody walks, and in single pictures.
    """
    still = (places == 1).mean() > 0.5 and not (places > 1).any()
    return NOBODY_WALKS if still else None


def too_few(people: int, vehicles: int | None) -> str:
    """The refusal where neither people nor moving vehicles (None: not looked for) are enough."""
    seen = f"{people} upright people are seen whole, and at least {MIN_PEOPLE} are needed"
    if vehicles is None:
        return f"{seen}: use more footage, or footage with people in it"
    return (
        f"{seen}, or {MIN_VEHICLES} moving vehicles, of which {vehicles} are seen whole: use more "
        "footage, or footage with people or more traffic in it"
    )


def in_words(people: int, vehicles: int) -> str:
    """Who tells the camera."""
    if not vehicles:
        return "people"
    return "people and vehicles" if people else "vehicles"


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
    parameters: Float[np.ndarray, "7"],
    depth: float,
    covariance: Float[np.ndarray, "7 7"],
    relative_ground_error: float,
    inlier_share: float,
    who: str = "people",
) -> str | None:
    """Why the camera is undetermined and what would determine it; None if it is determined."""
    if inlier_share < _MIN_INLIERS:
        if hanging(points):
            return HANGING
        told = prior.sigma[TILT] < _TOLD_TILT
        first = "an orientation that fits this footage, " if told else ""
        return (
            f"only {inlier_share:.0%} of the {who} agree with one camera over one flat ground; "
            f"needed: {first}people who stand upright on the same plane, or a lens file if the "
            "lens distortion is strong"
        )
    flat = depth < _MIN_DEPTH and bool(prior.sigma[FOCAL] > FOCAL_KNOWN)
    what = _vague(covariance, relative_ground_error)
    if flat:
        what = "the focal length is not determined"
    elif _reach(points) < _ONE_SPOT and prior.sigma[TILT] > _TILT_KNOWN:
        what = "the tilt is not determined"
    elif what is None:
        known = prior.sigma[FOCAL] <= FOCAL_KNOWN
        return None if known else _implausible(parameters, points.fisheye, who)
    where, needed = _lack(points, who, flat=flat)
    hint = " or a lens file (lens)" if prior.sigma[FOCAL] > 0 else ""
    return f"{what}: {where}; needed: {needed}{hint}"


def hanging(points: Points) -> bool:
    """Whether most heads lie below the feet in the picture, as if the camera hung upside down."""
    return bool(np.mean(points.seen[1] > 0) > 0.5)


def landmark_refusal(
    covariance: Float[np.ndarray, "7 7"], relative_ground_error: float
) -> str | None:
    """As :func:`refusal`, of a camera that landmarks tell: it needs neither people nor depth."""
    what = _vague(covariance, relative_ground_error)
    return what and (
        f"{what}: the landmarks, and the people if there are any, are too few or too close together"
        "; needed: four or more ground points near and far and on both sides, more people"
        f"{' or a lens file (lens)' if covariance[FOCAL, FOCAL] > 0 else ''}"
    )


def _vague(covariance: np.ndarray, relative_ground_error: float) -> str | None:
    """What is too uncertain for use, if so."""
    focal_sigma = float(np.sqrt(covariance[FOCAL, FOCAL]))
    if focal_sigma > _MAX_FOCAL_SIGMA:
        return f"the focal length is not determined (± {focal_sigma:.0%})"
    if not relative_ground_error <= _MAX_GROUND_ERROR:  # true for NaN
        return f"ground positions would be wrong by {relative_ground_error:.0%} of their distance"
    return None


def _lack(points: Points, who: str, *, flat: bool) -> tuple[str, str]:
    """What the people's positions lack, and what would supply it."""
    size = np.hypot(*(points.head - points.foot))
    if _reach(points) < _ONE_SPOT:
        return (
            f"all {who} stand in one spot",
            f"{who} in other parts of the image, near and far",
        )
    if flat or np.quantile(size, 0.95) < 1.25 * np.quantile(size, 0.05):
        return (
            f"all {who} are at one distance from the camera",
            f"{who} nearer to the camera and farther from it as well",
        )
    return (
        f"the {who} are too few, or too similar in size and position",
        f"more {who}, near and far and on both sides",
    )


def _reach(points: Points) -> float:
    """How far apart the feet are, in median lengths of a person; single strays do not count."""
    low, high = np.quantile(points.foot, (0.02, 0.98), axis=1)
    return float((high - low).max() / np.median(np.sqrt(points.seen2)))


def _implausible(parameters: np.ndarray, fisheye: bool, who: str) -> str | None:
    """Why the camera is implausible; asked only if no focal length was given."""
    corner = np.exp(-parameters[FOCAL])  # from the axis, in focal lengths
    view_deg = float(np.degrees(2 * (corner if fisheye else np.arctan(corner))))
    widest_deg = _FISHEYE_VIEW_DEG if fisheye else _DIAGONAL_VIEW_DEG[1]
    height_m = float(np.exp(parameters[HEIGHT]))
    needed = (
        "needed: footage of one fixed camera over flat ground, or a lens file (lens) or an "
        "orientation (orientation) if the values are correct"
    )
    if not _DIAGONAL_VIEW_DEG[0] <= view_deg <= widest_deg:
        return (
            f"the sizes and positions of the {who} suggest a diagonal field of view of "
            f"{view_deg:.1f}°, which is unlikely for a fixed camera; {needed}"
        )
    if not _HEIGHT_M[0] <= height_m <= _HEIGHT_M[1]:
        return (
            f"the sizes and positions of the {who} suggest a camera {height_m:.1f} m above the "
            f"ground, which is unlikely; {needed}"
        )
    return None


def warnings(
    n_sightings: int, n_people: int, inlier_share: float, prior: Prior,
    covariance: Float[np.ndarray, "7 7"], n_vehicles: int = 0,
) -> list[str]:  # fmt: skip
    """Warnings about an accepted camera, as sentences."""
    said = []
    if n_vehicles:
        also = f" and {n_people} {'people' if n_people > 1 else 'person'}" if n_people else ""
        said.append(
            f"The scale rests on {n_vehicles} vehicles{also}, and on the sizes that are usual for "
            "their classes, which differ between countries by up to a tenth."
        )
    elif n_people < _FEW_PEOPLE:
        who = f"{n_people} different people" if n_people > 1 else "what may be one person"
        said.append(
            f"The camera is based on {who}; with ten or more, the scale would depend less on the "
            "heights of these individuals."
        )
    if inlier_share < FEW_INLIERS:
        said.append(
            f"Only {inlier_share:.0%} of the {n_sightings} sightings agree with the camera; check "
            "the red ones in the figure."
        )
    if prior.sigma[FOCAL] > 0 and covariance[FOCAL, FOCAL] > 0.15**2:
        said.append(
            f"The focal length is known to ± {np.sqrt(covariance[FOCAL, FOCAL]):.0%} only; "
            "a lens file (lens), or people nearer and farther away, would improve it."
        )
    return said


def disagreements(alone: Calibration, given: Orientation) -> Iterator[tuple[str, str, str]]:
    """Values of a camera solved without the orientation ``given`` that contradict it: name, given
    value, found value. An undetermined camera contradicts nothing.
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
    # Both are 0 if the same lens gave both.
    both = float(np.hypot(sigma, other_sigma))
    return both > 0 and bool(abs(apart) > SIGMAS * both)


def _angle(angle_rad: float, sigma_rad: float) -> str:
    return "{:.1f} ± {:.1f}°".format(*np.degrees([angle_rad, sigma_rad]))
