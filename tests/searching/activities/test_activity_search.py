"""Scenes made by hand, of which it is known what happens in them."""

import gc
import weakref
from dataclasses import replace

import numpy as np
import pytest
from acting import STEP_S, fakes, stage, stay, track, walk  # noqa: F401
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.searching.activities import _casting as casting
from scene4d.searching.activities._events import WITHOUT_BREAK, Event, Found, one_per_occurrence
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Activity, Phase, Relation, Role, Term
from scene4d.searching.activities.identity import unite_tracks
from scene4d.searching.activities.search import find, judge
from scene4d.searching.predicates import _meeting as meeting

CATALOGUE = load_catalogue()
PERSON = Role("person", ("person",))
OTHER = Role("other", ("person",))
CAR = Role("car", ("car", "truck"))
PARK_S = 60.0


def _names(events):
    return [dict(event.roles) for event in events]


def _boxes(xy, width, height, below=0.0):
    """So large, on the feet that `acting.track` puts into the picture."""
    middle = np.array([960.0, 540.0 + below]) + 10 * np.atleast_2d(xy) * [1, -1]
    return np.hstack([middle - np.array([width / 2, height]), middle + np.array([width / 2, 0])])


def _parked(number=1, at=(0, 20), seconds=PARK_S):
    path = stay(at, seconds)
    return track(number, path, kind="car", box=_boxes(path, 160.0, 80.0, below=4.0))


def _entering(number=2, begin_s=10.0, car=(0.0, 20.0), start=(-12.0, 14.0), bends=True):
    """Somebody walks up to a car, stands there, bends into it within 0.6 s, and is gone."""
    car = np.asarray(car, float)
    door = car - np.array([1.0, 0.6])
    path = np.vstack([walk(start, door), stay(door, 1.0)])
    person = track(number, path, begin_s=begin_s, box=_boxes(path, 25.0, 60.0))
    return _bent(person) if bends else person


def _bent(one: Tracks) -> Tracks:
    """In the end seen less and less tall, on the same feet."""
    box = one.box_xyxy.copy()
    share = np.interp(np.arange(len(box)), [len(box) - 4, len(box) - 1], [1.0, 0.6])
    box[:, 1] = box[:, 3] - share * (box[:, 3] - box[:, 1])
    return replace(one, box_xyxy=box)


def _turned(one: Tracks, angle: float, by=(0.0, 0.0)) -> Tracks:
    """The same, seen from elsewhere: turned about the origin and moved on the ground."""
    turn = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    return replace(
        one,
        xy_m=one.xy_m @ turn.T + np.asarray(by),
        velocity_mps=one.velocity_mps @ turn.T,
        heading_rad=one.heading_rad + angle,
    )


def test_somebody_walks_to_a_parked_car_and_is_gone():
    person = _entering()
    events = find(stage(_parked(), person), CATALOGUE["person_enters_vehicle"])
    assert _names(events) == [{"person": 2, "vehicle": 1}]
    event = events[0]
    assert event.score > 0.5
    # Getting in goes on for 1.5 s after he was last seen.
    assert event.end_s == pytest.approx(person.time_s[-1] + 1.5)
    assert person.time_s[0] < event.begin_s < event.end_s - 1
    assert np.prod(list(event.why.values())) == pytest.approx(event.score)
    assert event.mean_score == pytest.approx(event.score ** (1 / len(event.why)))
    assert find(stage(_parked(), person), CATALOGUE["person_exits_vehicle"], min_score=0.2) == []


def test_backwards_in_time_it_is_getting_out():
    person = _entering(begin_s=0.0)
    out = replace(
        person,
        xy_m=person.xy_m[::-1].copy(),
        velocity_mps=-person.velocity_mps[::-1].copy(),
        box_xyxy=person.box_xyxy[::-1].copy(),
        time_s=person.time_s + 20,
    )
    world = stage(_parked(), out)
    assert _names(find(world, CATALOGUE["person_exits_vehicle"])) == [{"person": 2, "vehicle": 1}]
    assert find(world, CATALOGUE["person_enters_vehicle"], min_score=0.2) == []


def test_who_vanishes_upright_hardly_got_in():
    """One who is lost beside a car: as near, as sudden, and within its outline."""
    upright = _entering(bends=False)
    assert find(stage(_parked(), upright), CATALOGUE["person_enters_vehicle"], min_score=0.2) == []


