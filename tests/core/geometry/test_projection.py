"""Projection and what follows from it: ground points, horizon, vertical vanishing point."""

import cv2
import numpy as np
import pytest
from hypothesis import assume, given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scene4d.core import geometry
from scene4d.core.camera import Camera
from strategies import build_camera, build_lens, cameras, lenses, views

PLAIN = cameras(lenses(distorted=False), anywhere=True)
POINTS = st.lists(
    st.tuples(st.floats(-80.0, 80.0), st.floats(-80.0, 80.0), st.floats(-5.0, 25.0)),
    min_size=1,
    max_size=8,
).map(np.array)
LEVEL = Camera.from_pose(
    image_size=(1920, 1080), focal_px=1000.0, tilt_rad=0.0, roll_rad=0.0, height_m=5.0
)


def rotation_vector(R: np.ndarray) -> np.ndarray:
    """By SciPy: OpenCV's own conversion is off by 1e-5 near half a turn."""
    return Rotation.from_matrix(R).as_rotvec()


def horizon_pixels(camera: Camera, shift_px: float, n: int = 21) -> np.ndarray:
    """Pixels at a signed distance from the horizon, positive on the sky's side."""
    line = geometry.horizon_line(camera.K, camera.R)
    foot = -line[2] * line[:2]
    along = np.linspace(-3000, 3000, n)[:, None] * np.array([-line[1], line[0]])
    return foot + along + shift_px * line[:2]


@given(camera=PLAIN, points=POINTS)
def test_projection_against_opencv(camera, points):
    uv, valid = geometry.project(camera.P, points)
    depth = points @ camera.R[2] + camera.t[2]
    assume((np.abs(depth) > 1e-3).all())
    np.testing.assert_array_equal(valid, depth > 0)
    assert np.isnan(uv[~valid]).all()
    if valid.any():
        rotation = rotation_vector(camera.R)
        expected, _ = cv2.projectPoints(points[valid], rotation, camera.t, camera.K, None)
        np.testing.assert_allclose(uv[valid], expected[:, 0], rtol=1e-9, atol=1e-6)


@given(camera=cameras(anywhere=True), points=POINTS)
def test_projection_through_the_lens_against_opencv(camera, points):
    uv, valid = camera.project(points, undistorted=True)
    assume(valid.any())
    rotation = rotation_vector(camera.R)
    expected, _ = cv2.projectPoints(points[valid], rotation, camera.t, camera.K, camera.distortion)
    # Far outside the image the polynomial's terms cancel, and rounding shows.
    size = np.array(camera.image_size)
    seen = ((uv[valid] > -size) & (uv[valid] < 2 * size)).all(axis=1)
    found, shown = camera.project(points[valid])
    np.testing.assert_array_equal(np.isnan(found).any(axis=1), ~shown)
    seen &= shown
    np.testing.assert_allclose(found[seen], expected[:, 0][seen], rtol=1e-9, atol=1e-6)


@given(camera=PLAIN, points=POINTS)
def test_many_points_are_each_point_alone(camera, points):
    uv, valid = geometry.project(camera.P, points)
    for point, pixel, seen in zip(points, uv, valid, strict=True):
        u, v, w = camera.K @ (camera.R @ point + camera.t)
        assert seen == (w > geometry.projection.MIN_DEPTH_M)
        if seen:
            np.testing.assert_allclose(pixel, [u / w, v / w], rtol=1e-9)


def test_point_on_the_optical_axis_is_the_principal_point():
    camera = Camera.from_pose(
        image_size=(1920, 1080), focal_px=1000.0, tilt_rad=np.radians(30), roll_rad=0.4,
        height_m=5.0,
    )  # fmt: skip
    on_axis = np.array([[0.0, 5.0 / np.tan(np.radians(30)), 0.0]])
    np.testing.assert_allclose(camera.project(on_axis)[0], [[959.5, 539.5]], atol=1e-9)


def test_axes_of_the_image():
    uv, _ = LEVEL.project(np.array([[1.0, 10, 5], [0, 10, 6]]))
    np.testing.assert_allclose(uv, [[959.5 + 100, 539.5], [959.5, 539.5 - 100]])


def test_points_on_and_behind_the_principal_plane_have_no_image():
    uv, valid = LEVEL.project(np.array([[0.0, 0, 0], [3, 0, 9], [1, -5, 0], [0, 1e-3, 5]]))
    assert valid.tolist() == [False, False, False, True]
    assert np.isnan(uv[:3]).all()
    np.testing.assert_allclose(uv[3], [959.5, 539.5])


