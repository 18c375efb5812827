"""What callers may pass for points and image sizes, and the pixels that a camera speaks in."""

from types import SimpleNamespace

import numpy as np
import pytest
import supervision as sv
from hypothesis import assume, given

import scene4d
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.ground_map import GroundMap
from strategies import build_camera, build_lens, cameras, views

BARREL = build_camera(build_lens((1280, 720), 75.0, radial=(-0.2, 0.02, 0.0)), 25.0, 4.0, 6.0)


@given(view=views(cameras(anywhere=True)))
def test_pixels_of_the_footage_come_back_to_the_ground(view):
    """W3: what ``project`` gives, ``locate`` takes, and both are what the footage shows."""
    camera, xyz_m, flat = view
    seen, valid = camera.project(xyz_m)
    assume(valid.all())
    np.testing.assert_allclose(camera.undistort(seen)[0], flat, atol=1e-6)
    for uv, undistorted in ((seen, False), (flat, True)):
        xy_m, valid = camera.locate(uv, undistorted=undistorted)
        assert valid.all()
        np.testing.assert_allclose(xy_m, xyz_m[:, :2], rtol=1e-6, atol=1e-5)


def test_undistorted_pixels_are_other_pixels():
    xyz_m = np.array([[5.0, 9.0, 0.0]])
    apart = BARREL.project(xyz_m)[0] - BARREL.project(xyz_m, undistorted=True)[0]
    assert np.hypot(*apart[0]) > 20


def test_a_pixel_that_the_lens_cannot_show_has_no_ground():
    camera = build_camera(build_lens((1280, 720), 75.0, radial=(-0.2, 0.0, 0.0)), 25.0, 0.0, 6.0)
    beyond = np.array([[640.0, 5000.0], [640.0, 500.0]])
    assert camera.locate(beyond)[1].tolist() == [False, True]
    assert camera.locate(beyond, undistorted=True)[1].all()
    xyz_m = np.column_stack([camera.locate(beyond, undistorted=True)[0], [0, 0]])
    assert camera.project(xyz_m)[1].tolist() == [False, True]


POINTS = [[400, 500], [700, 650.5]]


@pytest.mark.parametrize(
    "uv",
    [
        POINTS,
        tuple(map(tuple, POINTS)),
        np.array(POINTS, np.float32),
        np.array([[400, 650], [700, 500]]),
        sv.Detections(np.array([[300.0, 100, 500, 500], [600, 300, 800, 650.5]])),
        SimpleNamespace(xyxy=[[300, 100, 500, 500], [600, 300, 800, 650.5]]),
    ],
    ids=["list", "tuple", "float32", "integers", "supervision", "boxes"],
)
def test_locate_takes_what_users_have(uv):
    expected = np.array(POINTS) if not isinstance(uv, np.ndarray) else np.asarray(uv, float)
    for found, valid in (BARREL.locate(uv), GROUND.locate(uv), BARREL.undistort(uv)):
        assert found.shape == (2, 2) and valid.tolist() == [True, True]
    np.testing.assert_allclose(BARREL.locate(uv)[0], BARREL.locate(expected)[0])


GROUND = GroundMap((1280, 720), np.linalg.inv(BARREL.P[:, [0, 1, 3]]))


@pytest.mark.parametrize("one", [[400, 500], (400.0, 500.0), np.array([400, 500])])
def test_one_point_in_one_point_out(one):
    for function in (BARREL.locate, BARREL.distort, BARREL.undistort, GROUND.locate):
        many, all_valid = function([one])
        single, valid = function(one)
        np.testing.assert_array_equal(single, many[0])
        assert single.shape == (2,) and bool(valid) and all_valid.all()
    uv, valid = BARREL.project((1, 12, 0))
    assert uv.shape == (2,) and valid
    xy_m, valid = BARREL.locate([640, -3000])
    assert np.isnan(xy_m).all() and not valid


def test_no_points_are_no_points():
    for empty in ([], np.empty((0, 2)), sv.Detections.empty()):
        xy_m, valid = BARREL.locate(empty)
        assert xy_m.shape == (0, 2) and valid.shape == (0,)


@pytest.mark.parametrize(
    "uv", [[1, 2, 3], [[1, 2, 3]], [["a", "b"]], [[1], [1, 2]], [[[1, 2]]], np.zeros((2, 2, 2))]
)
def test_what_is_no_point_is_refused_by_name(uv):
    with pytest.raises(InputError, match="uv: expected"):
        BARREL.locate(uv)
    with pytest.raises(InputError, match="xyz_m: expected"):
        BARREL.project([1, 2])


def test_heights_of_their_own():
    xy_m, _ = BARREL.locate(POINTS, [0.0, 1.7])
    np.testing.assert_array_equal(xy_m[0], BARREL.locate(POINTS[0])[0])
    np.testing.assert_array_equal(xy_m[1], BARREL.locate(POINTS[1], 1.7)[0])
    with pytest.raises(InputError, match="height_m: expected a number or 2 of them"):
        BARREL.locate(POINTS, [1.0, 2.0, 3.0])


K = np.array([[1000.0, 0, 639.5], [0, 1000, 359.5], [0, 0, 1]])


@pytest.mark.parametrize(
    "size",
    [[1280, 720], np.array([1280, 720]), (1280.0, 720.0), (np.int64(1280), np.float32(720))],
)
def test_an_image_size_of_whole_numbers_is_two_integers(tmp_path, size):
    """W7: a list or NumPy's integers failed later, or wrote a file that could not be read."""
    for made in (Lens(size, K), GroundMap(size, GROUND.ground_from_uv)):
        assert made.image_size == (1280, 720)
        assert [type(side) for side in made.image_size] == [int, int]
    path = tmp_path / "camera.json"
    Camera(size, K, t=np.array([0.0, 0, 5])).save(path)
    assert Camera.load(path).image_size == (1280, 720)
    assert Lens((640, 360), K).scaled_to(size).image_size == (1280, 720)


@pytest.mark.parametrize("size", [(1280.5, 720), (1280,), 1280, "1280x720", None, (np.nan, 720)])
def test_what_is_no_image_size_is_refused(size):
    with pytest.raises(InputError, match=r"image_size must be \(width, height\) in whole pixels"):
        Lens(size, K)


def test_solve_camera_takes_what_users_have(tmp_path):
    """W7: an image size of any whole numbers; what comes of it can be saved."""
    rng = np.random.default_rng(0)
    where = rng.uniform([-4, 8], [4, 25], (60, 2))
    truth = build_camera(build_lens((1280, 720), 60.0), 20.0, 2.0, 6.0)
    feet, _ = truth.project(np.column_stack([where, np.full(60, 0.04)]))
    heads, _ = truth.project(np.column_stack([where, rng.normal(1.70, 0.09, 60)]))
    expected = scene4d.solve_camera(feet, heads, image_size=(1280, 720))
    for size in ([1280, 720], np.array([1280.0, 720.0])):
        found = scene4d.solve_camera(feet, heads, image_size=size)
        assert found.image_size == (1280, 720) and type(found.image_size[0]) is int
        np.testing.assert_array_equal(found.camera.P, expected.camera.P)
        found.save(tmp_path / "camera.json")
        assert scene4d.Calibration.load(tmp_path / "camera.json").people == 60
