"""VIRAT's object files: their columns, and what must not be taken for one."""

import numpy as np
import pytest

from scene4d.core.errors import InputError
from scene4d.formats.annotations import read_annotations

SIZE = (1920, 1080)
NAME = "VIRAT_S_000101_00_000000_000100.viratdata.objects.txt"
TEXT = (
    "0 3 0 100 200 30 60 1\n"
    "0 3 1 102 200 30 60 1\n"
    "1 900 0 800 500 120 70 2\n"
    "2 900 4 400 500 220 90 3 \n"
    "7 5 11 410 520 20 20 4\n"
    "8 5 12 1500 700 60 60 5\n"
    "9 5 13 1500 700 60 60 0\n"
)


def read(tmp_path, text, name=NAME, **options):
    path = tmp_path / name
    path.write_text(text)
    return read_annotations(path, **{"image_size": SIZE} | options)


@pytest.mark.parametrize("options", [{}, {"format": "virat"}, {"name": "x.txt", "format": "virat"}])
def test_columns(tmp_path, options):
    found = read(tmp_path, TEXT, fps=30.0, **options)
    assert found.track.tolist() == [0, 0, 1, 2, 7, 8, 9]
    assert found.frame.tolist() == [0, 1, 0, 4, 11, 12, 13]
    np.testing.assert_allclose(found.time_s, found.frame / 30)
    np.testing.assert_array_equal(found.box_xyxy[0], [100, 200, 130, 260])
    np.testing.assert_array_equal(found.box_xyxy[3], [400, 500, 620, 590])
    assert found.class_name.tolist() == [
        "person", "person", "car", "vehicle", "object", "bicycle", "unknown",
    ]  # fmt: skip
    people = read(tmp_path, TEXT, classes=["person"], **options)
    assert people.track.tolist() == [0, 0]


def test_motchallenge_text_stays_motchallenge(tmp_path):
    text = "1 4 100 200 30 60 1 1\n2 4 100 200 30 60 1 1\n"
    found = read(tmp_path, text, "VIRAT_S_000001.txt")
    assert found.frame.tolist() == [0, 1]
    np.testing.assert_array_equal(found.box_xyxy[0], [100, 200, 130, 260])
    # The same text under the official name: frame 100, box from (200, 30), 60 wide, 1 high.
    found = read(tmp_path, text)
    assert found.frame.tolist() == [100, 100]
    np.testing.assert_array_equal(found.box_xyxy[0], [200, 30, 260, 31])


@pytest.mark.parametrize("kind", ["events", "mapping"])
@pytest.mark.parametrize("options", [{}, {"format": "virat"}])
def test_its_other_files_are_told(tmp_path, kind, options):
    text = "0 5 50 100 150 100 800 500 120 70\n"  # an event: ten numbers, as MOTChallenge has
    with pytest.raises(InputError, match=rf"{kind}\.txt: holds no boxes.*VIRAT_S_000001\.viratdat"):
        read(tmp_path, text, f"VIRAT_S_000001.viratdata.{kind}.txt", **options)


@pytest.mark.parametrize(
    ("line", "message"),
    [
        ("0 3 2 100 200 30 60", "line 9: expected 8 columns, found 7"),
        ("0 3 2 100 200 30 60 1 1", "line 9: expected 8 columns, found 9"),
        ("0 3 2 100 200 30 60 6", "line 9: the type must be 0 to 5, found 6"),
        ("0 3 2 100 200 30 60 -1", "line 9: the type must be 0 to 5, found -1"),
        ("0 3 2 100 200 30 60 1.5", "line 9: the type must be a whole number"),
        ("0 3 2 100 200 30 60 nan", "line 9: the type must be a whole number, found nan"),
        ("0 3 2.5 100 200 30 60 1", "line 9: the frame number must be a whole number"),
        ("0.5 3 2 100 200 30 60 1", "line 9: the object id must be a whole number"),
        ("0 3 -1 100 200 30 60 1", "line 9: .*negative frame number"),
        ("0 3 2 100 200 0 60 1", "line 9: .*empty or swapped"),
        ("0 3 2 100 nan 30 60 1", "line 9: .*not finite"),
        ("0 3 2 1920 200 30 60 1", "line 9: .*wholly outside the 1920x1080 image"),
        ("0 3 2 100 abc 30 60 1", "line 9: expected a number, found 'abc'"),
    ],
)
def test_bad_rows(tmp_path, line, message):
    with pytest.raises(InputError, match=r"objects\.txt: " + message):
        read(tmp_path, TEXT + "\n" + line + "\n")


@pytest.mark.parametrize(
    ("text", "message"),
    [
        (TEXT.replace(" ", ","), "line 1: expected columns separated by blanks, found '0,3,0"),
        ("# x\n" + TEXT.replace(" ", ";"), "line 2: expected columns separated by blanks"),
        ("\n1 2 3 4\n", r"line 2: expected 8 columns \(id, duration, .*found 4"),
        ("# none\n", "holds no rows"),
        ("", "the file is empty"),
    ],
)
def test_bad_layout(tmp_path, text, message):
    with pytest.raises(InputError, match=r"objects\.txt: .*" + message):
        read(tmp_path, text)
