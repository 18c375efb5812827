"""The camera and its lens: what they refuse, how they scale, what their file holds."""

import dataclasses
import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core import geometry
from scene4d.core.camera import SCHEMA, Camera, Lens
from scene4d.core.errors import InputError, OutputError
from strategies import SIZES, build_camera, build_lens, cameras, lenses

K = np.array([[1000.0, 0, 383.5], [0, 1010, 287.5], [0, 0, 1]])
POSE = {
    "image_size": (768, 576),
    "focal_px": 1185.0,
    "tilt_rad": 0.3,
    "roll_rad": -0.05,
    "height_m": 7.0,
}


def changed(matrix: np.ndarray, row: int, column: int, value: float) -> np.ndarray:
    out = np.array(matrix, float)
    out[row, column] = value
    return out


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"K": changed(K, 0, 2, np.nan)}, r"K must be 3x3 finite numbers, found .*na"),
        ({"K": changed(K, 0, 0, np.inf)}, r"K must be 3x3 finite numbers"),
        ({"K": changed(K, 0, 0, -1000)}, r"K must have positive focal lengths, found \[-1000"),
        ({"K": changed(K, 1, 1, 0)}, r"K must have positive focal lengths"),
        ({"K": changed(K, 1, 0, 3)}, r"K must be upper triangular with last row 0 0 1"),
        ({"K": changed(K, 2, 0, 1)}, r"K must be upper triangular with last row 0 0 1"),
        ({"K": changed(K, 2, 1, 1)}, r"K must be upper triangular with last row 0 0 1"),
        ({"K": 2 * K}, r"K must be upper triangular with last row 0 0 1"),
        ({"distortion": np.full(5, np.nan)}, r"distortion must be 5 finite numbers"),
        ({"image_size": (0, 576)}, r"image_size must be positive, found \(0, 576\)"),
        ({"image_size": (768, -1)}, r"image_size must be positive, found \(768, -1\)"),
    ],
)
def test_what_is_no_lens_is_refused_by_name(values, message):
    with pytest.raises(InputError, match=message):
        Lens(**({"image_size": (768, 576), "K": K} | values))


@pytest.mark.parametrize(
    ("values", "message"),
    [
        ({"R": np.diag([1.0, 1, -1])}, "R must be a rotation matrix"),
        ({"R": 1.01 * np.eye(3)}, "R must be a rotation matrix"),
        ({"R": np.full((3, 3), np.nan)}, "R must be 3x3 finite numbers"),
        ({"t": np.array([0, np.inf, 0])}, "t must be 3 finite numbers, found .*inf"),
        ({"K": changed(K, 0, 0, -1)}, "K must have positive focal lengths"),
    ],
)
def test_what_is_no_camera_is_refused_by_name(values, message):
    with pytest.raises(InputError, match=message):
        Camera(**({"image_size": (768, 576), "K": K} | values))


def test_a_camera_is_immutable_down_to_its_numbers():
    K_of_caller = K.copy()
    camera = Camera((768, 576), K_of_caller)
    K_of_caller[0, 0] = 1.0
    assert camera.K[0, 0] == 1000
    for array in (camera.K, camera.distortion, camera.R, camera.t):
        with pytest.raises(ValueError, match="read-only"):
            array[...] = 0
    with pytest.raises(dataclasses.FrozenInstanceError):
        camera.image_size = (1, 1)


def test_two_lenses_do_not_share_their_defaults():
    assert Lens((768, 576), K).distortion is not Lens((768, 576), K).distortion
    np.testing.assert_array_equal(Camera((768, 576), K).R, geometry.R_OVERHEAD)


@given(tilt=st.floats(-1.5, 1.5), roll=st.floats(-1.5, 1.5), height=st.floats(0.1, 100.0))
def test_pose_in_pose_out(tilt, roll, height):
    camera = Camera.from_pose(
        image_size=(768, 576), focal_px=1185.0, tilt_rad=tilt, roll_rad=roll, height_m=height
    )
    assert camera.tilt_rad == pytest.approx(tilt, abs=1e-9)
    assert camera.roll_rad == pytest.approx(roll, abs=1e-9)
    assert camera.height_m == pytest.approx(height)
    np.testing.assert_allclose(camera.centre_m, [0, 0, height], atol=1e-9)
    np.testing.assert_allclose(camera.R[2, 0], 0, atol=1e-12)
    assert camera.focal_px == pytest.approx(1185)


