"""Which moments meet, against comparing everybody with everybody."""

import numpy as np
import pytest
from acting import STEP_S, stage, stay, track
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.searching.predicates import _meeting as meeting
from scene4d.searching.predicates._crowd import crowded
from scene4d.searching.predicates._meeting import earlier, meetings, runs


def _random_stage(seed, people=6, vehicles=4, rows=90):
    rng = np.random.default_rng(seed)
    tracks = []
    for number in range(people + vehicles):
        n = int(rng.integers(1, rows))
        steps = rng.normal(0, 0.4, (n, 2)) + rng.normal(0, 0.3, 2)
        xy = rng.uniform(0, 40, 2) + np.cumsum(steps, axis=0)
        xy[rng.random(n) < 0.05] = np.nan
        begin = STEP_S * int(rng.integers(-20, 100))
        kind = "person" if number < people else "car"
        one = track(number, xy, begin_s=begin, kind=kind, velocity=np.zeros((n, 2)))
        tracks.append(one.select(np.sort(rng.permutation(n)[: max(1, int(0.8 * n))])))
    return stage(*tracks)


def _rows(world, kind):
    return np.flatnonzero(world.tracks.class_name == kind)


def _exhaustive(world, a, b, reach_m, lag=0):
    tick = np.rint(world.tracks.time_s / STEP_S).astype(int)
    apart = np.linalg.norm(world.tracks.xy_m[a][:, None] - world.tracks.xy_m[b][None], axis=2)
    meets = (tick[a][:, None] - lag == tick[b][None]) & (apart <= reach_m)
    if lag == 0:
        meets &= world.track_of_row[a][:, None] != world.track_of_row[b][None]
    i, j = np.nonzero(meets)
    return set(zip(a[i].tolist(), b[j].tolist(), strict=True))


@given(st.integers(0, 10_000), st.sampled_from([0.5, 3.0, 12.0]), st.sampled_from([0, 7, 40]))
@settings(deadline=None, max_examples=15)
def test_nobody_who_meets_is_missed_and_time_always_agrees(seed, reach_m, lag):
    world = _random_stage(seed)
    for kinds in (("person", "car"), ("person", "person")):
        a, b = (_rows(world, kind) for kind in kinds)
        i, j = meetings(world, a, b, reach_m=reach_m, lag=lag)
        found = set(zip(i.tolist(), j.tolist(), strict=True))
        assert len(found) == len(i)
        assert found >= _exhaustive(world, a, b, reach_m, lag)
        assert (world.tick[i] - world.tick[j] == lag).all()
        assert set(j.tolist()) <= set(b.tolist())
        order = np.lexsort((world.tick[i], world.track_of_row[j], world.track_of_row[i]))
        assert (order == np.arange(len(i))).all()


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=10)
def test_without_a_reach_everybody_at_the_same_time(seed):
    world = _random_stage(seed)
    a, b = _rows(world, "person"), _rows(world, "car")
    i, j = meetings(world, a, b, reach_m=np.inf)
    tick = np.rint(world.tracks.time_s / STEP_S)
    expected = np.argwhere(tick[a][:, None] == tick[b][None])
    assert set(zip(i.tolist(), j.tolist(), strict=True)) == {
        (int(a[x]), int(b[y])) for x, y in expected
    }


def test_a_margin_brings_the_moments_before():
    walker = track(1, np.column_stack([np.arange(400) * 0.3, np.zeros(400)]))
    car = track(2, stay([110, 0], 80), kind="car")
    world = stage(walker, car)
    a, b = np.arange(400), np.arange(400, 800)
    near = meetings(world, a, b, reach_m=2.0)[0]
    wide = meetings(world, a, b, reach_m=2.0, margin=50)[0]
    assert set(near) < set(wide)
    assert wide.min() <= 110 / 0.3 - 2 / 0.3 - 50
    assert near.min() > 300


def test_a_long_margin_takes_no_more_work_than_there_are_moments(monkeypatch):
    """Two who are always near: around each of their pieces lie all the others."""
    made = []
    original = meeting.expand

    def counting(first, count):
        made.append(int(count.sum()))
        return original(first, count)

    monkeypatch.setattr(meeting, "expand", counting)
    world = stage(*(track(n, stay([n, 0], 600)) for n in range(2)))
    everybody = np.arange(len(world.tracks))
    i, _ = meetings(world, everybody, everybody, reach_m=2.0, margin=10_000)
    assert len(i) == len(everybody) == 6_000
    assert max(made) == 6_000


