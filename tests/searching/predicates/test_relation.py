"""Two roles: near, towards, away, following, facing, sides."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from predicate_stages import drawn, one, rows_of, stage_of

from scene4d.core.errors import InputError
from scene4d.searching.predicates._distance import far, near, near_probability, same_place
from scene4d.searching.predicates._relation import (
    SIDES,
    facing,
    following,
    moving_away,
    moving_towards,
)

METRES = st.floats(-30.0, 30.0)
ANGLE = st.floats(-np.pi, np.pi)


def value(function, a, b, **more) -> float:
    stage = stage_of(a, b)
    return float(function(rows_of(stage, 1), rows_of(stage, 2), **more)[0])


def test_near_adds_the_spreads_along_the_line_between():
    a, b = one((1.0, 1.0), sigma_m=0.3), one((4.0, 5.0), sigma_m=0.4)
    expected = near_probability(5.0, distance_sigma_m=0.5)
    assert value(near, a, b) == pytest.approx(float(expected))
    assert value(far, a, b) == pytest.approx(1 - float(expected))
    assert value(near, a, a) > value(same_place, a, b)
    assert value(same_place, a, one((1.3, 1.0))) > 0.95


def test_the_cameras_error_is_shared():
    """A factor that is the same for both changes nothing; the difference of two counts."""
    a, b = one((0.0, 0.0), sigma_m=0.0), one((4.5, 0.0), sigma_m=0.0)

    def growing(along, across):
        """3 m either way at a, and so much more along and across the line at b."""
        more = np.diag([along, across])
        return lambda xy_m: np.diag([3.0, 3.0]) + xy_m[:, :1, None] / 4.5 * more

    for more_m, spread in ((0.0, 0.0), (1.2, 1.2)):
        stage = stage_of(a, b, factor=growing(more_m, 0.0))
        found = near(rows_of(stage, 1), rows_of(stage, 2))
        assert found[0] == pytest.approx(float(near_probability(4.5, distance_sigma_m=spread)))
    # Across the line between them it does not matter.
    stage = stage_of(a, b, factor=growing(0.0, 1.2))
    assert near(rows_of(stage, 1), rows_of(stage, 2))[0] == pytest.approx(
        float(near_probability(4.5))
    )


def test_at_one_place_the_spread_is_the_mean_of_all_directions():
    a = one((2.0, 2.0), sigma_m=1.0)
    assert value(near, a, a) == pytest.approx(
        float(near_probability(0.0, distance_sigma_m=np.sqrt(2)))
    )


def test_towards_and_away_by_hand():
    b = one((10.0, 0.0))
    for velocity, towards, away in (
        ((1.4, 0.0), 1.0, 0.0),
        ((-1.4, 0.0), 0.0, 1.0),
        ((0.0, 1.4), 0.0, 0.0),
        ((0.0, 0.0), 0.0, 0.0),
    ):
        a = one((0.0, 0.0), velocity)
        assert value(moving_towards, a, b) == pytest.approx(towards, abs=0.06)
        assert value(moving_away, a, b) == pytest.approx(away, abs=0.06)
    # On the border of the wedge: half, from its apex at 0.3 m/s.
    a = one((0.0, 0.0), (1.3, 1.0), sigma_mps=0.0)
    assert value(moving_towards, a, b) == pytest.approx(0.5, abs=0.01)


@pytest.mark.parametrize("sigma_mps", [0.1, 0.6])
@pytest.mark.parametrize("velocity", [(1.0, 0.3), (0.4, -0.2), (0.8, 0.9), (0.0, 0.0)])
def test_towards_is_the_share_of_draws_that_go_there(sigma_mps, velocity):
    rng = np.random.default_rng(3)
    a = one((0.0, 0.0), velocity, sigma_m=0.3, sigma_mps=sigma_mps)
    b = one((3.0, 2.0), sigma_m=0.3)
    of_a, of_b = drawn(a, 40_000, rng), drawn(b, 40_000, rng)
    way = of_b.xy_m - of_a.xy_m
    u = way / np.linalg.norm(way, axis=1)[:, None]
    rest = of_a.velocity_mps - 0.3 * u
    along = (rest * u).sum(axis=1)
    across = rest[:, 1] * u[:, 0] - rest[:, 0] * u[:, 1]
    share = (np.abs(across) < along).mean()
    assert value(moving_towards, a, b, sigma_mps=0.01) == pytest.approx(share, abs=0.02)


@settings(max_examples=20)
@given(x=METRES, y=METRES, vx=st.floats(-3, 3), vy=st.floats(-3, 3), turn=ANGLE, shift=METRES)
def test_where_the_axes_lie_does_not_matter(x, y, vx, vy, turn, shift):
    c, s = np.cos(turn), np.sin(turn)
    rotation = np.array([[c, -s], [s, c]])

    def moved(path_xy, v, heading):
        return one(rotation @ path_xy + shift, rotation @ v, heading + turn)

    first = one((x, y), (vx, vy), 0.7), one((1.0, 2.0), (0.5, 0.5), -2.0)
    second = moved((x, y), (vx, vy), 0.7), moved((1.0, 2.0), (0.5, 0.5), -2.0)
    for function in (near, far, moving_towards, moving_away, following, facing):
        expected = value(function, *first)
        assert 0 <= expected <= 1
        assert value(function, *second) == pytest.approx(expected, abs=1e-6)
    for side in SIDES:
        expected = value(facing, *first, side=side)
        assert 0 <= expected <= 1
        assert value(facing, *second, side=side) == pytest.approx(expected, abs=1e-6)


def test_who_walks_behind_follows():
    behind, ahead = one((0.0, 0.0), (1.3, 0.0)), one((3.0, 0.2), (1.3, 0.0))
    assert value(following, behind, ahead) > 0.9
    assert value(following, ahead, behind) < 0.01
    assert value(following, behind, one((0.0, 2.0), (1.3, 0.0))) < 0.1  # side by side
    assert value(following, behind, one((3.0, 0.0), (-1.3, 0.0))) < 0.01  # face to face
    assert value(following, behind, one((3.0, 0.0))) < 0.05  # stands
    assert value(following, behind, one((30.0, 0.0), (1.3, 0.0))) < 0.01


@settings(max_examples=30)
@given(off=st.floats(0.0, 3.0), more=st.floats(0.0, 0.1))
def test_the_further_it_looks_away_the_less_it_faces(off, more):
    b = one((5.0, 0.0))
    first, second = (
        value(facing, one((0.0, 0.0), heading=h), b) for h in (off, min(off + more, np.pi))
    )
    assert second <= first + 1e-9
    assert value(facing, one(heading=-off), b) == pytest.approx(first, abs=1e-9)


def test_facing_by_hand():
    b = one((5.0, 0.0), sigma_m=0.0)
    assert value(facing, one(heading=0.0, sigma_m=0.0), b) > 0.98
    assert value(facing, one(heading=np.pi / 4, sigma_m=0.0), b) == pytest.approx(0.5, abs=1e-3)
    assert value(facing, one(heading=np.pi), b) < 0.001
    # An axis without front and back: either way alike.
    axis = one(heading=0.0, heading_sigma_rad=np.nan)
    turned = one(heading=np.pi, heading_sigma_rad=np.nan)
    assert value(facing, axis, b) == pytest.approx(value(facing, turned, b))
    assert value(facing, axis, b) == pytest.approx(0.5, abs=0.02)
    # Nobody knows which way b lies: a quarter of the circle.
    blurred = one(heading=0.0, sigma_m=20.0), one((0.0, 0.0), sigma_m=20.0)
    assert value(facing, *blurred) == pytest.approx(0.25, abs=0.01)


CAR = {"name": "car", "heading": np.pi / 2, "heading_sigma_rad": 0.05}


@pytest.mark.parametrize(
    ("at", "side"),
    [
        ((0.0, 3.3), "front"), ((0.6, 3.0), "front"), ((0.0, -3.3), "back"), ((0.7, -3.0), "back"),
        ((-1.7, 0.5), "left"), ((-1.6, -1.0), "left"), ((1.7, 0.5), "right"), ((1.6, 1.2), "right"),
    ],
)  # fmt: skip
def test_sides_of_a_car_that_heads_along_y(at, side):
    person, car = one(at), one((0.0, 0.0), **CAR)
    found = {name: value(facing, person, car, side=name) for name in SIDES}
    assert found[side] > 0.8
    assert sum(found.values()) == pytest.approx(1.0, abs=0.02)


def test_of_an_axis_front_and_back_are_alike():
    person, car = one((0.0, 3.5)), one(**{**CAR, "heading_sigma_rad": np.nan})
    found = {name: value(facing, person, car, side=name) for name in SIDES}
    assert found["front"] == found["back"] == pytest.approx(0.5, abs=0.03)
    beside = {name: value(facing, one((2.0, 0.0)), car, side=name) for name in SIDES}
    assert beside["left"] == beside["right"] == pytest.approx(0.5, abs=0.03)


def test_a_doubtful_heading_blurs_the_sides():
    sure, unsure = (
        value(facing, one((0.0, 4.0)), one(**{**CAR, "heading_sigma_rad": s}), side="front")
        for s in (0.05, 0.8)
    )
    assert sure > 0.95
    assert unsure < 0.85


@pytest.mark.parametrize("sigma_m", [0.1, 1.5])
def test_a_bus_has_longer_sides_than_a_car(sigma_m):
    """Two metres off its left side, four ahead of its middle: before a car, beside a bus; as the
    share of drawn buses whose side is nearer.
    """
    stage = stage_of(
        one((4.0, 2.0)), one((0.0, 0.0), name="bus", heading=0.0, heading_sigma_rad=0.01)
    )
    n = len(stage.tracks)
    car = facing(rows_of(stage, 1), rows_of(stage, 2), side="left")[0]
    size, sigma = np.array([7.5, 2.75, 3.3]), np.array([sigma_m, 0.2, 0.3])
    tracks = replace(
        stage.tracks, size_m=np.tile(size, (n, 1)), size_sigma_m=np.tile(sigma, (n, 1))
    )
    bus = replace(stage, tracks=tracks)
    found = facing(rows_of(bus, 1), rows_of(bus, 2), side="left")[0]
    drawn = size[:2] + sigma[:2] * np.random.default_rng(0).normal(size=(100_000, 2))
    noise = 0.3 * np.random.default_rng(1).normal(size=(100_000, 2))
    inside = 4.0 + noise[:, 0] - np.abs(2.0 + noise[:, 1]) < (drawn[:, 0] - drawn[:, 1]) / 2
    assert found == pytest.approx(inside.mean(), abs=0.05) and found > 0.5 > car


@pytest.mark.parametrize("side", ["left", "right"])
@pytest.mark.parametrize("at", [(0.2, 0.9), (-0.25, 1.0), (0.2, -0.9)])
def test_left_and_right_are_the_share_of_drawn_headings(at, side):
    """Of a car whose heading is known to 0.4 rad: beside it, which side it is depends on that."""
    rng = np.random.default_rng(4)
    heading = np.pi / 2 + 0.4 * rng.normal(size=100_000)
    person = np.array(at) + 0.05 * rng.normal(size=(len(heading), 2))
    person -= 0.05 * rng.normal(size=(len(heading), 2))
    along = person[:, 0] * np.cos(heading) + person[:, 1] * np.sin(heading)
    across = person[:, 1] * np.cos(heading) - person[:, 0] * np.sin(heading)
    beside = np.abs(along) - np.abs(across) < (4.6 - 1.85) / 2
    share = (beside & ((across > 0) == (side == "left"))).mean()
    car = one((0.0, 0.0), name="car", heading=np.pi / 2, heading_sigma_rad=0.4)
    found = value(facing, one(at), car, side=side, sigma_m=0.01)
    assert found == pytest.approx(share, abs=0.03)


def test_another_side_is_refused():
    with pytest.raises(InputError, match="side must be one of front, back, left, right, found 'up"):
        value(facing, one(), one((1.0, 1.0), heading=0.0), side="up")


@pytest.mark.parametrize(
    "function", [near, far, same_place, moving_towards, moving_away, following, facing]
)
def test_unknown_stays_unknown(function):
    known = one((1.0, 0.0), (1.0, 0.0), 0.3)
    nowhere = one((np.nan, np.nan), (np.nan, np.nan))
    assert not np.isnan(value(function, known, known))
    assert np.isnan(value(function, known, nowhere))
    assert np.isnan(value(function, nowhere, known))


def test_facing_needs_a_heading():
    known, without = one((1.0, 0.0), heading=0.3), one((3.0, 0.0))
    assert np.isnan(value(facing, without, known))
    assert not np.isnan(value(facing, known, without))
    assert np.isnan(value(facing, known, without, side="front"))
    assert not np.isnan(value(facing, without, known, side="front"))


def test_rows_of_different_times_are_compared_as_they_are_aligned():
    first, second = one((0.0, 0.0)), one((0.5, 0.0))
    stage = stage_of(first, second)
    again = stage.rows(np.array([0, 0, 0]))
    found = near(again, stage.rows(np.array([0, 1, 1])))
    assert found.shape == (3,)
    assert found[1] == found[2] < found[0]