def test_the_principal_point_is_the_centre_of_the_image_unless_given():
    """768 pixel centres run from 0 to 767: their middle is 383.5."""
    np.testing.assert_array_equal(
        Camera.from_pose(**POSE).K, [[1185, 0, 383.5], [0, 1185, 287.5], [0, 0, 1]]
    )
    given_centre = Camera.from_pose(**POSE, centre_uv=(400.0, 200.0))
    np.testing.assert_array_equal(given_centre.K[:2, 2], [400, 200])


@pytest.mark.parametrize("name", ["height_m", "focal_px"])
@pytest.mark.parametrize("value", [0.0, -2.0, np.nan, np.inf])
def test_a_camera_below_the_ground_is_refused(name, value):
    with pytest.raises(InputError, match=f"{name}: found {value}, expected a number above 0"):
        Camera.from_pose(**POSE | {name: value})


def test_focal_length_of_a_camera_with_two_is_their_geometric_mean():
    assert Camera((768, 576), np.diag([800.0, 1250.0, 1.0])).focal_px == pytest.approx(1000)


@given(camera=cameras(anywhere=True))
def test_projection_matrix_is_K_times_the_pose(camera):
    P = camera.P
    for j in range(3):
        np.testing.assert_allclose(P[:, j], camera.K @ camera.R[:, j], atol=1e-9)
    np.testing.assert_allclose(P[:, 3], camera.K @ camera.t, rtol=1e-12, atol=1e-6)


@given(camera=cameras(anywhere=True))
def test_methods_are_the_functions_of_geometry(camera):
    points = camera.centre_m + 10 * camera.R[2] + np.array([[0.0, 0, 0], [1, 2, 0.5]])
    uv, valid = camera.project(points, undistorted=True)
    assert valid.all()
    np.testing.assert_array_equal(uv, geometry.project(camera.P, points)[0])
    for height in (0.0, np.array([1.0, 1.5])):
        np.testing.assert_array_equal(
            camera.locate(uv, height, undistorted=True)[0],
            geometry.locate(camera.P, uv, height)[0],
        )
    seen, valid = camera.distort(uv)
    np.testing.assert_array_equal(seen, geometry.distort(uv, camera.K, camera.distortion)[0])
    np.testing.assert_array_equal(camera.project(points)[0], seen)
    back, valid = camera.undistort(seen)
    np.testing.assert_allclose(back[valid], uv[valid], atol=1e-6)


def test_the_lens_of_a_camera_is_its_lens():
    camera = build_camera(build_lens(radial=(-0.05, 0.01, 0.0)))
    lens = camera.lens
    assert type(lens) is Lens
    assert lens.image_size == camera.image_size
    np.testing.assert_array_equal(lens.K, camera.K)
    np.testing.assert_array_equal(lens.distortion, camera.distortion)


# Scaling: pixel centres lie at integers.


def test_scaled_to_keeps_pixel_centres_at_integers():
    """Halving 768x576: the centre 383.5 of 768 pixels becomes the centre 191.5 of 384."""
    half = Lens((768, 576), K, np.arange(5) / 100).scaled_to((384, 288))
    assert half.image_size == (384, 288)
    np.testing.assert_allclose(half.K, [[500, 0, 191.5], [0, 505, 143.5], [0, 0, 1]])
    np.testing.assert_array_equal(half.distortion, np.arange(5) / 100)
    # The middle of the top-left four pixels, (0.5, 0.5), is the centre of the new first pixel.
    moved = Lens((768, 576), changed(changed(K, 0, 2, 0.5), 1, 2, 0.5)).scaled_to((384, 288))
    np.testing.assert_allclose(moved.K[:2, 2], [0, 0], atol=1e-12)


@given(lens=lenses(), scale=st.integers(1, 4), point=st.tuples(st.floats(-1, 1), st.floats(-1, 1)))
def test_scaling_moves_every_point_by_the_same_rule(lens, scale, point):
    width, height = lens.image_size
    large = lens.scaled_to((scale * width, scale * height))
    ray = np.array([*point, 1.0])
    uv, scaled = (lens.K @ ray)[:2], (large.K @ ray)[:2]
    np.testing.assert_allclose(scaled, (uv + 0.5) * scale - 0.5, atol=1e-8)
    np.testing.assert_allclose(
        large.distort(scaled)[0], (lens.distort(uv)[0] + 0.5) * scale - 0.5, atol=1e-6
    )


