"""Anchors of a site: every way to write them, and a clear word for what is none."""

import json

import numpy as np
import pytest

from scene4d.core.errors import InputError
from scene4d.formats.anchors import read_anchors
from scene4d.formats.cameras import read_camera, write_camera
from strategies import build_camera, build_lens

CAMERA = build_camera(build_lens((1280, 720), 60.0), 25.0, 1.0, 5.0, 40.0, (3.0, 4.0))
EARTH = [{"camera": "a", "u": 10, "v": 400, "lat": 53.44, "lon": -0.94},
         {"camera": "b", "u": 90, "v": 500, "lat": 53.441, "lon": -0.942}]  # fmt: skip
PLAN = [{"camera": "a", "u": 10, "v": 400, "x_m": 1.5, "y_m": 2}]


LINE = [[-0.94, 53.44], [-0.9385, 53.44], [-0.9385, 53.441]]


def feature(coordinates, keeps=None, of="LineString") -> dict:
    said = {} if keeps is None else {"for": keeps}
    return {"type": "Feature", "properties": said, "geometry": {"type": of,
            "coordinates": coordinates}}  # fmt: skip


def written(path, values):
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return path


def test_points_of_the_earth_in_json_and_csv_are_the_same(tmp_path):
    told = read_anchors(written(tmp_path / "a.json", {"points": EARTH}))
    rows = "camera,u,v,lat,lon\na,10,400,53.44,-0.94\nb,90,500,53.441,-0.942\n"
    listed = read_anchors(written(tmp_path / "a.csv", rows))
    assert told.kind == listed.kind == "earth" and told.camera == ("a", "b")
    np.testing.assert_array_equal(told.uv, [[10, 400], [90, 500]])
    np.testing.assert_array_equal(told.xy_m, listed.xy_m)
    east, north = told.xy_m[1] - told.xy_m[0]
    assert north == pytest.approx(111.3, abs=0.2)
    assert east == pytest.approx(-132.8, abs=0.5)
    assert told.latitude_deg == pytest.approx(53.4405)


def test_points_of_a_plan_and_known_cameras(tmp_path):
    write_camera(CAMERA, tmp_path / "gate.krtd", "krtd")
    found = read_anchors(
        written(tmp_path / "a.json", {"points": PLAN, "cameras": {"gate": "gate.krtd"}})
    )
    assert found.kind == "plan" and list(found.known) == ["gate"]
    np.testing.assert_allclose(found.known["gate"].centre_m, CAMERA.centre_m, atol=1e-6)
    alone = read_anchors(tmp_path / "gate.krtd")
    assert alone.kind == "cameras" and list(alone.known) == ["gate"]


def test_lines_of_a_map_in_metres_and_whose_they_are(tmp_path):
    both = {"type": "FeatureCollection", "features": [
        feature(LINE, "vehicles"), feature([LINE, LINE[:2]], of="MultiLineString")]}  # fmt: skip
    found = read_anchors(written(tmp_path / "roads.geojson", both))
    assert found.kind == "earth" and found.latitude_deg == pytest.approx(53.44, abs=0.001)
    assert [one.kinds for one in found.lines] == [(1,), (0, 1), (0, 1)]
    assert [len(one.xy_m) for one in found.lines] == [3, 3, 2]
    steps = np.diff(found.lines[0].xy_m, axis=0)
    np.testing.assert_allclose(np.hypot(*steps.T), [99.8, 111.3], atol=0.3)
    bare = read_anchors(written(tmp_path / "b.json", {"type": "LineString", "coordinates": LINE}))
    np.testing.assert_allclose(np.diff(bare.lines[0].xy_m, axis=0), steps, atol=0.01)


@pytest.mark.parametrize(
    ("name", "text", "word"),
    [
        ("a.json", {"points": []}, "no points and no cameras"),
        ("a.json", {"points": [*EARTH, *PLAN]}, "one of the two"),
        ("a.json", {"points": [EARTH[0] | {"lat": 95}]}, "lat"),
        ("a.json", {"points": [{"camera": "a", "u": 1, "v": 2}]}, "x_m"),
        ("a.json", {"points": [PLAN[0] | {"z": 1}]}, "unknown field"),
        ("a.json", {"point": PLAN}, "a.json"),
        ("a.csv", "camera,u,v,x_m,y_m\na,1,two,3,4\n", "line 2"),
        ("a.csv", "", "empty"),
        ("a.csv", "camera,u,v,x_m,y_m\n", "expected a header"),
        ("a.csv", "camera,u,v,x_m,y_m\na,1,2,3,4,5\n", "line 2"),
        ("a.geojson", {"type": "FeatureCollection", "features": []}, "holds no lines"),
        ("a.geojson", {"type": "Point", "coordinates": [1, 2]}, "a.geojson"),
        ("a.geojson", feature([[-0.94, 53.44]]), "two or more pairs"),
        ("a.geojson", feature([[-0.94, 53.44], ["a", 2]]), "two or more pairs"),
        ("a.geojson", feature([[53.44, 153.44], [0, 1]]), "longitude .-180 to 180., then"),
        ("a.geojson", feature([[0, 50], [1, 50]]), "reach over 72 km"),
        ("a.geojson", feature(LINE, "cars"), "properties.for"),
        ("a.geojson", feature(LINE, of="Polygon"), "leave anything else out"),
    ],
)
def test_what_is_no_anchor_is_named(tmp_path, name, text, word):
    with pytest.raises(InputError, match=word) as error:
        read_anchors(written(tmp_path / name, text))
    assert name in str(error.value)


def tensor(values: np.ndarray) -> dict:
    dims = [{"size": n, "name": ""} for n in values.shape]
    return {"shape": {"dims": dims}, "type": "DOUBLE_TYPE", "doubles": values.ravel().tolist()}


def is_msgs() -> dict:
    pose = np.eye(4)
    pose[:3, :3], pose[:3, 3] = CAMERA.R, CAMERA.t
    return {
        "resolution": {"height": 720, "width": 1280},
        "intrinsic": tensor(CAMERA.K),
        "distortion": tensor(CAMERA.distortion[None]),
        "extrinsic": [{"from": "1000", "tf": tensor(pose)}],
    }


def test_a_camera_of_the_intelligent_space_is_read(tmp_path):
    found = read_camera(written(tmp_path / "0.json", is_msgs()))
    np.testing.assert_allclose(found.P, CAMERA.P, rtol=1e-12, atol=1e-9)
    assert found.image_size == CAMERA.image_size
    lens = is_msgs() | {"extrinsic": []}
    np.testing.assert_array_equal(read_camera(written(tmp_path / "1.json", lens)).K, CAMERA.K)
    wrong = is_msgs()
    wrong["intrinsic"]["doubles"].pop()
    with pytest.raises(InputError, match=r"intrinsic\.doubles"):
        read_camera(written(tmp_path / "2.json", wrong))
