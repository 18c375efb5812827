"""The point where uprights meet, and the orientation it implies."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core import geometry
from scene4d.core.geometry import meeting_point, tilt_roll_from_vertical
from strategies import build_camera, build_lens, cameras, cameras_over_people, lenses, people_scene

SEED = st.integers(0, 2**32 - 1)
SQUARE = lenses(distorted=False, square=True)


def lines_through(point: np.ndarray, n: int, rng: np.random.Generator):
    """Segments whose lines meet in ``point``, in an image of about 1000 px."""
    start = rng.uniform(0, 1000, (n, 2))
    way = point - start
    return start, start + way * (rng.uniform(20, 200, n) / np.hypot(*way.T))[:, None]


@given(seed=SEED, n=st.integers(3, 30), x=st.floats(-5e3, 5e3), y=st.floats(2e3, 2e4))
def test_lines_through_one_point_meet_there(seed, n, x, y):
    start, end = lines_through(np.array([x, y]), n, np.random.default_rng(seed))
    found = meeting_point(start, end)
    np.testing.assert_allclose(found[:2] / found[2], [x, y], rtol=1e-5, atol=1e-2)


def test_two_lines_meet_in_their_intersection():
    found = meeting_point(np.array([[0.0, 0], [10, 0]]), np.array([[1.0, 1], [9, 1]]))
    np.testing.assert_allclose(found / found[2], [5, 5, 1], atol=1e-12)


@given(seed=SEED, unit=st.sampled_from([1e-4, 1e-2, 1e3, 1e6]), shift=st.floats(-1e3, 1e3))
def test_the_unit_of_the_pixels_does_not_matter(seed, unit, shift):
    rng = np.random.default_rng(seed)
    start, end = lines_through(np.array([400.0, 3000.0]), 20, rng)
    end = end + rng.normal(size=end.shape)
    here = meeting_point(start, end)
    there = meeting_point(unit * (start + shift), unit * (end + shift))
    expected = unit * (here[:2] / here[2] + shift)
    np.testing.assert_allclose(there[:2] / there[2], expected, rtol=1e-6)


@given(seed=SEED)
def test_which_end_comes_first_does_not_matter(seed):
    rng = np.random.default_rng(seed)
    start, end = lines_through(np.array([400.0, 3000.0]), 12, rng)
    end = end + rng.normal(size=end.shape)
    swap = rng.random(12)[:, None] < 0.5
    here = meeting_point(start, end)
    there = meeting_point(np.where(swap, end, start), np.where(swap, start, end))
    np.testing.assert_allclose(np.cross(here, there) / np.linalg.norm(here) ** 2, 0, atol=1e-9)


def test_parallel_lines_meet_at_infinity():
    start = np.array([[0.0, 0], [500, 30], [900, 80]])
    found = meeting_point(start, start + np.array([3.0, 40.0]))
    found = found / np.linalg.norm(found)
    assert abs(found[2]) < 1e-12
    np.testing.assert_allclose(np.abs(found[:2]), np.array([3, 40]) / np.hypot(3, 40), atol=1e-9)


def noisy_lines() -> tuple[np.ndarray, np.ndarray]:
    """Six lines that nearly meet; opposite segments (0, 5), (1, 4), (2, 3) balance each other.

    Their midpoints average to (500, 300) whichever pairs are taken, and 0 and 5 reach farthest, so
    that the frame of the points, in which the algebraic error is measured, stays as it is.
    """
    middle = np.array([[0, 0], [200, 100], [420, 450], [580, 150], [800, 500], [1000, 600]])
    way = np.array([[30, 60], [-8, 50], [-3, 40], [5, 45], [2, 55], [25, 80]]) / 2.0
    return middle - way, middle + way


def test_weight_zero_is_absence_and_weight_two_is_twice():
    start, end = noisy_lines()
    for weight in ([2, 1, 1, 1, 1, 2], [1, 3, 1, 1, 3, 1], [1, 1, 0, 0, 1, 1]):
        rows = np.repeat(np.arange(6), weight)
        weighted = meeting_point(start, end, np.array(weight, float))
        repeated = meeting_point(start[rows], end[rows])
        np.testing.assert_allclose(weighted[:2] / weighted[2], repeated[:2] / repeated[2])
        plain = meeting_point(start, end)
        assert np.hypot(*(weighted[:2] / weighted[2] - plain[:2] / plain[2])) > 1


def test_the_length_of_a_segment_is_no_weight():
    start, end = noisy_lines()
    middle, short = (start + end) / 2, np.array([1, 0.1, 1, 0.5, 0.3, 1])[:, None]
    here = meeting_point(start, end)
    there = meeting_point(middle + short * (start - middle), middle + short * (end - middle))
    np.testing.assert_allclose(here[:2] / here[2], there[:2] / there[2])


@pytest.mark.parametrize("n", [0, 1])
def test_one_segment_meets_nothing(n):
    with pytest.raises(ValueError, match=f"at least 2 segments, found {n}"):
        meeting_point(np.zeros((n, 2)), np.ones((n, 2)))


@given(camera=cameras(SQUARE, anywhere=True), sign=st.sampled_from([-1.0, 1.0, 1e3, -1e-3]))
def test_orientation_from_the_vertical_is_the_camera_s(camera, sign):
    point = sign * geometry.vertical_vanishing_point(camera.K, camera.R)
    tilt, roll = tilt_roll_from_vertical(point, float(camera.focal_px), camera.K[:2, 2].copy())
    assert tilt == pytest.approx(camera.tilt_rad, abs=1e-9)
    assert roll == pytest.approx(camera.roll_rad, abs=1e-9)


def test_verticals_that_are_parallel_mean_a_level_camera():
    leaning = np.array([np.sin(0.1), -np.cos(0.1), 0.0])
    tilt, roll = tilt_roll_from_vertical(leaning, 800.0, np.array([320.0, 240.0]))
    assert tilt == pytest.approx(0, abs=1e-12)
    assert roll == pytest.approx(0.1)


def test_camera_that_looks_up_has_a_negative_tilt():
    K = build_lens((640, 480)).K
    R = geometry.rotation_from_tilt_roll(-0.2, 0.05)
    point = geometry.vertical_vanishing_point(K, R)
    found = tilt_roll_from_vertical(point, float(K[0, 0]), K[:2, 2].copy())
    np.testing.assert_allclose(found, [-0.2, 0.05], atol=1e-12)


@given(camera=cameras_over_people(), seed=SEED)
def test_people_without_noise_give_tilt_and_roll(camera, seed):
    scene = people_scene(camera, 40, np.random.default_rng(seed), noise=0.0, noise_px=0.0)
    point = meeting_point(scene.foot_uv, scene.head_uv)
    tilt, roll = tilt_roll_from_vertical(point, float(camera.focal_px), camera.K[:2, 2].copy())
    assert tilt == pytest.approx(camera.tilt_rad, abs=1e-4)
    assert roll == pytest.approx(camera.roll_rad, abs=1e-4)


def test_noise_spreads_the_tilt_within_a_band():
    """Two-sided, in degrees: 60 crowds of 100 people whose ends are half a pixel off."""
    camera = build_camera(build_lens((1920, 1080), 50.0), 30.0, 3.0, 6.0)
    errors = []
    for seed in range(60):
        scene = people_scene(camera, 100, np.random.default_rng(seed), noise=0.0, noise_px=0.5)
        length = np.hypot(*(scene.foot_uv - scene.head_uv).T)
        point = meeting_point(scene.foot_uv, scene.head_uv, length**2)
        found = tilt_roll_from_vertical(point, float(camera.focal_px), camera.K[:2, 2].copy())
        errors.append(np.degrees(np.array(found) - [camera.tilt_rad, camera.roll_rad]))
    spread = np.std(errors, axis=0)
    assert 0.02 < spread[0] < 0.08
    assert 0.008 < spread[1] < 0.03
    assert (np.abs(np.mean(errors, axis=0)) < 4 * spread / np.sqrt(60)).all()
