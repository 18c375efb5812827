"""Nobody is there, and any of several activities: on stages in which it is known."""

from dataclasses import replace

import numpy as np
import pytest
from acting import SIZE, STEP_S, stage, stay, track, walk

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.searching.activities._absence import IN_VIEW, LOST
from scene4d.searching.activities.course import course_of
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.activities.search import find
from scene4d.searching.predicates.stage import Stage

YARD = np.array([[0.0, 0.0], [6.0, 0.0], [6.0, 6.0], [0.0, 6.0]])
CROSSING = np.vstack([stay((-9, 3), 10), walk((-9, 3), (15, 3)), stay((15, 3), 10)])
WATCHED = np.array([[0.0, 60.0, 0.0, 1800.0]])


def nobody(*terms: Term, least_s=2.0, classes=("person",), most_s=np.inf) -> Activity:
    inside = Term("inside", ("nobody",), {"zone": "yard"})
    phase = Phase("empty", terms or (inside,), least_s, most_s)
    return Activity("nobody is there", (Role("nobody", classes, absent=True),), (phase,))


def seen(*tracks, watched=WATCHED, **more) -> Stage:
    return stage(*tracks, zones={"yard": YARD}, watched=watched, **more)


def spans(stage, activity):
    found = sorted(find(stage, activity), key=lambda event: event.begin_s)
    return [(event.begin_s, event.end_s) for event in found]


def test_it_is_empty_before_and_after_somebody_crosses_it():
    here = seen(track(1, CROSSING))
    into, out = 10 + 9 / 1.4, 10 + 15 / 1.4
    (first, second) = spans(here, nobody())
    assert first == pytest.approx((0.0, into), abs=0.5)
    assert second == pytest.approx((out, 60.0), abs=0.5)
    best = find(here, nobody())[0]
    assert best.roles == {}
    assert best.score == pytest.approx(np.prod(list(best.why.values())))
    assert 0.95 < best.score <= 1
    assert best.probability is None
    course = course_of(here, nobody(), best)
    assert all(0 <= values.min() <= values.max() <= 1 for values in course.values.values())


def test_other_classes_do_not_count_and_how_long_is_asked_for():
    here = seen(track(1, CROSSING))
    assert spans(here, nobody(classes=("car",))) == [pytest.approx((0.0, 60.0), abs=0.5)]
    assert len(spans(here, nobody(least_s=20.0))) == 1
    assert len(spans(here, nobody(most_s=20.0))) == 1
    assert spans(here, nobody(least_s=50.0)) == []
    standing = nobody(
        Term("inside", ("nobody",), {"zone": "yard"}), Term("stationary", ("nobody",))
    )
    assert spans(here, standing) == [pytest.approx((0.0, 60.0), abs=0.5)]


def test_gaps_in_the_footage_are_not_emptiness():
    watched = np.array([[0.0, 5.0, 0.0, 150.0], [40.0, 60.0, 1200.0, 1800.0]])
    here = seen(track(1, CROSSING), watched=watched)
    assert spans(here, nobody()) == [
        pytest.approx((0.0, 5.0), abs=0.3),
        pytest.approx((40.0, 60.0), abs=0.3),
    ]
    assert here.frame_at(50.0) == 1500
    with pytest.raises(InputError, match="when the camera was watched is not known"):
        find(seen(track(1, CROSSING), watched=None), nobody())


def test_a_scene_without_anybody_is_empty_while_it_is_watched():
    none = track(1, stay((0, 0), 1)).select(np.zeros(5, bool))
    empty = Stage(Tracks.concatenate([none]), SIZE, STEP_S, zones={"yard": YARD}, watched=WATCHED)
    assert spans(empty, nobody()) == [(0.0, pytest.approx(60.0))]


def test_who_is_lost_within_may_still_be_there_and_what_is_not_seen_may_be_full():
    lost = seen(track(1, walk((-9, 3), (3, 3))))
    first, after = sorted(find(lost, nobody()), key=lambda event: event.begin_s)
    assert first.why[LOST] == 1.0
    assert after.why[LOST] == 0.5
    assert after.score == pytest.approx(0.5, abs=0.05)
    assert after.why[IN_VIEW] == 1.0
    # Ground is in the picture from 2 m * 300 / 540 on, and up to 960 / 300 to the right of ahead.
    camera = Camera.from_pose(
        image_size=SIZE, focal_px=300.0, tilt_rad=0.0, roll_rad=0.0, height_m=2.0
    )
    share = find(replace(lost, camera=camera), nobody())[0].why[IN_VIEW]
    y = 2.0 * 300 / 540
    corner = 6 * (1.875 - y) - 1.6 * (1.875**2 - y**2)
    assert share == pytest.approx((36 - 6 * y - corner) / 36, abs=0.02)


def test_positions_that_are_not_sure_make_it_less_sure():
    beside = [track(1, stay((-1.0, 3), 60), sigma_m=sigma) for sigma in (0.1, 1.0)]
    sure, unsure = (find(seen(one), nobody())[0].score for one in beside)
    assert sure > 0.99
    assert 0.7 < unsure < 0.95


def either(*some: Activity) -> Activity:
    roles = {role.name: role for one in some for role in one.roles}
    return Activity("either", tuple(roles.values()), (), alternatives=some)


def state(name: str, predicate: str, **parameters) -> Activity:
    term = Term(predicate, ("person",), parameters)
    return Activity(name, (Role("person", ("person",)),), (Phase(name, (term,), 1.0),))


def test_each_occurrence_is_told_with_what_it_was_and_once():
    moves, walks = state("moves", "moving"), state("inside", "inside", zone="yard")
    here = seen(track(1, CROSSING), track(2, stay((3, 5), 40)))
    found = find(here, either(moves, walks))
    alone = {one.name: find(here, one) for one in (moves, walks)}
    told = {(event.activity, event.roles["person"]): event for event in found}
    # Track 1 moves and is inside meanwhile: one event; track 2 only stands inside.
    assert sorted(number for _, number in told) == [1, 2]
    assert told["inside", 2].also == ()
    best = next(event for event in found if event.roles["person"] == 1)
    assert {best.activity, *best.also} == {"moves", "inside"}
    assert best.score == max(e.score for es in alone.values() for e in es if e.roles["person"] == 1)
    assert [e.score for e in found] == sorted((e.score for e in found), reverse=True)
    absent = replace(nobody(), name="nobody")
    assert {e.activity for e in find(here, either(moves, absent))} == {"moves", "nobody"}


def test_nobody_stands_alone():
    activity = nobody()
    with pytest.raises(InputError, match="stands alone"):
        find(
            seen(track(1, CROSSING)),
            replace(activity, phases=(*activity.phases, Phase("more", activity.terms))),
        )
