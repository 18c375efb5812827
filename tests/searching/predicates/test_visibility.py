"""Who appears and who is gone: in the middle of the picture, and behind nothing."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from predicate_stages import STEP_S, Path, rows_of, stage_of
from scipy.stats import norm

from scene4d.searching.predicates import _visibility
from scene4d.searching.predicates._visibility import (
    appears,
    appears_from,
    disappears,
    disappears_into,
)

MIDDLE = (600.0, 300.0, 640.0, 400.0)
EVEN = 2.0
"""Of the ends that only going into something explains, one in two is that."""
ENDS = {disappears: -1, appears: 0, disappears_into: -1, appears_from: 0}


@pytest.fixture(autouse=True, scope="module")
def no_posture():
    """Boxes alone: neither posture nor, without a camera, what followed says anything."""
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(_visibility, "_posture_ratio", lambda _, __, track: np.ones(len(track)))
        yield


def boxed(box, begin_s=4.0, end_s=10.0, velocity_px=(0.0, 0.0), name="person", at_end=None) -> Path:
    """An object whose box is ``box`` at its end (or first moment), and moves by px/s."""
    time = np.arange(begin_s, end_s + STEP_S / 2, STEP_S)
    from_s = time[0] if at_end is False else time[-1]
    shift = (time - from_s)[:, None] * np.tile(velocity_px, 2)
    zero = np.zeros((len(time), 2))
    return Path(time, zero, zero, box_xyxy=np.asarray(box) + shift, name=name)


CLOCK = boxed((10.0, 10.0, 30.0, 60.0), 0.0, 20.0)
"""Somebody who is there all the time, far from everything: when the clip begins and ends."""


def at_end(function, *paths: Path, b: int | None = None) -> float:
    stage = stage_of(*paths, CLOCK)
    a = rows_of(stage, 1)
    row = ENDS[function]
    if b is None:
        return float(function(a)[row])
    other = rows_of(stage, b)
    return EVEN * float(function(a, stage.rows(np.full(len(a), other.index[0])))[row])


@pytest.mark.parametrize("function", [disappears, appears])
def test_in_the_middle_of_the_picture_it_is_so_and_falls_off_with_time(function):
    stage = stage_of(boxed(MIDDLE), CLOCK)
    a = rows_of(stage, 1)
    found = function(a)
    assert found[ENDS[function]] > 0.99
    end_s = a.time_s[ENDS[function]]
    bell = np.exp(-((a.time_s - end_s) ** 2) / 2)
    np.testing.assert_allclose(found, bell, atol=0.01)
    wide = function(a, sigma_s=3.0)
    np.testing.assert_allclose(wide, bell ** (1 / 9), atol=0.01)


@pytest.mark.parametrize(
    "box",
    [
        (0.0, 300.0, 40.0, 400.0), (1239.0, 300.0, 1279.0, 400.0),
        (600.0, 0.0, 640.0, 100.0), (600.0, 619.0, 640.0, 719.0),
    ],
)  # fmt: skip
@pytest.mark.parametrize("function", [disappears, appears])
def test_at_the_border_it_left_or_entered(function, box):
    assert at_end(function, boxed(box)) < 0.05


@settings(max_examples=25)
@given(st.floats(0.0, 60.0), st.floats(0.0, 5.0))
def test_the_further_from_the_border_the_likelier(x, more):
    first, second = (
        at_end(disappears, boxed((left, 300.0, left + 40.0, 400.0))) for left in (x, x + more)
    )
    assert 0 <= first <= second + 1e-9 <= 1 + 1e-9


@pytest.mark.parametrize(("speed", "gone"), [(-150.0, False), (150.0, True), (0.0, True)])
def test_where_it_was_moving_counts(speed, gone):
    """60 px from the border, going out, back, or nowhere."""
    path = boxed((60.0, 300.0, 100.0, 400.0), velocity_px=(speed, 0.0))
    assert (at_end(disappears, path) > 0.9) == gone
    path = boxed((60.0, 300.0, 100.0, 400.0), velocity_px=(-speed, 0.0), at_end=False)
    assert (at_end(appears, path) > 0.9) == gone


def test_a_box_that_grows_in_place_does_not_move():
    path = boxed((60.0, 300.0, 100.0, 400.0))
    grow = np.linspace(0.0, 30.0, len(path))[::-1, None] * [1.0, 0.0, -1.0, 0.0]
    assert at_end(disappears, replace(path, box_xyxy=path.box_xyxy + grow)) > 0.9


@pytest.mark.parametrize("function", [disappears, appears])
def test_behind_something_nearer_it_is_only_hidden(function):
    nearer = boxed((580.0, 250.0, 700.0, 450.0), 0.0, 20.0, name="car")
    farther = boxed((580.0, 250.0, 700.0, 380.0), 0.0, 20.0, name="car")
    beside = boxed((645.0, 250.0, 800.0, 450.0), 0.0, 20.0, name="car")
    gone_before = boxed((580.0, 250.0, 700.0, 450.0), 0.0, 2.0, name="car")
    later = boxed((580.0, 250.0, 700.0, 450.0), 12.0, 20.0, name="car")
    assert at_end(function, boxed(MIDDLE), nearer) < 0.05
    for other in (farther, beside, gone_before, later):
        assert at_end(function, boxed(MIDDLE), other) > 0.95


def test_who_walks_behind_something_is_hidden_there():
    wall = boxed((660.0, 250.0, 900.0, 450.0), 0.0, 20.0, name="truck")
    assert at_end(disappears, boxed(MIDDLE, velocity_px=(100.0, 0.0)), wall) < 0.1
    assert at_end(disappears, boxed(MIDDLE, velocity_px=(-100.0, 0.0)), wall) > 0.95


@settings(max_examples=25)
@given(st.floats(0.0, 1.0), st.floats(0.0, 0.2))
def test_the_more_is_covered_the_less_it_is_gone(share, more):
    found = []
    for covered in (share, min(share + more, 1.0)):
        cover = boxed((600.0, 250.0, 600.0 + 40.0 * covered, 450.0), 0.0, 20.0)
        found.append(at_end(disappears, boxed(MIDDLE), cover))
    assert found[1] <= found[0] + 1e-9


@pytest.mark.parametrize("function", [disappears_into, appears_from])
def test_what_it_gets_into_is_no_obstacle_and_all_else_is(function):
    car = boxed((580.0, 250.0, 700.0, 450.0), 0.0, 20.0, name="car")
    other = boxed((590.0, 240.0, 690.0, 460.0), 0.0, 20.0, name="car")
    assert at_end(function, boxed(MIDDLE), car, b=2) > 0.95
    assert at_end(function, boxed(MIDDLE), car, b=3) < 0.05  # b is the clock
    assert at_end(function, boxed(MIDDLE), car, other, b=2) < 0.05
    assert at_end(function, boxed(MIDDLE), car, other, b=3) < 0.05
    assert at_end(function, boxed(MIDDLE), other, b=2) > 0.95


CAR = (580.0, 250.0, 700.0, 450.0)


def into(box, car=CAR, function=disappears_into, **more) -> float:
    return at_end(function, boxed(box, **more), boxed(car, 0.0, 20.0, name="car"), b=2)


@pytest.mark.parametrize("function", [disappears_into, appears_from])
@pytest.mark.parametrize("share", [0.0, 0.4, 0.7, 0.85, 1.0])
def test_what_is_inside_a_thing_is_seen_within_its_outline(function, share):
    """The share of the last (or first) box within b's, softly about 0.7."""
    right = CAR[0] + 40 * share
    expected = norm.cdf((share - 0.7) / 0.15)
    assert into((right - 40, 300.0, right, 400.0), function=function) == pytest.approx(
        expected, abs=0.005
    )
    lower = CAR[1] + 100 * share
    found = into((600.0, lower - 100, 640.0, lower), function=function)
    assert found == pytest.approx(expected, abs=0.005)


