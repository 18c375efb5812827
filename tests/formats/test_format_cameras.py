"""Camera files: known cameras, independent readers, round trips."""

import json
from dataclasses import replace

import cv2
import numpy as np
import pytest
import yaml
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scene4d.core import geometry
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError, OutputError
from scene4d.formats.cameras import camera_formats, read_camera, read_lens, write_camera
from strategies import build_fisheye, fisheye_lenses

WRITABLE = [f.name for f in camera_formats() if f.write]
NO_DISTORTION = ("deepstream", "matrix")
FILE_NAMES = {
    "json": "camera.json",
    "opencv-yaml": "camera.yml",
    "opencv-xml": "camera.xml",
    "krtd": "camera.krtd",
    "colmap": "model",
    "ros": "camera.yaml",
    "deepstream": "camInfo.yml",
    "matrix": "P.txt",
}


UNIT = st.floats(0.0, 1.0)
NUMBERS = st.fixed_dictionaries(
    {
        "size": st.tuples(st.integers(160, 2000), st.integers(120, 1100)),
        "focal": UNIT, "aspect": UNIT, "cx": UNIT, "cy": UNIT,
        "tilt": UNIT, "roll": UNIT, "heading": UNIT,
        "centre": st.tuples(UNIT, UNIT, UNIT),
        "distortion": st.tuples(UNIT, UNIT, UNIT, UNIT, UNIT),
    }
)  # fmt: skip


def random_camera(n):
    width, height = 2 * n["size"][0], 2 * n["size"][1]
    fx = (0.4 + 3.6 * n["focal"]) * width
    cx, cy = (0.4 + 0.2 * n["cx"]) * width - 0.5, (0.4 + 0.2 * n["cy"]) * height - 0.5
    K = np.array([[fx, 0, cx], [0, fx * (0.9 + 0.2 * n["aspect"]), cy], [0, 0, 1]])
    turn = Rotation.from_euler("z", 2 * np.pi * n["heading"]).as_matrix()
    tilt, roll = 0.02 + 1.48 * n["tilt"], 1.2 * (n["roll"] - 0.5)
    R = geometry.rotation_from_tilt_roll(tilt, roll) @ turn
    centre = (np.array(n["centre"]) - [0.5, 0.5, 0]) * [400, 400, 40] + [0, 0, 1.5]
    distortion = (np.array(n["distortion"]) - 0.5) * [1, 1, 0.05, 0.05, 1]
    return Camera((width, height), K, distortion, R, -R @ centre)


@pytest.mark.parametrize("name", WRITABLE)
@settings(max_examples=40, deadline=None)
@given(numbers=NUMBERS)
def test_what_is_written_reads_back(tmp_path_factory, name, numbers):
    camera = random_camera(numbers)
    path = tmp_path_factory.mktemp("cameras") / FILE_NAMES[name]
    write_camera(camera, path, name)
    found = read_camera(path, image_size=camera.image_size)  # the format is detected
    assert found.image_size == camera.image_size
    np.testing.assert_allclose(found.K, camera.K, rtol=1e-9, atol=1e-6)
    expected = np.zeros(5) if name in NO_DISTORTION else camera.distortion
    np.testing.assert_array_equal(found.distortion, expected)
    if name == "ros":
        assert not isinstance(found, Camera)
        return
    np.testing.assert_allclose(found.R, camera.R, atol=1e-9)
    np.testing.assert_allclose(found.t, camera.t, atol=1e-7)


FISHEYE = [f.name for f in camera_formats() if f.write and f.fisheye]


