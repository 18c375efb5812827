"""The fisheye model: forwards and backwards against OpenCV, where it ends, and what a camera does
with it.
"""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core import geometry
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from strategies import build_fisheye, fisheye_lenses

ANGLE = st.floats(0.0, np.radians(88))
TURN = st.floats(-np.pi, np.pi)


def rays_of(angle_rad, turn_rad) -> np.ndarray:
    """Unit rays at these angles from the axis, turned about it."""
    sin, cos = np.sin(angle_rad), np.cos(angle_rad)
    return np.column_stack([sin * np.cos(turn_rad), sin * np.sin(turn_rad), cos])


def opencv_pixels(lens: Lens, rays: np.ndarray) -> np.ndarray:
    """Where OpenCV's own fisheye projection shows these rays."""
    zero = np.zeros(3)
    alpha = lens.K[0, 1] / lens.K[0, 0]
    uv, _ = cv2.fisheye.projectPoints(
        rays[:, None], zero, zero, lens.K, lens.distortion, alpha=alpha
    )
    return uv[:, 0]


@given(lens=fisheye_lenses(), angle=ANGLE, turn=TURN)
def test_forwards_and_backwards_against_opencv(lens, angle, turn):
    ray = rays_of(np.array([angle, angle / 2]), np.array([turn, turn + 1]))
    expected = opencv_pixels(lens, ray)
    flat = (ray / ray[:, 2:] @ lens.K.T)[:, :2]
    shown, valid = lens.distort(flat)
    assert valid.all()
    np.testing.assert_allclose(shown, expected, rtol=0, atol=1e-7)
    back, valid = lens.undistort(expected)
    assert valid.all()
    again = np.column_stack([back, [1.0, 1.0]]) @ np.linalg.inv(lens.K).T
    again /= np.linalg.norm(again, axis=1, keepdims=True)
    np.testing.assert_allclose(again, ray, rtol=0, atol=1e-9)


@given(lens=fisheye_lenses(), turn=TURN)
def test_a_ray_at_right_angles_to_the_axis_has_no_undistorted_pixel(lens, turn):
    angle = np.radians([89.9, 90.0, 95.0])
    k1, k2, k3, k4 = lens.distortion
    r = angle * (1 + k1 * angle**2 + k2 * angle**4 + k3 * angle**6 + k4 * angle**8)
    uv = r[:, None] * [np.cos(turn), np.sin(turn)] @ lens.K[:2, :2].T + lens.K[:2, 2]
    found, valid = lens.undistort(uv)
    assert valid.tolist() == [True, False, False]
    assert np.isnan(found[1:]).all() and np.isfinite(found[0]).all()


def test_a_curve_that_folds_ends_there():
    """θ (1 - θ² / 3) grows up to θ = 1 and 2/3 focal lengths."""
    lens = build_fisheye(focal_px=300.0, distortion=(-1 / 3, 0.0, 0.0, 0.0))
    centre = lens.K[:2, 2]
    tangent = np.tan([0.98, 1.02])
    _, valid = lens.distort(centre + 300 * tangent[:, None] * [1.0, 0.0])
    assert valid.tolist() == [True, False]
    _, valid = lens.undistort(centre + 300 * np.array([[0.66, 0], [0.67, 0], [0.0, 0.0]]))
    assert valid.tolist() == [True, False, True]


def test_pixels_that_are_none_stay_so():
    lens = build_fisheye()
    bad = np.array([[np.nan, 3.0], [np.inf, 3.0], [3.0, -np.inf]])
    for turned, valid in (lens.distort(bad), lens.undistort(bad)):
        assert not valid.any() and np.isnan(turned).all()


