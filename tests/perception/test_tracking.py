from collections import Counter, defaultdict

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays

from scene4d.core.errors import InputError
from scene4d.perception._tracking import Tracker, clear_matches
from scene4d.perception.objects import colour_histograms

INF = np.inf


def box(u, v, height=80.0):
    return [u - height / 5, v - height, u + height / 5, v]


def colour(*peaks):
    """One-hot histograms: people in plain clothes."""
    return np.eye(8)[list(peaks)]


def groups(tracks, people):
    """Per track, how often it shows which person; and the reverse."""
    by_track, by_person = defaultdict(Counter), defaultdict(Counter)
    for t, p in zip(tracks, people, strict=True):
        by_track[t][p] += 1
        by_person[p][t] += 1
    return by_track, by_person


def purity(tracks, people):
    """Share of the boxes that belong to the person whom their track shows most."""
    return sum(max(c.values()) for c in groups(tracks, people)[0].values()) / len(people)


def completeness(tracks, people):
    """Share of the boxes that lie in the longest track of their person."""
    return sum(max(c.values()) for c in groups(tracks, people)[1].values()) / len(people)


@pytest.mark.parametrize("dt", [0.1, 0.4, 1.0])
def test_a_walker_keeps_one_track_even_where_boxes_do_not_overlap(dt):
    tracker = Tracker()
    labels = [
        tracker.update(np.array([box(100 + 64 * t, 300 + 5 * t)]), t)[0]
        for t in np.arange(0, 8, dt)
    ]
    assert set(labels) == {0}


def test_crossing_walkers_are_never_mixed():
    tracker = Tracker()
    tracks, people = [], []
    for t in np.arange(0, 10, 0.5):
        boxes = np.array([box(100 + 60 * t, 300), box(700 - 60 * t, 304)])
        tracks += [*tracker.update(boxes, t, colour(0, 5))]
        people += [0, 1]
    assert purity(tracks, people) == 1
    assert completeness(tracks, people) == 1


def test_without_colours_a_doubtful_meeting_ends_both_tracks():
    tracker = Tracker()
    tracks, people = [], []
    for t in np.arange(0, 10, 0.5):
        boxes = np.array([box(100 + 60 * t, 300), box(700 - 60 * t, 301)])
        tracks += [*tracker.update(boxes, t)]
        people += [0, 1]
    assert purity(tracks, people) == 1


def test_colours_part_people_who_change_places():
    here = np.array([box(300, 300), box(330, 300)])
    tracker = Tracker()
    first = tracker.update(here, 0.0, colour(0, 5))
    second = tracker.update(here, 1.0, colour(5, 0))
    assert second.tolist() == first[::-1].tolist()


def test_another_size_is_another_person():
    tracker = Tracker()
    a = tracker.update(np.array([box(300, 300, 80)]), 0.0)
    b = tracker.update(np.array([box(300, 300, 130)]), 0.4)
    assert a[0] != b[0]


def test_people_are_forgotten_after_a_while():
    tracker = Tracker()
    person = np.array([box(300, 300)])
    nobody = np.empty((0, 4))
    first = tracker.update(person, 0.0)[0]
    assert tracker.update(nobody, 1.0).shape == (0,)
    assert tracker.update(person, 1.5)[0] == first
    for t in (2.0, 3.0, 4.0):
        tracker.update(nobody, t)
    assert tracker.update(person, 5.0)[0] != first


@pytest.mark.parametrize("time_s", [0.5, float("nan"), INF])
def test_time_runs_forward(time_s):
    tracker = Tracker()
    tracker.update(np.array([box(1, 2)]), 1.0)
    with pytest.raises(InputError, match="in order"):
        tracker.update(np.array([box(1, 2)]), time_s)


@given(
    arrays(float, (3, 5, 2), elements=st.floats(0, 500)),
    st.lists(st.floats(0, 5), min_size=3, max_size=3).map(sorted),
)
def test_a_frame_never_has_a_track_twice(places, times):
    tracker = Tracker()
    for feet, t in zip(places, times, strict=True):
        labels = tracker.update(np.array([box(*f) for f in feet]), t)
        assert len(set(labels)) == 5
        assert labels.min() >= 0


def test_only_pairs_without_rivals_are_clear():
    pairs, doubtful = clear_matches(np.array([[1.0, INF], [INF, 2.0]]))
    assert pairs == [(0, 0), (1, 1)]
    assert doubtful.tolist() == [False, False]
    # Two tracks claim box 0 about equally; track 2 has box 1 for itself.
    pairs, doubtful = clear_matches(np.array([[1.0, INF], [3.0, INF], [INF, 2.0]]))
    assert pairs == [(2, 1)]
    assert doubtful.tolist() == [True, True, False]
    pairs, doubtful = clear_matches(np.full((2, 2), INF))
    assert pairs == []
    assert not doubtful.any()


def test_histograms_tell_clothes_apart_and_forgive_the_light():
    image = np.zeros((200, 300, 3), np.uint8)
    image[:, :100], image[:, 100:200], image[:, 200:] = (30, 30, 180), (180, 40, 30), (34, 34, 190)
    red, blue, lighter, outside = colour_histograms(
        image, np.array([[10.0, 20, 60, 150], [110, 20, 160, 150], [210, 20, 260, 150],
                         [400, 20, 450, 150]])
    )  # fmt: skip
    for row in (red, blue, lighter, outside):
        assert row.sum() == pytest.approx(1)

    def overlap(a, b):
        return np.sqrt(a * b).sum()

    assert overlap(red, lighter) > 0.85
    assert overlap(red, blue) < 0.5


@pytest.mark.parametrize(
    ("step", "least_pure", "least_complete"),
    [(1, 0.96, 0.75), (4, 0.97, 0.4), (8, 0.98, 0.3), (16, 0.98, 0.15)],
)
def test_pets_by_position_alone(pets_truth, step, least_pure, least_complete):
    tracker, tracks, people = Tracker(), [], []
    for frame in sorted(pets_truth)[::step]:
        boxes, ids = pets_truth[frame]
        tracks += [*tracker.update(boxes, frame / 10)]
        people += [*ids]
    assert purity(tracks, people) >= least_pure
    assert completeness(tracks, people) >= least_complete


@pytest.mark.parametrize(
    ("stride", "least_pure", "least_complete"), [(1, 0.98, 0.65), (2, 0.96, 0.5)]
)
def test_pets_with_colours(pets_frames, pets_truth, stride, least_pure, least_complete):
    tracker, tracks, people = Tracker(), [], []
    for frame in pets_frames[::stride]:
        boxes, ids = pets_truth[frame.index]
        tracks += [*tracker.update(boxes, frame.time_s, colour_histograms(frame.image_bgr, boxes))]
        people += [*ids]
    assert purity(tracks, people) >= least_pure
    assert completeness(tracks, people) >= least_complete
