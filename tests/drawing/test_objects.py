"""Objects of a moment over its frame."""

from dataclasses import replace

import cv2
import numpy as np

from made_tracks import made_tracks
from scene4d.core.camera import Camera
from scene4d.core.cuboids import cuboid_corners
from scene4d.core.tracks import Tracks
from scene4d.drawing.objects import draw_objects

CAMERA: Camera = Camera.from_pose(
    image_size=(640, 480), focal_px=600.0, tilt_rad=0.35, roll_rad=0.0, height_m=5.0
)
GREY = np.full((480, 640, 3), 90, np.uint8)


def moment() -> Tracks:
    """A car and somebody."""
    nan = np.nan
    return made_tracks(
        np.array([1, 2]), np.zeros(2), np.array([[1.5, 14.0], [-2.0, 11.0]]), frame=0,
        class_name=np.array(["car", "person"]), covariance_m2=0.0, velocity_mps=0.0,
        velocity_covariance=0.0, heading_rad=np.array([0.5, nan]),
        heading_sigma_rad=np.array([0.1, nan]), box_xyxy=0.0, z_m=0.0, z_sigma_m=0.0,
        size_m=np.array([[4.5, 1.8, 1.5], [nan, nan, 1.75]]),
        size_sigma_m=np.array([[0.4, 0.1, 0.1], [nan, nan, 0.04]]),
    )  # fmt: skip


def coloured(tracks: Tracks) -> tuple[np.ndarray, float]:
    """Where the frame's part of the figure is not grey, and its scale to pixels of the footage."""
    png = draw_objects(CAMERA, tracks, GREY)
    assert png is not None
    image = cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).astype(int)
    scale = image.shape[1] / 640
    return np.ptp(image[: round(480 * scale)], axis=2) > 60, scale


def test_a_cuboid_lies_where_its_corners_are_seen():
    car = moment().select(np.array([0]))
    drawn, scale = coloured(car)
    v, u = np.nonzero(drawn)
    uv = CAMERA.project(cuboid_corners(car)[0])[0]
    np.testing.assert_allclose([u.min() / scale, v.min() / scale], uv.min(axis=0), atol=3)
    np.testing.assert_allclose([u.max() / scale, v.max() / scale], uv.max(axis=0), atol=3)


def test_a_person_is_an_upright_of_his_height():
    drawn, scale = coloured(moment().select(np.array([1])))
    v, _ = np.nonzero(drawn)
    foot, head = CAMERA.project(np.array([[-2.0, 11.0, 0.0], [-2.0, 11.0, 1.75]]))[0]
    np.testing.assert_allclose([v.min() / scale, v.max() / scale], [head[1], foot[1]], atol=4)


def test_what_is_not_known_is_drawn_as_less():
    both = moment()
    axis = replace(both, heading_sigma_rad=np.full(2, np.nan))
    none = replace(both, heading_rad=np.full(2, np.nan))
    counts = [int(coloured(one)[0].sum()) for one in (both, axis, none)]
    assert counts[0] > counts[1] > counts[2] > 0
    nowhere = replace(both, xy_m=np.full((2, 2), np.nan))
    assert draw_objects(CAMERA, nowhere, GREY) is None
