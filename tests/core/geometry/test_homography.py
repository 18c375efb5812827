"""The ground plane as a homography, against OpenCV and against known cameras."""

from dataclasses import replace

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.geometry import apply_homography, is_rotation, pose_from_homography
from strategies import build_camera, build_lens, cameras, lenses, views

SQUARE = lenses(distorted=False, square=True)
FACTOR = st.sampled_from([-1.0, 1.0]).flatmap(
    lambda sign: st.floats(-8.0, 8.0).map(lambda power: sign * 10.0**power)
)


def from_ground(camera: Camera) -> np.ndarray:
    """K [r1 r2 t]: metres on the plane Z = 0 to pixels (Zhang 2000, equation 2)."""
    return camera.K @ np.column_stack([camera.R[:, 0], camera.R[:, 1], camera.t])


def pose(camera: Camera, H: np.ndarray | None = None):
    return pose_from_homography(from_ground(camera) if H is None else H, camera.K[:2, 2])


def test_points_by_hand():
    H = np.array([[2.0, 0, 1], [0, 3, 0], [0, 0.5, 1]])
    mapped, valid = apply_homography(H, np.array([[1.0, 0], [1, 2], [0, -2], [0, -4]]))
    np.testing.assert_array_equal(valid, [True, True, False, False])
    np.testing.assert_array_equal(mapped, [[3, 0], [1.5, 3], [np.nan] * 2, [np.nan] * 2])


@given(seen=views(cameras(lenses(distorted=False), anywhere=True)))
def test_points_are_where_opencv_maps_them(seen):
    camera, xyz, _ = seen
    H = from_ground(camera)
    mapped, valid = apply_homography(H, xyz[:, :2])
    assert valid.all()
    expected = cv2.perspectiveTransform(xyz[None, :, :2], H)[0]
    np.testing.assert_allclose(mapped, expected, rtol=1e-9, atol=1e-6)


@given(seen=views(cameras(lenses(distorted=False), anywhere=True)))
def test_there_and_back(seen):
    camera, xyz, uv = seen
    H = from_ground(camera)
    mapped, _ = apply_homography(H, xyz[:, :2])
    np.testing.assert_allclose(mapped, uv, rtol=1e-7, atol=1e-5)
    back, valid = apply_homography(np.linalg.inv(H), mapped)
    assert valid.all()
    np.testing.assert_allclose(back, xyz[:, :2], rtol=1e-6, atol=1e-5)


def test_behind_the_camera_nothing_is_seen():
    camera = build_camera(build_lens((1280, 720)), 20.0, 0.0, 6.0)
    xy = np.array([[0.0, 20.0], [0.0, -20.0]])
    np.testing.assert_array_equal(apply_homography(from_ground(camera), xy)[1], [True, False])
    np.testing.assert_array_equal(
        camera.project(np.column_stack([xy, np.zeros(2)]))[1], [True, False]
    )


@pytest.mark.parametrize("bad", [np.nan, np.inf, -np.inf])
@pytest.mark.parametrize("axis", [0, 1])
def test_points_that_are_not_finite_are_invalid(bad, axis):
    camera = build_camera(build_lens((1280, 720)), 20.0, 3.0, 6.0, 40.0)
    points = np.array([[640.0, 500.0], [640.0, 500.0]])
    points[0, axis] = bad
    mapped, valid = apply_homography(np.linalg.inv(from_ground(camera)), points)
    np.testing.assert_array_equal(valid, [False, True])
    np.testing.assert_array_equal(np.isnan(mapped).all(axis=1), [True, False])


def test_no_points_are_no_error():
    mapped, valid = apply_homography(np.eye(3), np.empty((0, 2)))
    assert mapped.shape == (0, 2)
    assert valid.shape == (0,)


@given(camera=cameras(SQUARE, anywhere=True), factor=FACTOR)
def test_the_camera_comes_back_from_its_ground(camera, factor):
    """Whatever the scale and the sign of the matrix, the heading and the place."""
    focal, R, t = pose(camera, factor * from_ground(camera))
    assert focal == pytest.approx(camera.focal_px, rel=1e-6)
    np.testing.assert_allclose(R, camera.R, atol=1e-6)
    np.testing.assert_allclose(t, camera.t, rtol=1e-6, atol=1e-5)
    assert is_rotation(R)


@given(lens=lenses(distorted=False), factor=FACTOR)
def test_the_principal_point_is_where_it_is_said_to_be(lens, factor):
    square = replace(
        lens,
        K=np.array([[lens.K[0, 0], 0, lens.K[0, 2]], [0, lens.K[0, 0], lens.K[1, 2]], [0, 0, 1]]),
    )
    camera = build_camera(square, 25.0, 5.0, 6.0, 30.0)
    assert pose(camera, factor * from_ground(camera))[0] == pytest.approx(camera.focal_px, rel=1e-6)