@given(
    lens=fisheye_lenses(),
    tilt=st.floats(-0.2, 1.5),
    angle=st.floats(0.0, np.radians(86)),
    turn=TURN,
    height_m=st.floats(2.0, 10.0),
)
def test_a_pixel_far_off_the_axis_is_located_on_the_ground(lens, tilt, angle, turn, height_m):
    """The ray of the pixel, taken from OpenCV's forward model, meets the ground by hand."""
    R = geometry.rotation_from_tilt_roll(tilt, 0.1)
    camera = lens.posed(R, -R @ np.array([0.0, 0.0, height_m]))
    ray = rays_of(np.array([angle]), np.array([turn]))
    towards = ray @ R
    uv = opencv_pixels(lens, ray)
    xy, valid = camera.locate(uv)
    assert valid[0] == (towards[0, 2] < 0) or abs(towards[0, 2]) < 1e-6
    # within rounding of the horizon either answer will do
    if towards[0, 2] < -0.01:
        expected = -towards[0, :2] / towards[0, 2] * height_m
        np.testing.assert_allclose(xy[0], expected, rtol=1e-7, atol=1e-7)
        seen, shown = camera.project(np.array([[*expected, 0.0]]))
        assert shown.all()
        np.testing.assert_allclose(seen, uv, atol=1e-5)


def test_what_stands_behind_the_camera_s_plane_is_not_shown():
    lens = build_fisheye()
    R = geometry.rotation_from_tilt_roll(np.radians(45), 0.0)
    camera = lens.posed(R, -R @ np.array([0.0, 0.0, 3.0]))
    behind = np.array([[0.0, -10.0, 0.0], [0.0, 10.0, 0.0]])
    assert camera.project(behind)[1].tolist() == [False, True]


@given(lens=fisheye_lenses(), scale=st.integers(2, 4), angle=ANGLE, turn=TURN)
def test_scaling_and_refocusing_keep_the_lens(lens, scale, angle, turn):
    ray = rays_of(np.array([angle]), np.array([turn]))
    width, height = lens.image_size
    large = lens.scaled_to((scale * width, scale * height))
    assert large.is_fisheye
    expected = (opencv_pixels(lens, ray) + 0.5) * scale - 0.5
    np.testing.assert_allclose(opencv_pixels(large, ray), expected, atol=1e-7)
    # A longer focal length keeps the displacement as a share of the distance f θ on the sensor.
    other, r = lens.refocused(1.3), np.linspace(0, 0.8, 5) * lens.K[0, 0]
    assert other.K[0, 0] == pytest.approx(1.3 * lens.K[0, 0])
    gains = [
        1 + sum(k * (r / x.K[0, 0]) ** (2 * i + 2) for i, k in enumerate(x.distortion))
        for x in (lens, other)
    ]
    np.testing.assert_allclose(*gains)


def test_a_disturbed_fisheye_moves_the_corner_as_a_share():
    camera = build_fisheye().posed(*(lambda R: (R, -R @ [0.0, 0, 3]))(geometry.R_OVERHEAD))
    other = camera.disturbed(np.array([0.0, 0, 0, 0, 0.01]))
    assert other.is_fisheye
    r = np.hypot(*camera.image_size) / 2 / camera.K[0, 0]  # f θ of the corner, without distortion
    assert (other.distortion[0] - camera.distortion[0]) * r**2 == pytest.approx(0.01)


def test_file_round_trip(tmp_path):
    camera = build_fisheye(distortion=(-0.01, 0.02, -0.003, 0.0004)).posed(
        geometry.rotation_from_tilt_roll(0.5, 0.1), np.array([0.1, 2.0, 3.0])
    )
    path = tmp_path / "camera.json"
    camera.save(path)
    values = json.loads(path.read_text())
    assert values["distortion_model"] == "fisheye"
    assert values["distortion"] == [-0.01, 0.02, -0.003, 0.0004]
    found = Camera.load(path)
    assert found.is_fisheye
    np.testing.assert_array_equal(found.distortion, camera.distortion)
    assert found.lens.is_fisheye and found.scaled_to((640, 480)).is_fisheye


def test_coefficients_belong_to_their_model(tmp_path):
    with pytest.raises(InputError, match=r"distortion must be 4 finite numbers"):
        Lens((640, 480), np.eye(3), np.zeros(5), distortion_model="fisheye")
    with pytest.raises(InputError, match=r"distortion must be 5 finite numbers"):
        Lens((640, 480), np.eye(3), np.zeros(4))
    with pytest.raises(InputError, match="must be 'pinhole' or 'fisheye', found 'panorama'"):
        Lens((640, 480), np.eye(3), np.zeros(4), distortion_model="panorama")
