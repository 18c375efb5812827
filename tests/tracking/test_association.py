"""Identities on the ground: synthetic streets whose truth is known."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.tracking._association import MEMORY_S, GroundTracker, _assigned

SIZE = (1000, 600)
SIGMA = 0.12


def frame_of(xy, kinds="person", size=None, known=None, colour=None):
    """Detections of one moment, seen from straight above at 20 px per metre."""
    xy = np.asarray(xy, float).reshape(-1, 2)
    n = len(xy)
    kinds = np.full(n, kinds) if isinstance(kinds, str) else np.asarray(kinds)
    half = np.where(kinds == "person", 20.0, 50.0) if size is None else np.asarray(size, float)
    foot = 20 * xy
    box = np.column_stack(
        [foot[:, 0] - half / 2, foot[:, 1] - 2 * half, foot[:, 0] + half / 2, foot[:, 1]]
    )
    found = Detections.from_boxes(SIZE, np.zeros(n), box, class_name=kinds)
    located = Located.nowhere(n)
    there = np.ones(n, bool) if known is None else np.asarray(known)
    located.xy_m[there] = xy[there]
    located.covariance_m2[there] = np.eye(2) * SIGMA**2
    return found, located, colour


def follow(moments):
    """Numbers of every moment ``(time, (detections, located, colour))``."""
    tracker = GroundTracker()
    return [tracker.update(t, *frame) for t, frame in moments]


def noisy(rng, xy):
    return np.asarray(xy, float) + rng.normal(0, SIGMA, (len(xy), 2))


def crossing(t):
    """Two people who walk through one another's paths, 0.7 m apart when they meet."""
    return np.array([[10 + 1.3 * t, 15.0], [30 - 1.2 * t, 15.7]])


def test_walkers_who_meet_keep_their_numbers():
    rng = np.random.default_rng(0)
    for _ in range(5):
        labels = follow((t, frame_of(noisy(rng, crossing(t)))) for t in np.arange(0, 16, 0.1))
        assert np.unique(labels, axis=0).tolist() == [[0, 1]]


def test_missed_sightings_false_alarms_and_an_irregular_clock():
    rng = np.random.default_rng(1)
    walkers = [set(), set()]
    tracker = GroundTracker()
    for t in np.cumsum(rng.uniform(0.03, 0.3, 90)):
        seen = np.flatnonzero(rng.random(2) > 0.15)
        alarms = rng.uniform([5, 5], [45, 25], (int(rng.random() < 0.2), 2))
        xy = np.concatenate([noisy(rng, crossing(t))[seen], alarms])
        label = tracker.update(t, *frame_of(xy))
        assert len(set(label.tolist())) == len(label)
        for who, number in zip(seen, label, strict=False):
            walkers[who].add(int(number))
    assert [len(numbers) for numbers in walkers] == [1, 1]
    assert not walkers[0] & walkers[1]


def test_a_walker_hidden_for_a_while_keeps_the_number_and_not_for_ever():
    def labels(hidden_s):
        times = np.concatenate([np.arange(0, 4, 0.1), np.arange(4 + hidden_s, 8, 0.1)])
        return follow((t, frame_of([[10 + 1.3 * t, 15.0]])) for t in times)

    assert labels(1.5)[-1] == labels(1.5)[0]
    assert labels(3.5)[-1] != labels(3.5)[0]


def test_who_comes_in_where_another_left_is_somebody_else():
    def left_and_entered(edge_m):
        out = [(t, frame_of([[edge_m - 1.3 * (2 - t), 15.0]])) for t in np.arange(0, 2, 0.1)]
        back = [(t, frame_of([[edge_m - 0.2, 15.0]])) for t in np.arange(2.8, 4, 0.1)]
        labels = follow(out + back)
        return labels[0] != labels[-1]

    assert left_and_entered(50.0)  # the picture's right border
    assert not left_and_entered(30.0)


