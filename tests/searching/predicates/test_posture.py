"""Who is seen less tall than it stands, by cameras near and far."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from predicate_stages import (
    STEP_S,
    Path,
    View,
    body_boxes,
    random_view,
    rows_of,
    seen_stage,
    stage_of,
    straight,
)

from scene4d.core.camera import Camera
from scene4d.searching.predicates._posture import stooping

FEET_PX = 600.0


def pictured(tall_px, top_px=None) -> Path:
    """Somebody whose boxes in a picture of 1280 x 720 are so tall, on the same feet or below the
    same upper edge.
    """
    tall = np.asarray(tall_px, float)
    top = FEET_PX - tall if top_px is None else np.broadcast_to(top_px, tall.shape)
    left, zero = np.full(len(tall), 500.0), np.zeros((len(tall), 2))
    box = np.column_stack([left, top, left + 40, top + tall])
    return Path(np.arange(len(tall)) * STEP_S, zero, zero, box_xyxy=box)


def judged(path: Path, **more) -> np.ndarray:
    """Without a camera."""
    return stooping(rows_of(stage_of(path), 1), **more)


def bending(count: int = 21, to: float = 0.7) -> np.ndarray:
    """Shares of the standing height: upright for most of the time, bent in the last 0.6 s."""
    return np.interp(np.arange(count), [count - 4, count - 1], [1.0, to])


def walked(start, end, share, height_m: float = 1.75) -> Path:
    """A straight way, as tall as these shares of the height say."""
    way = np.subtract(end, start)
    path = straight(start, way / ((len(share) - 1) * STEP_S), (len(share) - 1) * STEP_S)
    return replace(path, height_m=height_m * np.asarray(share))


# Known motion in random cameras


@pytest.mark.parametrize("seed", range(6))
def test_who_bends_stoops_and_who_stands_does_not_in_every_camera(seed):
    view = random_view(np.random.default_rng(seed), max_tilt_deg=35.0)
    stands = walked((-1.5, 1.0), (1.5, 0.0), np.ones(21))
    bends = walked((1.5, -1.0), (0.0, 1.0), bending(), height_m=1.6)
    stage = seen_stage(view, stands, bends)
    assert stooping(rows_of(stage, 1)).max() < 0.07
    found = stooping(rows_of(stage, 2))
    assert found[:17].max() < 0.07
    assert found[-1] > 0.99
    assert (np.diff(found[17:]) > 0).all()


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("direction", [1, -1])
def test_walking_away_or_towards_the_camera_is_no_stooping(seed, direction):
    rng = np.random.default_rng(seed)
    camera = Camera.from_pose(
        image_size=(1920, 1080),
        focal_px=float(rng.uniform(1000, 1600)),
        tilt_rad=float(rng.uniform(0.2, 0.35)),
        roll_rad=float(rng.uniform(-0.1, 0.1)),
        height_m=float(rng.uniform(4.0, 7.0)),
        distortion=(float(rng.uniform(-0.1, 0.1)), 0.0, 0.0, 0.0, 0.0),
    )
    view = replace(random_view(rng), camera=camera, turn_rad=0.0, shift_m=np.zeros(2))
    ends = ((-1.0, 13.0), (2.0, 40.0))[::direction]
    path = walked(*ends, np.ones(51))
    stage = seen_stage(view, path)
    tall = np.diff(stage.tracks.box_xyxy[:, [1, 3]])[:, 0]
    assert tall.max() > 2.2 * tall.min(), "the picture alone says something else"
    assert stooping(rows_of(stage, 1)).max() < 0.07
    # Without the camera heights in the picture are all there is.
    flat = replace(stage, camera=None)
    far = tall.argmin()
    assert stooping(rows_of(flat, 1))[far] > 0.99
    near = tall > np.quantile(tall, 0.8)
    assert stooping(rows_of(flat, 1))[near].max() < 0.06


def test_a_metre_up_in_the_picture_of_a_level_camera_is_the_focal_length_over_the_distance():
    """Up and down: a rolled camera sees a leaning line, whose box is lower."""
    camera = Camera.from_pose(
        image_size=(1280, 720), focal_px=900.0, tilt_rad=0.0, roll_rad=0.3, height_m=1.2
    )
    distance = np.array([3.0, 10.0, 45.0])
    aside = np.array([1.0, -2.0, 7.0])
    path = Path(np.arange(5) * STEP_S, np.zeros((5, 2)), np.zeros((5, 2)))
    places = np.vstack([np.column_stack([aside, distance]), [0.0, -5.0], [np.nan, np.nan]])
    stage = replace(stage_of(replace(path, xy_m=places)), camera=camera)
    found = stage.px_per_m(np.arange(5))
    np.testing.assert_allclose(found[:3], 900.0 * np.cos(0.3) / distance, rtol=1e-9)
    assert np.isnan(found[3:]).all(), "behind the camera, and nowhere"
    np.testing.assert_array_equal(stage.px_per_m(np.array([2, 0, 2])), found[[2, 0, 2]])
    np.testing.assert_array_equal(replace(stage, camera=None).px_per_m(np.arange(5)), np.ones(5))


def test_what_counts_is_the_picture_that_the_lens_made():
    """Boxes are of the footage: a metre at the lower border, by the lens's own formula."""
    f, k1, height_m, distance = 900.0, -0.12, 3.0, 7.0
    camera = Camera.from_pose(
        image_size=(1280, 720), focal_px=f, tilt_rad=0.0, roll_rad=0.0, height_m=height_m,
        distortion=(k1, 0.0, 0.0, 0.0, 0.0),
    )  # fmt: skip
    stage = replace(stage_of(straight((0.0, distance), (0.0, 0.0), 0.2)), camera=camera)
    foot, head = height_m / distance, (height_m - 1.70) / distance
    length = f * (foot * (1 + k1 * foot**2) - head * (1 + k1 * head**2))
    np.testing.assert_allclose(stage.px_per_m(np.arange(2)), length / 1.70, rtol=1e-9)
    assert length / 1.70 < 0.98 * f / distance


