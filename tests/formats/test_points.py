"""Points on the ground from two columns, people.parquet and annotations."""

import numpy as np
import pytest

from scene4d.core.errors import InputError
from scene4d.core.tables import write_people
from scene4d.formats.points import read_points

SIZE = (640, 480)
POINTS = np.array([[10.0, 20.5], [639.5, 479.5], [-0.5, -0.5], [320.0, 240.0]])


def write(tmp_path, text, name="points.txt"):
    path = tmp_path / name
    path.write_text(text)
    return path


@pytest.mark.parametrize("separator", [",", ", ", " ", "\t", ";", " ; "])
@pytest.mark.parametrize("header", ["", "u,v\n", "# a comment\n\nU V\n", '"u","v"\n'])
def test_two_columns(tmp_path, separator, header):
    text = header + "\n".join(f"{u}{separator}{v}" for u, v in POINTS) + "\n\n"
    np.testing.assert_array_equal(read_points(write(tmp_path, text), image_size=SIZE), POINTS)


@pytest.mark.parametrize(
    ("text", "message"),
    [
        ("u,v\n1,2\n3,480\n", r"line 3: point \(3, 480\) does not lie in the 640x480 image"),
        ("1 2\n\n# x\n-1 5\n", r"line 4: point \(-1, 5\) does not lie"),
        ("1 2\nnan 5\n", r"line 2: point \(nan, 5\) does not lie"),
        ("1 2\n3 x\n", "line 2: expected a number, found 'x'"),
        ("1 x\n", "line 1: expected a number, found 'x'"),
        ("1 2\n3 4 5\n", "line 2: expected 2 columns, found 3"),
        ("u,v\n", "holds no rows of numbers"),
        ("u,v\n1,2,3\n", "line 2: expected 2 columns u v, found 3"),
        ("x,y\n1,2\n", "holds no ground points; expected two columns u v"),
        ("1 2 3\n", "holds no ground points"),
        ("hello\n", "holds no ground points.*people.parquet.*virat"),
        ("", "holds no ground points"),
    ],
)
def test_bad_columns(tmp_path, text, message):
    with pytest.raises(InputError, match=r"points\.txt: .*" + message):
        read_points(write(tmp_path, text), image_size=SIZE)


def people(**changes):
    columns = {
        "frame": np.arange(3),
        "foot_u": np.array([10.0, 900.0, 30.0]),
        "foot_v": np.array([20.0, np.nan, 40.0]),
        "inlier": np.array([True, False, True]),
    }
    return {name: c for name, c in (columns | changes).items() if c is not None}


@pytest.mark.parametrize("name", ["people.parquet", "table.bin"])
def test_the_inliers_of_a_calibration(tmp_path, name):
    path = tmp_path / name
    write_people(path, people())
    np.testing.assert_array_equal(read_points(path, image_size=SIZE), [[10, 20], [30, 40]])


@pytest.mark.parametrize(
    ("changes", "message"),
    [
        ({"inlier": None}, "column 'inlier' is missing; .*found 'frame, foot_u, foot_v'"),
        ({"foot_u": None}, "column 'foot_u' is missing"),
        ({"inlier": np.zeros(3, bool)}, "none of its people is an inlier"),
        ({"inlier": np.ones(3)}, "column 'inlier': expected true or false, found float64"),
        ({"foot_u": np.array(["a", "b", "c"])}, "column 'foot_u': expected numbers"),
        ({"foot_u": np.array([10.0, 20, 700])}, r"row 3: point \(700, 40\) does not lie"),
        ({"inlier": np.ones(3, bool)}, r"row 2: point \(900, nan\) does not lie"),
    ],
)
def test_bad_tables(tmp_path, changes, message):
    path = tmp_path / "people.parquet"
    write_people(path, people(**changes))
    with pytest.raises(InputError, match=r"people\.parquet: " + message):
        read_points(path, image_size=SIZE)


def test_not_a_table(tmp_path):
    with pytest.raises(InputError, match=r"people\.parquet: is not a whole Parquet file"):
        read_points(write(tmp_path, "1 2\n", "people.parquet"), image_size=SIZE)
    with pytest.raises(InputError, match=r"none\.txt: cannot be read"):
        read_points(tmp_path / "none.txt", image_size=SIZE)
    with pytest.raises(InputError, match="holds no ground points"):
        read_points(tmp_path, image_size=SIZE)


def test_the_feet_of_annotated_persons(tmp_path):
    text = "0 3 0 100 200 30 60 1\n1 9 0 300 300 90 50 2\n0 3 1 500 450 20 60 1\n"
    path = write(tmp_path, text, "VIRAT_S_000001.viratdata.objects.txt")
    # The car is no person, and the second person's feet are below the picture.
    np.testing.assert_array_equal(read_points(path, image_size=SIZE), [[115, 260]])
    path = write(tmp_path, text.splitlines()[1], "VIRAT_S_000002.viratdata.objects.txt")
    with pytest.raises(InputError, match="holds no box of a person whose feet are in the picture"):
        read_points(path, image_size=SIZE)
    path = write(tmp_path, "1,-1,10,20,30,0,1\n", "det.txt")
    with pytest.raises(InputError, match=r"det\.txt: line 1: .*empty or swapped"):
        read_points(path, image_size=SIZE)


def test_real_boxes(shared_data):
    found = read_points(shared_data / "pets2009" / "frcnn_det.txt", image_size=(768, 576))
    assert 4000 < len(found) <= 4359
    np.testing.assert_allclose(found[0], [(649.441 + 693.858) / 2, 317.632])