def test_who_vanishes_outside_its_outline_did_not_get_in():
    """As near on the ground, and bent, but seen beside the car to the last."""
    aside = _entering()
    aside = replace(aside, box_xyxy=aside.box_xyxy - np.array([100.0, 0.0, 100.0, 0.0]))
    assert find(stage(_parked(), aside), CATALOGUE["person_enters_vehicle"]) == []


def test_walking_by_is_neither():
    world = stage(_parked(), track(2, walk([-15, 18.5], [15, 18.5]), begin_s=10))
    for name in ("person_enters_vehicle", "person_exits_vehicle"):
        assert find(world, CATALOGUE[name]) == []


def test_vanishing_elsewhere_is_no_entering():
    person = _entering(car=(30.0, 20.0), start=(15.0, 14.0))
    assert find(stage(_parked(), person), CATALOGUE["person_enters_vehicle"]) == []


def test_two_who_get_in_are_two_events_and_two_cars_beside_one_another_are_one():
    cars = [_parked(1), _parked(5, (2.4, 20))]
    people = [_entering(2), _entering(3, begin_s=10.4, start=(-12.0, 25.0))]
    events = find(stage(*cars, *people), CATALOGUE["person_enters_vehicle"])
    assert [event.roles["person"] for event in events].count(2) == 1
    assert [event.roles["person"] for event in events].count(3) == 1
    # Each of the cars, alone, is one that both got into.
    for car in cars:
        alone = find(stage(car, *people), CATALOGUE["person_enters_vehicle"])
        assert sorted(event.roles["person"] for event in alone) == [2, 3]


def _drive(number, speeds):
    """Along +X with these speeds, a step each."""
    speeds = np.asarray(speeds, float)
    xy = np.column_stack([np.cumsum(speeds) * STEP_S, np.full(len(speeds), 30.0)])
    velocity = np.column_stack([speeds, np.zeros(len(speeds))])
    return track(number, xy, kind="car", velocity=velocity)


def test_stopping_and_starting():
    slow = np.linspace(6, 0, 15)
    stops = _drive(1, [*[6] * 20, *slow, *[0] * 20])
    starts = _drive(1, [*[0] * 20, *slow[::-1], *[6] * 20])
    passes = _drive(1, [6] * 50)
    for driven, expected in ((stops, "vehicle_stops"), (starts, "vehicle_starts"), (passes, None)):
        for name in ("vehicle_stops", "vehicle_starts"):
            events = find(stage(driven), CATALOGUE[name])
            assert len(events) == (name == expected)


def _arc(total_rad, seconds=6.0, speed=5.0):
    n = round(seconds / STEP_S)
    angle = np.concatenate([np.zeros(15), np.linspace(0, total_rad, n), np.full(15, total_rad)])
    velocity = speed * np.column_stack([np.cos(angle), np.sin(angle)])
    return track(1, np.cumsum(velocity * STEP_S, axis=0), kind="car", velocity=velocity)


@pytest.mark.parametrize(
    ("turn", "expected"),
    [
        (np.pi / 2, "vehicle_turns_left"),
        (-np.pi / 2, "vehicle_turns_right"),
        (np.pi, "vehicle_makes_u_turn"),
        (0.0, None),
    ],
)
def test_turning(turn, expected):
    world = stage(_arc(turn))
    best = {
        name: max((event.score for event in find(world, CATALOGUE[name])), default=0.0)
        for name in ("vehicle_turns_left", "vehicle_turns_right", "vehicle_makes_u_turn")
    }
    if expected is None:
        assert max(best.values()) < 0.1
    else:
        assert max(best, key=best.__getitem__) == expected
        assert best[expected] > 0.7


def test_two_people_meet_once_whoever_is_first():
    one = track(4, np.vstack([walk([-12, 10], [-0.6, 10]), stay([-0.6, 10], 10)]))
    other = track(9, np.vstack([walk([12, 10], [0.6, 10]), stay([0.6, 10], 10)]))
    events = find(stage(one, other), CATALOGUE["people_meet"])
    assert len(events) == 1
    assert set(events[0].roles.values()) == {4, 9}
    past = track(9, walk([12, 10], [-12, 10]))
    assert find(stage(one, past), CATALOGUE["people_meet"], min_score=0.2) == []