@pytest.mark.parametrize("name", FISHEYE)
@settings(max_examples=20, deadline=None)
@given(lens=fisheye_lenses(), tilt=st.floats(0.1, 1.5))
def test_a_fisheye_camera_reads_back(tmp_path_factory, name, lens, tilt):
    lens = replace(lens, K=lens.K * [[1, 0, 1], [1, 1, 1], [1, 1, 1]])  # COLMAP knows no skew
    camera = lens.posed(geometry.rotation_from_tilt_roll(tilt, 0.1), np.array([0.1, 2.0, 3.0]))
    path = tmp_path_factory.mktemp("cameras") / FILE_NAMES[name]
    write_camera(camera, path, name)
    found = read_camera(path)
    assert found.is_fisheye
    np.testing.assert_array_equal(found.distortion, camera.distortion)
    np.testing.assert_allclose(found.K, camera.K, rtol=1e-12)
    if name != "ros":
        np.testing.assert_allclose(found.R, camera.R, atol=1e-9)


def test_formats_without_fisheye_lenses_refuse_them(tmp_path):
    assert set(FISHEYE) == {"json", "opencv-yaml", "opencv-xml", "colmap", "ros"}
    camera = build_fisheye().posed(geometry.R_OVERHEAD, np.array([0.0, 0.0, 3.0]))
    for name in set(WRITABLE) - set(FISHEYE):
        with pytest.raises(InputError, match=f"{name}' has no place for a fisheye.*colmap"):
            write_camera(camera, tmp_path / FILE_NAMES[name], name)
    assert not list(tmp_path.iterdir())


def test_we_read_the_fisheye_files_of_opencv(tmp_path):
    """As OpenCV's calibration sample writes them: four coefficients and ``fisheye_model``."""
    K, d = (
        np.array([[400.0, 0, 630.25], [0, 410, 366.5], [0, 0, 1]]),
        np.array([0.1, 0.02, 0, 1e-4]),
    )
    path = tmp_path / "out.yml"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("image_width", 1280)
    storage.write("image_height", 720)
    storage.write("fisheye_model", 1)
    storage.write("camera_matrix", K)
    storage.write("distortion_coefficients", d[:, None])
    storage.release()
    lens = read_lens(path)
    assert lens.is_fisheye
    np.testing.assert_array_equal(lens.distortion, d)
    path.write_text(path.read_text().replace("fisheye_model: 1", "fisheye_model: 0"))
    np.testing.assert_array_equal(read_lens(path).distortion, [*d, 0.0])  # k1 k2 p1 p2


@pytest.mark.parametrize(
    ("line", "distortion"),
    [
        ("1 SIMPLE_RADIAL_FISHEYE 1280 720 400 640 360 0.05", (0.05, 0, 0, 0)),
        ("1 RADIAL_FISHEYE 1280 720 400 640 360 0.05 -0.01", (0.05, -0.01, 0, 0)),
        ("1 OPENCV_FISHEYE 1280 720 400 410 640 360 0.1 0.2 0.3 0.4", (0.1, 0.2, 0.3, 0.4)),
    ],
)
def test_fisheye_models_of_colmap(tmp_path, line, distortion):
    (tmp_path / "cameras.txt").write_text(line + "\n")
    lens = read_lens(tmp_path)
    assert lens.is_fisheye
    np.testing.assert_array_equal(lens.distortion, distortion)
    np.testing.assert_array_equal(lens.K[:2, 2], [639.5, 359.5])


def test_every_writable_format_is_in_the_round_trip():
    assert set(WRITABLE) == set(FILE_NAMES)
    read_only = {f.name for f in camera_formats() if not f.write}
    assert read_only == {"is-msgs", "kitti", "openlabel", "tsai", "towncentre"}


@pytest.fixture
def camera():
    return Camera(
        (1280, 720),
        np.array([[1000.0, 0, 630.25], [0, 1010, 366.5], [0, 0, 1]]),
        np.array([-0.25, 0.08, 1e-05, -0.0005, -0.01]),
        geometry.rotation_from_tilt_roll(0.4, -0.05),
        np.array([0.5, 2.0, 12.0]),
    )


