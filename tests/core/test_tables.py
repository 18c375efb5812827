"""Detections and segments: rows that belong together stay together."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import type_checks
from scene4d.core.body import COCO17, FOOT_HEIGHT_M, HALPE26
from scene4d.core.errors import InputError
from scene4d.core.people import Detections, Segments

SIZE = (640, 480)
NAMES = ("head_top", "feet")


@pytest.fixture
def unchecked():
    """No run-time check of annotations comes before the tables' own."""
    with type_checks.unchecked():
        yield


def detections(n: int = 4, start: int = 0, names: tuple[str, ...] = NAMES, **changes) -> Detections:
    rows = np.arange(start, start + n)
    k = len(names)
    values = {
        "time_s": rows / 10,
        "score": rows / 100,
        "track": 100 + rows,
        "class_name": np.array([f"class {i}" for i in rows], dtype="<U12"),
        "keypoint_uv": rows[:, None, None] + np.zeros((n, k, 2)),
        "keypoint_score": rows[:, None] / 1000 + np.zeros((n, k)),
        "keypoint_names": names,
    }
    boxes = rows[:, None] + np.array([0.0, 10, 20, 30])
    return Detections.from_boxes(SIZE, rows, boxes, **(values | changes))


def segments(n: int = 4, start: int = 0) -> Segments:
    rows = np.arange(start, start + n)
    return Segments(
        foot_uv=rows[:, None] + np.array([0.0, 100.0]),
        head_uv=rows[:, None] + np.array([0.0, 10.0]),
        frame=rows,
        time_s=rows / 10,
        track=100 + rows,
        score=rows / 100,
        box_xyxy=rows[:, None] + np.zeros((1, 4)),
        from_box=rows % 2 == 0,
    )


def assert_rows(table, rows: list[int]) -> None:
    """Each column still holds what was made for these rows."""
    rows = np.array(rows, int)
    np.testing.assert_array_equal(table.frame, rows)
    np.testing.assert_array_equal(table.time_s, rows / 10)
    np.testing.assert_array_equal(table.score, rows / 100)
    np.testing.assert_array_equal(table.track, 100 + rows)
    np.testing.assert_array_equal(table.box_xyxy[:, 0], rows)
    if isinstance(table, Detections):
        assert table.class_name.tolist() == [f"class {i}" for i in rows]
        np.testing.assert_array_equal(table.keypoint_uv[:, 1, 1], rows)
        np.testing.assert_array_equal(table.keypoint_score[:, 0], rows / 1000)
        assert table.image_size == SIZE
        assert table.keypoint_names == NAMES
    else:
        np.testing.assert_array_equal(table.foot_uv[:, 1], rows + 100)
        np.testing.assert_array_equal(table.head_uv[:, 1], rows + 10)
        np.testing.assert_array_equal(table.from_box, rows % 2 == 0)


@pytest.mark.parametrize("make", [detections, segments])
@given(mask=st.lists(st.booleans(), max_size=8))
def test_selection_takes_whole_rows(make, mask):
    table = make(len(mask))
    rows = np.flatnonzero(mask)
    assert_rows(table.select(np.array(mask, bool)), rows.tolist())
    assert_rows(table.select(rows[::-1]), rows[::-1].tolist())
    assert len(table.select(rows)) == len(rows)


@pytest.mark.parametrize("make", [detections, segments])
def test_selection_may_repeat_rows(make):
    assert_rows(make(4).select(np.array([3, 0, 0])), [3, 0, 0])


def test_joined_parts_keep_their_order():
    joined = Detections.concatenate([detections(3), detections(0), detections(2, start=7)])
    assert_rows(joined, [0, 1, 2, 7, 8])
    assert len(joined) == 5


def test_parts_that_do_not_belong_together_are_not_joined():
    with pytest.raises(InputError, match="nothing to concatenate"):
        Detections.concatenate([])
    other_size = Detections.from_boxes((320, 240), np.arange(1), np.zeros((1, 4)))
    with pytest.raises(InputError, match="differ in image_size"):
        Detections.concatenate([detections(1, names=()), other_size])
    with pytest.raises(InputError, match="differ in keypoint_names"):
        Detections.concatenate([detections(1), detections(1, names=("feet", "head_top"))])