def test_following_has_a_direction():
    first = track(1, walk([0, 10], [30, 10]))
    second = track(2, walk([-3, 10], [27, 10]))
    events = find(stage(first, second), CATALOGUE["person_follows_person"])
    assert _names(events) == [{"person": 2, "other": 1}]


def test_a_crowd_forms_once():
    angle = np.linspace(0, 2 * np.pi, 7)[:-1]
    people = [
        track(
            n,
            np.vstack([stay(start, 3), walk(start, place), stay(place, 8)]),
        )
        for n, (start, place) in enumerate(
            zip(
                20 * np.column_stack([np.cos(angle), np.sin(angle)]),
                np.column_stack([np.cos(angle), np.sin(angle)]),
                strict=True,
            )
        )
    ]
    assert len(find(stage(*people), CATALOGUE["crowd_forms"])) == 1
    assert find(stage(*people[:4]), CATALOGUE["crowd_forms"]) == []


def test_standing_beside_a_parked_car_for_long_enough():
    for seconds, expected in ((20.0, 1), (5.0, 0)):
        person = track(2, stay([1.5, 20], seconds), begin_s=5.0)
        events = find(stage(_parked(), person), CATALOGUE["person_stands_near_parked_vehicle"])
        assert len(events) == expected
    assert events == []


@given(
    st.floats(0, 2 * np.pi),
    st.tuples(st.floats(-500, 500), st.floats(-500, 500)),
    st.integers(-500, 100_000),
)
@settings(deadline=None, max_examples=15)
def test_neither_place_nor_direction_nor_time_of_day_matters(angle, by, ticks):
    tracks = [_parked(), _entering(), track(7, walk([-15, 18], [15, 18]))]
    before = find(stage(*tracks), CATALOGUE["person_enters_vehicle"], min_score=0.01)
    moved = [replace(_turned(one, angle, by), time_s=one.time_s + ticks * STEP_S) for one in tracks]
    after = find(stage(*moved), CATALOGUE["person_enters_vehicle"], min_score=0.01)
    assert _names(after) == _names(before)
    for one, other in zip(before, after, strict=True):
        assert other.score == pytest.approx(one.score, abs=1e-6)
        assert other.begin_s - ticks * STEP_S == pytest.approx(one.begin_s, abs=1e-3)


def test_what_is_added_far_away_changes_nothing():
    tracks = [_parked(), _entering()]
    far = [
        track(10 + n, stay([500.0 + n, 500], 30), kind="car" if n % 2 else "person")
        for n in range(6)
    ]
    alone = find(stage(*tracks), CATALOGUE["person_enters_vehicle"])
    assert find(stage(*tracks, *far), CATALOGUE["person_enters_vehicle"]) == alone


def test_nothing_to_find():
    activity = CATALOGUE["person_enters_vehicle"]
    everybody = stage(_parked(), _entering())
    nobody = replace(everybody, tracks=everybody.tracks.select(np.zeros(0, int)))
    for name, one in CATALOGUE.items():
        if "zone" not in name:
            assert find(nobody, one) == []
    assert find(stage(_entering()), activity) == []
    assert find(stage(_parked()), activity) == []
    short = stage(track(1, [[0.0, 0.0]]), track(2, [[0.0, 0.0]], kind="car"))
    assert find(short, activity) == []


def test_places_must_be_there_and_be_zones():
    activity = CATALOGUE["person_leaves_through_zone"]
    world = stage(_entering())
    with pytest.raises(InputError, match="no zone 'door'"):
        find(world, activity)
    square = np.array([[-4.0, 15], [2, 15], [2, 24], [-4, 24]])
    with pytest.raises(InputError, match="did you mean 'doors'"):
        find(replace(world, zones={"doors": square}), activity)
    with pytest.raises(InputError, match="crosses itself"):
        find(replace(world, zones={"door": square[[0, 2, 1, 3]]}), activity)
    late = track(5, stay([50, 50], 60), kind="car")
    world = stage(_entering(), late, zones={"door": square})
    assert _names(find(world, activity)) == [{"person": 2}]


def _found(score, begin_s, end_s, doer, partner=99, place=(0.0, 0.0)):
    event = Event("x", score, score, float(begin_s), float(end_s), {"a": doer, "b": partner}, {})
    return Found(event, doer, (partner,), np.array(place))