@settings(max_examples=25)
@given(st.floats(0.0, 1.0), st.floats(0.0, 0.2), st.booleans())
def test_the_more_of_it_is_within_the_likelier_it_is_inside(share, more, begins):
    function = appears_from if begins else disappears_into
    found = [
        into((CAR[2] - 40 * part, 300.0, CAR[2] - 40 * part + 40, 400.0), function=function)
        for part in (share, min(1.0, share + more))
    ]
    assert 0 <= found[0] <= found[1] + 1e-9 <= 1 + 1e-9


def test_within_is_asked_of_the_last_box_alone_and_of_where_b_is_then():
    """Wherever both were before."""
    for velocity_px in ((0.0, 0.0), (150.0, 0.0)):
        person = boxed(MIDDLE, velocity_px=(100.0, 0.0))
        car = boxed(CAR, 4.0, 10.0, velocity_px=velocity_px, name="car")
        stage = stage_of(person, car, CLOCK)
        a = rows_of(stage, 1)
        found = EVEN * disappears_into(a, rows_of(stage, 2))
        assert found[-1] > 0.9
        bell = np.exp(-((a.time_s - a.time_s[-1]) ** 2) / 2)
        np.testing.assert_allclose(found, found[-1] * bell, atol=1e-9)


@pytest.mark.parametrize("function", [disappears_into, appears_from])
def test_where_b_is_hidden_for_a_while_the_nearest_box_counts(function):
    stage = stage_of(boxed(MIDDLE), boxed(CAR, 4.0, 10.0, name="car"), CLOCK)
    expected = function(rows_of(stage, 1), rows_of(stage, 2))
    assert EVEN * expected.max() > 0.9
    for gap in (slice(10, 15), slice(0, 3), slice(-3, None)):
        box, observed = stage.tracks.box_xyxy.copy(), stage.tracks.observed.copy()
        rows = rows_of(stage, 2).index[gap]
        box[rows], observed[rows] = np.nan, False
        holed = replace(stage, tracks=replace(stage.tracks, box_xyxy=box, observed=observed))
        found = function(rows_of(holed, 1), rows_of(holed, 2))
        np.testing.assert_allclose(found, expected, atol=1e-9)