def test_pets_view_001(shared_data):
    camera = read_camera(shared_data / "pets2009" / "View_001.xml")
    assert camera.image_size == (768, 576)
    assert np.degrees(camera.tilt_rad) == pytest.approx(16.48, abs=0.005)
    assert np.degrees(camera.roll_rad) == pytest.approx(-3.09, abs=0.005)
    assert camera.height_m == pytest.approx(7.07, abs=0.005)
    assert camera.K[0, 0] == pytest.approx(1185, abs=0.5)
    assert camera.K[1, 1] == pytest.approx(1195, abs=0.5)


def test_tsai_distortion_over_the_whole_image(shared_data):
    """The file's own equation, Xu = Xd (1 + kappa1 r^2) in mm, written out here by hand."""
    camera = read_camera(shared_data / "pets2009" / "View_001.xml")
    u, v = (
        x.ravel() for x in np.meshgrid(np.linspace(-0.5, 767.5, 65), np.linspace(-0.5, 575.5, 49))
    )
    cx, cy, kappa = 3.2422149053e02, 2.8256650051e02, 5.1113043639e-03
    dx, dy = 5.1273271277e-03 / 1.0937855397, 4.65e-03
    x, y = (u - cx) * dx, (v - cy) * dy
    factor = 1 + kappa * (x * x + y * y)
    expected = np.column_stack([x * factor / dx + cx, y * factor / dy + cy])
    found, valid = camera.undistort(np.column_stack([u, v]))
    assert valid.all()
    assert np.abs(expected - np.column_stack([u, v])).max() > 10  # the lens is not a small thing
    assert np.abs(found - expected).max() < 0.01


def test_towncentre(shared_data):
    camera = read_camera(shared_data / "towncentre" / "TownCentre-calibration.ci")
    assert camera.image_size == (1920, 1080)
    assert np.degrees(camera.tilt_rad) == pytest.approx(20.04, abs=0.005)
    assert np.degrees(camera.roll_rad) == pytest.approx(-1.44, abs=0.005)
    np.testing.assert_allclose(camera.centre_m, [-9.04, -5.00, 7.844], atol=0.005)
    np.testing.assert_allclose(camera.distortion[:2], [-0.60150605, 4.70203733])


@pytest.mark.parametrize(("name", "size"), [("G341", (1920, 1080)), ("G506", (1920, 1072))])
def test_meva_cameras_stand_upright_above_the_ground(shared_data, name, size):
    camera = read_camera(shared_data / "meva" / "cameras" / f"{name}.krtd")
    assert camera.image_size == size  # inferred; 960 and 959.5 are both the centre of 1920
    assert 2 < camera.height_m < 15
    assert 10 < np.degrees(camera.tilt_rad) < 25
    assert abs(np.degrees(camera.roll_rad)) < 5


@pytest.mark.parametrize("name", ["opencv-yaml", "opencv-xml"])
def test_opencv_reads_our_files(tmp_path, camera, name):
    path = tmp_path / FILE_NAMES[name]
    write_camera(camera, path, name)
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_READ)
    assert storage.getNode("image_width").real() == 1280
    np.testing.assert_array_equal(storage.getNode("camera_matrix").mat(), camera.K)
    np.testing.assert_array_equal(
        storage.getNode("distortion_coefficients").mat().ravel(), camera.distortion
    )
    np.testing.assert_array_equal(storage.getNode("R").mat(), camera.R)
    np.testing.assert_array_equal(storage.getNode("T").mat().ravel(), camera.t)
    storage.release()