def test_one_of_several_events_that_overlap():
    best, inside, after = _found(0.9, 2, 6, 1), _found(0.8, 5, 9, 1, 98), _found(0.7, 6.5, 9, 1)
    other = _found(0.6, 3, 5, 2)
    found = [inside, other, after, best]
    kept = [one.score for one in one_per_occurrence(found)]
    assert kept == [0.9, 0.7, 0.6]
    # Where the roles may be swapped, whoever takes part is busy.
    assert [one.score for one in one_per_occurrence(found, symmetric=True)] == [0.9, 0.7]
    # In a crowd, whoever is near does it together.
    far = _found(0.5, 3, 5, 3, place=(30.0, 0.0))
    kept = [one.score for one in one_per_occurrence([*found, far], crowd_m=6.0)]
    assert kept == [0.9, 0.7, 0.5]


# From here on with predicates whose values are written on the tracks.


def _term(predicate, *roles, negated=False, **parameters):
    return Term(predicate, roles, parameters, negated)


LIT = Activity("lit", (PERSON,), (Phase("on", (_term("lit", "person"),), 1.0),))


def test_every_occurrence_is_an_event_with_its_time():
    p = np.zeros(60)
    p[10:20], p[40:50] = 0.9, 0.8
    events = find(stage(track(1, stay([0, 0], 12), lit=p)), LIT)
    assert [event.score for event in events] == pytest.approx([0.9, 0.8])
    assert [(e.begin_s, e.end_s) for e in events] == [
        pytest.approx((2.0, 3.8)),
        pytest.approx((8.0, 9.8)),
    ]
    assert events[0].why == {"on: lit(person)": pytest.approx(0.9)}
    assert find(stage(track(1, stay([0, 0], 12), lit=p)), LIT, min_score=0.85)[1:] == []


def test_ties_are_ordered_by_time_and_then_by_track():
    p = np.full(10, 0.7)
    tracks = [
        track(n, stay([0, 0], 2), lit=p, begin_s=begin)
        for n, begin in ((3, 4.0), (1, 4.0), (2, 0.0))
    ]
    events = find(stage(*tracks), LIT)
    assert [event.roles["person"] for event in events] == [2, 1, 3]


def test_a_negated_term_is_the_opposite():
    p = np.concatenate([np.full(20, 0.9), np.full(20, 0.2)])
    off = replace(LIT, phases=(Phase("off", (_term("lit", "person", negated=True),), 1.0),))
    events = find(stage(track(1, stay([0, 0], 8), lit=p)), off)
    assert events[0].score == pytest.approx(0.8)
    assert events[0].begin_s == pytest.approx(4.0)


def test_what_cannot_be_judged_counts_one_half_and_never_alone():
    both = replace(
        LIT, phases=(Phase("on", (_term("lit", "person"), _term("unknown", "person")), 1.0),)
    )
    world = stage(track(1, stay([0, 0], 4), lit=np.full(20, 0.8)))
    event = find(world, both)[0]
    assert event.score == pytest.approx(0.4)
    assert np.isnan(event.why["on: unknown(person)"])
    assert (event.begin_s, event.end_s) == pytest.approx((0.0, 3.8))
    alone = replace(LIT, phases=(Phase("on", (_term("unknown", "person"),), 1.0),))
    assert find(world, alone, min_score=0.02) == []


def test_missing_positions_do_no_harm():
    xy = stay([0, 0], 12)
    xy[20:23] = np.nan
    near = Activity("near", (PERSON, CAR), (Phase("p", (_term("by", "person", "car"),), 2.0),))
    world = stage(track(1, xy), track(2, stay([1, 0], 12), kind="car"))
    events = find(world, near)
    assert len(events) == 1
    assert (events[0].begin_s, events[0].end_s) == pytest.approx((0.0, 11.8))
    nowhere = stage(track(1, xy * np.nan), track(2, stay([1, 0], 12), kind="car"))
    assert find(nowhere, near) == []


def test_a_moment_earlier():
    """Somebody stands where a car stood twenty seconds before, not where it stands now."""
    then = Activity(
        "then",
        (PERSON, CAR),
        (Phase("p", (_term("by", "person", "car", lag_s=20.0, tau_m=2.0),), 1.0),),
    )
    car = track(2, np.vstack([stay([0, 0], 10), walk([0, 0], [60, 0], speed=10)]), kind="car")
    person = track(1, stay([0.5, 0], 4), begin_s=22.0)
    events = find(stage(person, car), then)
    assert _names(events) == [{"person": 1, "car": 2}]
    assert (events[0].begin_s, events[0].end_s) == pytest.approx((22.0, 25.8))
    soon = track(1, stay([0.5, 0], 4), begin_s=10.0)
    assert find(stage(soon, car), then) == []