def test_cameras_from_above_see_a_share_of_a_height_within_three_hundredths():
    """A sinking head comes nearer to the ground and farther from the camera."""
    rng = np.random.default_rng(5)
    share = bending()
    worst = []
    for _ in range(40):
        view = random_view(rng, max_tilt_deg=35.0)
        stage = seen_stage(view, walked((-1.5, -1.0), (1.3, 1.0), share))
        box = stage.tracks.box_xyxy
        tall = (box[:, 3] - box[:, 1]) / stage.px_per_m(np.arange(len(box)))
        worst.append(np.abs(tall / np.sort(tall)[15] - share).max())
    assert np.median(worst) < 0.01
    assert max(worst) < 0.03


@pytest.mark.parametrize("tilt_deg", [15.0, 30.0, 45.0, 55.0])
def test_who_walks_upright_across_the_picture_does_not_stoop(tilt_deg):
    """Away from the middle uprights lean, and a box does not: it is as high as they reach up."""
    camera = Camera.from_pose(
        image_size=(1920, 1080), focal_px=1000.0, tilt_rad=np.radians(tilt_deg), roll_rad=0.0,
        height_m=6.0,
    )  # fmt: skip
    middle = 6.0 / np.tan(np.radians(tilt_deg))
    view = View(camera, 0.0, np.array([0.0, middle]))
    reach = 0.6 * 960 / 1000 * np.hypot(6.0, middle)
    upright = walked((-reach, 0.0), (reach / 2, 0.0), np.ones(21))
    stage = seen_stage(view, upright)
    assert stooping(rows_of(stage, 1)).max() < 0.1


@pytest.mark.parametrize("rows", [2, 3])
def test_of_a_short_track_the_tallest_moment_is_standing(rows):
    path = pictured(100.0 * np.linspace(1.0, 0.75, rows))
    assert judged(path)[-1] > 0.9


# What the number is


