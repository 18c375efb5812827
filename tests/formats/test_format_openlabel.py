"""OpenLABEL and KITTI cameras, from samples written by hand after their specifications."""

import json
import warnings

import numpy as np
import pytest
from scipy.spatial.transform import Rotation

from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.formats.annotations import read_annotations
from scene4d.formats.cameras import read_camera

CAMERA = Camera.from_pose(
    image_size=(1920, 1200),
    focal_px=1400.0,
    tilt_rad=0.35,
    roll_rad=0.02,
    height_m=8.0,
    centre_uv=(967.8, 581.7),
    distortion=(-0.17, 0.12, -0.0001, -0.002, -0.03),
)
CAM_FROM_WORLD = np.block([[CAMERA.R, CAMERA.t[:, None]], [np.zeros(3), np.ones(1)]])
# A lidar on the same mast, turned about and 7.5 m above the ground.
WORLD_FROM_LIDAR = np.eye(4)
WORLD_FROM_LIDAR[:3, :3] = Rotation.from_euler("zyx", [77, 2, -1], degrees=True).as_matrix()
WORLD_FROM_LIDAR[:3, 3] = [-15.9, 2.3, 7.5]
WORLD_FROM_BASE = np.eye(4)
WORLD_FROM_BASE[:3, :3] = Rotation.from_euler("z", 30, degrees=True).as_matrix()
WORLD_FROM_BASE[:3, 3] = [3.0, 4.0, 0.1]
LIDAR_FROM_CAM = np.linalg.inv(CAM_FROM_WORLD @ WORLD_FROM_LIDAR)


def document(pose, *, matrix="camera_matrix", distortion="distortion_coeffs", parent="lidar"):
    """ASAM OpenLABEL 1.0.0: streams, and coordinate systems under their names."""
    pinhole = {
        "width_px": 1920,
        "height_px": 1200,
        matrix: np.column_stack([CAMERA.K, np.zeros(3)]).ravel().tolist(),
        distortion: CAMERA.distortion.tolist(),
    }
    base, lidar = as_standard(WORLD_FROM_BASE), np.linalg.inv(WORLD_FROM_BASE) @ WORLD_FROM_LIDAR
    return {
        "openlabel": {
            "metadata": {"schema_version": "1.0.0"},
            "coordinate_systems": {
                "map": {"type": "scene_cs", "parent": "", "children": ["base"]},
                "base": {"type": "local_cs", "parent": "map", "pose_wrt_parent": base},
                "lidar": {"parent": "base", "pose_wrt_parent": as_standard(lidar)},
                "south": {"type": "sensor_cs", "parent": parent, "pose_wrt_parent": pose},
            },
            "streams": {
                "lidar": {"type": "lidar", "uri": ""},
                "south": {"type": "camera", "stream_properties": {"intrinsics_pinhole": pinhole}},
            },
        }
    }


def written(tmp_path, values):
    path = tmp_path / "labels.json"
    path.write_text(json.dumps(values))
    return path


def as_standard(matrix):
    quaternion = Rotation.from_matrix(matrix[:3, :3]).as_quat().tolist()
    return {"quaternion": quaternion, "translation": matrix[:3, 3].tolist()}


@pytest.mark.parametrize(
    "values",
    [
        document({"matrix4x4": LIDAR_FROM_CAM.ravel().tolist()}),
        document(as_standard(LIDAR_FROM_CAM)),
        # TUMTraf: parent coordinates into the camera's, few decimals, names of VCD 4.
        document(
            {"matrix4x4": np.linalg.inv(LIDAR_FROM_CAM).round(8).tolist()},
            matrix="camera_matrix_3x4",
            distortion="distortion_coeffs_1xN",
        ),
    ],
)
def test_openlabel(tmp_path, values):
    found = read_camera(written(tmp_path, values))
    assert isinstance(found, Camera)
    assert found.image_size == (1920, 1200)
    np.testing.assert_allclose(found.K, CAMERA.K)
    np.testing.assert_allclose(found.distortion, CAMERA.distortion)
    np.testing.assert_allclose(found.R, CAMERA.R, atol=1e-7)
    np.testing.assert_allclose(found.t, CAMERA.t, atol=1e-6)


@pytest.mark.parametrize("way", ["standard", "TUMTraf"])
def test_both_ways_to_write_a_pose_are_told_apart(tmp_path, way):
    """Where both stand upright, which is so for one heading in eighteen, a warning says so."""
    told = 0
    for heading in range(0, 360, 5):
        turn = np.eye(4)
        turn[:3, :3] = Rotation.from_euler("z", heading, degrees=True).as_matrix()
        cam_from_world = CAM_FROM_WORLD @ turn
        pose = np.linalg.inv(cam_from_world) if way == "standard" else cam_from_world
        path = written(tmp_path, document({"matrix4x4": pose.ravel().tolist()}, parent=""))
        with warnings.catch_warnings(record=True) as caught:
            warnings.simplefilter("always")
            found = read_camera(path)
        if caught:
            assert "system 'south': its pose may be meant either way" in str(caught[0].message)
            told += 1
        if way == "standard" or not caught:
            np.testing.assert_allclose(found.R, cam_from_world[:3, :3], atol=1e-9)
            np.testing.assert_allclose(found.t, cam_from_world[:3, 3], atol=1e-9)
    assert told <= 5  # of 72


