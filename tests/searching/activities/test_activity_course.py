"""Predicates of an event over time."""

import numpy as np
from acting import STEP_S, stage, stay, track, walk

from scene4d.searching.activities.course import Course, course_of
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.activities.search import find
from scene4d.searching.predicates import near_probability

ROLES = (Role("person", ("person",)), Role("car", ("car",)))
PASSES = Activity("passes", ROLES, (Phase("by", (Term("near", ("person", "car")),), min_s=1.0),))


def scene(others: int = 1):
    """Somebody walks past a parked car, and others do so ten metres off."""
    rows = [track(1, stay((0, 20), 40.0), kind="car")]
    for number in range(others + 1):
        aside = 2.0 + 10.0 * number
        path = walk((-15, 20 + aside), (15, 20 + aside))
        rows.append(track(2 + number, path, begin_s=5.0))
    return stage(*rows)


def test_a_course_is_the_predicate_of_the_distance_at_every_moment():
    one = scene()
    (event,) = find(one, PASSES)
    course = course_of(one, PASSES, event)
    assert list(course.values) == list(event.why) == ["by: near(person, car)"]
    np.testing.assert_allclose(np.diff(course.time_s), STEP_S)
    assert course.time_s[0] <= event.begin_s < event.end_s <= course.time_s[-1]
    walker = one.tracks.select(one.tracks.track == event.roles["person"])
    x = np.interp(course.time_s, walker.time_s, walker.xy_m[:, 0])
    exact = near_probability(np.hypot(x, 2.0))
    np.testing.assert_allclose(course.values["by: near(person, car)"], exact, atol=0.03)
    # Three seconds on both sides, and of nobody else.
    assert event.begin_s - course.time_s[0] <= 3.0 + STEP_S
    assert len(course.time_s) < len(walker.time_s)


def test_a_course_is_drawn_by_its_height_and_gaps():
    course = Course(np.arange(5.0), {"p": np.array([0.0, 0.5, np.nan, 0.99, 1.0])})
    assert course.signs("p", 5) == "▁▅ ██"


def test_nobody_together_has_no_course():
    one = scene()
    (event,) = find(one, PASSES)
    apart = stage(
        track(1, stay((0, 20), 5.0), kind="car"), track(2, stay((0, 22), 5.0), begin_s=20.0)
    )
    assert course_of(apart, PASSES, event) is None
