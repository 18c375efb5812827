"""Ground homographies as text and JSON, against the cameras that they were taken from."""

import json

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.ground_map import GroundMap
from scene4d.formats.cameras import write_camera
from scene4d.formats.homographies import read_ground_map, read_reference
from strategies import build_camera, build_lens, cameras, lenses

SIZE = (1920, 1080)


def uv_to_ground(camera):
    """Pixels to metres on Z = 0: the inverse of P without its third column."""
    return np.linalg.inv(camera.P[:, [0, 1, 3]])


def rows(H, separator=","):
    return "".join(separator.join(f"{x:.17g}" for x in row) + "\n" for row in H)


CAMERA = build_camera(build_lens(SIZE, 45.0), 22.0, 1.5, 7.0, heading_deg=30.0, xy_m=(5.0, -3.0))
H = uv_to_ground(CAMERA)
GOOD = rows(H)
FEET = np.array([[960.0, 700.0], [100.0, 900.0], [1800.0, 640.5]])


def write(tmp_path, text, name="a_homography_img2world.txt"):
    path = tmp_path / name
    path.write_text(text)
    return path


def same_ground(found, camera=CAMERA):
    xy, seen = found.locate(FEET)
    truth, _ = camera.locate(FEET)
    assert seen.all()
    np.testing.assert_allclose(xy, truth, rtol=1e-9, atol=1e-9)


@pytest.mark.parametrize(
    "text",
    [
        GOOD,
        rows(H, " "),
        rows(H, "\t"),
        rows(H, " , "),
        rows(H, ";\n"),
        "# of a scene\n\n" + rows(H, "   ").replace("\n", "  # a row\n\n"),
        " ".join(rows(-3.5 * H, " ").split()),
        "\ufeff" + GOOD.replace("\n", "\r\n"),
        json.dumps(H.tolist()),
        json.dumps(H.ravel().tolist()),
        json.dumps({"homography": H.tolist(), "unit": "m", "image_size": [1920, 1080]}),
        json.dumps({"H": (2e-3 * H).tolist()}),
    ],
)
def test_spellings(tmp_path, text):
    path = write(tmp_path, text, "anything.txt")
    same_ground(read_ground_map(path, image_size=SIZE))
    found = read_reference(path, image_size=SIZE)
    assert isinstance(found, GroundMap)
    assert found.image_size == SIZE
    same_ground(found)


def test_the_official_layout(tmp_path):
    """Commas, eight digits, exponents of three digits, as the release writes them."""
    text = "".join(",".join(f"{x:.8g}" for x in row) + "\n" for row in H / np.linalg.norm(H))
    text = text.replace("e-0", "e-00")
    assert "e-00" in text
    found = read_ground_map(write(tmp_path, text), image_size=SIZE)
    np.testing.assert_allclose(found.locate(FEET)[0], CAMERA.locate(FEET)[0], atol=2e-4)


@settings(max_examples=40, deadline=None)
@given(
    camera=cameras(lenses(distorted=False, square=True), anywhere=True),
    factor=st.floats(1e-4, 1e4),
    negative=st.booleans(),
    plan=st.booleans(),
)
def test_the_camera_comes_back(tmp_path_factory, camera, factor, negative, plan):
    """Whatever the factor, its sign and the handedness of the file's world."""
    ground = np.diag([1.0, -1.0 if plan else 1.0, 1.0]) @ uv_to_ground(camera)
    path = tmp_path_factory.getbasetemp() / "drawn_homography_img2world.txt"
    path.write_text(rows((-factor if negative else factor) * ground))
    found = read_ground_map(path, image_size=camera.image_size)
    assert found.mirrored == plan
    assert found.camera().focal_px == pytest.approx(camera.focal_px, rel=1e-5)
    assert found.camera().height_m == pytest.approx(camera.height_m, rel=1e-5)
    assert found.camera().tilt_rad == pytest.approx(camera.tilt_rad, abs=1e-6)
    assert found.camera().roll_rad == pytest.approx(camera.roll_rad, abs=1e-6)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("1 2 3\n4 5 6\n7 8\n", "line 3: expected the 9 numbers of a 3x3 homography, found 8"),
        (GOOD + "\n7\n8\n", "line 5: expected the 9 numbers of a 3x3 homography, found 11"),
        ("# nothing\n", "line 1: expected the 9 numbers .* found 0"),
        ("1 2 3\n4 x 6\n7 8 9\n", "line 2: expected a number, found 'x'"),
        ("1 2 3\n4 5 nan\n7 8 9\n", "line 2: expected a finite number, found 'nan'"),
        ("1 2 3\n4 5 6\n7 inf 9\n", "line 3: expected a finite number, found 'inf'"),
        ("1 2 3\n2 4 6\n7 8 9\n", "not invertible"),
        ("0 0 0\n0 0 0\n0 0 0\n", "homography: "),
        ("", "the file is empty"),
        ("[[1, 2], [3, 4]]", "expected the 9 numbers of a 3x3 homography, found 4"),
        ('[[1, 2, 3], [4, NaN, 6], [7, 8, 9]]', "JSON: expected a finite number"),
        ('[[1, 2, 3], [4, true, 6], [7, 8, 9]]', "JSON: expected a number, found True"),
        ("[[1, 2,\n3]", "is not JSON: .* line 2"),
        ('{"homography": [[1, 2], [3, 4]]}', "one field that is a 3x3 list of numbers, found none"),
        (
            json.dumps({"a": H.tolist(), "b": H.tolist()}),
            "one field that is a 3x3 list of numbers, found 'a', 'b'",
        ),
        ('{"H": [[1, 2, 3], [4, "x", 6], [7, 8, 9]]}', "field 'H': expected a number, found 'x'"),
    ],
)  # fmt: skip
def test_bad_homographies(tmp_path, text, message):
    with pytest.raises(InputError, match=r"a_homography_img2world\.txt: .*" + message):
        read_ground_map(write(tmp_path, text), image_size=SIZE)


