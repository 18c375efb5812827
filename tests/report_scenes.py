"""Synthetic calibrations for the report's tests: people on the ground of a known camera."""

from typing import Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Segments
from scene4d.drawing.scenery import image_of, in_frame

COVARIANCE = np.diag([0.02, np.radians(0.3), np.radians(0.2), 0.02, 0.0]) ** 2


def camera(**changes: Any) -> Camera:
    pose: dict[str, Any] = {
        "image_size": (768, 576),
        "focal_px": 1185.0,
        "tilt_rad": np.radians(16.48),
        "roll_rad": np.radians(-3.09),
        "height_m": 7.07,
    }
    return Camera.from_pose(**(pose | changes))


def people(
    cam: Camera, n: int = 120, seed: int = 0, x: float = 14.0, y: tuple[float, float] = (3.0, 40.0)
) -> tuple[Segments, np.ndarray, np.ndarray]:
    """Segments wholly in the frame, with their ground points and heights: no noise at all."""
    rng = np.random.default_rng(seed)
    xy = np.column_stack([rng.uniform(-x, x, 40 * n), rng.uniform(*y, 40 * n)])
    height = rng.normal(1.7, 0.09, len(xy))
    foot = image_of(cam, np.column_stack([xy, np.full(len(xy), 0.04)]))
    head = image_of(cam, np.column_stack([xy, height]))
    rows = np.flatnonzero(in_frame(foot, cam.image_size) & in_frame(head, cam.image_size))[:n]
    assert len(rows) == n, "the scene shows too few people"
    return (
        Segments.from_points(foot[rows], head[rows], track=np.arange(n) // 6),
        xy[rows],
        height[rows],
    )


def calibration(cam: Camera | None = None, n: int = 120, **changes: Any) -> Calibration:
    cam = camera() if cam is None else cam
    segments, _, _ = people(cam, n)
    inlier = np.ones(n, bool)
    inlier[::9] = n < 9
    values: dict[str, Any] = {
        "status": "ok",
        "method": "joint",
        "image_size": cam.image_size,
        "person_height_m": 1.70,
        "camera": cam,
        "covariance": COVARIANCE,
        "segments": segments,
        "inlier": inlier,
        "residual": np.zeros(n),
        "ground_error_m": {"median": 0.38, "p90": 0.9, "walked_median": 0.26, "out_to_m": 31.2},
        "ground_error_from_camera_m": {
            "median": 2.1,
            "p90": 3.4,
            "walked_median": 1.9,
            "out_to_m": 31.2,
        },
        "frames": 80,
    }
    return Calibration(**(values | changes))


def undetermined(**changes: Any) -> Calibration:
    segments, _, _ = people(camera(), 12)
    values: dict[str, Any] = {
        "status": "undetermined",
        "method": "joint",
        "image_size": (768, 576),
        "person_height_m": 1.70,
        "reason": "the focal length is not determined: all people stand at <one> distance",
        "segments": segments,
        "frames": 80,
    }
    return Calibration(**(values | changes))
