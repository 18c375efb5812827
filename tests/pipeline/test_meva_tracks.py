"""Annotated boxes under many numbers become one track per object."""

import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from scene4d.model import Detections
from scene4d.pipeline.evaluating.meva_tracks import one_track_per_object

SIZE = (1920, 1080)
GAP = 30.0


def boxes(*parts: tuple[int, str, range, float, float]) -> Detections:
    """Tracks: number, class, frames, left edge in frame 0, pixels per frame; 40 x 100 pixels."""
    rows = [
        (track, kind, frame, start + speed * frame)
        for track, kind, frames, start, speed in parts
        for frame in frames
    ]
    left = np.array([row[3] for row in rows])
    return Detections.from_boxes(
        SIZE,
        np.array([row[2] for row in rows]),
        np.column_stack([left, np.full(len(rows), 200.0), left + 40, np.full(len(rows), 300.0)]),
        track=np.array([row[0] for row in rows]),
        class_name=np.array([row[1] for row in rows]),
    )


def spans(found: Detections) -> dict[int, tuple[int, int, int]]:
    """First and last frame and number of rows by track."""
    frames = {t: found.frame[found.track == t] for t in np.unique(found.track).tolist()}
    return {t: (int(f.min()), int(f.max()), len(f)) for t, f in frames.items()}


def test_the_same_boxes_are_one_object_from_the_first_label_to_the_last():
    found = one_track_per_object(
        boxes((8, "person", range(0, 60), 100, 2), (3, "person", range(30, 90), 100, 2)), GAP
    )
    assert spans(found) == {3: (0, 89, 90)}


def test_chains_of_labels():
    parts = [(k, "person", range(20 * k, 20 * k + 40), 100, 1) for k in range(1, 6)]
    assert spans(one_track_per_object(boxes(*parts), GAP)) == {1: (20, 139, 120)}


def test_a_track_goes_on_as_the_one_that_begins_where_it_ends():
    found = one_track_per_object(
        boxes((1, "vehicle", range(0, 30), 100, 0), (2, "vehicle", range(45, 60), 100, 0)), GAP
    )
    assert spans(found) == {1: (0, 59, 45)}


def test_what_is_not_the_same():
    apart = boxes(
        (1, "person", range(0, 30), 100, 0),
        (2, "vehicle", range(0, 30), 100, 0),  # another kind of thing at the same place
        (3, "person", range(0, 30), 108, 0),  # close together, not the same
        (4, "person", range(0, 30), 500, 0),
        (5, "person", range(61, 90), 100, 0),  # too late
        (6, "person", range(40, 60), 150, 0),  # elsewhere
    )
    assert set(spans(one_track_per_object(apart, GAP))) == {1, 2, 3, 4, 5, 6}


def test_two_who_pass_each_other_stay_two():
    found = one_track_per_object(
        boxes((1, "person", range(0, 100), 0, 2), (2, "person", range(0, 100), 200, -2)), GAP
    )
    assert spans(found) == {1: (0, 99, 100), 2: (0, 99, 100)}


def test_each_end_has_one_successor():
    # Two begin where one ended: the better one is its continuation.
    found = one_track_per_object(
        boxes(
            (1, "person", range(0, 30), 100, 0),
            (2, "person", range(35, 60), 110, 0),
            (3, "person", range(35, 60), 101, 0),
        ),
        GAP,
    )
    assert spans(found) == {1: (0, 59, 55), 2: (35, 59, 25)}


def test_nearly_the_same_boxes_are_averaged():
    found = one_track_per_object(
        boxes((1, "person", range(0, 10), 100, 0), (2, "person", range(0, 10), 101, 0)), GAP
    )
    np.testing.assert_allclose(found.box_xyxy, np.tile([100.5, 200, 140.5, 300], (10, 1)))


def test_nobody():
    assert (
        len(
            one_track_per_object(
                boxes((1, "person", range(3), 0, 0)).select(np.zeros(3, bool)), GAP
            )
        )
        == 0
    )


@given(
    st.lists(
        st.tuples(
            st.sampled_from(["person", "vehicle"]),
            st.integers(0, 50),
            st.integers(1, 40),
            st.sampled_from([0.0, 3.0, 30.0, 400.0]),
        ),
        min_size=1,
        max_size=6,
    ),
    st.randoms(use_true_random=False),
)
def test_whatever_is_annotated(objects, random):
    parts = [
        (k, kind, range(begin, begin + n), place, 0.0)
        for k, (kind, begin, n, place) in enumerate(objects)
    ]
    given_boxes = boxes(*parts)
    found = one_track_per_object(given_boxes, GAP)
    # No object is twice in a frame, nobody is lost, and nobody changes their kind.
    keys = list(zip(found.frame.tolist(), found.track.tolist(), strict=True))
    assert len(set(keys)) == len(keys)
    assert set(found.frame.tolist()) == set(given_boxes.frame.tolist())
    for track in np.unique(found.track):
        assert len(set(found.class_name[found.track == track].tolist())) == 1
    # The order of the lines in the file does not matter.
    order = list(range(len(given_boxes)))
    random.shuffle(order)
    again = one_track_per_object(given_boxes.select(np.array(order)), GAP)
    np.testing.assert_array_equal(again.track, found.track)
    np.testing.assert_allclose(again.box_xyxy, found.box_xyxy)