@pytest.mark.parametrize(("begin_s", "end_s"), [(0.0, 1.0), (19.0, 20.0)])
@pytest.mark.parametrize("function", [disappears_into, appears_from])
def test_however_far_off_in_time_its_own_box_is_nearest(function, begin_s, end_s):
    """Tracks before and behind b, which are seen all the time, are others."""
    a = boxed(MIDDLE, 0.6, 19.4)
    b = boxed(CAR, begin_s, end_s, name="car")
    stage = stage_of(CLOCK, a, CLOCK, b, CLOCK)
    rows = rows_of(stage, 2)
    other = stage.rows(np.full(len(rows), rows_of(stage, 4).index[0]))
    assert np.isfinite(function(rows, other)).all()


@pytest.mark.parametrize("function", [disappears_into, appears_from])
def test_without_any_box_of_b_nothing_is_known(function):
    stage = stage_of(boxed(MIDDLE), boxed(CAR, 4.0, 10.0, name="car"), CLOCK)
    box = stage.tracks.box_xyxy.copy()
    box[rows_of(stage, 2).index] = np.nan
    holed = replace(stage, tracks=replace(stage.tracks, box_xyxy=box))
    assert np.isnan(function(rows_of(holed, 1), rows_of(holed, 2))).all()


# Things at the picture's border are entered, too.
AT_BORDER = (0.0, 300.0, 40.0, 400.0)
CAR_AT_BORDER = (0.0, 250.0, 150.0, 450.0)
WALKS_PX = 1.4 / 1.75 * 100
"""At 1.4 m/s, of somebody who is 1.75 m and 100 px tall."""


def test_who_stands_still_at_the_border_does_not_leave_through_it():
    assert into(AT_BORDER, CAR_AT_BORDER) > 0.95
    assert into(AT_BORDER, CAR_AT_BORDER, velocity_px=(-WALKS_PX, 0.0)) < 0.05
    # Along the border and back into the picture is not out of it.
    assert into(AT_BORDER, CAR_AT_BORDER, velocity_px=(0.0, WALKS_PX)) > 0.95
    assert into(AT_BORDER, CAR_AT_BORDER, velocity_px=(WALKS_PX, 0.0)) > 0.95
    # In time reversed who comes in through the border comes out of no car there.
    assert into(AT_BORDER, CAR_AT_BORDER, appears_from, at_end=False) > 0.95
    arrives = {"velocity_px": (WALKS_PX, 0.0), "at_end": False}
    assert into(AT_BORDER, CAR_AT_BORDER, appears_from, **arrives) < 0.05


