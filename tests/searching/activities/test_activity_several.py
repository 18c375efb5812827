"""Roles that several play at the same time."""

from itertools import product

import numpy as np
import pytest
from acting import fakes, stage, stay, track  # noqa: F401
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.activities.search import find, judge

LIT = Term("lit", ("person",))
BY_CAR = Term("by", ("person", "vehicle"), {"tau_m": 3.0})


def several(count, *terms, min_s=0.0, exactly=False):
    roles = [Role("person", ("person",), count, exactly), Role("vehicle", ("car",))]
    used = {role for term in terms for role in term.roles}
    phases = (Phase("so", terms, min_s),)
    return Activity("several", tuple(r for r in roles if r.name in used), phases)


@settings(max_examples=20, deadline=None)
@given(st.lists(st.floats(0.0, 1.0), min_size=3, max_size=6), st.integers(2, 4), st.booleans())
def test_the_score_is_that_he_is_and_enough_others_are(chances, count, exactly):
    """Against the sum over all ways in which the others may be."""
    people = [track(k, stay((5.0 * k, 0), 1), lit=[p] * 5) for k, p in enumerate(chances, 1)]
    found = find(stage(*people), several(count, LIT, exactly=exactly), min_score=0.05)
    best = 0.0
    for k, own in enumerate(chances):
        others = [p for j, p in enumerate(chances) if j != k and p > 0.01]
        ways = product([0, 1], repeat=len(others))
        enough = sum(
            np.prod([p if w else 1 - p for p, w in zip(others, way, strict=True)])
            for way in ways
            if sum(way) == count - 1 or (sum(way) >= count and not exactly)
        )
        best = max(best, own * enough)
    if best < 0.049:
        assert found == []
    elif best > 0.051:
        assert len(found) == 1  # they do it together, once
        assert found[0].score == pytest.approx(best, abs=1e-6)
        said = "exactly" if exactly else "at least"
        assert f"so: {said} {count} (person)" in found[0].why
        assert np.prod(list(found[0].why.values())) == pytest.approx(best, abs=1e-6)


def test_they_are_counted_at_the_same_car_and_the_same_moment():
    cars = [track(8, stay((0, 0), 20), kind="car"), track(9, stay((50, 0), 20), kind="car")]
    here = [track(k, stay((k, 0), 10)) for k in (1, 2)]
    there, later = track(3, stay((50, 1), 10)), track(4, stay((0, 1), 4), begin_s=12)
    three = several(3, BY_CAR)
    assert find(stage(*cars, *here, there, later), three) == []
    in_time = track(4, stay((0, 1), 4), begin_s=4)
    (event,) = find(stage(*cars, *here, there, in_time), three)
    assert event.roles["vehicle"] == 8
    assert (event.begin_s, event.end_s) == pytest.approx((4.0, 7.8))
    assert len(find(stage(*cars, *here, there, later), several(2, BY_CAR))) == 1


def test_what_cannot_be_judged_counts_nobody():
    people = [track(k, stay((k, 0), 2)) for k in range(1, 9)]
    unknown = several(3, Term("unknown", ("person",)), LIT)
    assert find(stage(*people), unknown) == []


def test_two_counts_at_once_are_refused():
    both = Activity(
        "both",
        (Role("person", ("person",), 2), Role("vehicle", ("car",), 2)),
        (Phase("so", (BY_CAR,)),),
    )
    with pytest.raises(InputError, match="one at most"):
        find(stage(track(1, stay((0, 0), 1))), both)


def test_of_sixty_people_casts_are_as_many_as_people():
    rng = np.random.default_rng(3)
    people = [track(k, rng.uniform(0, 40, 2) + np.zeros((600, 2))) for k in range(60)]
    judged = judge(stage(*people), several(3, LIT))
    assert judged.casts == 60
    assert len(judged.events) == 1
