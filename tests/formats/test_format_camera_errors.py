"""Bad camera files: one sentence that names the file, the place and what was expected."""

import pytest

from scene4d.core.errors import InputError
from scene4d.formats.cameras import read_camera

YAML = """%YAML:1.0
---
image_width: 640
image_height: 480
camera_matrix: !!opencv-matrix
   rows: 3
   cols: 3
   dt: d
   data: [ 600., 0., 319.5, 0., 600., 239.5, 0., 0., 1. ]
"""
KRTD = "600 0 319.5\n0 600 239.5\n0 0 1\n\n1 0 0\n0 0 -1\n0 1 0\n\n0 5 0\n\n0 0\n"
ROS = """image_width: 640
image_height: 480
camera_matrix: {rows: 3, cols: 3, data: [600, 0, 319.5, 0, 600, 239.5, 0, 0, 1]}
distortion_model: plumb_bob
distortion_coefficients: {rows: 1, cols: 5, data: [0, 0, 0, 0, 0]}
"""
RATIONAL = ROS.replace("cols: 5", "cols: 8").replace("0, 0, 0]}", "0, 0, 0, 1, 2, 3]}")
TSAI = """<Camera>
<Geometry width="768" height="576" dpx="5e-3" dpy="5e-3"/>
<Intrinsic focal="5.5" kappa1="5e-3" cx="380" cy="280" sx="1.0"/>
<Extrinsic tx="0" ty="0" tz="1" rx="2" ry="0" rz="0"/>
</Camera>"""
CI = "FocalLengthX = 2696\nRotationW = 1\n"
P = "600 0 319.5 0\n0 600 239.5 0\n0 0 1 0\n"


def lines(distortion):
    return YAML + f"distortion_coefficients: [{', '.join(map(str, distortion))}]\n"


CASES = [
    ("a.yml", "", "the file is empty"),
    ("a.yml", "hello world", "no camera format recognises this file"),
    ("a.yml", YAML.replace("camera_matrix", "camera_metrics"), "'camera_matrix' is missing"),
    ("a.yml", YAML.replace("600., 0.", "600."), "expected 3x3 numbers, found 8"),
    ("a.yml", YAML.replace("319.5", ".nan"), "'camera_matrix'.*finite.*nan"),
    ("a.yml", YAML.replace("319.5", "abc"), "'camera_matrix'.*number.*'abc'"),
    ("a.yml", YAML.replace("0., 0., 1.", "0., 0., 2."), "last row must be 0 0 1"),
    ("a.yml", YAML.replace("image_width: 640", "image_width: -640"), "'image_width'.*-640"),
    ("a.yml", YAML.replace("data: [", "data: [["), "line 1?[0-9]: is not valid YAML"),
    ("a.yml", YAML + "R: [1, 0, 0, 0, 1, 0, 0, 0, 1]\n", "'R' is there without its partner"),
    ("a.yml", YAML + "R: [1, 0, 0, 0, 1, 0, 0, 0, 2]\nT: [0, 0, 0]\n", "R must be a rotation"),
    ("a.yml", YAML + "R: [1, 0]\nT: [0, 0, 0]\n", "expected 3x3 or 3 numbers, found 2"),
    ("a.yml", YAML.replace("   rows: 3", "   - rows: 3"), "line [0-9]+: is not valid YAML"),
    ("a.yml", "camera_matrix: !!opencv-matrix [1, 2]\n", "line 1: is not valid YAML"),
    ("a.yml", "camera_matrix: [1]\ncamera_matrix: [2]\n", "line 2: the name .* is there twice"),
    ("a.yml", lines([0, 0, 0, 0, 1]) + "fisheye_model: 1\n", "fisheye lens has the four .*found 5"),
    ("a.yml", lines([0.1, 0, 0, 0, 0, 0.2, 0, 0]), "rational model"),
    ("a.yml", lines([0.1, 0, 0, 0, 0, 0, 0, 0, 0.2, 0, 0, 0]), "thin prism model"),
    ("a.xml", "<opencv_storage><camera_matrix>", "line 1: is not well-formed XML"),
    ("a.xml", '<!DOCTYPE a [<!ENTITY b "c">]><opencv_storage>&b;</opencv_storage>', "refused"),
    ("a.krtd", KRTD.replace("600 0 319.5", "600 0"), "line 1: expected 3 numbers, found 2"),
    ("a.krtd", KRTD.replace("0 5 0", "0 five 0"), "line 9: expected a number, found 'five'"),
    ("a.krtd", KRTD + "\n1\n", "expected 7 or 8 rows"),
    ("a.krtd", KRTD.replace("319.5", "3").replace("239.5", "2"), "give image_size"),
    ("a.krtd", KRTD.replace("600 0 319.5", "-600 0 319.5"), "positive focal lengths"),
    ("cameras.txt", "1 THIN_PRISM_FISHEYE 640 480 1 1\n", "line 1: .*OPENCV_FISHEYE"),
    ("cameras.txt", "# a\n1 PINHOLE 640 480 600 600 320\n", "line 2: PINHOLE has 4 parameters"),
    ("cameras.txt", "1 FULL_OPENCV 9 9 1 1 1 1 0 0 0 0 0 1 0 0\n", "rational model"),
    ("a.yaml", ROS.replace("plumb_bob", "thin_prism"), "'thin_prism' is not supported"),
    ("a.yaml", ROS.replace("cols: 5", "cols: 4"), "expected 1x4 numbers, found 5"),
    ("a.yaml", RATIONAL, "rational model"),
    ("camInfo.yml", "projectionMatrix_3x4: [1, 2, 3]\n", "expected 3x4 numbers, found 3"),
    ("a.xml", TSAI.replace('focal="5.5" ', ""), "<Intrinsic>: attribute 'focal' is missing"),
    ("a.xml", TSAI.replace('dpx="5e-3"', 'dpx="0"'), "'dpx' must be positive"),
    ("a.xml", TSAI.replace("<Geometry", "<Geo"), "element <Geometry> is missing"),
    ("a.ci", CI, "'Skew' is missing|'PrincipalPointX' is missing|field .* is missing"),
    ("a.ci", CI + "what is this\n", "line 3: expected `Name = value`"),
    ("P.txt", P.replace("0 0 1 0", "0 0 0 0"), "no perspective camera"),
    ("P.json", "[1, 2, 3]", "12 numbers of a 3x4 matrix, found 3"),
    ("P.json", "[1, 2, ", "is not JSON"),
    ("c.json", '{"schema": "other"}', '"schema" must be'),
]  # fmt: skip