def test_without_b_who_is_gone_at_the_border_is_explained_by_it_moving_or_not():
    for speed in (0.0, -WALKS_PX, WALKS_PX):
        assert at_end(disappears, boxed(AT_BORDER, velocity_px=(speed, 0.0))) < 0.05


@pytest.mark.parametrize(
    ("box", "car", "out"),
    [
        ((0.0, 300.0, 40.0, 400.0), (0.0, 250.0, 150.0, 450.0), (-1.0, 0.0)),
        ((1239.0, 300.0, 1279.0, 400.0), (1100.0, 250.0, 1279.0, 450.0), (1.0, 0.0)),
        ((600.0, 0.0, 640.0, 100.0), (500.0, 0.0, 700.0, 150.0), (0.0, -1.0)),
        ((600.0, 619.0, 640.0, 719.0), (500.0, 550.0, 700.0, 719.0), (0.0, 1.0)),
    ],
)
def test_every_border_is_one(box, car, out):
    away = tuple(WALKS_PX * v for v in out)
    assert into(box, car) > 0.95
    assert into(box, car, velocity_px=away) < 0.05
    assert into(box, car, velocity_px=tuple(-v for v in away)) > 0.95


@pytest.mark.parametrize("speed_mps", [0.8, 1.4])
@pytest.mark.parametrize("end", ["lower", "right"])
def test_who_walks_out_is_told_by_the_side_that_is_still_in_the_picture(end, speed_mps):
    """The border cuts the box while it leaves: its other side moves, its middle half as fast."""
    speed_px = speed_mps / 1.75 * 100
    time = np.arange(4.0, 10.0 + STEP_S / 2, STEP_S)
    way = ((time - time[-1]) * speed_px)[:, None]
    if end == "lower":
        whole = np.array([600.0, 680.0, 640.0, 780.0]) + way * [0, 1, 0, 1]
        car = (500.0, 550.0, 800.0, 719.0)
    else:
        whole = np.array([1255.0, 300.0, 1295.0, 400.0]) + way * [1, 0, 1, 0]
        car = (1100.0, 250.0, 1279.0, 450.0)
    box = np.minimum(whole, [1279.0, 719.0, 1279.0, 719.0])
    zero = np.zeros((len(time), 2))
    stage = stage_of(Path(time, zero, zero, box_xyxy=box), boxed(car, 0.0, 20.0, name="car"), CLOCK)
    a = rows_of(stage, 1)
    other = stage.rows(np.full(len(a), rows_of(stage, 2).index[0]))
    assert EVEN * disappears_into(a, other).max() < 0.2


@pytest.mark.parametrize("speed_px", [15.0, 22.0, 30.0])
def test_a_side_that_the_border_cuts_does_not_tell_how_fast_it_leaves(speed_px):
    """The left side stays at the border while the right one comes nearer to it: the box moves as
    the right side does. Were both counted it would move half as fast.
    """
    time = np.arange(4.0, 10.0 + STEP_S / 2, STEP_S)
    right = 60.0 + (time[-1] - time) * speed_px
    box = np.column_stack([0 * right, 300.0 + 0 * right, right, 400.0 + 0 * right])
    zero = np.zeros((len(time), 2))
    car = boxed((0.0, 250.0, 500.0, 450.0), 0.0, 20.0, name="car")
    stage = stage_of(Path(time, zero, zero, box_xyxy=box), car, CLOCK)
    a = rows_of(stage, 1)
    found = EVEN * disappears_into(a, stage.rows(np.full(len(a), rows_of(stage, 2).index[0])))[-1]
    leaves = norm.cdf((0.5 * speed_px / np.sqrt(60.0 * 100.0) - 0.15) / 0.05)
    assert found == pytest.approx((1 - leaves) * norm.cdf(2), abs=0.01)