@pytest.mark.parametrize("text", ["1 2 3\n4 5 nan\n7 8 9\n", "1 2 3\n2 4 6\n7 8 9\n"])
def test_a_spoilt_homography_is_still_called_one(tmp_path, text):
    """So that the message is about its numbers and not about camera formats."""
    path = write(tmp_path, text)
    with pytest.raises(InputError, match=r"finite|invertible"):
        read_reference(path, image_size=SIZE)


@pytest.mark.parametrize("name", ["json", "krtd", "matrix", "opencv-yaml", "opencv-xml"])
def test_cameras_are_references_too(tmp_path, name):
    path = tmp_path / {"json": "camera.json", "krtd": "camera.krtd"}.get(name, "camera.txt")
    write_camera(CAMERA, path, name)
    found = read_reference(path, image_size=SIZE)
    assert isinstance(found, Camera)
    same_ground(found)


@pytest.mark.parametrize(
    "values",
    [
        {"K": np.eye(3).tolist(), "dist": [0, 0]},
        {"camera_matrix": np.eye(3).tolist()},
        {"R": np.eye(3).tolist(), "t": [0, 0, 1]},
        {"a": H.tolist(), "b": H.tolist()},
        {},
    ],
)
def test_other_json_is_no_homography(tmp_path, values):
    with pytest.raises(InputError, match="schema"):  # taken for a camera.json
        read_reference(write(tmp_path, json.dumps(values), "x.json"), image_size=SIZE)


def test_what_is_neither(tmp_path):
    with pytest.raises(InputError, match=r"x\.txt: is neither a camera file .*, json,.*nine"):
        read_reference(write(tmp_path, "1 2 3 4 5\n", "x.txt"), image_size=SIZE)
    lens = "image_width: 1920\nimage_height: 1080\ncamera_matrix: {data: [1000, 0, 960, 0, 1000, "
    lens += "540, 0, 0, 1]}\ndistortion_model: plumb_bob\n"
    lens += "distortion_coefficients: {data: [0, 0, 0, 0, 0]}\n"
    with pytest.raises(InputError, match=r"ros\.yaml: holds a lens without a pose"):
        read_reference(write(tmp_path, lens, "ros.yaml"), image_size=SIZE)
    with pytest.raises(InputError, match=r"carries no image size; give image_size"):
        read_reference(write(tmp_path, GOOD))
    with pytest.raises(InputError, match=r"none\.txt: cannot be read"):
        read_reference(tmp_path / "none.txt", image_size=SIZE)
    with pytest.raises(InputError, match=r"e\.txt: the file is empty"):
        read_reference(write(tmp_path, "\n", "e.txt"), image_size=SIZE)


TOKENS = ["", "nan", "1e400", "²", "[", "]", "{", "}", ",", "\n", "true", '"', "#", "null"]


@settings(max_examples=80, deadline=None)
@given(
    as_json=st.booleans(),
    edits=st.lists(
        st.tuples(st.floats(0, 1), st.integers(0, 4), st.sampled_from(TOKENS)), max_size=3
    ),
)
def test_spoilt_files_end_in_an_input_error(tmp_path_factory, as_json, edits):
    text = json.dumps({"H": H.tolist()}) if as_json else GOOD
    for place, length, token in edits:
        start = int(place * len(text))
        text = text[:start] + token + text[start + length :]
    path = tmp_path_factory.getbasetemp() / "spoilt_homography"
    path.write_text(text)
    for read in (read_ground_map, read_reference):
        try:
            read(path, image_size=SIZE)
        except InputError as error:
            assert str(error).startswith(f"{path}: ")