@given(view=views())
def test_ground_points_come_back(view):
    camera, points, uv = view
    np.testing.assert_allclose(camera.project(points, undistorted=True)[0], uv, atol=1e-6)
    xy, valid = geometry.locate(camera.P, uv)
    assert valid.all()
    np.testing.assert_allclose(xy, points[:, :2], rtol=1e-9, atol=1e-7)


@given(camera=PLAIN, points=POINTS)
def test_locate_is_the_inverse_of_project_on_any_plane(camera, points):
    assume((np.abs(points[:, 2] - camera.height_m) > 0.05).all())
    uv, seen = camera.project(points)
    assume(seen.any() and (np.abs(uv[seen]) < 1e6).all())
    uv, points = uv[seen], points[seen]
    xy, valid = geometry.locate(camera.P, uv, points[:, 2])
    assert valid.all()
    np.testing.assert_allclose(xy, points[:, :2], rtol=1e-6, atol=1e-5)
    for pixel, point in zip(uv, points, strict=True):
        alone, valid = geometry.locate(camera.P, pixel[None], float(point[2]))
        assert valid.all()
        np.testing.assert_allclose(alone[0], point[:2], rtol=1e-6, atol=1e-5)


@given(camera=PLAIN, shift_px=st.floats(1e-3, 3000.0))
def test_above_the_horizon_there_is_no_ground(camera, shift_px):
    xy, valid = geometry.locate(camera.P, horizon_pixels(camera, shift_px))
    assert not valid.any()
    assert np.isnan(xy).all()


@given(camera=PLAIN, shift_px=st.floats(0.01, 3000.0))
def test_below_the_horizon_there_is_ground(camera, shift_px):
    uv = horizon_pixels(camera, -shift_px)
    ahead = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(camera.K).T @ camera.R
    xy, valid = geometry.locate(camera.P, uv)
    assert valid.all()
    # Beyond the nadir too: the ground point lies in the ray's direction, not opposite to it.
    assert (np.einsum("ni,ni->n", xy - camera.centre_m[:2], ahead[:, :2]) >= 0).all()


@pytest.mark.parametrize("roll_deg", [0.0, 7.3, -20.0])
@pytest.mark.parametrize("tilt_deg", [0.0, 5.0, 33.3, 60.0])
def test_a_ray_on_the_horizon_has_no_ground_whatever_the_rounding(tilt_deg, roll_deg):
    camera = build_camera(tilt_deg=tilt_deg, roll_deg=roll_deg)
    xy, valid = geometry.locate(camera.P, horizon_pixels(camera, 0.0))
    assert not valid.any()
    assert np.isnan(xy).all()


def test_level_camera_has_no_ground_in_its_middle_row():
    uv = np.column_stack([np.linspace(0, 1919, 7), np.full(7, 539.5)])
    xy, valid = LEVEL.locate(uv)
    assert not valid.any()
    assert np.isnan(xy).all()


def test_plane_above_the_camera_is_seen_above_the_horizon_only():
    uv = np.array([[959.5, 539.5 - 100], [959.5, 539.5 + 100]])
    xy, valid = LEVEL.locate(uv, 7.0)
    assert valid.tolist() == [True, False]
    np.testing.assert_allclose(xy[0], [0, 20], atol=1e-9)
    assert np.isnan(xy[1]).all()


@given(camera=PLAIN)
def test_plane_through_the_camera_is_never_met(camera):
    uv = np.vstack([horizon_pixels(camera, s) for s in (-500.0, -1.0, 1.0, 500.0)])
    xy, valid = geometry.locate(camera.P, uv, float(camera.height_m))
    assert not valid.any()
    assert np.isnan(xy).all()


def test_pixels_that_are_no_numbers_have_no_ground():
    uv = np.array([[np.nan, 700.0], [900, np.nan], [np.inf, 700], [900, -np.inf], [900, 700]])
    xy, valid = LEVEL.locate(uv)
    assert valid.tolist() == [False, False, False, False, True]
    assert np.isnan(xy[:4]).all()


def test_points_that_are_no_numbers_have_no_image():
    points = np.array([[np.nan, 9, 0], [0, np.inf, 0], [np.inf, 9, 0], [0, -np.inf, 0], [0, 9, 0]])
    uv, valid = LEVEL.project(points)
    assert valid.tolist() == [False, False, False, False, True]
    assert np.isnan(uv[:4]).all()


