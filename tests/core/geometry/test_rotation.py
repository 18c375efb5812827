"""The paper's rotation, its angles, and the other ways to write a rotation."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scene4d.core import geometry
from scene4d.core.geometry import (
    is_rotation,
    quaternion_from_rotation,
    rotation_from_euler_zyx,
    rotation_from_quaternion,
    rotation_from_tilt_roll,
    tilt_roll_from_rotation,
)
from scene4d.formats.cameras import read_camera

ANGLE = st.floats(-np.pi, np.pi)
TILT = st.floats(np.radians(-89.0), np.radians(89.0))
UNIT = st.floats(-1.0, 1.0)
QUATERNIONS = st.tuples(UNIT, UNIT, UNIT, UNIT).filter(lambda q: np.linalg.norm(q) > 0.01)


def test_overhead_camera_looks_down_with_the_image_top_towards_plus_y():
    R = rotation_from_tilt_roll(np.pi / 2)
    np.testing.assert_allclose(R, geometry.R_OVERHEAD, atol=1e-15)
    np.testing.assert_array_equal(geometry.R_OVERHEAD, [[1, 0, 0], [0, -1, 0], [0, 0, -1]])


def test_level_camera_looks_along_plus_y_with_x_to_the_right():
    expected = [[1, 0, 0], [0, 0, -1], [0, 1, 0]]
    np.testing.assert_allclose(rotation_from_tilt_roll(0.0), expected, atol=1e-15)


def test_camera_rolled_by_a_quarter_turn_has_up_to_its_right():
    # up = (sin roll, -cos roll, 0) for a level camera: at +90 degrees it is the image's right.
    np.testing.assert_allclose(rotation_from_tilt_roll(0.0, np.pi / 2)[:, 2], [1, 0, 0], atol=1e-15)


@given(tilt=TILT, roll=ANGLE)
def test_rotation_is_the_product_of_the_paper(tilt, roll):
    r_roll = Rotation.from_euler("z", roll).as_matrix()
    r_pitch = Rotation.from_euler("x", tilt - np.pi / 2).as_matrix()
    expected = r_roll @ r_pitch @ np.diag([1.0, -1.0, -1.0])
    np.testing.assert_allclose(rotation_from_tilt_roll(tilt, roll), expected, atol=1e-14)


@given(tilt=TILT, roll=ANGLE)
def test_optical_axis_goes_below_the_horizon_by_the_tilt_and_onto_plus_y(tilt, roll):
    axis = rotation_from_tilt_roll(tilt, roll)[2]
    np.testing.assert_allclose(axis, [0, np.cos(tilt), -np.sin(tilt)], atol=1e-14)


@given(tilt=TILT, roll=ANGLE, heading=ANGLE)
def test_tilt_and_roll_round_trip_whatever_the_heading(tilt, roll, heading):
    R = rotation_from_tilt_roll(tilt, roll) @ Rotation.from_euler("z", heading).as_matrix()
    found_tilt, found_roll = tilt_roll_from_rotation(R)
    assert found_tilt == pytest.approx(tilt, abs=1e-12)
    assert np.angle(np.exp(1j * (found_roll - roll))) == pytest.approx(0, abs=1e-12)


def test_tilt_of_a_matrix_just_outside_the_unit_sphere_is_a_number():
    R = geometry.R_OVERHEAD * (1 + 1e-12)
    assert tilt_roll_from_rotation(R)[0] == pytest.approx(np.pi / 2)


@pytest.mark.parametrize(
    ("file", "tilt_deg", "roll_deg", "height_m", "focal_px"),
    [
        ("pets2009/View_001.xml", 16.48, -3.09, 7.07, (1185.0, 1195.0)),
        ("towncentre/TownCentre-calibration.ci", 20.04, -1.44, 7.844, (2696.36, 2696.36)),
    ],
)
def test_known_cameras(shared_data, file, tilt_deg, roll_deg, height_m, focal_px):
    """Angles and heights as DESIGN.md states them, from the recordings' own calibration."""
    camera = read_camera(shared_data / file)
    tilt, roll = tilt_roll_from_rotation(camera.R)
    assert np.degrees(tilt) == pytest.approx(tilt_deg, abs=0.005)
    assert np.degrees(roll) == pytest.approx(roll_deg, abs=0.005)
    assert geometry.camera_centre(camera.R, camera.t)[2] == pytest.approx(height_m, abs=0.005)
    np.testing.assert_allclose(camera.K.diagonal()[:2], focal_px, atol=0.5)
    # The paper's rotation differs from the file's by a turn about the vertical alone.
    turn = rotation_from_tilt_roll(tilt, roll).T @ camera.R
    np.testing.assert_allclose(turn[2], [0, 0, 1], atol=1e-6)
    np.testing.assert_allclose(turn[:2, 2], 0, atol=1e-6)


@given(rx=ANGLE, ry=ANGLE, rz=ANGLE)
def test_euler_angles_against_scipy(rx, ry, rz):
    expected = Rotation.from_euler("ZYX", [rz, ry, rx]).as_matrix()
    np.testing.assert_allclose(rotation_from_euler_zyx(rx, ry, rz), expected, atol=1e-14)


@given(q=QUATERNIONS)
def test_quaternions_against_scipy_at_any_length(q):
    expected = Rotation.from_quat(q).as_matrix()
    np.testing.assert_allclose(rotation_from_quaternion(np.array(q)), expected, atol=1e-13)


@given(q=QUATERNIONS)
def test_quaternion_of_a_rotation_against_scipy(q):
    rotation = Rotation.from_quat(q)
    found = quaternion_from_rotation(rotation.as_matrix())
    assert found[3] >= 0
    assert np.linalg.norm(found) == pytest.approx(1.0, abs=1e-12)
    assert abs(found @ rotation.as_quat()) == pytest.approx(1.0, abs=1e-12)
    np.testing.assert_allclose(rotation_from_quaternion(found), rotation.as_matrix(), atol=1e-12)


@pytest.mark.parametrize("axis", range(3))
def test_quaternion_of_half_a_turn(axis):
    half_turn = -np.eye(3)
    half_turn[axis, axis] = 1.0
    found = quaternion_from_rotation(half_turn)
    np.testing.assert_allclose(np.abs(found), np.eye(4)[axis], atol=1e-12)


@given(q=QUATERNIONS)
def test_every_rotation_is_one(q):
    assert is_rotation(Rotation.from_quat(q).as_matrix())


@pytest.mark.parametrize(
    "matrix",
    [
        np.diag([1.0, 1.0, -1.0]),
        -np.eye(3),
        1.001 * np.eye(3),
        np.eye(3) + np.array([[0, 1e-3, 0], [0, 0, 0], [0, 0, 0]]),
        np.zeros((3, 3)),
        np.full((3, 3), np.nan),
        np.diag([np.inf, 1.0, 1.0]),
        np.eye(2),
        np.eye(4),
    ],
    ids=["mirror", "inversion", "scaled", "sheared", "zero", "nan", "infinite", "2x2", "4x4"],
)
def test_what_is_no_rotation(matrix):
    assert not is_rotation(matrix)


def test_rotation_written_with_six_decimals_still_is_one():
    assert is_rotation(np.round(rotation_from_tilt_roll(0.3, -0.1), 6))


def test_shared_constants_cannot_be_changed():
    for constant in (geometry.R_OVERHEAD, geometry.NO_DISTORTION):
        with pytest.raises(ValueError, match="read-only"):
            constant[0] = 2.0