def test_bare_boxes_are_unknown_persons():
    found = Detections.from_boxes(SIZE, np.array([0, 5]), np.array([[1, 2, 3, 4], [5, 6, 7, 8]]))
    assert found.frame.tolist() == [0, 5]
    assert found.frame.dtype == found.track.dtype == np.int64
    assert np.isnan(found.time_s).all()
    assert found.track.tolist() == [-1, -1]
    assert found.score.tolist() == [1, 1]
    assert found.class_name.tolist() == ["person", "person"]
    assert found.box_xyxy.tolist() == [[1, 2, 3, 4], [5, 6, 7, 8]]
    assert found.keypoint_uv.shape == (2, 0, 2)
    assert found.keypoint_score.shape == (2, 0)


def test_named_keypoints_that_nobody_measured_are_unknown_not_leftovers():
    found = Detections.from_boxes(SIZE, np.arange(3), np.zeros((3, 4)), keypoint_names=COCO17)
    assert np.isnan(found.keypoint_uv).all()
    assert found.keypoint_uv.shape == (3, 17, 2)
    np.testing.assert_array_equal(found.keypoint_score, np.zeros((3, 17)))


def test_no_detections_are_a_table_too():
    none = Detections.from_boxes(SIZE, np.array([]), np.array([]))
    assert len(none) == 0
    assert none.box_xyxy.shape == (0, 4)


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("time_s", np.zeros(3)),
        ("score", np.ones(5)),
        ("track", np.zeros(1, int)),
        ("class_name", np.array(["person"] * 2)),
        ("keypoint_uv", np.zeros((3, 2, 2))),
        ("keypoint_score", np.zeros((3, 2))),
    ],
)
def test_columns_of_other_lengths_are_named(unchecked, name, value):
    with pytest.raises(InputError, match=f"detections: {name} has {len(value)} rows, not 4"):
        detections(4, **{name: value})


def test_boxes_of_another_number_are_named(unchecked):
    with pytest.raises(InputError, match="detections: box_xyxy has 3 rows, not 2"):
        Detections.from_boxes(SIZE, np.arange(2), np.zeros((3, 4)))


@pytest.mark.parametrize(
    ("name", "value"),
    [("keypoint_uv", np.zeros((4, 3, 2))), ("keypoint_score", np.zeros((4, 1)))],
)
def test_keypoints_without_their_names_are_named(unchecked, name, value):
    found = value.shape[1]
    with pytest.raises(InputError, match=f"{name} holds {found} keypoints, keypoint_names 2"):
        detections(4, **{name: value})


def test_bare_points_are_unknown_segments():
    feet, heads = np.array([[1, 2], [3, 4], [5, 6]]), np.array([[1, 0], [3, 1], [5, 2]])
    found = Segments.from_points(feet, heads)
    np.testing.assert_array_equal(found.foot_uv, feet)
    np.testing.assert_array_equal(found.head_uv, heads)
    assert found.track.tolist() == [-1, -1, -1]
    assert found.frame.tolist() == [0, 0, 0]
    assert found.score.tolist() == [1, 1, 1]
    assert np.isnan(found.time_s).all()
    assert np.isnan(found.box_xyxy).all()
    assert not found.from_box.any()
    assert Segments.from_points(feet, heads, from_box=True).from_box.all()
    assert Segments.from_points(feet, heads, track=np.array([4, 4, 9])).track.tolist() == [4, 4, 9]


@pytest.mark.parametrize(
    ("name", "heads", "track"),
    [("head_uv", np.zeros((3, 2)), None), ("track", np.zeros((2, 2)), np.array([1, 2, 3]))],
)
def test_feet_without_their_heads_are_refused(unchecked, name, heads, track):
    with pytest.raises(InputError, match=f"segments: {name} has 3 rows, not 2"):
        Segments.from_points(np.zeros((2, 2)), heads, track=track)


def test_skeletons_are_in_the_order_of_their_data_sets():
    assert len(HALPE26) == len(set(HALPE26)) == 26
    assert HALPE26.index("head_top") == 17
    assert HALPE26.index("left_ankle") == 15
    assert HALPE26[24:] == ("left_heel", "right_heel")
    assert COCO17[0] == "nose"
    assert COCO17[15:] == ("left_ankle", "right_ankle")
    assert len(COCO17) == 17


def test_feet_stand_on_the_ground_or_a_little_above():
    """W4: people.parquet put keypoints of feet onto Z = 0, the solver onto 0.04 m."""
    points = Segments.from_points(np.zeros((2, 2)), np.ones((2, 2)))
    assert points.foot_height_m.tolist() == [FOOT_HEIGHT_M, FOOT_HEIGHT_M] == [0.04, 0.04]
    boxes = Segments.from_points(np.zeros((2, 2)), np.ones((2, 2)), from_box=True)
    assert boxes.foot_height_m.tolist() == [0.0, 0.0]
