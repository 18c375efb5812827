"""Rigid fits: exact where they can be, proper rotations always, and never beaten."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.spatial.transform import Rotation

from scene4d.core.geometry import is_rotation, rigid_fit

SEED = st.integers(0, 2**32 - 1)
DIMENSION = st.sampled_from([2, 3])


def random_rotation(d: int, rng: np.random.Generator) -> np.ndarray:
    if d == 3:
        return Rotation.random(rng=rng).as_matrix()
    angle = rng.uniform(-np.pi, np.pi)
    c, s = np.cos(angle), np.sin(angle)
    return np.array([[c, -s], [s, c]])


def cost(R, t, source, target):
    return np.sum((source @ R.T + t - target) ** 2)


def is_proper(R: np.ndarray) -> bool:
    return np.allclose(R @ R.T, np.eye(len(R)), atol=1e-9) and np.linalg.det(R) > 0


@given(seed=SEED, d=DIMENSION, n=st.integers(4, 20), scale=st.sampled_from([1e-3, 1.0, 1e5]))
def test_a_moved_point_set_is_moved_back(seed, d, n, scale):
    rng = np.random.default_rng(seed)
    R, t = random_rotation(d, rng), scale * rng.uniform(-100, 100, d)
    source = scale * rng.normal(size=(n, d)) + scale * rng.uniform(-10, 10, d)
    found_R, found_t = rigid_fit(source, source @ R.T + t)
    np.testing.assert_allclose(found_R, R, atol=1e-6)
    np.testing.assert_allclose(source @ found_R.T + found_t, source @ R.T + t, atol=1e-9 * scale)


def test_a_quarter_turn_is_the_one_that_was_made():
    source = np.array([[0.0, 0.0], [2.0, 0.0], [0.0, 1.0]])
    target = np.array([[5.0, 7.0], [5.0, 9.0], [4.0, 7.0]])
    R, t = rigid_fit(source, target)
    np.testing.assert_allclose(R, [[0, -1], [1, 0]], atol=1e-12)
    np.testing.assert_allclose(t, [5, 7], atol=1e-12)


@given(seed=SEED, d=DIMENSION)
def test_the_fewest_points_are_enough(seed, d):
    rng = np.random.default_rng(seed)
    R, t = random_rotation(d, rng), rng.normal(size=d)
    source = rng.normal(size=(d, d))
    found_R, found_t = rigid_fit(source, source @ R.T + t)
    assert is_proper(found_R)
    np.testing.assert_allclose(source @ found_R.T + found_t, source @ R.T + t, atol=1e-9)


@given(seed=SEED, d=DIMENSION)
def test_a_mirrored_set_gets_a_rotation_not_a_mirror(seed, d):
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(8, d)) * np.arange(1, d + 1)
    mirror = np.eye(d)
    mirror[0, 0] = -1
    target = source @ mirror.T
    R, t = rigid_fit(source, target)
    assert is_proper(R)
    # A mirror would fit exactly; no rotation does.
    assert cost(R, t, source, target) > 1e-3


def test_the_mirrored_plane_has_the_known_best_rotation():
    # Spread 4 along x and 1 along y, mirrored in y: turning costs more than leaving y wrong.
    source = np.array([[4.0, 0], [-4, 0], [0, 1], [0, -1]])
    R, t = rigid_fit(source, source * [1, -1])
    np.testing.assert_allclose(R, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(t, 0, atol=1e-12)


@given(seed=SEED, d=DIMENSION, mirrored=st.booleans())
def test_no_other_rigid_motion_fits_better(seed, d, mirrored):
    rng = np.random.default_rng(seed)
    source = rng.normal(size=(12, d)) * 5
    target = source @ random_rotation(d, rng).T + rng.normal(size=d) + rng.normal(size=(12, d))
    if mirrored:
        target = target * np.array([-1.0] + [1.0] * (d - 1))
    R, t = rigid_fit(source, target)
    best = cost(R, t, source, target)
    for size in (1e-3, 1e-2, 0.1, 1.0):
        for _ in range(5):
            turn = random_rotation(d, rng)
            if d == 3:
                turn = Rotation.from_rotvec(size * rng.normal(size=3)).as_matrix()
            elif size < 1:
                a = size * rng.normal()
                turn = np.array([[np.cos(a), -np.sin(a)], [np.sin(a), np.cos(a)]])
            other = turn @ R
            assert cost(other, t + size * rng.normal(size=d), source, target) >= best - 1e-9
            moved = target.mean(axis=0) - other @ source.mean(axis=0)
            assert cost(other, moved, source, target) >= best - 1e-9


def test_three_dimensions_against_scipy():
    rng = np.random.default_rng(3)
    source, noise = rng.normal(size=(30, 3)), 0.3 * rng.normal(size=(30, 3))
    target = Rotation.from_rotvec([0.3, -1.0, 2.0]).apply(source) + noise
    expected, _ = Rotation.align_vectors(target - target.mean(axis=0), source - source.mean(axis=0))
    R, _ = rigid_fit(source, target)
    np.testing.assert_allclose(R, expected.as_matrix(), atol=1e-9)


def test_scale_is_not_fitted():
    source = np.array([[0.0, 0], [1, 0], [0, 1], [1, 1]])
    R, t = rigid_fit(source, 3 * source)
    np.testing.assert_allclose(R, np.eye(2), atol=1e-12)
    np.testing.assert_allclose(t, [1, 1], atol=1e-12)


@pytest.mark.parametrize("points", [np.zeros((5, 3)), np.outer(np.arange(5.0), [1, 2, 3])])
def test_degenerate_sets_still_get_a_rotation(points):
    R, t = rigid_fit(points, points + 1)
    assert is_rotation(R)
    np.testing.assert_allclose(points @ R.T + t, points + 1, atol=1e-9)


@pytest.mark.parametrize(("n", "d"), [(0, 2), (1, 2), (2, 3)])
def test_too_few_points_are_counted(n, d):
    with pytest.raises(ValueError, match=f"at least {d} points, found {n}"):
        rigid_fit(np.zeros((n, d)), np.zeros((n, d)))


@pytest.mark.parametrize("bad", [np.nan, np.inf])
@pytest.mark.parametrize("side", [0, 1])
def test_points_that_are_no_numbers_are_refused(bad, side):
    sets = [np.arange(6.0).reshape(3, 2), np.arange(6.0).reshape(3, 2)]
    sets[side][1, 0] = bad
    with pytest.raises(ValueError, match="finite"):
        rigid_fit(*sets)