def test_scaled_skew_and_sides_of_their_own():
    lens = Lens((1000, 1000), changed(K, 0, 1, 10)).scaled_to((2000, 1990))
    np.testing.assert_allclose(lens.K[0], [2000, 20, 2 * (383.5 + 0.5) - 0.5])
    np.testing.assert_allclose(lens.K[1], [0, 1.99 * 1010, 1.99 * (287.5 + 0.5) - 0.5])


def test_a_scaled_camera_keeps_its_pose_and_sees_the_same():
    camera = build_camera(build_lens((768, 576)), 20.0, 3.0, 5.0, 40.0, (1.0, 2.0))
    double = camera.scaled_to((1536, 1152))
    assert isinstance(double, Camera)
    point = camera.centre_m + 10 * camera.R[2] + np.array([[0.3, 0.2, 0.1]])
    np.testing.assert_allclose(double.project(point)[0], (camera.project(point)[0] + 0.5) * 2 - 0.5)


def test_the_same_size_is_the_same_lens():
    lens = Lens((768, 576), K)
    assert lens.scaled_to((768, 576)) is lens


@pytest.mark.parametrize("size", [(1000, 1009), (1009, 1000), (500, 504)])
def test_an_aspect_within_one_percent_is_served(size):
    assert Lens((1000, 1000), K).scaled_to(size).image_size == size


@pytest.mark.parametrize("size", [(1000, 1012), (1012, 1000), (1920, 1080), (1, 1000)])
def test_another_aspect_is_refused(size):
    with pytest.raises(InputError, match=f"1000x1000 images.*{size[0]}x{size[1]}.*lens file made"):
        Lens((1000, 1000), K).scaled_to(size)


@pytest.mark.parametrize("size", [(0, 0), (0, 100), (100, 0), (-1000, -1000)])
def test_no_lens_serves_an_empty_image(size):
    with pytest.raises(InputError, match="image_size must be positive"):
        Lens((1000, 1000), K).scaled_to(size)


# camera.json


@settings(max_examples=30)
@given(camera=cameras(anywhere=True))
def test_file_round_trip_is_exact(tmp_path_factory, camera):
    path = tmp_path_factory.mktemp("camera") / "camera.json"
    camera.save(path)
    loaded = Camera.load(path)
    assert loaded.image_size == camera.image_size
    for name in ("K", "distortion", "R", "t", "P"):
        np.testing.assert_array_equal(getattr(loaded, name), getattr(camera, name))
    for name in ("focal_px", "tilt_rad", "roll_rad", "height_m"):
        assert getattr(loaded, name) == getattr(camera, name)


def test_fields_of_the_file_are_those_of_the_design(tmp_path):
    camera = build_camera(build_lens(radial=(-0.05, 0.01, 0.0)), 30.0, 5.0, 4.0)
    camera.save(str(tmp_path / "camera.json"))
    values = json.loads((tmp_path / "camera.json").read_text())
    assert list(values) == [
        "schema", "image_size", "K", "distortion", "R", "t", "P",
        "focal_px", "tilt_deg", "roll_deg", "height_m",
    ]  # fmt: skip
    assert values["schema"] == "scene4d/camera/2" == SCHEMA
    assert values["image_size"] == [1280, 720]
    assert values["tilt_deg"] == pytest.approx(30)
    assert values["roll_deg"] == pytest.approx(5)
    assert values["height_m"] == pytest.approx(4)
    assert values["focal_px"] == pytest.approx(640 / np.tan(np.radians(25)))
    np.testing.assert_allclose(
        values["P"], np.array(values["K"]) @ np.column_stack([values["R"], values["t"]])
    )
    assert values["distortion"] == camera.distortion.tolist()


def test_loaded_values_beyond_the_camera_s_are_let_pass(tmp_path):
    """A calibration's file holds more than the camera: status, people, warnings."""
    path = tmp_path / "camera.json"
    values = build_camera().to_dict() | {"status": "ok", "people": 12, "warnings": []}
    path.write_text(json.dumps(values))
    assert Camera.load(path).image_size == SIZES[2]