def test_no_points_are_no_points():
    assert LEVEL.project(np.empty((0, 3)))[0].shape == (0, 2)
    assert LEVEL.locate(np.empty((0, 2)))[0].shape == (0, 2)


@given(camera=cameras(anywhere=True))
def test_camera_centre_is_where_the_camera_is(camera):
    np.testing.assert_allclose(camera.R @ camera.centre_m + camera.t, 0, atol=1e-12)


@given(camera=cameras(anywhere=True), direction=st.floats(-np.pi, np.pi))
def test_far_ground_points_approach_the_horizon_from_below(camera, direction):
    line = geometry.horizon_line(camera.K, camera.R)
    assert np.hypot(line[0], line[1]) == pytest.approx(1.0, abs=1e-12)
    heading = np.array([np.cos(direction), np.sin(direction), 0.0])
    assume(camera.R[2] @ heading > 0.1)
    distance = np.array([1e3, 1e5, 1e7])
    uv, valid = camera.project(distance[:, None] * heading, undistorted=True)
    assert valid.all()
    above = uv @ line[:2] + line[2]
    assert (above < 0).all()
    # The gap closes as 1 / distance: a camera as high as 20 m, at most some 1e4 px per radian.
    np.testing.assert_array_less(-above, 1e6 * camera.height_m / distance)


@given(camera=cameras(anywhere=True))
def test_horizon_is_positive_on_the_sky(camera):
    line = geometry.horizon_line(camera.K, camera.R)
    sky = camera.centre_m + 100 * camera.R[2] * [1, 1, 0] + [0, 0, 5]
    uv, valid = camera.project(sky[None], undistorted=True)
    assert valid.all()
    assert uv[0] @ line[:2] + line[2] > 0


def test_horizon_of_a_level_camera_is_its_middle_row():
    np.testing.assert_allclose(geometry.horizon_line(LEVEL.K, LEVEL.R), [0, -1, 539.5], atol=1e-12)


def test_horizon_falls_to_the_right_with_positive_roll():
    camera = build_camera(build_lens((1280, 720)), tilt_deg=0.0, roll_deg=10.0)
    a, b, c = geometry.horizon_line(camera.K, camera.R)
    left, right = -(a * 0 + c) / b, -(a * 1279 + c) / b
    assert (right - left) / 1279 == pytest.approx(np.tan(np.radians(10)))


def test_camera_looking_straight_down_has_no_horizon():
    assert np.isnan(
        geometry.horizon_line(np.diag([1000.0, 1000.0, 1.0]), geometry.R_OVERHEAD)
    ).all()


@given(camera=PLAIN, points=POINTS)
def test_uprights_meet_at_the_vertical_vanishing_point(camera, points):
    bottom, seen = camera.project(points * [1, 1, 0])
    top, seen_too = camera.project(points * [1, 1, 0] + [0, 0, 1])
    shown = seen & seen_too & (np.abs(bottom) < 1e5).all(axis=1) & (np.abs(top) < 1e5).all(axis=1)
    nadir = geometry.vertical_vanishing_point(camera.K, camera.R)
    assert nadir[2] > 0
    nadir = nadir / nadir[2]
    for a, b in zip(bottom[shown], top[shown], strict=True):
        line = np.cross([*a, 1], [*b, 1])
        length = np.hypot(line[0], line[1])
        assume(length > 1e-2)
        assert abs(line @ nadir) / length < 1e-3 * (1 + np.hypot(*(nadir[:2] - a)) / length)
        # Down in the world is towards the nadir in the image.
        assert (a - b) @ (nadir[:2] - a) > 0 or np.allclose(a, nadir[:2], atol=1e-3 * length)


def test_vertical_vanishing_point_of_known_poses():
    K = LEVEL.K
    overhead = geometry.vertical_vanishing_point(K, geometry.R_OVERHEAD)
    np.testing.assert_allclose(overhead, [959.5, 539.5, 1], atol=1e-9)
    level = geometry.vertical_vanishing_point(K, LEVEL.R)
    np.testing.assert_allclose(level, [0, 1000, 0], atol=1e-9)
    # At 45 degrees the nadir lies one focal length below the principal point.
    tilted = geometry.vertical_vanishing_point(K, geometry.rotation_from_tilt_roll(np.pi / 4))
    np.testing.assert_allclose(tilted / tilted[2], [959.5, 1539.5, 1], atol=1e-9)
