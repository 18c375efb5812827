"""Objects on a region with a ground of its own are placed by that ground."""

import numpy as np

from scene4d.core.body import BODY_RADIUS_M
from scene4d.core.calibration import Calibration
from scene4d.core.ground_regions import GroundRegion
from scene4d.core.people import Detections
from scene4d.tracking.placing import bottoms_hidden, place, shared_covariance
from strategies import build_camera, build_lens

CAMERA = build_camera(build_lens((1280, 720), 50.0), 22.0, 0.0, 6.0)
STEP_M = 1.0
RIGHT = GroundRegion(np.array([[640.0, 100], [1279, 100], [1279, 719], [640, 719]]), STEP_M, 0.1)


def calibration(*regions: GroundRegion) -> Calibration:
    covariance = np.diag([0.02, 0.01, 0.005, 0.03, 0.0]) ** 2
    return Calibration(
        "ok", "joint", CAMERA.image_size, 1.7, CAMERA, covariance, ground_regions=regions
    )


def boxes(places: np.ndarray, z: np.ndarray) -> Detections:
    """Around upright cylinders of 1.70 m."""
    turn = np.linspace(0, 2 * np.pi, 40)
    found = []
    for (x, y), level in zip(places, z, strict=True):
        rim = BODY_RADIUS_M * np.column_stack([np.cos(turn), np.sin(turn)]) + [x, y]
        rings = [np.column_stack([rim, np.full(40, level + h)]) for h in (0.0, 1.0)]
        uv = CAMERA.project(np.vstack([*rings, [[x, y, level + 1.7]]]))[0]
        found.append(np.concatenate([uv.min(axis=0), uv.max(axis=0)]))
    return Detections.from_boxes(CAMERA.image_size, np.zeros(len(z), int), np.array(found))


def test_people_on_a_platform_get_its_metres():
    places = np.array([[2.5, 12.0], [-2.5, 12.0], [3.0, 16.0]])
    seen = boxes(places, np.array([STEP_M, 0.0, STEP_M]))
    hidden = bottoms_hidden(seen)
    found = place(seen, calibration(RIGHT), 1.7, hidden)
    np.testing.assert_allclose(found.xy_m, places, atol=0.25)
    flat = place(seen, calibration(), 1.7, hidden)
    assert (np.hypot(*(flat.xy_m - places).T)[[0, 2]] > 1.0).all()
    np.testing.assert_array_equal(flat.xy_m[1], found.xy_m[1])


def test_its_uncertain_height_is_shared_by_all_who_stand_there():
    places = np.array([[2.5, 12.0], [-2.5, 12.0]])
    with_step = shared_covariance(calibration(RIGHT), places)
    exact = shared_covariance(calibration(GroundRegion(RIGHT.polygon_uv, STEP_M, 0.0)), places)
    more = np.trace(with_step - exact, axis1=1, axis2=2)
    far_m = np.hypot(2.5, 12.0)
    np.testing.assert_allclose(more, [(0.1 * far_m / (6.0 - STEP_M)) ** 2, 0.0], rtol=1e-6)