@pytest.mark.parametrize(
    ("change", "message"),
    [
        ({"K": None}, r"field 'K' is missing: it must be 3x3 finite numbers"),
        ({"K": "wide"}, r"'K' must be 3x3 finite numbers, found 'wide'"),
        ({"K": [[1, 2], [3]]}, r"'K' must be 3x3 finite numbers"),
        ({"K": [[1000, 0], [0, 1000]]}, r"'K' must be 3x3 finite numbers"),
        ({"K": [[float("nan"), 0, 1], [0, 1, 1], [0, 0, 1]]}, r"'K' must be 3x3 finite .*nan"),
        ({"K": [[-9, 0, 1], [0, 1, 1], [0, 0, 1]]}, r"K must have positive focal lengths"),
        ({"K": {"f": 3}}, r"'K' must be 3x3 finite numbers"),
        ({"distortion": [0, 0, 0, 0]}, r"'distortion' must be 5 finite numbers, found \[0, 0, 0"),
        ({"distortion": [0, 0, 0, 0, float("inf")]}, r"'distortion' must be 5 finite numbers"),
        ({"distortion_model": "x"}, r"'distortion_model' must be 'fisheye', or absent.*found 'x'"),
        ({"distortion_model": "fisheye"}, r"'distortion' must be 4 finite numbers"),
        ({"t": [0, 0]}, r"'t' must be 3 finite numbers, found \[0, 0\]"),
        ({"t": [0, 0, 10**400]}, r"'t' must be 3 finite numbers"),
        ({"t": [0, 0, 0]}, r"'t' must be that of a camera above the ground"),
        ({"height_m": 0}, r"'height_m' must be [\d.]+, as K, R and t say, found 0"),
        ({"focal_px": "f"}, r"'focal_px' must be a number, found 'f'"),
        ({"R": [[1, 0, 0], [0, 1, 0], [0, 0, -1]]}, r"R must be a rotation matrix"),
        ({"image_size": [640]}, r"'image_size' must be 2 finite numbers, found \[640\]"),
        ({"image_size": [640.5, 480]}, r"image_size must be \(width, height\) in whole pixels"),
        ({"image_size": [float("nan"), 480]}, r"'image_size' must be 2 finite numbers"),
        ({"image_size": "640x480"}, r"'image_size' must be 2 finite numbers"),
        ({"image_size": [True, True]}, r"'image_size' must be 2 finite numbers"),
        ({"image_size": [640, 0]}, r"image_size must be positive"),
        ({"schema": "scene4d/camera/9"}, r'field "schema" must be .scene4d/camera/1. or .*/2.'),
        ({"status": 3}, "'status' must be a text, found 3"),
        ({"schema": None}, r'field "schema"'),
        ({"status": "undetermined", "reason": "all stand in one spot"}, "one spot"),
        ({"status": "undetermined"}, "holds no camera: undetermined"),
    ],
)
def test_a_bad_field_is_named_with_its_file(tmp_path, change, message):
    path = tmp_path / "bad camera.json"
    path.write_text(json.dumps(build_camera().to_dict() | change))
    with pytest.raises(InputError, match=message) as caught:
        Camera.load(path)
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("field", ["image_size", "K", "distortion", "R", "t"])
def test_a_missing_field_is_named(tmp_path, field):
    path = tmp_path / "camera.json"
    values = build_camera().to_dict()
    del values[field]
    path.write_text(json.dumps(values))
    with pytest.raises(InputError, match=f"camera.json: field '{field}' is missing"):
        Camera.load(path)


@pytest.mark.parametrize(
    "content",
    [b"", b"not json", b'{"schema": "scene4d/camera/1"', b"\xff\xfe\x00", b"[" * 200_000],
    ids=["empty", "text", "cut", "binary", "deep"],
)
def test_what_is_not_json_is_said_so(tmp_path, content):
    path = tmp_path / "camera.json"
    path.write_bytes(content)
    with pytest.raises(InputError, match=r"camera\.json: is not JSON"):
        Camera.load(path)


@pytest.mark.parametrize("content", ["[]", "3", "null", '"text"', "{}"])
def test_json_that_is_no_camera_is_said_so(tmp_path, content):
    path = tmp_path / "camera.json"
    path.write_text(content)
    with pytest.raises(InputError, match=r'camera.json: field "schema" must be'):
        Camera.load(path)


def test_a_file_that_cannot_be_read_is_named(tmp_path):
    with pytest.raises(InputError, match=r"none.json: cannot be read: No such file"):
        Camera.load(tmp_path / "none.json")
    with pytest.raises(InputError, match="cannot be read: Is a directory"):
        Camera.load(tmp_path)


def test_a_camera_is_not_saved_into_nothing(tmp_path):
    with pytest.raises(OutputError, match=r"camera.json: cannot be written: No such file"):
        build_camera().save(tmp_path / "missing" / "camera.json")