def test_it_is_the_share_of_draws_in_which_it_is_less_tall():
    """Both edges drawn with their stated errors, and what people call stooping with its own."""
    rng = np.random.default_rng(4)
    for tall in (300.0, 20.0):
        for share in (1.0, 0.93, 0.88, 0.8):
            path = pictured(tall * np.append(np.ones(20), share))
            edge = max(0.02, 1.0 / (tall * share))
            true = share + edge * (rng.normal(size=200_000) - rng.normal(size=200_000))
            counted = (true < 0.9 + 0.05 * rng.normal(size=200_000)).mean()
            assert judged(path)[-1] == pytest.approx(counted, abs=0.005)


def test_in_few_pixels_it_is_less_sure():
    found = [judged(pictured(tall * bending()))[[0, -1]] for tall in (400.0, 100.0, 12.0)]
    (stood, _), (same, _), _ = found
    assert stood == pytest.approx(same, abs=1e-9), "2 % of a box is more than a pixel"
    assert found[0][0] < found[2][0] < 0.5 < found[2][1] < found[0][1]


@given(st.floats(200.0, 350.0), st.floats(0.25, 1.2), st.floats(0.0, 0.3), st.floats(0.3, 1.0))
def test_the_taller_the_less_and_the_larger_the_share_the_more(tall, q, more, share):
    """Of boxes so large that no pixel counts."""
    lower, higher = (
        judged(pictured(tall * np.append(np.ones(9), x)), share=share)[-1] for x in (q, q + more)
    )
    assert 0 <= higher <= lower <= 1
    wider = judged(pictured(tall * np.append(np.ones(9), q)), share=min(1.0, share + more))[-1]
    assert wider >= lower


@given(st.floats(0.45, 2.0), st.integers(0, 2**32 - 1))
def test_only_ratios_of_heights_count(scale, seed):
    share = np.random.default_rng(seed).uniform(0.5, 1.1, 12)
    first, second = (judged(pictured(tall * share)) for tall in (240.0, 240.0 * scale))
    np.testing.assert_allclose(first, second, atol=1e-9)


def test_feet_behind_something_low_shorten_it_like_a_bent_back():
    whole = pictured(100.0 * bending())
    hidden = pictured(100.0 * bending(), top_px=500.0)
    np.testing.assert_allclose(judged(hidden), judged(whole), atol=1e-9)


# What counts as standing


def test_everybody_is_compared_with_itself():
    small, tall = pictured(100.0 * np.ones(20)), pictured(140.0 * np.ones(20))
    stage = stage_of(small, tall)
    for track in (1, 2):
        assert stooping(rows_of(stage, track)).max() < 0.05
    np.testing.assert_array_equal(stooping(rows_of(stage, 1)), judged(small))


def test_who_bends_most_of_the_time_still_bends():
    share = np.append(np.full(14, 0.7), np.ones(6))
    found = judged(pictured(120.0 * share))
    assert found[:14].min() > 0.99
    assert found[14:].max() < 0.06


@pytest.mark.parametrize("at", [0, 11, 19])
def test_one_box_too_tall_is_not_the_standing_height(at):
    tall = np.full(20, 100.0)
    expected = judged(pictured(tall))
    tall[at] = 180.0
    found = judged(pictured(tall))
    others = np.arange(20) != at
    np.testing.assert_allclose(found[others], expected[others], atol=1e-9)
    assert found[at] < 1e-6


def test_rows_that_cannot_be_judged_do_not_tell_how_tall_it_stands():
    """A track that is cut by the border for most of the time, and then seen whole, bent at last."""
    share = np.append(np.full(25, 0.6), np.append(np.ones(4), 0.7))
    path = pictured(150.0 * share)
    box = path.box_xyxy.copy()
    box[:25, [1, 3]] += 720 - FEET_PX
    found = judged(replace(path, box_xyxy=box))
    assert np.isnan(found[:25]).all()
    assert found[25:29].max() < 0.06
    assert found[29] > 0.99


# Unknown


