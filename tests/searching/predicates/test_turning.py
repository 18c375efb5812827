"""Turns to the left and right, turning round, reversing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from predicate_stages import STEP_S, Path, arc, rows_of, stage_of, straight

from scene4d.searching.predicates._turning import reversing, turning_left, turning_right, u_turning

CAR = {"name": "car"}


def values(function, *paths, track=1, **more) -> np.ndarray:
    return function(rows_of(stage_of(*paths), track), **more)


def course(*legs, sigma_mps=0.05) -> Path:
    """A track of legs (speed along X, seconds)."""
    speed = np.concatenate([np.full(round(seconds / STEP_S), v) for v, seconds in legs])
    x = np.cumsum(speed) * STEP_S
    return Path(
        np.arange(len(speed)) * STEP_S,
        np.column_stack([x, np.zeros_like(x)]),
        np.column_stack([speed, np.zeros_like(x)]),
        name="car",
        sigma_mps=sigma_mps,
    )


@settings(max_examples=25)
@given(rate=st.floats(0.2, 1.2), speed=st.floats(1.5, 12.0), heading=st.floats(-np.pi, np.pi))
def test_an_arc_is_a_turn_to_its_side_wherever_it_heads(rate, speed, heading):
    left = arc(speed, rate, course_rad=heading, **CAR)
    right = arc(speed, -rate, course_rad=heading, **CAR)
    # At the ends of a track the window is cut.
    middle = slice(5, -5)
    found = values(turning_left, left)[middle]
    assert (found > 0.85).all()
    np.testing.assert_allclose(values(turning_right, right)[middle], found, atol=1e-6)
    assert (values(turning_right, left)[middle] < 0.01).all()
    assert (values(turning_left, right)[middle] < 0.01).all()


def test_by_hand():
    """0.2 rad over 2 s against 15° ± 5°, and no error of the velocity."""
    path = arc(5.0, 0.1, sigma_mps=0.0, **CAR)
    z = (0.2 - np.radians(15)) / np.radians(5)
    assert z == pytest.approx(-0.708, abs=1e-3)
    assert values(turning_left, path)[10] == pytest.approx(0.2394, abs=1e-3)


def test_the_straight_and_the_standing_do_not_turn():
    for path in (straight((0, 0), (5, 0), **CAR), straight((0, 0), (0, 0), **CAR)):
        for function in (turning_left, turning_right, u_turning):
            assert (values(function, path) < 0.01).all()
    # What stands turns for no reason of its own, however uncertain it is.
    blurred = straight((0, 0), (0.1, 0), sigma_mps=2.0, **CAR)
    assert (values(turning_left, blurred) < 0.01).all()


@settings(max_examples=25)
@given(st.floats(0.0, 0.6), st.floats(0.0, 0.1))
def test_sharper_is_likelier(rate, more):
    first, second = (
        values(turning_left, arc(4.0, max(r, 1e-6), **CAR))[10] for r in (rate, rate + more)
    )
    assert second >= first - 1e-9


def test_it_is_the_share_of_draws_that_turn():
    rng = np.random.default_rng(8)
    path = arc(2.0, 0.15, sigma_mps=0.3, **CAR)
    count = 4000
    early, late = (path.velocity_mps[row] + 0.3 * rng.normal(size=(count, 2)) for row in (5, 15))
    turn = np.angle(np.exp(1j * (np.arctan2(*late.T[::-1]) - np.arctan2(*early.T[::-1]))))
    found = values(turning_left, path, sigma_rad=0.001)[10]
    assert found == pytest.approx((turn > np.radians(15)).mean(), abs=0.03)


def test_of_other_tracks_nothing_is_taken():
    alone = values(turning_left, arc(4.0, 0.5))
    among = values(turning_left, straight((0, 0), (3, 0)), arc(4.0, 0.5), arc(4.0, -0.5), track=2)
    np.testing.assert_allclose(among, alone)


def test_a_u_turn_is_one_to_either_side_and_a_right_angle_is_none():
    for sign in (1, -1):
        turn = arc(3.0, sign * np.pi / 6, seconds=6.0, **CAR)
        assert values(u_turning, turn)[15] > 0.95
    corner = arc(3.0, np.pi / 6, seconds=3.0, **CAR)
    assert values(u_turning, corner).max() < 0.05


def test_who_backs_out_and_drives_off_reversed_at_first():
    found = values(reversing, course((-1.0, 3.0), (0.0, 1.0), (3.0, 5.0)))
    assert (found[:14] > 0.9).all()
    assert (found[15:20] < 0.05).all()
    assert (found[20:] < 0.1).all()


def test_who_drives_in_and_backs_into_a_gap_reversed_at_last():
    found = values(reversing, course((5.0, 4.0), (0.0, 1.0), (-1.0, 3.0)))
    assert (found[:20] < 0.05).all()
    assert (found[25:] > 0.9).all()


def test_twice_there_and_back():
    found = values(reversing, course((3.0, 4.0), (0.0, 1.0), (-1.0, 2.0), (0.0, 1.0), (3.0, 4.0)))
    assert (found[:20] < 0.05).all()
    assert (found[25:35] > 0.9).all()
    assert (found[40:] < 0.05).all()


def test_one_way_all_the_time_is_no_reversing_nor_is_a_bend():
    assert (values(reversing, course((3.0, 5.0), (0.0, 2.0), (3.0, 5.0))) < 0.05).all()
    bend = arc(4.0, 0.6, seconds=10.0, **CAR)
    assert (values(reversing, bend) < 0.05).all()


def test_slowly_backwards():
    """Of two gears the slower one is the reverse, the more so the more they differ; one that is
    never changed is the reverse where it is slower than anybody drives forwards.
    """
    found = values(reversing, course((-1.0, 6.0), (0.0, 1.0), (2.0, 1.0)))
    assert found[10] == pytest.approx(2.0**3 / (1 + 2.0**3), abs=0.02)
    twice = values(reversing, course((-1.0, 6.0), (0.0, 1.0), (-1.0, 2.0), (0.0, 1.0), (2.0, 1.0)))
    assert twice[10] == pytest.approx(found[10], abs=0.02)
    creeping, walking = (
        values(reversing, course((speed, 5.0)), speed_mps=0.3)[5] for speed in (0.75, 1.5)
    )
    assert creeping == pytest.approx(1 / 2, abs=0.02)
    assert walking == pytest.approx(1 / 9, abs=0.02)


def test_equal_speeds_leave_it_open():
    found = values(reversing, course((2.0, 3.0), (0.0, 1.0), (-2.0, 3.0)))
    np.testing.assert_allclose(found[[5, 25]], 0.5, atol=0.05)


def test_a_heading_of_its_own_counts_where_it_opposes():
    path = course((2.0, 4.0))
    against = replace(path, heading_rad=np.full(len(path), np.pi))
    along = replace(path, heading_rad=np.zeros(len(path)))
    axis = replace(against, heading_sigma_rad=np.nan)
    assert (values(reversing, against) > 0.95).all()
    assert (values(reversing, along) < 0.06).all()
    assert (values(reversing, axis) < 0.06).all()


def test_of_two_vehicles_each_has_its_own_gears():
    first, second = course((5.0, 4.0)), course((-1.0, 3.0), (0.0, 1.0), (3.0, 5.0))
    np.testing.assert_allclose(values(reversing, first, second), values(reversing, first))
    np.testing.assert_allclose(values(reversing, first, second, track=2), values(reversing, second))


@pytest.mark.parametrize("function", [turning_left, turning_right, u_turning, reversing])
def test_unknown_stays_unknown_and_nothing_gives_nothing(function):
    path = arc(4.0, 0.5, **CAR)
    velocity = path.velocity_mps.copy()
    velocity[8] = np.nan
    found = values(function, replace(path, velocity_mps=velocity))
    assert np.flatnonzero(np.isnan(found)).tolist() == [8]
    assert ((found >= 0) & (found <= 1))[~np.isnan(found)].all()
    empty = stage_of(path).rows(np.array([], int))
    assert function(empty).shape == (0,)
