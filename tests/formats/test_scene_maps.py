"""Scenes as GeoJSON and OGC Moving Features."""

import json
from dataclasses import replace

import numpy as np
import pytest
from export_scenes import (
    ANCHOR,
    nowhere,
    parked,
    scene,
    tracks_of,
    walker,
    without_nowhere,
)

from scene4d.core.errors import InputError
from scene4d.formats.scenes import write_scene


def test_geojson_features(tmp_path):
    write_scene(scene(), tmp_path / "a.geojson", "geojson")
    found = json.loads((tmp_path / "a.geojson").read_text())
    line, point, null = found["features"]
    assert (line["geometry"]["type"], point["geometry"]["type"]) == ("LineString", "Point")
    assert null["geometry"] is None
    at = line["geometry"]["coordinates"]
    lonlat = ANCHOR.to_lonlat(walker().xy_m)
    np.testing.assert_allclose(at, lonlat, atol=1e-9)
    for name in ("times", "times_s", "speeds_mps", "sigmas_m"):
        assert len(line["properties"][name]) == len(at)
    np.testing.assert_allclose(
        point["geometry"]["coordinates"], ANCHOR.to_lonlat(np.array([[-5.0, 20.0]]))[0], atol=1e-9
    )
    assert line["properties"]["sigma_m"] == pytest.approx(np.sqrt(0.04 + 0.09 + 0.01 + 0.02))
    assert (line["properties"]["rows"], line["properties"]["observed_rows"]) == (4, 3)


def test_geojson_without_anchor_says_what_to_do(tmp_path):
    with pytest.raises(InputError, match=r"give an anchor of .*, or export moving-features"):
        write_scene(scene(geo=None), tmp_path / "a.geojson", "geojson")
    assert not list(tmp_path.iterdir())


def test_who_creeps_does_not_stand(tmp_path):
    """0.4 m/s for a second stays within half a metre, and is a motion all the same."""
    n = 30
    creeping = tracks_of(
        np.ones(n), np.arange(n),
        xy=np.column_stack([0.4 * np.arange(n) / 30, np.zeros(n)]),
        velocity_mps=np.tile([0.4, 0.0], (n, 1)),
    )  # fmt: skip
    unknown = replace(creeping, velocity_mps=np.full((n, 2), np.nan), track=creeping.track + 1)
    jumping = replace(
        creeping, velocity_mps=np.zeros((n, 2)), xy_m=creeping.xy_m * 10, track=creeping.track + 2
    )
    write_scene(scene(creeping, unknown, jumping), tmp_path / "a.geojson", "geojson")
    features = json.loads((tmp_path / "a.geojson").read_text())["features"]
    assert [f["properties"]["standing"] for f in features] == [False, True, False]


def test_a_gap_without_positions_is_left_out_of_the_line(tmp_path):
    xy = np.array([[0.0, 9], [1, 9], [np.nan, np.nan], [3, 9], [4, 9]])
    write_scene(scene(tracks_of(np.ones(5), np.arange(5), xy=xy)), tmp_path / "a", "geojson")
    feature = json.loads((tmp_path / "a").read_text())["features"][0]
    assert len(feature["geometry"]["coordinates"]) == 4
    assert feature["properties"]["rows"] == 5


# Moving Features


@pytest.mark.parametrize("local", [False, True])
def test_moving_features_keep_the_requirements(tmp_path, local):
    """OGC 19-045r3, requirements 2.6 to 2.8, 2.22 to 2.29 and 2.38 to 2.42."""
    unknown = {"geo": None, "start_utc": None} if local else {}
    one = tracks_of(
        [9], [3], xy=[[1.0, 5.0]], keypoint_uv=np.full((1, 2, 2), np.nan),
        keypoint_score=np.full((1, 2), np.nan),
    )  # fmt: skip
    write_scene(scene(walker(), parked(), one, **unknown), tmp_path / "a.json", "moving-features")
    found = json.loads((tmp_path / "a.json").read_text())
    assert found["type"] == "FeatureCollection"
    assert {"type", "properties"} == set(found["crs"]) == set(found["trs"])
    assert ("bbox" in found, "time" in found) == (not local, not local)
    assert [f["id"] for f in found["features"]] == [1, 2, 9]
    for feature in found["features"]:
        assert feature["type"] == "Feature"
        geometry = feature["temporalGeometry"]
        times = geometry["datetimes"]
        assert geometry["type"] == "MovingPoint"
        assert len(times) == len(geometry["coordinates"]) >= 1
        assert times == sorted(set(times))
        assert geometry["interpolation"] == ("Linear" if len(times) > 1 else "Discrete")
        (group,) = feature["temporalProperties"]
        assert group.pop("datetimes") == times
        assert len(group) == 4
        for values in group.values():
            assert len(values["values"]) == len(times)
            assert values["type"] in {"Measure", "Text"}
            form = values.get("form", "MTS")
            assert len(form) == 3 or form.startswith("http")


def test_moving_features_in_local_metres(tmp_path):
    table = without_nowhere(geo=None, start_utc=None)
    write_scene(table, tmp_path / "a.json", "moving-features")
    found = json.loads((tmp_path / "a.json").read_text())
    assert "metres on the ground" in found["crs"]["properties"]["name"]
    assert "seconds" in found["trs"]["properties"]["name"]
    walking = found["features"][0]
    assert walking["temporalGeometry"]["datetimes"] == [0, 1, 2, 3]
    np.testing.assert_allclose(walking["temporalGeometry"]["coordinates"], walker().xy_m)
    assert walking["temporalProperties"][0]["observed"]["values"] == [True, True, False, True]


def test_moving_features_count_what_they_leave_out(tmp_path):
    with pytest.warns(UserWarning, match="left out 1 tracks without a position"):
        write_scene(scene(), tmp_path / "a.json", "moving-features")
    assert len(json.loads((tmp_path / "a.json").read_text())["features"]) == 2


@pytest.mark.parametrize("name", ["geojson", "moving-features"])
def test_maps_need_a_position(tmp_path, name):
    with pytest.raises(InputError, match="no row has a position"):
        write_scene(scene(nowhere()), tmp_path / "a", name)
    assert not list(tmp_path.iterdir())


@pytest.mark.parametrize("name", ["geojson", "moving-features"])
def test_a_track_is_in_one_place_at_a_time(tmp_path, name):
    tracks = tracks_of([4, 4], [6, 6], xy=np.ones((2, 2)))
    with pytest.raises(InputError, match=r"track 4 has two rows at 0\.2 s"):
        write_scene(scene(tracks), tmp_path / "a", name)
