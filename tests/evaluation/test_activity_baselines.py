"""What a search is compared with: pixels for metres, and P(near) alone."""

import numpy as np
import pytest

from made_tracks import made_tracks
from scene4d.core.errors import InputError
from scene4d.evaluation.trials._baselines import (
    NOISE_SHARE,
    in_box_sizes,
    in_pixels,
    near_alone,
    track_ends,
)
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.predicates.stage import Stage

STEP = 0.2


def stage(feet: dict[int, np.ndarray], height: float = 50.0) -> Stage:
    """Objects whose boxes' feet are at these pixels, from 0 s on; NaN where nobody was seen."""
    uv = np.concatenate(list(feet.values())).astype(float)
    n = len(uv)
    half = height / 5
    box = np.column_stack([uv[:, 0] - half, uv[:, 1] - height, uv[:, 0] + half, uv[:, 1]])
    times = np.concatenate([np.arange(len(v)) * STEP for v in feet.values()])
    tracks = made_tracks(
        np.repeat(list(feet), [len(v) for v in feet.values()]), times, np.full((n, 2), 7.0),
        frame=np.round(times * 30).astype(int), covariance_m2=1.0, shared_covariance_m2=1.0,
        velocity_mps=7.0, velocity_covariance=1.0, heading_rad=7.0, heading_sigma_rad=7.0,
        box_xyxy=box, observed=np.isfinite(box[:, 0]),
    )  # fmt: skip
    return Stage(tracks, (640, 480), STEP, camera_factor=lambda xy_m: np.zeros((len(xy_m), 2, 3)))


def line(n: int, start: tuple[float, float], per_s: tuple[float, float]) -> np.ndarray:
    return np.array(start) + np.arange(n)[:, None] * STEP * np.array(per_s)


def test_places_and_velocities_of_the_picture():
    seen = stage({3: line(20, (100, 200), (50, -20)), 8: line(10, (500, 300), (0, 30))})
    found = in_pixels(seen, 0.02).tracks
    np.testing.assert_allclose(found.xy_m[0], [2.0, -4.0])
    first = found.track == 3
    # To the right and up: up is forward.
    np.testing.assert_allclose(found.velocity_mps[first], np.tile([1.0, 0.4], (20, 1)), atol=1e-9)
    np.testing.assert_allclose(found.velocity_mps[~first], np.tile([0, -0.6], (10, 1)), atol=1e-9)
    np.testing.assert_allclose(found.heading_rad[first], np.arctan2(0.4, 1.0))
    np.testing.assert_allclose(found.heading_rad[~first], -np.pi / 2)


def test_nothing_of_the_ground_is_left():
    moved = in_pixels(stage({1: line(5, (100, 200), (10, 0))}), 0.02)
    assert moved.camera_factor is None
    for column in ("xy_m", "covariance_m2", "velocity_mps", "velocity_covariance", "heading_rad"):
        assert not (getattr(moved.tracks, column) == 7.0).any(), column
    assert not moved.tracks.shared_covariance_m2.any()


def test_a_left_turn_stays_a_left_turn():
    angle = np.linspace(0, np.pi / 2, 30)
    # On the ground and in the picture: to the right first, then away, which is up.
    feet = np.column_stack([300 + 100 * np.sin(angle), 400 - 100 * (1 - np.cos(angle))])
    heading = in_pixels(stage({1: feet}), 0.02).tracks.heading_rad
    assert heading[0] == pytest.approx(0, abs=0.2)
    assert heading[-1] == pytest.approx(np.pi / 2, abs=0.2)
    assert (np.diff(heading) > -1e-9).all()


def test_the_errors_are_those_of_a_line_through_noise():
    rng = np.random.default_rng(0)
    height = 50.0
    clean = line(21, (100, 200), (30, 10))
    middle = []
    for _ in range(400):
        noisy = clean + rng.normal(0, NOISE_SHARE * height, clean.shape)
        found = in_pixels(stage({1: noisy}, height), 0.02)
        middle.append(found.tracks.velocity_mps[10])
    expected = in_pixels(stage({1: clean}, height), 0.02).tracks.velocity_covariance[10]
    np.testing.assert_allclose(np.cov(np.array(middle).T), expected, atol=0.25 * expected[0, 0])