def test_a_wrong_principal_point_is_a_wrong_camera():
    """60 px too low: the focal length is off, and the caller has to know."""
    camera = build_camera(build_lens((1280, 720), 55.0), 25.0, 0.0, 6.0)
    focal, _, _ = pose_from_homography(from_ground(camera), camera.K[:2, 2] + [0.0, 60.0])
    # The circular points stay: u = ∓i f / cos tilt on the horizon, f tan tilt above v0. They lie
    # on u² + (v - v0)² + f² = 0 (Hartley & Zisserman 2004, section 8.5).
    tilt, f = np.radians(25.0), camera.focal_px
    expected = np.sqrt((f / np.cos(tilt)) ** 2 - (f * np.tan(tilt) + 60) ** 2)
    assert focal == pytest.approx(expected, rel=1e-9)
    assert abs(focal / f - 1) > 0.02


@given(
    camera=cameras(SQUARE, anywhere=True),
    noise=st.lists(st.floats(-1e-4, 1e-4), min_size=9, max_size=9),
)
def test_a_noisy_map_still_gives_a_rotation(camera, noise):
    H = from_ground(camera)
    try:
        focal, R, t = pose(camera, H * (1 + np.reshape(noise, (3, 3))))
    except InputError:
        return  # long lenses: a small change of the horizon's slope is out of proportion
    assert focal > 0
    assert is_rotation(R)
    assert -(R.T @ t)[2] > 0


@pytest.mark.parametrize("tilt_deg", [90.0, 89.9, 89.6])
@pytest.mark.parametrize("digits", [17, 9, 6])
def test_looking_straight_down_is_refused(tilt_deg, digits):
    """Any focal length fits, so what remains of it is rounding: 41 % off with six digits."""
    H = from_ground(build_camera(build_lens((1280, 720)), tilt_deg, 3.0, 6.0))
    H = np.vectorize(lambda value: float(f"{value:.{digits}g}"))(H)
    with pytest.raises(InputError, match="straight down"):
        pose_from_homography(H, np.array([639.5, 359.5]))


def test_looking_nearly_straight_down_is_no_difficulty():
    camera = build_camera(build_lens((1280, 720)), 89.0, 3.0, 6.0)
    assert pose(camera)[0] == pytest.approx(camera.focal_px, rel=1e-6)


@pytest.mark.parametrize("stretch", [0.3, 0.75, 1.3, 3.0])
@pytest.mark.parametrize("axis", [0, 1])
def test_a_map_out_of_proportion_is_refused(stretch, axis):
    camera = build_camera(build_lens((1280, 720), 55.0), 20.0, 3.0, 6.0, 40.0)
    metres = np.eye(3)
    metres[axis, axis] = stretch
    with pytest.raises(InputError, match="is it in metres, and for images of this size"):
        pose(camera, from_ground(camera) @ metres)


@pytest.mark.parametrize("stretch", [0.95, 1.05])
def test_a_map_slightly_out_of_proportion_gives_the_nearest_camera(stretch):
    camera = build_camera(build_lens((1280, 720), 55.0), 20.0, 3.0, 6.0, 40.0)
    focal, R, t = pose(camera, from_ground(camera) @ np.diag([stretch, 1.0, 1.0]))
    assert focal == pytest.approx(camera.focal_px, rel=0.05)
    assert is_rotation(R)
    assert np.degrees(np.arccos((np.trace(R @ camera.R.T) - 1) / 2)) < 3
    # Neither axis is trusted more: with the world turned by a quarter the camera is the same.
    turned = (
        from_ground(camera)
        @ np.diag([stretch, 1.0, 1.0])
        @ np.array([[0, -1.0, 0], [1, 0, 0], [0, 0, 1]])
    )
    there, R_there, t_there = pose(camera, turned)
    assert there == pytest.approx(focal, rel=1e-9)
    assert -(R_there.T @ t_there)[2] == pytest.approx(-(R.T @ t)[2], rel=1e-9)


def test_a_stretch_along_the_view_is_another_camera():
    """The one equation to spare says nothing here: the map is exactly that of another camera."""
    camera = build_camera(build_lens((1280, 720), 55.0), 20.0, 0.0, 6.0)
    H = from_ground(camera) @ np.diag([1.0, 1.1, 1.0])
    focal, R, t = pose(camera, H)
    other = replace(camera, K=np.array([[focal, 0, 639.5], [0, focal, 359.5], [0, 0, 1]]), R=R, t=t)
    other_H = from_ground(other) * (H[2, 2] / from_ground(other)[2, 2])
    np.testing.assert_allclose(other_H, H, rtol=1e-6, atol=1e-6)
    assert abs(focal / camera.focal_px - 1) > 0.05


def test_what_no_focal_length_makes_square_is_refused():
    # Both columns meet at infinity, in directions neither orthogonal nor equally long.
    H = np.array([[1.0, 0.5, 3], [0, 1, 4], [0, 0, 1]])
    with pytest.raises(InputError, match="no camera with square pixels"):
        pose_from_homography(H, np.zeros(2))
