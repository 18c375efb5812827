"""What a calibration's uncertainty means on the ground: the errors that a user is told."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.core._ground_jacobian import common_motion, rigid_motions, sigma_m
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera

_REACH = 0.95
"""Share of the feet within the distance to which the ground counts as in view: a few sightings far
away would stretch it without bound."""
_RINGS, _RAYS = 14, 20
"""Places for which errors on the ground are predicted, away from the camera and across. Chosen:
twice as many move the medians by less than 3 %."""
_BORDER = 9
"""Pixels along each side of the picture by which its azimuths are found."""


@dataclass(frozen=True)
class GroundErrors:
    """Predicted errors (m) in the form of :attr:`.Calibration.ground_error_m`: ``within`` the scene
    (a rigid motion of the whole scene is no error) and ``from_camera``. ``relative`` is the median
    of the latter over the distance, where people walked.
    """

    within: dict[str, float]
    from_camera: dict[str, float]
    relative: float


def ground_errors(found: Calibration) -> GroundErrors:
    """The errors of :meth:`.Calibration.ground_sigma_m` over the ground in view, and where people
    walked. Raises :class:`InputError` without a camera.
    """
    feet, by_feet, valid = found.ground_jacobian(found.walked_uv())
    feet, by_feet = feet[valid], by_feet[valid]
    camera = found.camera
    assert camera is not None
    distance_m = np.maximum(np.hypot(*(feet - camera.centre_m[:2]).T), 1e-6)
    if len(feet) == 0:
        nothing = {"median": np.inf, "p90": np.inf}
        return GroundErrors(nothing, nothing, np.inf)
    reach_m = float(np.quantile(distance_m, _REACH))
    xy, by_view, valid = found.ground_jacobian(_in_view_uv(found, camera, reach_m))
    places = (xy[valid], by_view[valid]) if valid.any() else (feet, by_feet)
    covariance, motion = found.parameter_covariance, common_motion(feet, by_feet)
    walked, in_view = (
        [sigma_m(by - rigid_motions(at) @ motion, covariance), sigma_m(by, covariance)]
        for at, by in ((feet, by_feet), places)
    )
    middle = np.median([*walked, walked[1] / distance_m], axis=1)
    median, p90 = np.quantile(in_view, [0.5, 0.9], axis=1)
    within, from_camera = (
        {
            "median": float(median[k]),
            "p90": float(p90[k]),
            "walked_median": float(middle[k]),
            "out_to_m": reach_m,
        }
        for k in range(2)
    )
    return GroundErrors(within, from_camera, float(middle[2]))


def _in_view_uv(found: Calibration, camera: Camera, reach_m: float) -> np.ndarray:
    """Where the picture shows places of the ground in view."""
    uv, seen = found.ground_pixels(places_in_view(camera, reach_m))
    inside = (uv >= -0.5) & (uv <= np.array(found.image_size) - 0.5)
    return uv[seen & inside.all(axis=1)]


def places_in_view(camera: Camera, reach_m: float) -> Float[np.ndarray, "n 2"]:
    """Ground points (n, 2) of equal shares of the ground out to ``reach_m`` from the camera, over
    the azimuths that the picture holds; the nearest may lie below the picture.
    """
    width, height = camera.image_size
    side = np.linspace(0, 1, _BORDER)
    lattice = np.stack(np.meshgrid(side * (width - 1), side * (height - 1)), axis=-1)
    xy, valid = camera.locate(lattice.reshape(-1, 2))
    ahead = np.arctan2(camera.R[2, 1], camera.R[2, 0])
    away = xy[valid] - camera.centre_m[:2]
    if len(away) == 0:
        return np.empty((0, 2))
    azimuth = np.angle(np.exp(1j * (np.arctan2(away[:, 1], away[:, 0]) - ahead)))
    ring = reach_m * np.sqrt((np.arange(_RINGS) + 0.5) / _RINGS)
    ray = ahead + np.interp(
        (np.arange(_RAYS) + 0.5) / _RAYS, [0, 1], [azimuth.min(), azimuth.max()]
    )
    places = ring[:, None, None] * np.stack([np.cos(ray), np.sin(ray)], axis=-1)
    found: np.ndarray = camera.centre_m[:2] + places.reshape(-1, 2)
    return found
