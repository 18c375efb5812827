"""Files of named zones and lines, right and wrong."""

import json
from pathlib import Path
from tempfile import TemporaryDirectory

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.searching._places import read_places
from strategies import ANY_TEXT

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
        ([], "must be an object"),
        ({}, "no zone and no line"),
        ({"zone": {}}, "unknown field 'zone'; known: zones, lines"),
        ({"zones": []}, "field 'zones' must be an object"),
        ({"zones": {"bay": 3}}, "field 'zones.bay' must be nx2 finite numbers, found 3"),
        ({"zones": {"bay": None}}, "field 'zones.bay' is missing"),
        ({"zones": {"bay": [[0, 0], [1]]}}, "nx2 finite numbers"),
        ({"zones": {"bay": [[0, 0], [1, "x"], [2, 2]]}}, "nx2 finite numbers"),
        ({"zones": {"bay": [[0, 0], [1, True], [2, 2]]}}, "nx2 finite numbers"),
        ('{"zones": {"bay": [[0, 0], [1, NaN], [2, 2]]}}', "nx2 finite numbers"),
        ({"zones": {"bay": [[0, 0], [1, 10**400], [2, 2]]}}, "nx2 finite numbers"),
        ({"zones": {"bay": SQUARE[:2]}}, "at least 3"),
        ({"zones": {"bay": BOW}}, "crosses itself"),
        ({"zones": {" ": SQUARE}}, "1 to 80 characters"),
        ({"zones": {"x" * 5000: SQUARE}}, "1 to 80 characters"),
        ('{"zones": {"bay": [[0, 0], [4, 0], [4, 4]], "bay": []}}', "'bay' is there twice"),
        ({"lines": {"exit": LINE[:1]}}, "at least 2"),
        ({"zones": {"bay": {"camera": "gaet", "points": SQUARE}}}, "did you mean 'gate'"),
        (
            {"zones": {"bay": {"camera": 3, "points": SQUARE}}},
            "field 'zones.bay.camera' must be a text",
        ),
        ({"zones": {"bay": {"corners": SQUARE}}}, "unknown field 'zones.bay.corners'"),
        ({"zones": {"bay": SQUARE, "Bay": SQUARE}}, "twice"),
        ({"zones": {"bay": SQUARE, "Bay": {"camera": "gate", "points": SQUARE}}}, "twice"),
        ({"zones": {"bay": SQUARE}, "lines": {"bay": LINE}}, "a zone and a line"),
        ({"type": "FeatureCollection"}, "field 'features' is missing"),
        ({"type": "FeatureCollection", "features": [3]}, "field 'features[0]' must be an object"),
        ({"type": []}, "unknown field 'type'"),
        ({"type": "Feature", "geometry": {"type": []}, "properties": {}}, "geometry.type"),
        ({"type": "FeatureCollection", "crs": "EPSG:4326", "features": []}, "crs"),
        (feature("Polygon", [SQUARE]), "field 'properties.name' is missing"),
        (feature("Polygon", [SQUARE, SQUARE], name="bay"), "without holes"),
        (feature("Polygon", 5, name="bay"), "one ring"),
        (feature("Polygon", [[[0, 0], [10**400, 0], [1, 1]]], name="bay"), "finite numbers"),
        (feature("Point", [0, 0], name="bay"), "must be Polygon or LineString"),
    ],
)
def test_what_is_wrong_is_named_with_the_file(tmp_path, values, says):
    with pytest.raises(InputError, match=r"places\.json.*") as told:
        read(tmp_path, values)
    assert says in str(told.value)
    assert len(str(told.value)) < 500


NUMBERS = st.integers() | st.floats() | st.just(10**400)
LEAVES = st.none() | st.booleans() | NUMBERS | st.text(ANY_TEXT, max_size=9)
FIELDS = "zones lines bay camera points type features geometry properties name coordinates"
KEYS = st.sampled_from(FIELDS.split())
WORDS = st.sampled_from(["Feature", "FeatureCollection", "Polygon", "LineString", "gate"])


@given(
    st.recursive(
        LEAVES | WORDS | st.just(SQUARE),
        lambda inner: st.lists(inner, max_size=3) | st.dictionaries(KEYS, inner, max_size=4),
        max_leaves=12,
    )
)
def test_any_json_is_read_or_refused_in_one_line(values):
    with TemporaryDirectory() as folder:
        try:
            read(Path(folder), values)
        except InputError as error:
            assert len(str(error)) < 500
            assert "\n" not in str(error)


def test_a_file_that_is_not_there(tmp_path):
    with pytest.raises(InputError, match="gone"):
        read_places(tmp_path / "gone.json", ("gate",))
