"""Objects on grounds of their own: regions of the picture above or below the camera's ground."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.body import LEFT_FOOT, RIGHT_FOOT
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.tracking._people_points import body_point


def located_on_levels(
    detections: Detections,
    calibration: Calibration,
    locate: Callable[[Bool[np.ndarray, "n"], Camera], Located],
) -> Located:
    """Positions of all detections, each over the ground on which its feet are seen.

    ``locate`` gives those of some rows by a camera over their ground. The uncertain height of a
    region moves all that stands on it alike: :meth:`.Calibration.ground_covariance` holds it.
    """
    camera = calibration.camera
    assert camera is not None
    height_m, _ = calibration.ground_height_m(feet_uv(detections))
    found = Located.nowhere(len(detections))
    for level in np.unique(height_m):
        rows = height_m == level
        found = found.put(rows, locate(rows, camera.on_ground(float(level)) if level else camera))
    return found


def feet_uv(detections: Detections) -> Float[np.ndarray, "n 2"]:
    """Where objects touch the ground: between the feet, or the middle of the box's bottom edge."""
    between, seen = body_point(detections, LEFT_FOOT + RIGHT_FOOT)
    return np.where(seen[:, None], between, detections.box_foot_uv)