def test_rows_without_a_ground_point_are_told_by_the_image():
    times = np.arange(0, 16, 0.1)
    blind = [
        (t, frame_of(crossing(t) + np.array([[0, -3], [0, 3]]), known=[False, t > 5]))
        for t in times
    ]
    assert np.unique(follow(blind), axis=0).tolist() == [[0, 1]]


def test_one_without_a_ground_point_for_a_moment_keeps_the_number():
    times = np.arange(0, 4, 0.1)
    seen = [(t, frame_of([[10 + t, 15.0]], known=[not 2 < t < 2.6])) for t in times]
    assert np.unique(follow(seen)).tolist() == [0]


def test_two_without_ground_points_pass_each_other_unseen():
    def xy(t):
        return [[20 - 1.3 * (t - 2), 15.0], [20 + 1.3 * (t - 2), 15.0]]

    times = [*np.arange(0, 1.5, 0.1), *np.arange(2.5, 4, 0.1)]
    labels = follow((t, frame_of(xy(t), known=[False, False])) for t in times)
    # They start left to right, and the numbers follow the image.
    assert (np.array(labels) == labels[0]).all()


def test_who_has_been_hidden_does_not_take_what_is_near_another():
    """A wide prediction is near to everything; the likelihood counts its width."""

    def both(t):
        return frame_of([[20.0, 15.0], [21.5, 15.0]][: 2 if t < 1 else 1])

    moments = [(t, both(t)) for t in np.arange(0, 3, 0.1)]
    labels = follow([*moments, (3.0, frame_of([[20.7, 15.0]]))])
    assert labels[-1][0] == labels[0][0]


def test_who_was_hidden_for_less_comes_back_first():
    def seen(t):
        there = [[20.0, 15.0]] if t < 2.1 else []
        return frame_of([*there, *([[21.0, 15.0]] if t < 3.8 else [])])

    moments = [(t, seen(t)) for t in np.arange(0, 5, 0.1)]
    labels = follow([*moments, (5.0, frame_of([[20.45, 15.0]]))])
    assert labels[-1][0] == labels[0][1]


def test_size_tells_two_apart_and_keeps_up_with_who_comes_nearer():
    def both(t):
        return frame_of([[20, 15], [21, 15]], size=[8.0 + 8.0 * t, 12.0])

    after = frame_of([[20.5, 15.1], [20.5, 14.9]], size=[12.0, 32.0])
    labels = follow([*((t, both(t)) for t in np.arange(0, 3, 0.1)), (4.4, after)])
    assert labels[-1].tolist() == labels[0][::-1].tolist()


def test_an_impossible_pair_does_not_break_up_a_good_one():
    cost = np.array([[-5.0, -1.0], [-3.0, np.inf]])
    assert [a.tolist() for a in _assigned(cost)] == [[0], [0]]


def test_people_are_never_vehicles_and_a_car_may_look_like_a_truck():
    kinds = ["car", "truck", "bus", "vehicle", "car", "person", "bicycle", "motorcycle"]
    labels = follow((0.1 * k, frame_of([[20, 15]], kind, [40])) for k, kind in enumerate(kinds))
    assert np.concatenate(labels).tolist() == [0, 0, 0, 0, 0, 1, 2, 2]


def test_a_parked_car_stays_one_track_through_minutes_of_passers_by():
    def last(kind, hidden_s):
        times = np.concatenate([np.arange(0, 4, 0.2), 4 + hidden_s + np.arange(0, 2, 0.2)])
        return int(follow((t, frame_of([[20, 15]], kind)) for t in times)[-1][0])

    assert last("car", 300.0) == 0
    assert last("car", 900.0) == 1
    assert last("person", 20.0) == 1


