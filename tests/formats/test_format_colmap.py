"""COLMAP's text models: conventions, rigs, and folders that are written whole or not at all."""

import errno
from pathlib import Path

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scene4d.core import geometry
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError, OutputError
from scene4d.formats.cameras import read_camera, read_lens, write_camera


@pytest.fixture
def camera():
    return Camera(
        (1280, 720),
        np.array([[1000.0, 0, 630.25], [0, 1010, 366.5], [0, 0, 1]]),
        np.array([-0.25, 0.08, 1e-05, -0.0005, -0.01]),
        geometry.rotation_from_tilt_roll(0.4, -0.05),
        np.array([0.5, 2.0, 12.0]),
    )


def test_colmap_counts_pixels_from_the_corner_and_quaternions_from_w(tmp_path, camera):
    write_camera(camera, tmp_path / "model", "colmap")
    lines = (tmp_path / "model" / "cameras.txt").read_text().splitlines()
    _, model, _, _, *values = lines[-1].split()
    assert model == "FULL_OPENCV"
    assert [float(x) for x in values[:4]] == [1000, 1010, 630.75, 367.0]
    images = (tmp_path / "model" / "images.txt").read_text().splitlines()
    w, x, y, z = (float(q) for q in images[1].split()[1:5])
    np.testing.assert_allclose(Rotation.from_quat([x, y, z, w]).as_matrix(), camera.R, atol=1e-12)


@pytest.mark.parametrize(
    ("model", "values", "distortion"),
    [
        ("SIMPLE_PINHOLE", "900 640.5 360.5", [0, 0, 0, 0, 0]),
        ("PINHOLE", "900 900 640.5 360.5", [0, 0, 0, 0, 0]),
        ("SIMPLE_RADIAL", "900 640.5 360.5 -0.1", [-0.1, 0, 0, 0, 0]),
        ("RADIAL", "900 640.5 360.5 -0.1 0.02", [-0.1, 0.02, 0, 0, 0]),
        ("OPENCV", "900 900 640.5 360.5 -0.1 0.02 1e-3 2e-3", [-0.1, 0.02, 1e-3, 2e-3, 0]),
        (
            "FULL_OPENCV",
            "900 900 640.5 360.5 -0.1 0.02 1e-3 2e-3 0.3 0 0 0",
            [-0.1, 0.02, 1e-3, 2e-3, 0.3],
        ),
    ],
)
def test_colmap_models(tmp_path, model, values, distortion):
    (tmp_path / "cameras.txt").write_text(f"# comment\n1 {model} 1280 720 {values}\n")
    (tmp_path / "images.txt").write_text("7 1 0 0 0 0 0 0 1 a b.jpg\n1.0 2.0 -1\n")
    for path in (tmp_path, tmp_path / "cameras.txt"):
        found = read_camera(path)
        np.testing.assert_allclose(found.K, [[900, 0, 640], [0, 900, 360], [0, 0, 1]])
        np.testing.assert_allclose(found.distortion, distortion)
        assert isinstance(found, Camera)
    # Several images, the first without points: no camera, but a lens.
    (tmp_path / "images.txt").write_text("1 1 0 0 0 0 0 0 1 a.jpg\n\n2 1 0 0 0 0 0 1 1 b.jpg\n\n")
    with pytest.raises(InputError, match="holds 2 images"):
        read_camera(tmp_path)
    assert read_lens(tmp_path).K[0, 2] == 640


def test_colmap_path_may_be_its_cameras_file(tmp_path, camera):
    write_camera(camera, tmp_path / "cameras.txt", "colmap")
    assert Path(tmp_path / "images.txt").is_file()
    np.testing.assert_allclose(read_camera(tmp_path).t, camera.t)


# Rigs (version 3.12 and later), after COLMAP's documentation of its output format.

RIGS = """# Rig calib list with one line of data per calib:
#   RIG_ID, NUM_SENSORS, REF_SENSOR_TYPE, REF_SENSOR_ID, SENSORS[] as (SENSOR_TYPE, SENSOR_ID, ...
3 3 CAMERA 1 IMU 7 1 1 0 0 0 0 0 0 CAMERA 2 1 {sensor}
"""
FRAMES = """# Frame list with one line of data per frame:
5 3 {rig} 1 CAMERA {camera} 11
"""