def test_where_a_car_was_parked_at_any_time_before():
    parked = Activity(
        "parked",
        (PERSON, CAR),
        (
            Phase(
                "p",
                (
                    _term("near", "person", "car", lag_s=np.inf, tau_m=2.0),
                    _term("stationary", "car", lag_s=np.inf),
                ),
                1.0,
            ),
        ),
    )
    left = track(2, np.vstack([stay([0, 0], 10), walk([0, 0], [60, 0], speed=10)]), kind="car")
    person = track(1, stay([0.5, 0], 4), begin_s=1000.0)
    where_it_drove = track(3, stay([40, 0], 4), begin_s=1000.0)
    events = find(stage(person, left, where_it_drove), parked)
    assert _names(events) == [{"person": 1, "car": 2}]
    before = track(2, stay([0, 0], 4), begin_s=2000.0, kind="car")
    assert find(stage(person, before), parked) == []


def test_lags_that_ask_nothing():
    alone = replace(LIT, phases=(Phase("p", (_term("lit", "person", lag_s=5.0),), 1.0),))
    with pytest.raises(InputError, match="at least one must have none"):
        find(stage(track(1, stay([0, 0], 4))), alone)
    somewhere = Activity(
        "x",
        (PERSON, CAR),
        (Phase("p", (_term("lit", "person"), _term("lit", "car", lag_s=np.inf)), 1.0),),
    )
    world = stage(track(1, stay([0, 0], 4)), track(2, stay([0, 0], 4), kind="car"))
    with pytest.raises(InputError, match="at any earlier time"):
        find(world, somewhere)


def test_three_roles():
    third = Role("third", ("person",))
    activity = Activity(
        "three",
        (PERSON, CAR, third),
        (
            Phase(
                "p",
                (
                    _term("by", "person", "car"),
                    _term("by", "car", "third", tau_m=2.0),
                ),
                1.0,
            ),
        ),
    )
    world = stage(
        track(1, stay([3, 0], 4)),
        track(2, stay([1, 0], 4)),
        track(3, stay([0, 0], 4), kind="car"),
        track(4, stay([50, 0], 4)),
    )
    events = find(world, activity)
    assert _names(events) == [{"person": 1, "car": 3, "third": 2}]


def test_roles_that_nothing_binds_need_only_be_there():
    activity = Activity(
        "while",
        (PERSON, CAR),
        (Phase("p", (_term("lit", "person"), _term("lit", "car")), 1.0),),
    )
    car = track(2, stay([900, 0], 4), kind="car", begin_s=2.0)
    events = find(stage(track(1, stay([0, 0], 4)), car), activity)
    assert (events[0].begin_s, events[0].end_s) == pytest.approx((2.0, 3.8))


def test_relations_between_phases():
    activity = Activity(
        "inside",
        (PERSON, CAR),
        (
            Phase("long", (_term("by", "person", "car"), _term("lit", "car")), 1.0),
            Phase("short", (_term("lit", "person"),), 0.4),
        ),
        (Relation("short", "during", "long"),),
    )
    p = np.zeros(60)
    p[20:30] = 0.9
    world = stage(track(1, stay([0, 0], 12), lit=p), track(2, stay([1, 0], 12), kind="car"))
    events = find(world, activity)
    assert len(events) == 1
    assert events[0].score == pytest.approx(0.9)
    assert (events[0].begin_s, events[0].end_s) == pytest.approx((0.0, 11.8))
    before = replace(activity, relations=(Relation("short", "before", "long"),))
    assert find(world, before)[0].begin_s == pytest.approx(4.0)


def test_stretching_is_said_in_the_reasons():
    activity = Activity(
        "on off",
        (PERSON,),
        (
            Phase("on", (_term("lit", "person"),), 0.4),
            Phase("off", (_term("lit", "person", negated=True),), 0.4),
        ),
    )
    p = np.concatenate([np.full(5, 0.99), np.full(20, 0.4), np.full(5, 0.01)])
    event = find(stage(track(1, stay([0, 0], 6), lit=p)), activity)[0]
    assert np.prod(list(event.why.values())) == pytest.approx(event.score)
    assert (WITHOUT_BREAK in event.why) == (len(event.why) == 3)