@pytest.mark.parametrize("suffix", ["yml", "xml"])
@pytest.mark.parametrize("pose", ["rvec", "extrinsic_matrix", "none"])
def test_we_read_files_of_opencv(tmp_path, camera, suffix, pose):
    path = tmp_path / f"out.{suffix}"
    storage = cv2.FileStorage(str(path), cv2.FILE_STORAGE_WRITE)
    storage.write("calibration_time", "Thu Jan  1 00:00:00 1970")
    storage.write("image_width", 1280)
    storage.write("image_height", 720)
    storage.write("camera_matrix", camera.K)
    storage.write("distortion_coefficients", camera.distortion[:, None])
    storage.write("extrinsic_parameters", np.ones((4, 6)))  # of a chessboard: not the camera's
    if pose == "rvec":
        storage.write("rvec", cv2.Rodrigues(camera.R)[0])
        storage.write("tvec", camera.t[:, None])
    elif pose == "extrinsic_matrix":
        storage.write("extrinsic_matrix", np.column_stack([camera.R, camera.t]))
    storage.release()
    found = read_camera(path)
    np.testing.assert_allclose(found.K, camera.K)
    np.testing.assert_allclose(found.distortion, camera.distortion)
    assert isinstance(found, Camera) == (pose != "none")
    if isinstance(found, Camera):
        np.testing.assert_allclose(found.R, camera.R, atol=1e-12)
        np.testing.assert_allclose(found.t, camera.t, atol=1e-12)


def test_deepstream_holds_both_matrices(tmp_path, camera):
    """Read with a plain YAML parser, as NVIDIA's tools do (they take ``_w2p`` alone)."""
    path = tmp_path / "camInfo.yml"
    write_camera(camera, path, "deepstream")
    values = yaml.safe_load(path.read_text())
    assert list(values) == ["projectionMatrix_3x4_w2p", "projectionMatrix_3x4", "modelInfo"]
    assert values["modelInfo"] == {"height": 1.7, "radius": 0.25}
    world = np.array([[1.0, 20.0, 1.7, 1.0], [-4.0, 35.0, 0.0, 1.0]])
    uv = world @ camera.P.T
    for name, origin in zip(values, (0.0, [639.5, 359.5]), strict=False):
        found = world @ np.reshape(values[name], (3, 4)).T
        np.testing.assert_allclose(
            found[:, :2] / found[:, 2:], uv[:, :2] / uv[:, 2:] - origin, atol=1e-9
        )
    lines = path.read_text().splitlines()
    centred = lines[lines.index("projectionMatrix_3x4:") :]  # the older entry alone
    path.write_text("\n".join(centred))
    with pytest.raises(InputError, match="give image_size"):
        read_camera(path)
    np.testing.assert_allclose(read_camera(path, image_size=(1280, 720)).P, camera.P, atol=1e-8)


# deepstream-tracker-3d/configs/camInfo.yml of NVIDIA's deepstream_reference_apps (Apache-2.0);
# the world of that sample is left-handed, in centimetres.
NVIDIA = """
projectionMatrix_3x4: [2582.5691623002185, -485.10283397043617, 650.27745033162591,
  -89466.605755471101, -423.46809686390498, 1044.6870098337931, 2461.1283636622838,
  -214284.36100320917, -0.25563255317172684, -0.90495941862094287, 0.34014768617197644,
  -1181.960782357068]
modelInfo:
  height: 205
  radius: 33
"""


def test_nvidias_own_sample(tmp_path):
    path = tmp_path / "camInfo.yml"
    path.write_text(NVIDIA)
    with pytest.raises(InputError, match="left-handed"):
        read_camera(path, image_size=(1920, 1080))
    mirrored = NVIDIA.replace("[2582", "[-2582").replace("-423", "423").replace("-0.2556", "0.2556")
    path.write_text(mirrored)
    camera = read_camera(path, image_size=(1920, 1080))
    np.testing.assert_allclose(camera.K[:2, 2], [959.5, 539.5], atol=1e-6)
    np.testing.assert_allclose(camera.K[0, 0], camera.K[1, 1])
    assert camera.height_m == pytest.approx(4.8195, abs=1e-4)  # the sample says 481.95
    assert np.degrees(camera.tilt_rad) == pytest.approx(19.886, abs=1e-3)


