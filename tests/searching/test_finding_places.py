"""Files of named zones and lines, right and wrong."""

import json

import numpy as np
import pytest

from scene4d.core.errors import InputError
from scene4d.searching.places import read_places

SQUARE = [[0, 0], [4, 0], [4, 4], [0, 4]]
BOW = [[0, 0], [4, 4], [4, 0], [0, 4]]
LINE = [[0, 8], [6, 8.5]]


def read(tmp_path, values, cameras=("gate", "yard")):
    path = tmp_path / "places.json"
    path.write_text(values if isinstance(values, str) else json.dumps(values))
    return read_places(path, cameras)


def feature(kind, coordinates, **properties):
    return {
        "type": "Feature",
        "properties": properties,
        "geometry": {"type": kind, "coordinates": coordinates},
    }


def test_the_two_ways_to_write_it_are_the_same(tmp_path):
    plain = read(
        tmp_path,
        {"zones": {"bay": SQUARE}, "lines": {"exit": {"camera": "yard", "points": LINE}}},
    )
    geo = read(
        tmp_path,
        {
            "type": "FeatureCollection",
            "features": [
                feature("Polygon", [SQUARE], name="bay"),
                feature("LineString", LINE, name="exit", camera="yard"),
            ],
        },
    )
    for places in (plain, geo):
        assert places.names("zone") == ("bay",)
        assert places.names("line") == ("exit",)
        assert places.shared == ("bay",)
        np.testing.assert_array_equal(places.of("gate", "zone")["bay"], SQUARE)
        np.testing.assert_array_equal(places.of("yard", "line")["exit"], LINE)
        assert places.of("gate", "line") == {}


def test_one_feature_and_a_name_for_two_cameras(tmp_path):
    assert read(tmp_path, feature("Polygon", [SQUARE], name="bay")).names("zone") == ("bay",)
    two = read(
        tmp_path,
        {
            "type": "FeatureCollection",
            "features": [
                feature("Polygon", [SQUARE], name="bay", camera="gate"),
                feature("Polygon", [SQUARE], name="bay", camera="yard"),
            ],
        },
    )
    assert two.names("zone") == ("bay",)


@pytest.mark.parametrize(
    ("values", "says"),
    [
        ("{", "not JSON"),
        ([], "expected an object"),
        ({}, "no zone and no line"),
        ({"zone": {}}, "did you mean 'zones'"),
        ({"zones": []}, "zones: expected names"),
        ({"zones": {"bay": 3}}, "zone 'bay': expected a list"),
        ({"zones": {"bay": [[0, 0], [1]]}}, "point 2"),
        ({"zones": {"bay": [[0, 0], [1, "x"], [2, 2]]}}, "point 2"),
        ({"zones": {"bay": [[0, 0], [1, True], [2, 2]]}}, "point 2"),
        ('{"zones": {"bay": [[0, 0], [1, NaN], [2, 2]]}}', "point 2"),
        ({"zones": {"bay": SQUARE[:2]}}, "at least 3"),
        ({"zones": {"bay": BOW}}, "crosses itself"),
        ({"zones": {" ": SQUARE}}, "empty"),
        ({"lines": {"exit": LINE[:1]}}, "at least 2"),
        ({"zones": {"bay": {"camera": "gaet", "points": SQUARE}}}, "did you mean 'gate'"),
        ({"zones": {"bay": {"camera": 3, "points": SQUARE}}}, "camera must be a name"),
        ({"zones": {"bay": {"corners": SQUARE}}}, "unknown key 'corners'"),
        ({"zones": {"bay": SQUARE, "Bay": SQUARE}}, "twice"),
        ({"zones": {"bay": SQUARE, "Bay": {"camera": "gate", "points": SQUARE}}}, "twice"),
        ({"zones": {"bay": SQUARE}, "lines": {"bay": LINE}}, "a zone and a line"),
        ({"type": "FeatureCollection"}, "features: expected a list"),
        ({"type": "FeatureCollection", "features": [3]}, "feature 1"),
        ({"type": "FeatureCollection", "crs": "EPSG:4326", "features": []}, "crs"),
        (feature("Polygon", [SQUARE]), "properties.name"),
        (feature("Polygon", [SQUARE, SQUARE], name="bay"), "without holes"),
        (feature("Polygon", 5, name="bay"), "one ring"),
        (feature("Point", [0, 0], name="bay"), "expected Polygon or LineString"),
    ],
)
def test_what_is_wrong_is_named_with_the_file(tmp_path, values, says):
    with pytest.raises(InputError, match=r"places\.json.*") as told:
        read(tmp_path, values)
    assert says in str(told.value)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="gone"):
        read_places(tmp_path / "gone.json", ("gate",))
