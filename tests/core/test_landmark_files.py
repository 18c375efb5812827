"""Landmarks as values and as files."""

import json

import pytest

from scene4d.core.errors import InputError
from scene4d.core.landmarks import Distance, GroundPoint, Landmarks, Upright

GOOD = {
    "schema": "scene4d/landmarks/1",
    "points": [
        {"uv": [10, 20.5], "xy_m": [0, 0], "name": "manhole"},
        {"uv": [300, 200], "xy_m": [8.4, -2], "height_m": 0.1, "sigma_m": 0.01, "sigma_px": 1},
    ],
    "uprights": [{"foot_uv": [90, 210], "head_uv": [88, 102], "height_m": 2.1}],
    "distances": [{"uv": [[12, 230], [200, 90]], "distance_m": 12.3, "sigma_m": 0.1}],
}


@pytest.fixture
def load(tmp_path):
    """Reads values written to a file."""

    def of(values: object) -> Landmarks:
        path = tmp_path / "measured.json"
        path.write_text(json.dumps(values))
        return Landmarks.load(path)

    return of


def test_every_field_is_read(load):
    assert load(GOOD) == Landmarks(
        (
            GroundPoint((10.0, 20.5), (0.0, 0.0), name="manhole"),
            GroundPoint((300.0, 200.0), (8.4, -2.0), 0.1, 0.01, 1.0),
        ),
        (Upright((90.0, 210.0), (88.0, 102.0), 2.1),),
        (Distance(((12.0, 230.0), (200.0, 90.0)), 12.3, 0.1),),
    )
    assert load(GOOD).names() == ("manhole", "point 2", "upright 1", "distance 1")


@pytest.mark.parametrize(
    ("where", "value", "said"),
    [
        (("points", 0, "uv"), [1], "points[0].uv' must be 2 finite numbers"),
        (("points", 0, "uv"), [1, "2"], "points[0].uv"),
        (("points", 1, "xy_m"), None, "points[1].xy_m' is missing"),
        (("points", 1, "xy_m"), [1e9, 0], "points[1].xy_m must be metres"),
        (("points", 1, "height_m"), -1, "points[1].height_m must be 0 to 1000 m, found -1"),
        (("points", 1, "sigma_m"), 0, "points[1].sigma_m must be greater than 0, found 0"),
        (("points", 1, "sigma_px"), -2, "points[1].sigma_px must be greater than 0, found -2"),
        (("points", 1, "xy"), [1, 2], "unknown field 'points[1].xy'"),
        (("points", 1, "name"), 5, "points[1].name' must be a text"),
        (("uprights", 0, "height_m"), True, "uprights[0].height_m' must be a number"),
        (("uprights", 0, "height_m"), 0, "uprights[0].height_m must be greater than 0"),
        (("uprights", 0, "head_uv"), [90, 210], "uprights[0]: its two pixels must lie apart"),
        (("distances", 0, "uv"), [[1, 2]], "distances[0].uv' must be 2x2 finite numbers"),
        (("distances", 0, "distance_m"), "12", "distances[0].distance_m' must be a number"),
        (("points",), {}, "'points' must be a list of objects"),
        (("schema",), "scene4d/camera/2", "'schema' must be 'scene4d/landmarks/1'"),
        (("pionts",), [], "unknown field 'pionts'"),
    ],
)
def test_a_bad_field_is_named_with_the_file(load, where, value, said):
    values = json.loads(json.dumps(GOOD))
    inside = values
    for key in where[:-1]:
        inside = inside[key]
    inside[where[-1]] = value
    with pytest.raises(InputError) as error:
        load(values)
    assert said in str(error.value) and "measured.json" in str(error.value)


@pytest.mark.parametrize(
    ("points", "said"),
    [([], "there are no landmarks"), (GOOD["points"][:1], "at one position fit any camera")],
)
def test_what_says_nothing_is_refused(load, points, said):
    with pytest.raises(InputError, match=said):
        load({"points": points})


def test_pixels_outside_the_picture_are_refused(load):
    assert load(GOOD).inside((320, 240)) == load(GOOD)
    with pytest.raises(InputError, match=r"points\[1\].*\(300, 200\) lies outside.*200x240"):
        load(GOOD).inside((200, 240))


def test_a_table_holds_ground_points(tmp_path):
    path = tmp_path / "measured.csv"
    path.write_text(
        "name;u;v;x_m;y_m;z_m;sigma_m;sigma_px\nmanhole;10;20.5;0;0;;;\n\n"
        ";300;200;8.4;-2;0.1;0.01;1\n"
    )
    assert Landmarks.load(path).points == (
        GroundPoint((10.0, 20.5), (0.0, 0.0), name="manhole"),
        GroundPoint((300.0, 200.0), (8.4, -2.0), 0.1, 0.01, 1.0),
    )


@pytest.mark.parametrize(
    ("text", "said"),
    [
        ("u,v,x_m\n1,2,3\n", "line 1: expected a header with the columns u, v, x_m, y_m"),
        ("u,v,x_m,y_m,height\n", "line 1: expected a header"),
        ("u,v,x_m,y_m\n1,2,3\n", "line 2: expected 4 cells, found 3"),
        ("u,v,x_m,y_m\n1,2,,4\n", "line 2: x_m is empty"),
        ("u,v,x_m,y_m\n1,2,3,4\n1,two,3,4\n", "line 3: expected a number, found 'two'"),
        ("u,v,x_m,y_m,sigma_m\n1,2,3,4,0\n5,6,7,8,1\n", "points[0].sigma_m must be greater"),
        ("u,v,x_m,y_m\n", "there are no landmarks"),
        ("", "the file is empty"),
    ],
)
def test_a_wrong_table_is_refused_with_its_line(tmp_path, text, said):
    path = tmp_path / "measured.csv"
    path.write_text(text)
    with pytest.raises(InputError) as error:
        Landmarks.load(path)
    assert said in str(error.value) and "measured.csv" in str(error.value)