def test_openlabel_without_pose_is_a_lens(tmp_path):
    assert type(read_camera(written(tmp_path, document({})))) is Lens
    values = document({})
    del values["openlabel"]["coordinate_systems"]
    assert type(read_camera(written(tmp_path, {"vcd": values["openlabel"]}))) is Lens


def spoilt(**changes):
    values = document({"matrix4x4": LIDAR_FROM_CAM.ravel().tolist()})
    for place, value in changes.items():
        values["openlabel"][place] = value
    return values


SYSTEMS = spoilt()["openlabel"]["coordinate_systems"]


HERE = np.eye(4).ravel().tolist()


def posed(pose, **systems):
    south = {"parent": "lidar", "pose_wrt_parent": pose}
    return spoilt(coordinate_systems=SYSTEMS | {"south": south} | systems)


@pytest.mark.parametrize(
    ("values", "message"),
    [
        (spoilt(streams={}), "expected one camera with 'intrinsics_pinhole', found none"),
        (spoilt(streams=[1]), "'openlabel.streams' must be an object"),
        (
            spoilt(
                streams={
                    name: {"stream_properties": {"intrinsics_pinhole": {}}} for name in ("a", "b")
                }
            ),
            "found 'a, b'; keep that of one",
        ),
        (
            spoilt(streams={"a": {"stream_properties": {"intrinsics_pinhole": {}}}}),
            "field 'camera_matrix' is missing",
        ),
        (posed({"matrix4x4": [1, 2]}), "field 'matrix4x4': expected 4x4 numbers, found 2"),
        (posed({"matrix4x4": [2] * 16}), "south.*matrix4x4' must be a rotation"),
        (posed({"euler_angles": [1, 2, 3]}), "euler_angles' must be replaced by"),
        (posed({"quaternion": [0] * 4, "translation": [0] * 3}), "the quaternion is zero"),
        (posed({"quaternion": [0, 0, 0, 1]}), "translation' is missing"),
        (posed(HERE, lidar=3), "lidar' must be an object"),
        (posed(HERE, lidar={"parent": "nowhere"}), "nowhere' is missing"),
        (posed(HERE, lidar={"parent": "lidar"}), "lidar' must be no parent of its own"),
        ({"openlabel": 3}, "'openlabel' must be an object, found 3"),
    ],
)  # fmt: skip
def test_bad_openlabel(tmp_path, values, message):
    with pytest.raises(InputError, match=rf"labels\.json: .*{message}"):
        read_camera(written(tmp_path, values))


# KITTI, after the readme of its development kit.

OBJECT = """P0: 7.215377e+02 0 6.095593e+02 0 0 7.215377e+02 1.728540e+02 0 0 0 1 0
P2: 7.215377e+02 0 6.095593e+02 4.485728e+01 0 7.215377e+02 1.728540e+02 2.163791e-01 0 0 1 2.7e-03
R0_rect: 1 0 0 0 1 0 0 0 1
"""
RAW = """calib_time: 09-Jan-2012 13:57:47
S_02: 1.392000e+03 5.120000e+02
S_rect_02: 1.242000e+03 3.750000e+02
P_rect_02: 7.215377e+02 0 6.095593e+02 4.485728e+01 0 7.215377e+02 1.728540e+02 0.2 0 0 1 0.003
"""


def test_kitti_calibration(tmp_path):
    path = tmp_path / "000000.txt"
    for text, size in ((OBJECT, (1242, 375)), (RAW, None)):
        path.write_text(text)
        found = read_camera(path, image_size=size)
        assert type(found) is Lens
        assert found.image_size == (1242, 375)
        np.testing.assert_array_equal(
            found.K, [[721.5377, 0, 609.5593], [0, 721.5377, 172.854], [0, 0, 1]]
        )
        assert not found.distortion.any()
    path.write_text(OBJECT)
    with pytest.raises(InputError, match="carries no image size; give image_size"):
        read_camera(path)
    path.write_text(OBJECT.replace("2.7e-03", ""))
    with pytest.raises(InputError, match="line 2: expected the 12 numbers"):
        read_camera(path)


LABELS = """0 -1 DontCare -1 -1 -10 219.31 188.49 245.50 218.56 -1000 -1000 -1000 -10 -1 -1 -1
0 2 Pedestrian 0 0 -2.52 1106.13 166.57 1204.47 323.87 1.71 0.71 0.78 6.3 1.6 8.8 -1.9
7 0 Van 0 0 -1.79 296.74 161.75 455.22 292.37 2.0 1.82 4.43 -4.5 1.8 13.4 -2.1
"""


def test_kitti_tracking_labels(tmp_path):
    path = tmp_path / "0000.txt"
    path.write_text(LABELS)
    found = read_annotations(path, image_size=(1242, 375))
    assert found.frame.tolist() == [0, 7]
    assert found.track.tolist() == [2, 0]
    assert found.class_name.tolist() == ["person", "car"]
    assert found.score.tolist() == [1, 1]
    np.testing.assert_array_equal(found.box_xyxy[0], [1106.13, 166.57, 1204.47, 323.87])
    path.write_text(LABELS.replace("-1.9\n", "-1.9 0.25\n"))  # results end in a score
    assert read_annotations(path, image_size=(1242, 375)).score.tolist() == [0.25, 1]
    path.write_text(LABELS.replace("Van", "Flying"))
    with pytest.raises(InputError, match=r"0000\.txt: line 3: expected 17 or 18 words"):
        read_annotations(path, image_size=(1242, 375))
