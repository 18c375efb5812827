"""Ground positions of all detections, before association."""

from collections.abc import Callable
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.body import LEFT_FOOT, RIGHT_FOOT
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import CLASSES, VEHICLES, Located
from scene4d.tracking._people import locate_people
from scene4d.tracking._people_points import body_point
from scene4d.tracking._vehicles import locate_vehicles

_HIDDEN_SHARE = 0.3
"""Largest covered share of a box's bottom edge for it to count as visible."""
_NAME = f"<U{max(map(len, CLASSES))}"


def known_classes(detections: Detections) -> tuple[Detections, int]:
    """The rows of classes that a scene can hold, and the number of other rows."""
    kept = np.isin(detections.class_name, CLASSES)
    few = detections.select(kept)
    return replace(few, class_name=few.class_name.astype(_NAME)), int((~kept).sum())


def place(
    detections: Detections,
    calibration: Calibration,
    person_height_m: float,
    bottom_hidden: Bool[np.ndarray, "n"],
) -> Located:
    """Ground positions of people and vehicles, each on the ground where its feet are seen.

    ``bottom_hidden`` is from :func:`bottoms_hidden`, computed on frames with all detections.
    """

    def on_one_ground(rows: Bool[np.ndarray, "n"], camera: Camera) -> Located:
        return _place(detections.select(rows), camera, person_height_m, bottom_hidden[rows])

    return located_on_levels(detections, calibration, on_one_ground)


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
    height_m, _ = calibration.ground_height_m(_feet_uv(detections))
    found = Located.nowhere(len(detections))
    for level in np.unique(height_m):
        rows = height_m == level
        found = found.put(rows, locate(rows, camera.on_ground(float(level)) if level else camera))
    return found


def _feet_uv(detections: Detections) -> Float[np.ndarray, "n 2"]:
    """Where objects touch the ground: between the feet, or the middle of the box's bottom edge."""
    between, seen = body_point(detections, LEFT_FOOT + RIGHT_FOOT)
    return np.where(seen[:, None], between, detections.box_foot_uv)


def _place(
    detections: Detections,
    camera: Camera,
    person_height_m: float,
    bottom_hidden: Bool[np.ndarray, "n"],
) -> Located:
    found = Located.nowhere(len(detections))
    people = detections.class_name == "person"
    if people.any():
        located = locate_people(detections.select(people), camera, height_m=float(person_height_m))
        found = found.put(people, located)
    vehicles = np.isin(detections.class_name, VEHICLES)
    if vehicles.any():
        located = locate_vehicles(
            detections.select(vehicles), camera, bottom_hidden=bottom_hidden[vehicles]
        )
        found = found.put(vehicles, located)
    return found


def bottoms_hidden(detections: Detections) -> Bool[np.ndarray, "n"]:
    """Which boxes have their ground contact hidden: another box of the frame, which reaches
    further down, covers more than :data:`_HIDDEN_SHARE` of their bottom edge.
    """
    hidden = np.zeros(len(detections), bool)
    order = np.argsort(detections.frame, kind="stable")
    starts = np.flatnonzero(np.diff(detections.frame[order], prepend=-1))
    for rows in np.split(order, starts[1:]) if len(order) else []:
        x1, y1, x2, y2 = detections.box_xyxy[rows].T
        across = np.minimum(x2[:, None], x2) - np.maximum(x1[:, None], x1)
        before = (y2[None] > y2[:, None] + 1) & (y1[None] < y2[:, None])
        covered = np.where(before, np.clip(across, 0, None), 0.0).max(axis=1)
        hidden[rows] = covered > _HIDDEN_SHARE * (x2 - x1)
    return hidden


def shared_covariance(
    calibration: Calibration, xy_m: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 2 2"]:
    """Covariance of ground positions (n, 2) due to calibration error; NaN without a position."""
    found = np.full((len(xy_m), 2, 2), np.nan)
    rows = np.isfinite(xy_m).all(axis=1)
    known = calibration.covariance is not None and bool(calibration.ground_regions)
    if not calibration.parameter_covariance.any() and not known:
        found[rows] = 0.0
        return found
    uv, seen = calibration.ground_pixels(xy_m[rows])
    rows[rows] = seen
    found[rows] = calibration.ground_covariance(uv[seen], from_camera=True)[0]
    return found


def ground_under(
    calibration: Calibration, xy_m: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Height of the ground at positions and its standard deviation; NaN without a position."""
    uv, _ = calibration.ground_pixels(np.nan_to_num(xy_m))
    placed = np.isfinite(xy_m).all(axis=1)
    z_m, sigma_m = calibration.ground_height_m(uv)
    return np.where(placed, z_m, np.nan), np.where(placed, sigma_m, np.nan)