@pytest.mark.parametrize("min_score", [-0.1, 1.1, np.nan])
def test_scores_that_cannot_be(min_score):
    with pytest.raises(InputError, match="min_score"):
        find(stage(_parked()), LIT, min_score=float(min_score))


def test_an_activity_that_is_wrong():
    wrong = replace(LIT, phases=(Phase("on", (_term("lti", "person"),)),))
    with pytest.raises(InputError, match="did you mean 'lit'"):
        find(stage(_parked()), wrong)


def test_a_low_threshold_finds_no_less():
    rng = np.random.default_rng(0)
    tracks = [track(n, stay([0, 0], 10), lit=rng.uniform(0, 1, 50)) for n in range(5)]
    strict = find(stage(*tracks), LIT, min_score=0.5)
    loose = find(stage(*tracks), LIT, min_score=0.1)
    assert loose[: len(strict)] == strict


# One object under two numbers.


def test_tracks_of_one_thing_are_united():
    whole = track(5, walk([0, 10], [14, 10]))
    n = len(whole)
    first, second = whole.select(np.arange(n // 2)), whole.select(np.arange(n // 3, n))
    again = replace(second, track=np.full(len(second), 9))
    other = track(7, walk([0, 14], [14, 14]))
    united = unite_tracks(stage(first, again, other))
    assert np.unique(united.tracks.track).tolist() == [5, 7]
    mine = united.tracks.select(united.tracks.track == 5)
    assert np.allclose(mine.time_s, whole.time_s)
    assert np.allclose(mine.xy_m, whole.xy_m)


def test_a_track_that_takes_up_another_is_the_same_and_another_kind_is_not():
    whole = track(5, stay([0, 10], 10))
    late = whole.select(np.arange(28, 50))
    early = whole.select(np.arange(25))
    assert len(unite_tracks(stage(early, replace(late, track=np.full(22, 6)))).first_row) == 1
    car = replace(late, track=np.full(22, 6), class_name=np.full(22, "car"))
    assert len(unite_tracks(stage(early, car)).first_row) == 2
    much_later = replace(late, track=np.full(22, 6), time_s=late.time_s + 30)
    assert len(unite_tracks(stage(early, much_later)).first_row) == 2


def test_uniting_asks_for_no_factors():
    asked = []

    def counting(xy_m):
        asked.append(len(xy_m))
        return np.zeros((len(xy_m), 2, 1))

    world = stage(track(3, stay([0, 10], 4)), track(8, stay([0, 10], 6)), camera_factor=counting)
    united = unite_tracks(world)
    assert len(united.tracks) == 30
    assert asked == []
    united.rows(np.array([5])).camera_factor  # noqa: B018
    assert asked == [1]
    nobody = replace(world, tracks=world.tracks.select(np.zeros(0, int)))
    assert len(unite_tracks(nobody).tracks) == 0


@pytest.mark.parametrize("name", ["person_enters_vehicle", "vehicle_stops"])
def test_how_many_were_judged_comes_with_the_events(name):
    """Two people at a car, and one far away; a truck too, which nobody is near."""
    truck = track(7, stay([90, 20], PARK_S), kind="truck")
    near = [_entering(2), _entering(3, begin_s=12.0, start=(-12.0, 25.0))]
    far = track(4, stay([40, 60], PARK_S))
    world = stage(_parked(), truck, far, *near)
    for least in (0.05, 1.0):
        judged = judge(world, CATALOGUE[name], min_score=least)
        assert judged.events == find(world, CATALOGUE[name], min_score=least)
        assert judged.casts == 2


@given(st.sampled_from([0.1, 0.3, 7.1, 0.0999999999, 4.2]))
@settings(deadline=None)
def test_when_a_clip_begins_makes_no_difference(begin_s):
    """Half a step late too, where moments lie between two ticks of a clock that begins at 0."""
    world = stage(_parked(), _entering())
    late = replace(world, tracks=replace(world.tracks, time_s=world.tracks.time_s + begin_s))
    for name in ("person_enters_vehicle", "vehicle_stops"):
        before, after = (find(one, CATALOGUE[name]) for one in (world, late))
        assert [(e.score, e.roles) for e in after] == [
            (pytest.approx(e.score), e.roles) for e in before
        ]
        for one, other in zip(before, after, strict=True):
            assert other.begin_s == pytest.approx(one.begin_s + begin_s)
            assert other.end_s == pytest.approx(one.end_s + begin_s)


# What is asked must not explode, and nothing must outlive it.


def test_nothing_keeps_a_stage_alive_after_it_was_searched():
    """Not even until the next collection: a month of footage is searched stage by stage."""
    tracks = [_parked(), _entering(), *(track(n, stay([n, 0], 4)) for n in range(5, 11))]
    gc.collect()
    gc.disable()
    try:
        for activity in CATALOGUE.values():
            if not any("zone" in term.parameters for term in activity.terms):
                world = stage(*tracks, camera_factor=lambda xy_m: np.zeros((len(xy_m), 2, 1)))
                held = weakref.ref(world)
                find(unite_tracks(world), activity)
                find(world, activity)
                del world
                assert held() is None, activity.name
    finally:
        gc.enable()


def _then(*roles):
    """Each of the roles is lit for a second, one after the other; nothing binds them."""
    phases = [Phase(name, (_term("lit", name),), 1.0, gap_s=20.0) for name in roles]
    return Activity("then", tuple(Role(name, ("person",)) for name in roles), tuple(phases))


def _lamps(count, lit_at):
    """People of whom these are lit for two seconds each, and the others never."""
    tracks = []
    for number in range(count):
        p = np.full(100, 0.01)
        if number in lit_at:
            p[lit_at[number] : lit_at[number] + 10] = 0.95
        tracks.append(track(number, stay([5.0 * number, 0], 20), lit=p))
    return stage(*tracks)


def test_roles_that_nothing_binds_are_cast_from_those_who_can_play_them():
    """Of 30 people 3 are ever lit: of 24,360 casts of three only their 6 are made."""
    world = _lamps(30, {4: 0, 17: 30, 21: 60})
    judged = judge(world, _then("a", "b", "c"), min_score=0.5)
    assert judged.casts == 6
    assert _names(judged.events) == [{"a": 4, "b": 17, "c": 21}]
    # A second lit moment of each is judged with the least score that is asked for, not with more.
    everybody = judge(world, _then("a", "b"), min_score=0.001)
    assert everybody.casts == 30 * 29


def test_too_many_casts_are_refused_before_they_are_made(monkeypatch):
    """19 people who are all lit, four times "then": 93,024 casts."""
    made = []
    original = casting.expand

    def counting(first, count):
        made.append(int(count.sum()))
        return original(first, count)

    monkeypatch.setattr(casting, "expand", counting)
    world = _lamps(19, {})
    lit = replace(world, tracks=replace(world.tracks, score=np.full(len(world.tracks), 0.9)))
    assert len(find(lit, _then("a", "b"))) > 0
    monkeypatch.setattr(meeting, "_MOST_ROWS", 2_500_000)
    with pytest.raises(InputError, match=r"at which 4 roles .* fewer roles, say which .* near"):
        find(lit, _then("a", "b", "c", "d"))
    assert max(made) * 3 <= 2_500_000


@given(st.integers(0, 10_000), st.sampled_from([1, 2]), st.booleans())
@settings(deadline=None, max_examples=20)
def test_no_event_is_lost_to_pruning(seed, people, bound):
    """A threshold keeps what a lower one finds at or above it, also just at it: a phase of one
    moment is as probable as its best, so that the score is the bound by which casts are dropped.
    """
    rng = np.random.default_rng(seed)
    world = stage(*(track(n, stay([n, 0], 3), lit=rng.uniform(0.1, 0.9, 15)) for n in range(4)))
    roles = ("a", "b")[:people]
    terms = (_term("by", "a", "b"),) if bound and people == 2 else ()
    activity = Activity(
        "x",
        tuple(Role(name, ("person",)) for name in roles),
        tuple(
            Phase(f"{role} {n}", (_term("lit", role, negated=n == 1), *terms), 0.0, STEP_S, 9.0)
            for role in roles
            for n in range(2)
        ),
    )

    def found(least):
        return {
            (tuple(e.roles.values()), e.begin_s, e.end_s): e.score
            for e in find(world, activity, min_score=least)
        }

    everything = found(0.001)
    for score in [*everything.values()][:5]:
        kept = {key for key, s in everything.items() if s >= score}
        assert kept <= set(found(score * (1 - 1e-12)))