def test_who_stands_keeps_the_last_heading():
    walks, stands = line(10, (100, 200), (50, 0)), np.tile([190.0, 200.0], (20, 1))
    found = in_pixels(stage({1: np.vstack([walks, stands])}), 0.02).tracks
    np.testing.assert_allclose(found.heading_rad[12:], found.heading_rad[12])
    assert found.heading_rad[-1] == pytest.approx(0.0, abs=0.1)
    first = in_pixels(stage({1: np.vstack([stands, stands[-1] + walks - walks[0]])}), 0.02).tracks
    assert first.heading_rad[0] == pytest.approx(0.0, abs=0.1)
    never = in_pixels(stage({1: stands, 2: walks}), 0.02).tracks
    assert np.isnan(never.heading_rad[never.track == 1]).all()


def test_gaps_and_lonely_rows_have_no_velocity():
    feet = line(12, (100, 200), (50, 0))
    feet[5] = np.nan
    found = in_pixels(stage({1: feet, 2: feet[:1]}), 0.02).tracks
    assert np.isnan(found.xy_m[5]).all()
    assert np.isnan(found.velocity_mps[5]).all()
    np.testing.assert_allclose(found.velocity_mps[4], [1.0, 0.0], atol=1e-9)
    assert np.isnan(found.velocity_mps[12]).all()


def test_the_factor_is_a_length():
    with pytest.raises(InputError, match="metres_per_px"):
        in_pixels(stage({1: line(3, (1, 60), (1, 1))}), 0.0)


def test_by_box_sizes_what_looks_twice_as_large_moves_half_as_fast():
    feet = line(20, (100, 200), (50, -20))
    near, far = (in_box_sizes(stage({1: feet}, height), 2.5).tracks for height in (100.0, 50.0))
    np.testing.assert_allclose(near.velocity_mps * 2, far.velocity_mps)
    # 50 px high and 20 px wide: a metre is 12.65 px.
    np.testing.assert_allclose(
        far.velocity_mps[5], np.array([50.0, 20.0]) * 2.5 / np.sqrt(1000), rtol=1e-9
    )
    np.testing.assert_allclose(near.heading_rad, far.heading_rad)


def test_the_ends_of_tracks():
    seen = stage({3: line(21, (100, 200), (50, 0)), 8: line(11, (500, 300), (0, 30))})
    spans, score, track = track_ends(seen, ("person",), 3.0, at_end=True)
    np.testing.assert_allclose(spans, [[1.0, 4.0], [-1.0, 2.0]])
    assert track.tolist() == [3, 8]
    assert score[1] > score[0]
    spans, _, _ = track_ends(seen, ("person",), 3.0, at_end=False)
    np.testing.assert_allclose(spans, [[0.0, 3.0], [0.0, 3.0]])
    assert len(track_ends(seen, ("car",), 3.0, at_end=True)[0]) == 0


def test_an_empty_stage():
    nobody = stage({1: line(3, (1, 60), (1, 1))})
    empty = Stage(nobody.tracks.select(np.zeros(3, bool)), (640, 480), STEP)
    assert len(in_pixels(empty, 0.02).tracks) == 0


ROLES = (Role("person", ("person",)), Role("vehicle", ("car",)))
NEAR = Term("near", ("person", "vehicle"), {"tau_m": 3.0})
MOVING = Term("moving", ("person",))


def test_near_alone():
    activity = Activity(
        "x",
        ROLES,
        (
            Phase("a", (NEAR, MOVING), 1.0, 2.0),
            Phase("b", (MOVING,), 1.0, 4.0, 0.5),
            Phase("c", (NEAR,), 1.0, 3.0, 0.25),
        ),
        phrases=("x happens",),
        labels=("X",),
    )
    alone = near_alone(activity)
    assert [(p.name, p.terms, p.min_s, p.max_s, p.gap_s) for p in alone.phases] == [
        ("a", (NEAR,), 1, np.inf, 0),
        ("c", (NEAR,), 1, np.inf, 4.75),
    ]
    assert (alone.name, alone.roles, alone.labels) == ("x", ROLES, ("X",))


@pytest.mark.parametrize("terms", [(MOVING,), (Term("near", ("person", "vehicle"), negated=True),)])
def test_what_says_nothing_of_nearness(terms):
    assert near_alone(Activity("x", ROLES, (Phase("a", terms),))) is None


def test_a_phase_that_is_left_out_at_the_beginning_takes_no_time():
    activity = Activity(
        "x", ROLES, (Phase("a", (MOVING,), 1.0, 9.0), Phase("b", (NEAR,), 1.0, 2.0, 3.0))
    )
    assert near_alone(activity).phases[0].gap_s == 0.0