def test_far_apart_costs_nothing():
    tracks = [track(n, stay([1000.0 * n, 0], 20)) for n in range(40)]
    world = stage(*tracks)
    everybody = np.arange(len(world.tracks))
    assert len(meetings(world, everybody, everybody, reach_m=5.0)[0]) == 0


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=15)
def test_earlier_finds_who_was_there_before(seed):
    world = _random_stage(seed)
    a, b = _rows(world, "person"), _rows(world, "car")
    reach = 3.0
    i, j = earlier(world, a, b, reach_m=reach)
    apart = np.linalg.norm(world.tracks.xy_m[i] - world.tracks.xy_m[j], axis=1)
    assert (apart <= reach).all()
    assert (world.tick[j] < world.tick[i]).all()
    assert len(runs(i, world.track_of_row[j])) == len(i)
    # Of a square only the first row stands: who was well within reach before is found.
    tick, of = world.tick, world.track_of_row
    near = np.linalg.norm(world.tracks.xy_m[a][:, None] - world.tracks.xy_m[b][None], axis=2)
    before = tick[b][None] < tick[a][:, None]
    found = {(int(x), int(of[y])) for x, y in zip(i, j, strict=True)}
    for x, y in np.argwhere((near <= 0.8 * reach) & before):
        assert (int(a[x]), int(of[b[y]])) in found


def test_rows_out_of_order_are_refused():
    one = track(1, stay([0, 0], 2))
    world = stage(one.select(np.arange(10)[::-1].copy()))
    with pytest.raises(InputError, match="not later than the row before"):
        _ = world.tick
    late = track(1, stay([0, 0], 1))
    late.time_s[2] = np.nan
    with pytest.raises(InputError, match="not finite"):
        _ = stage(late).tick


@given(
    st.floats(-1000.0, 1000.0),
    st.sampled_from([0.04, 0.2, 0.25, 0.5, 1.0, 6.006 / 30]),
    st.sampled_from([0.0, 0.5, -0.5]),
)
def test_moments_a_step_apart_are_a_tick_apart(begin_s, step_s, offset):
    """Wherever they begin: of ticks that are rounded to even, every other one would be missing."""
    begin_s = step_s * (round(begin_s / step_s) + offset)
    one = track(1, stay([0, 0], 60 * step_s, step_s), begin_s=begin_s, step_s=step_s)
    other = track(2, stay([1, 0], 30 * step_s, step_s), begin_s=begin_s + 7 * step_s, step_s=step_s)
    world = stage(one, other, step_s=step_s)
    assert world.tick.tolist() == [*range(60), *range(7, 37)]
    assert world.used.all()
    i, j = meetings(world, np.arange(60), np.arange(60, 90), reach_m=2.0, lag=3)
    assert (i - (j - 60)).tolist() == [10] * 30


def test_tracks_that_are_seen_half_a_step_after_others_lose_no_moment():
    one = track(1, stay([0, 0], 8))
    world = stage(one, track(2, stay([0, 0], 8), begin_s=0.5 * STEP_S))
    assert world.tick.tolist() == [*range(40), *range(40)]
    assert world.used.all()


def test_two_rows_of_a_moment_count_once():
    one = track(1, stay([0, 0], 2), step_s=0.05)
    world = stage(one)
    assert world.used.sum() == len(np.unique(world.tick)) < len(one)


@given(st.integers(0, 10_000), st.integers(1, 6))
@settings(deadline=None, max_examples=15)
def test_a_crowd_is_at_least_so_many(seed, count):
    """Against drawing who is near, with the same chances."""
    rng = np.random.default_rng(seed)
    people = 6
    world = stage(*(track(n, [rng.uniform(-3, 3, 2)], sigma_m=0.3) for n in range(people)))
    p = crowded(world.rows(np.array([0])), count=float(count), radius_m=2.0)[0]
    xy = world.tracks.xy_m
    apart = np.linalg.norm(xy[1:] - xy[0], axis=1)
    sigma = np.sqrt(0.5**2 + 2 * 0.3**2)
    drawn = (apart + sigma * rng.normal(size=(20_000, people - 1)) < 2.0).sum(axis=1)
    assert p == pytest.approx(np.mean(drawn >= count - 1), abs=0.02)


def test_nobody_without_a_place_is_a_crowd():
    world = stage(track(1, [[np.nan, np.nan]]), track(2, [[0.0, 0.0]]))
    p = crowded(world.rows(np.array([0, 1, 1])), count=2.0, radius_m=2.0)
    assert np.isnan(p[0])
    assert p[1:].tolist() == [0.0, 0.0]
