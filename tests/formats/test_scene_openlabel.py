"""OpenLABEL: cuboids as another library turns them, and what is left out where it is unknown."""

import json
from dataclasses import replace

import numpy as np
from export_scenes import START, moved, parked, scene, walker, without_nowhere
from scipy.spatial.transform import Rotation

from scene4d.core.cuboids import cuboid_corners
from scene4d.core.vehicle_shapes import CUBOID
from scene4d.formats.scenes import write_scene


def written(tmp_path, table, **more):
    (path,) = write_scene(table, tmp_path / "a.json", "openlabel", **more)
    return json.loads(path.read_text(encoding="utf-8"))["openlabel"]


def test_a_cuboid_has_the_corners_of_the_track(tmp_path):
    document = written(tmp_path, scene())
    data = document["frames"]["30"]["objects"]["2"]["object_data"]
    (cuboid,) = data["cuboid"]
    values = np.array(cuboid["val"])
    turn = Rotation.from_quat(values[3:7]).as_matrix()
    corners = values[:3] + ((CUBOID - [0, 0, 0.5]) * values[7:]) @ turn.T
    np.testing.assert_allclose(corners, cuboid_corners(parked())[1], atol=1e-5)
    assert cuboid["coordinate_system"] in document["coordinate_systems"]
    (front,) = cuboid["attributes"]["boolean"]
    assert front == {"name": "front_known", "val": False}
    sigma = cuboid["attributes"]["vec"][0]["val"]
    np.testing.assert_allclose(sigma, [0.25, 0.25, 0.08, -1, 0.4, 0.1, 0.125], atol=1e-4)


def test_a_known_front_has_a_sigma(tmp_path):
    car = replace(parked(), heading_sigma_rad=np.full(3, 0.2))
    frames = written(tmp_path, scene(walker(), car))["frames"]
    attributes = frames["0"]["objects"]["2"]["object_data"]["cuboid"][0]["attributes"]
    assert attributes["boolean"][0]["val"] and attributes["vec"][0]["val"][3] == 0.2


def test_people_have_a_centroid_and_a_height(tmp_path):
    document = written(tmp_path, scene())
    data = document["frames"]["60"]["objects"]["1"]["object_data"]
    assert "cuboid" not in data and "bbox" not in data, "nobody saw this moment"
    assert data["point3d"][0]["val"] == [4.4, 8.0, 0.875]
    assert {one["name"]: one["val"] for one in data["num"]} == {
        "height_m": 1.75, "height_sigma_m": 0.05,
    }  # fmt: skip
    nowhere = document["frames"]["30"]["objects"]["7"]["object_data"]
    assert "point3d" not in nowhere and len(nowhere["bbox"]) == 1
    assert document["objects"]["1"]["frame_intervals"] == [{"frame_start": 0, "frame_end": 90}]
    assert list(document["streams"]) == ["G340"]


def test_pieces_follow_one_another(tmp_path):
    first = without_nowhere()
    whole = written(tmp_path, [first, moved(first, 90)])
    assert list(map(int, whole["frames"])) == [0, 30, 60, 90, 120, 150, 180]
    assert whole["objects"]["2"]["frame_intervals"] == [{"frame_start": 0, "frame_end": 150}]
    assert whole["frames"]["0"]["frame_properties"]["timestamp"] == f"{START:%Y-%m-%dT%H:%M:%SZ}"
    unknown = written(tmp_path, scene(start_utc=None))
    assert unknown["frames"]["60"]["frame_properties"]["timestamp"] == 2.0