@settings(max_examples=25)
@given(st.floats(0.0, 200.0), st.floats(0.0, 50.0), st.floats(0.0, 60.0))
def test_the_faster_outwards_the_less_it_got_in(speed, more, left):
    """Between what the border leaves of whoever goes through it, and what no border does."""
    box = (left, 300.0, left + 40.0, 400.0)
    slow, fast = (into(box, CAR_AT_BORDER, velocity_px=(-v, 0.0)) for v in (speed, speed + more))
    assert fast <= slow + 1e-9
    gone, wholly_within = at_end(disappears, boxed(box, velocity_px=(-speed, 0.0))), norm.cdf(2)
    # A vehicle that stands may have moved by 2 ± 0.5 m with a probability of 3e-5.
    assert gone * wholly_within - 1e-4 <= slow <= wholly_within + 1e-4


def test_the_border_is_no_matter_in_the_middle_whatever_the_motion():
    for speed in (0.0, 100.0, -100.0):
        moved = into(MIDDLE, velocity_px=(speed, 0.0))
        assert moved == pytest.approx(into(MIDDLE), abs=1e-6)


def test_the_clips_own_begin_and_end_are_none():
    everything = stage_of(boxed(MIDDLE, 0.0, 20.0), CLOCK)
    a = rows_of(everything, 1)
    assert disappears(a).max() < 1e-6
    assert appears(a).max() < 1e-6
    late = stage_of(boxed(MIDDLE, 3.0, 18.0), CLOCK)
    assert disappears(rows_of(late, 1))[-1] > 0.95
    assert appears(rows_of(late, 1))[0] > 0.95


def test_bridged_rows_at_the_end_are_not_its_end():
    stage = stage_of(boxed(MIDDLE), CLOCK)
    tracks = stage.tracks
    observed = tracks.observed.copy()
    observed[26:31] = False
    box = np.where(observed[:, None], tracks.box_xyxy, np.nan)
    stage = replace(stage, tracks=replace(tracks, observed=observed, box_xyxy=box))
    found = disappears(rows_of(stage, 1))
    assert found.argmax() == 25
    assert found[25] > 0.99


def test_who_was_never_seen_cannot_be_judged():
    time = np.arange(5) * STEP_S
    never = Path(time, np.zeros((5, 2)), np.zeros((5, 2)))
    stage = stage_of(never, CLOCK)
    assert np.isnan(disappears(rows_of(stage, 1))).all()
    assert not np.isnan(disappears(rows_of(stage, 2))).any()
    alone = stage_of(never)
    assert np.isnan(appears(rows_of(alone, 1))).all()
    assert disappears(stage.rows(np.array([], int))).shape == (0,)


def test_time_reversed_the_one_is_the_other():
    rng = np.random.default_rng(5)
    for _ in range(10):
        corner = rng.uniform([0, 0], [1200, 600])
        box = (*corner, *(corner + rng.uniform(20, 200, 2)))
        begin, end = np.sort(rng.integers(5, 95, 2)) * STEP_S
        path = boxed(box, begin, end + 1.0, velocity_px=rng.uniform(-60, 60, 2))
        cover = boxed((*(corner - 10), *(corner + rng.uniform(0, 300, 2))), 0.0, 20.0)
        there = stage_of(path, cover, CLOCK)
        mirrored = [
            replace(p, time_s=20.0 - p.time_s[::-1], box_xyxy=p.box_xyxy[::-1])
            for p in (path, cover, CLOCK)
        ]
        back = stage_of(*mirrored)
        np.testing.assert_allclose(
            disappears(rows_of(there, 1)), appears(rows_of(back, 1))[::-1], atol=1e-6
        )
        into_cover, from_cover = (
            function(a, at.rows(np.full(len(a), rows_of(at, 2).index[0])))
            for function, at, a in (
                (disappears_into, there, rows_of(there, 1)),
                (appears_from, back, rows_of(back, 1)),
            )
        )
        # But for the tail of "moved by 2 ± 0.5 m": cars drive off and arrive unequally often.
        np.testing.assert_allclose(into_cover, from_cover[::-1], atol=5e-5)
