"""A bare homography as a reference: its sign, its handedness, its origin and its camera."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.geometry import rigid_fit
from scene4d.core.ground_map import GroundMap
from strategies import build_camera, build_lens, cameras, lenses, views

SQUARE = cameras(lenses(distorted=False, square=True), anywhere=True)
CAMERA = build_camera(build_lens((1280, 720), 55.0), 20.0, 3.0, 6.0, 40.0, (3.0, 4.0))
FACTOR = st.sampled_from([-1.0, 1.0]).flatmap(
    lambda sign: st.floats(-12.0, 12.0).map(lambda power: sign * 10.0**power)
)


def matrix(camera: Camera) -> np.ndarray:
    """Pixels to metres on the ground, with whatever scale the inverse has."""
    return np.linalg.inv(camera.P[:, [0, 1, 3]])


def ground_map(camera: Camera, world: np.ndarray | None = None, factor: float = 1.0) -> GroundMap:
    H = matrix(camera) if world is None else world @ matrix(camera)
    return GroundMap(camera.image_size, factor * H)


@given(seen=views(cameras(lenses(distorted=False), anywhere=True)), factor=FACTOR)
def test_it_locates_as_the_camera_does_whatever_its_scale_and_sign(seen, factor):
    camera, xyz, uv = seen
    xy, valid = ground_map(camera, factor=factor).locate(uv)
    assert valid.all()
    np.testing.assert_allclose(xy, xyz[:, :2], rtol=1e-6, atol=1e-5)


@given(camera=SQUARE, factor=FACTOR)
def test_the_sky_is_no_ground_whatever_the_sign(camera, factor):
    width, height = camera.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, 7), np.linspace(-2 * height, height - 1, 40))
    uv = np.column_stack([u.ravel(), v.ravel()])
    up = camera.R[:, 2] @ np.linalg.inv(camera.K)
    rises = np.column_stack([uv, np.ones(len(uv))]) @ up
    clear = np.abs(rises) > 1e-6
    xy, valid = ground_map(camera, factor=factor).locate(uv)
    np.testing.assert_array_equal(valid[clear], rises[clear] < 0)
    np.testing.assert_array_equal(np.isnan(xy).any(axis=1), ~valid)


@given(camera=SQUARE, factor=FACTOR, axis=st.sampled_from([0, 1]))
def test_a_map_with_y_down_is_mirrored_so_that_a_rigid_motion_fits(camera, factor, axis):
    flip = np.diag([-1.0 if axis == 0 else 1.0, -1.0 if axis == 1 else 1.0, 1.0])
    width, height = camera.image_size
    uv = np.array([[0.1, 0.99], [0.5, 0.9], [0.9, 0.99], [0.3, 0.95]]) * [width, height]
    true, seen = camera.locate(uv)
    plan = ground_map(camera, flip, factor)
    assert plan.mirrored
    assert not ground_map(camera, factor=factor).mirrored
    xy, valid = plan.locate(uv)
    np.testing.assert_array_equal(valid, seen)
    xy, true = xy[seen], true[seen]
    if len(xy) > 2:
        R, t = rigid_fit(xy, true)
        size = np.abs(true - true.mean(axis=0)).max()
        np.testing.assert_allclose(xy @ R.T + t, true, atol=1e-6 * size + 1e-6)
        R, t = rigid_fit(xy * [1, -1], true)
        assert np.abs(xy * [1, -1] @ R.T + t - true).max() > 1e-3 * size


def test_only_the_y_axis_turns():
    plan = ground_map(CAMERA, np.diag([1.0, -1.0, 1.0]))
    uv = np.array([[640.0, 600.0], [300.0, 500.0]])
    np.testing.assert_allclose(plan.locate(uv)[0], CAMERA.locate(uv)[0])
    plan = ground_map(CAMERA, np.diag([-1.0, 1.0, 1.0]))
    np.testing.assert_allclose(plan.locate(uv)[0], -CAMERA.locate(uv)[0])


def test_mirroring_is_found_and_not_told():
    with pytest.raises(TypeError):
        GroundMap((1280, 720), matrix(CAMERA), mirrored=True)  # type: ignore[call-arg]
    again = GroundMap((1280, 720), ground_map(CAMERA, np.diag([1.0, -1.0, 1.0])).ground_from_uv)
    assert not again.mirrored


@given(camera=SQUARE, factor=FACTOR)
def test_the_camera_comes_back(camera, factor):
    there = ground_map(camera, factor=factor)
    # Elements may be so small that they have lost digits: 1e-316.
    expected = ground_map(camera).ground_from_uv
    np.testing.assert_allclose(there.ground_from_uv, expected, rtol=1e-9, atol=1e-300)
    found = there.camera()
    assert found.image_size == camera.image_size
    assert found.focal_px == pytest.approx(camera.focal_px, rel=1e-5)
    assert found.tilt_rad == pytest.approx(camera.tilt_rad, abs=1e-5)
    assert found.roll_rad == pytest.approx(camera.roll_rad, abs=1e-5)
    assert found.height_m == pytest.approx(camera.height_m, rel=1e-5)
    np.testing.assert_allclose(found.centre_m, camera.centre_m, atol=1e-3)
    np.testing.assert_allclose(found.R, camera.R, atol=1e-5)


def test_a_mirrored_map_has_a_camera_above_the_ground():
    found = ground_map(CAMERA, np.diag([1.0, -1.0, 1.0])).camera()
    assert found.height_m == pytest.approx(6.0)
    assert found.tilt_rad == pytest.approx(np.radians(20.0))
    assert found.roll_rad == pytest.approx(np.radians(3.0))


@given(camera=SQUARE, east=st.floats(1e5, 9e5), north=st.floats(0.0, 1e7), down=st.booleans())
def test_the_origin_may_be_as_far_away_as_that_of_utm(camera, east, north, down):
    world = np.array([[1.0, 0, east], [0, -1.0 if down else 1.0, north], [0, 0, 1]])
    there = ground_map(camera, world)
    assert there.mirrored == down
    width, height = camera.image_size
    uv = np.array([[0.4, 0.99], [0.6, 0.99], [0.5, 0.95]]) * [width, height]
    true, seen = camera.locate(uv)
    xy, _ = there.locate(uv)
    expected = true + np.array([east, -north if down else north])
    np.testing.assert_allclose(xy[seen], expected[seen], atol=1e-4)
    found = there.camera()
    assert found.focal_px == pytest.approx(camera.focal_px, rel=1e-4)
    assert found.height_m == pytest.approx(camera.height_m, rel=1e-4)


def test_the_camera_assumes_square_pixels_a_middle_and_no_lens():
    """A camera that is otherwise has another one in its place; the map itself stays true."""
    lens = build_lens((1280, 720), 55.0, aspect=1.05, centre_shift=(0.03, -0.04))
    camera = build_camera(lens, 25.0, 2.0, 6.0, 10.0)
    there = ground_map(camera)
    uv = np.array([[640.0, 600.0], [300.0, 500.0]])
    np.testing.assert_allclose(there.locate(uv)[0], camera.locate(uv)[0])
    found = there.camera()
    np.testing.assert_array_equal(found.K[:2, 2], [639.5, 359.5])
    assert found.K[0, 0] == found.K[1, 1]
    assert found.K[0, 1] == 0
    np.testing.assert_array_equal(found.distortion, 0)
    assert found.focal_px == pytest.approx(camera.focal_px, rel=0.1)
    assert found.focal_px != pytest.approx(camera.focal_px, rel=0.005)


@pytest.mark.parametrize("scale", [1.0, -1e6])
def test_there_is_no_camera_straight_above(scale):
    above = build_camera(build_lens((1280, 720)), 90.0, 3.0, 6.0)
    there = ground_map(above, factor=scale)
    uv = np.array([[100.0, 100.0], [1200.0, 700.0]])
    np.testing.assert_allclose(there.locate(uv)[0], above.locate(uv)[0], atol=1e-9)
    with pytest.raises(InputError, match="straight down"):
        there.camera()


@pytest.mark.parametrize("stretch", [0.25, 4.0])
def test_there_is_no_camera_where_the_axes_differ_in_scale(stretch):
    with pytest.raises(InputError, match="is it in metres"):
        ground_map(CAMERA, np.diag([1.0, stretch, 1.0])).camera()


SINGULAR = np.outer([1.0, 2.0, 3.0], [1e-3, 2e-3, 1.0])


@pytest.mark.parametrize(
    ("H", "message"),
    [
        (np.full((3, 3), np.nan), "expected 3x3 finite numbers, found"),
        (np.diag([1.0, np.inf, 1.0]), "expected 3x3 finite numbers, found"),
        (np.zeros((3, 3)), "sees no ground"),
        (np.array([[1.0, 0, 0], [0, 1, 0], [0, 0, 0]]), "sees no ground"),
        (SINGULAR, "not invertible"),
        (1e-9 * SINGULAR, "not invertible"),
        (matrix(CAMERA) @ np.diag([1.0, 0.0, 1.0]), "not invertible"),
        (np.diag([1.0, 1.0, 0.0]) @ matrix(CAMERA), "sees no ground"),
        (np.diag([1.0, 0.0, 1.0]) @ matrix(CAMERA), "not invertible"),
    ],
)
def test_what_is_no_map_is_refused(H, message):
    with pytest.raises(InputError, match=message):
        GroundMap((1280, 720), H)


def test_a_horizon_at_the_foot_of_the_picture_is_refused():
    """The sign is told by the middle of the lowest row: there is none."""
    camera = build_camera(build_lens((1280, 720), 55.0), 20.0, 0.0, 6.0)
    K = camera.K.copy()
    K[1, 2] = 719.0 + camera.focal_px * np.tan(np.radians(20.0))
    with pytest.raises(InputError, match="middle of the picture's lowest row sees no ground"):
        ground_map(replace(camera, K=K))


def test_the_matrix_cannot_be_changed_afterwards():
    H = matrix(CAMERA)
    there = GroundMap((1280, 720), H)
    before = there.ground_from_uv.copy()
    H[:] = 0
    np.testing.assert_array_equal(there.ground_from_uv, before)
    with pytest.raises(ValueError, match="read-only"):
        there.ground_from_uv[0, 0] = 1