@pytest.mark.parametrize(("name", "text", "message"), CASES)
def test_bad_files(tmp_path, name, text, message):
    path = tmp_path / name
    path.write_text(text)
    with pytest.raises(InputError, match=message) as caught:
        read_camera(path)
    assert str(caught.value).count(str(path)) == 1
    assert str(caught.value).startswith(f"{path}: ")


@pytest.mark.parametrize("text", [YAML, KRTD, ROS, P, TSAI])
def test_the_unspoilt_texts_are_good(tmp_path, text):
    path = tmp_path / "good"
    path.write_text(text)
    assert read_camera(path).K[0, 0] > 0


def test_missing_and_binary_files(tmp_path):
    with pytest.raises(InputError, match="cannot be read"):
        read_camera(tmp_path / "missing.yml")
    (tmp_path / "a.bin").write_bytes(bytes(range(256)))
    with pytest.raises(InputError, match="no camera format"):
        read_camera(tmp_path / "a.bin")
    with pytest.raises(InputError, match="not UTF-8"):
        read_camera(tmp_path / "a.bin", format="krtd")
    with pytest.raises(InputError, match="no camera format"):
        read_camera(tmp_path)
    (tmp_path / "cameras.bin").write_bytes(b"\0")
    with pytest.raises(InputError, match="model_converter"):
        read_camera(tmp_path)
    with pytest.raises(InputError, match="format 'nonsense' is unknown"):
        read_camera(tmp_path, format="nonsense")


def test_principal_point_of_another_image_size(tmp_path):
    path = tmp_path / "a.krtd"
    path.write_text(KRTD)
    assert read_camera(path).image_size == (640, 480)
    assert read_camera(path, image_size=(704, 480)).image_size == (704, 480)
    with pytest.raises(InputError, match="made for another image size"):
        read_camera(path, image_size=(1920, 1080))


def test_unit_of_deepstream(tmp_path):
    matrix = "projectionMatrix_3x4: [600, 0, 0, 0, 0, 0, -600, 600, 0, 1, 0, 0]\n"
    text = matrix + "modelInfo: {height: %s}\n"
    path = tmp_path / "camInfo.yml"
    for height, metres in (("1.7", 1.0), ("170", 0.01), ("1700", 0.001)):
        path.write_text(text % height)
        found = read_camera(path, image_size=(640, 480))
        assert found.height_m == pytest.approx(metres)
    path.write_text(text % "20")
    with pytest.raises(InputError, match=r"modelInfo\.height"):
        read_camera(path, image_size=(640, 480))