@pytest.mark.parametrize(
    ("top", "bottom", "known"),
    [
        (0.0, 100.0, False), (-20.0, 100.0, False), (2.0, 100.0, False), (2.5, 100.0, True),
        (619.0, 719.0, False), (640.0, 740.0, False), (600.0, 716.5, True), (300.0, 400.0, True),
    ],
)  # fmt: skip
def test_a_box_that_the_upper_or_lower_border_may_cut_is_unknown(top, bottom, known):
    tall = bottom - top
    path = pictured(np.full(10, tall))
    box = path.box_xyxy.copy()
    box[4, [1, 3]] = top, bottom
    found = judged(replace(path, box_xyxy=box))
    assert np.isnan(found[4]) == (not known)
    assert np.isfinite(np.delete(found, 4)).all()
    # The sides cut no height.
    aside = replace(path, box_xyxy=path.box_xyxy - [500.0, 0, 500.0, 0])
    np.testing.assert_array_equal(judged(aside), judged(path))


def test_who_was_not_seen_or_is_nowhere_is_unknown():
    view = random_view(np.random.default_rng(2), max_tilt_deg=30.0)
    stage = seen_stage(view, walked((-1.0, 0.0), (1.0, 0.0), bending()))
    tracks = stage.tracks
    expected = stooping(rows_of(stage, 1))
    observed, xy, box = tracks.observed.copy(), tracks.xy_m.copy(), tracks.box_xyxy.copy()
    observed[3], xy[5], box[7] = False, np.nan, np.nan
    known = np.delete(np.arange(21), [3, 5, 7])
    holed = replace(stage, tracks=replace(tracks, observed=observed, xy_m=xy, box_xyxy=box))
    found = stooping(rows_of(holed, 1))
    assert np.flatnonzero(np.isnan(found)).tolist() == [3, 5, 7]
    np.testing.assert_allclose(found[known], expected[known], atol=0.02)
    never = replace(stage, tracks=replace(tracks, observed=np.zeros(21, bool)))
    assert np.isnan(stooping(rows_of(never, 1))).all()
    assert stooping(stage.rows(np.array([], int))).shape == (0,)


# A function of rows


@settings(max_examples=30)
@given(st.lists(st.integers(0, 49), max_size=30), st.integers(0, 2**32 - 1))
def test_values_belong_to_rows_whichever_are_asked_for(asked, seed):
    """In any order, some twice, those of one track or of many: the standing height is that of the
    whole track, not of the rows that were asked for.
    """
    rng = np.random.default_rng(seed)
    paths = [pictured(rng.uniform(60, 200) * rng.uniform(0.5, 1.1, n)) for n in (7, 1, 22, 20)]
    stage = stage_of(*paths)
    every = stooping(stage.rows(np.arange(50)))
    index = np.array(asked, int)
    np.testing.assert_array_equal(stooping(stage.rows(index)), every[index])
    alone = [judged(path) for path in paths]
    np.testing.assert_array_equal(np.concatenate(alone), every)


@settings(max_examples=30)
@given(st.lists(st.integers(-50, 800), min_size=2, max_size=30), st.floats(0.0, 1.0))
def test_whatever_the_boxes_it_is_a_probability_or_unknown(edges, share):
    half = len(edges) // 2
    top, bottom = np.sort([edges[:half], edges[half : 2 * half]], axis=0).astype(float)
    found = judged(pictured(bottom - top, top_px=top), share=share)
    known = found[np.isfinite(found)]
    assert ((known >= 0) & (known <= 1)).all()
    assert np.isnan(found[(top <= 2) | (bottom >= 717)]).all()


def test_boxes_of_bodies_go_from_head_to_foot():
    """What these tests stand on: a body twice as near is twice as tall in a level picture."""
    view = random_view(np.random.default_rng(0))
    camera = Camera.from_pose(
        image_size=(1280, 720), focal_px=800.0, tilt_rad=0.0, roll_rad=0.0, height_m=1.0
    )
    view = replace(view, camera=camera, turn_rad=0.0, shift_m=np.zeros(2))
    path = replace(straight((0.0, 5.0), (0.0, 5.0), 1.0), height_m=np.full(6, 1.5))
    box = body_boxes(view, path)
    tall = box[:, 3] - box[:, 1]
    np.testing.assert_allclose(tall, 800 * 1.5 / path.xy_m[:, 1], rtol=1e-9)