SENSOR_R = Rotation.from_euler("xyz", [0.1, -0.3, 0.05]).as_matrix()
SENSOR_T = np.array([0.25, -0.1, 0.4])


def pose_line(R, t):
    x, y, z, w = Rotation.from_matrix(R).as_quat()
    return " ".join(map(repr, map(float, (w, x, y, z, *t))))


@pytest.fixture
def rig(tmp_path, camera):
    """Two cameras in a rig, and one picture of one of them; ``images.txt`` says something else."""
    rig_R, rig_t = SENSOR_R.T @ camera.R, SENSOR_R.T @ (camera.t - SENSOR_T)

    def write(which, rigs=RIGS, frames=FRAMES):
        (tmp_path / "cameras.txt").write_text(
            "1 PINHOLE 1280 720 900 900 640 360\n2 PINHOLE 1280 720 1000 1010 630.75 367\n"
        )
        (tmp_path / "images.txt").write_text(f"11 1 0 0 0 0 0 0 {which} a.jpg\n\n")
        sensor, pose = pose_line(SENSOR_R, SENSOR_T), pose_line(rig_R, rig_t)
        (tmp_path / "rigs.txt").write_text(rigs.format(sensor=sensor))
        (tmp_path / "frames.txt").write_text(frames.format(rig=pose, camera=which))
        return tmp_path

    return write


def test_a_pose_is_that_of_the_sensor_in_its_rig(rig, camera):
    found = read_camera(rig(2))
    np.testing.assert_allclose(found.R, camera.R, atol=1e-12)
    np.testing.assert_allclose(found.t, camera.t, atol=1e-12)
    assert found.K[0, 0] == 1000
    reference = read_camera(rig(1))  # has the pose of the rig itself
    assert reference.K[0, 0] == 900
    np.testing.assert_allclose(found.R @ reference.R.T, SENSOR_R, atol=1e-12)
    np.testing.assert_allclose(found.t - SENSOR_R @ reference.t, SENSOR_T, atol=1e-12)


def test_without_listed_frames_the_images_count(rig):
    np.testing.assert_array_equal(read_camera(rig(2, frames="# none\n")).R, np.eye(3))


@pytest.mark.parametrize(
    ("rigs", "frames", "message"),
    [
        (RIGS, FRAMES + "6 3 {rig} 1 CAMERA 1 12\n", "holds 2 images"),
        (RIGS.replace("CAMERA 2 1 {sensor}", "CAMERA 2 0"), FRAMES, "no pose of camera '2'"),
        (RIGS.replace("3 3 CAMERA", "4 3 CAMERA"), FRAMES, "in rig '3'"),
        (RIGS.replace("2 1 {sensor}", "2 1 1 0 0"), FRAMES, r"rigs\.txt line 3: expected a pose"),
        (RIGS.replace("2 1 {sensor}", "2 x"), FRAMES, "HAS_POSE must be 0 or 1, found 'x'"),
        (RIGS, FRAMES.replace(" 11", ""), r"frames\.txt line 2: expected FRAME_ID"),
        (RIGS, FRAMES.replace("{rig}", "0 0 0 0 1 2 3"), "line 2: the quaternion is zero"),
    ],
)
def test_bad_rigs(rig, rigs, frames, message):
    with pytest.raises(InputError, match=message):
        read_camera(rig(2, rigs, frames))


def test_a_full_disk_leaves_no_part_of_a_model(tmp_path, camera, monkeypatch):
    """The second file does not fit: a lone ``cameras.txt`` would read as a lens."""
    synced = []

    def full_at_the_second(handle):
        synced.append(handle)
        if len(synced) == 2:
            raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr("os.fsync", full_at_the_second)
    with pytest.raises(OutputError, match=r"images\.txt: cannot be written: No space left"):
        write_camera(camera, tmp_path / "model", "colmap")
    assert not list(tmp_path.iterdir())