def test_deepstream_w2p_counts_from_the_corner(tmp_path, camera):
    path = tmp_path / "camInfo.yml"
    path.write_text(f"projectionMatrix_3x4_w2p: {camera.P.ravel().tolist()}\n")
    found = read_camera(path, image_size=(1280, 720))
    np.testing.assert_allclose(found.P, camera.P, atol=1e-8)
    nested = f"projectionMatrix_3x4: {camera.P.tolist()}\n"
    path.write_text(nested)
    with pytest.raises(InputError, match="nested rows"):
        read_camera(path, image_size=(1280, 720))


@pytest.mark.parametrize("factor", [1.0, -3.5, 1e-4])
@pytest.mark.parametrize("style", ["rows", "commas", "one line", "json"])
def test_bare_matrix_up_to_its_factor(tmp_path, camera, factor, style):
    P = factor * camera.P
    path = tmp_path / "P.txt"
    join = {"rows": " ", "commas": ", ", "one line": " "}.get(style, "")
    rows = [join.join(map(repr, row)) for row in P.tolist()]
    text = json.dumps(P.tolist()) if style == "json" else "\n".join(rows)
    path.write_text(
        text.replace("\n", " ") if style == "one line" else "# P\n" * (style == "rows") + text
    )
    found = read_camera(path, image_size=(1280, 720))
    np.testing.assert_allclose(found.K, camera.K, rtol=1e-9, atol=1e-7)
    np.testing.assert_allclose(found.R, camera.R, atol=1e-10)
    np.testing.assert_allclose(found.t, camera.t, atol=1e-8)
    # An independent decomposition gives the same K.
    K = cv2.decomposeProjectionMatrix(P)[0]  # which leaves the signs open
    np.testing.assert_allclose(found.K, np.abs(K / K[2, 2]), rtol=1e-9, atol=1e-6)


def test_ros_file_holds_the_rectified_projection(tmp_path, camera):
    path = tmp_path / "camera.yaml"
    write_camera(camera, path, "ros")
    text = path.read_text()
    assert "1.0e-05" in text  # YAML 1.1 takes 1e-05 for a string
    assert "[1000.0, 0.0, 630.25, 0.0, 0.0, 1010.0, 366.5, 0.0, 0.0, 0.0, 1.0, 0.0]" in text
    assert type(read_camera(path)) is Lens


def test_lens_is_scaled_to_the_footage(tmp_path, camera):
    path = tmp_path / "camera.json"
    write_camera(camera, path, "json")
    lens = read_lens(path, image_size=(640, 360))
    assert type(lens) is Lens
    assert lens.image_size == (640, 360)
    np.testing.assert_allclose(lens.K[:2, 2], [(630.25 + 0.5) / 2 - 0.5, (366.5 + 0.5) / 2 - 0.5])
    with pytest.raises(InputError, match=r"camera\.json: .*aspect ratio differs"):
        read_lens(path, image_size=(640, 480))


@pytest.mark.parametrize("name", ["ros", "colmap"])
def test_missing_folders_are_made(tmp_path, camera, name):
    path = tmp_path / "new" / "dir" / "camera"
    write_camera(camera, path, name)
    assert read_lens(path).K[0, 0] == camera.K[0, 0]


def test_writing_says_what_it_cannot(tmp_path, camera):
    with pytest.raises(InputError, match="read only"):
        write_camera(camera, tmp_path / "a.xml", "tsai")
    with pytest.raises(InputError, match="unknown"):
        write_camera(camera, tmp_path / "a.xml", "nonsense")
    (tmp_path / "file").write_text("x")
    with pytest.raises(OutputError):
        write_camera(camera, tmp_path / "file", "colmap")
    assert (tmp_path / "file").read_text() == "x"
    with pytest.raises(OutputError, match=r"a\.yml: cannot be written: Not a directory"):
        write_camera(camera, tmp_path / "file" / "a.yml", "ros")
    assert sorted(p.name for p in tmp_path.iterdir()) == ["file"]
    skewed = Camera(camera.image_size, camera.K + np.eye(3, k=1) * [[0, 1, 0]], R=camera.R)
    with pytest.raises(InputError, match="skew"):
        write_camera(skewed, tmp_path / "model", "colmap")