def test_a_vehicle_that_stops_and_starts_keeps_its_number_beside_another():
    rng = np.random.default_rng(2)
    speed = np.interp(np.arange(0, 40, 0.1), [0, 6, 10, 20, 24, 40], [4, 4, 0, 0, 3, 0])
    x = 5 + np.cumsum(speed * 0.1) / 2
    moments = [
        (0.1 * k, frame_of(noisy(rng, [[x[k], 15.0], [30.0, 19.0]]), "car"))
        for k in range(len(x))
        if rng.random() > 0.2
    ]
    assert np.unique(follow(moments), axis=0).tolist() == [[0, 1]]


def test_what_was_driving_is_not_waited_for_as_if_it_stood():
    times = np.append(np.arange(0, 4, 0.1), 60.0)
    labels = follow((t, frame_of([[10 + min(2 * t, 8.0), 15.0]], "car")) for t in times)
    assert labels[-1] != labels[0]


def test_colours_tell_two_apart_who_come_out_of_hiding():
    red, blue = np.eye(2)
    start = [(t, frame_of([[20, 15], [21, 15]], colour=np.array([red, blue]))) for t in (0.0, 0.1)]
    # Both have moved half a metre towards each other and beyond: position alone cannot tell.
    after = (1.5, frame_of([[20.5, 15.1], [20.5, 14.9]], colour=np.array([blue, red])))
    assert follow([*start, after])[-1].tolist() == [1, 0]
    unknown = (1.5, frame_of([[20.9, 15], [20.1, 15]], colour=np.full((2, 2), np.nan)))
    assert follow([*start, unknown])[-1].tolist() == [1, 0]


@settings(max_examples=30)
@given(st.integers(0, 2**32 - 1))
def test_the_order_of_the_rows_decides_nothing(seed):
    rng = np.random.default_rng(seed)
    plain, mixed = GroundTracker(), GroundTracker()
    people = rng.uniform([5, 5], [45, 25], (6, 2))
    for k in range(12):
        people = people + rng.normal(0, 0.3, people.shape)
        xy = people[rng.random(6) > 0.2]
        order = rng.permutation(len(xy))
        here = plain.update(0.2 * k, *frame_of(xy))
        there = mixed.update(0.2 * k, *frame_of(xy[order]))
        assert here[order].tolist() == there.tolist()


def test_state_is_bounded_by_what_is_in_view():
    rng = np.random.default_rng(3)
    tracker = GroundTracker()
    most = 0
    for k in range(600):
        tracker.update(0.1 * k, *frame_of(rng.uniform([5, 5], [45, 25], (3, 2))))
        most = max(most, len(tracker))
    assert most < 3 * 10 * MEMORY_S + 3
    tracker.update(100.0, *frame_of([[20, 15]]))
    assert len(tracker) == 1


def test_empty_frames_pass():
    tracker = GroundTracker()
    nobody = frame_of(np.empty((0, 2)))
    assert tracker.update(0.0, *nobody).shape == (0,)
    assert tracker.update(0.1, *frame_of([[20, 15]])).tolist() == [0]
    assert tracker.update(0.2, *nobody).shape == (0,)
    assert tracker.update(0.3, *frame_of([[20, 15]])).tolist() == [0]


def test_bad_input_is_named():
    found, located, _ = frame_of([[20, 15]])
    tracker = GroundTracker()
    tracker.update(1.0, found, located)
    for time_s in (1.0, 0.5, float("nan")):
        with pytest.raises(InputError, match="give the frames in order"):
            tracker.update(time_s, found, located)
    with pytest.raises(InputError, match="1 detections, 0 located rows"):
        tracker.update(2.0, found, Located.nowhere(0))
    with pytest.raises(InputError, match="found class 'dog'"):
        tracker.update(2.0, *frame_of([[20, 15]], "dog"))
    with pytest.raises(InputError, match="box of row 0"):
        tracker.update(2.0, *frame_of([[20, np.nan]]))
    with pytest.raises(InputError, match="appearance of 2 columns after 1"):
        tracker.update(2.0, found, located, np.full((1, 2), 0.5))
    # What was refused has left no trace.
    assert tracker.update(2.0, found, located).tolist() == [0]
