"""The fast P(near) of all pairs against the exact one."""

import tracemalloc

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.searching.predicates import near_pairs, near_probability, pairs

SHAPES = [(1, 1, 1), (3, 5, 1), (40, 30, 7), (5, 3, 200), (2, 2, 1500), (300, 400, 1)]


def covariances(shape, rng) -> np.ndarray:
    root = 0.5 * rng.normal(size=(*shape, 2, 2))
    return root @ root.swapaxes(-1, -2)


def exact(a, b, of_a=None, of_b=None, **how) -> np.ndarray:
    away = a[:, None] - b[None]
    d = np.linalg.norm(away, axis=-1)
    if of_a is None:
        return near_probability(d, **how)
    u = away / d[..., None]
    spread = np.einsum("...i,...ij,...j->...", u, of_a[:, None] + of_b[None], u)
    return near_probability(d, distance_sigma_m=np.sqrt(spread), **how)


@pytest.mark.parametrize("shape", SHAPES)
@pytest.mark.parametrize("centre_m", [0.0, 1e5])
@pytest.mark.parametrize("doubted", [False, True])
def test_it_is_the_exact_one_to_a_millionth(shape, centre_m, doubted):
    rng = np.random.default_rng(5)
    n, m, f = shape
    a, b = (rng.uniform(-15, 15, (k, f, 2)) + centre_m for k in (n, m))
    of_a, of_b = (covariances((k, f), rng) for k in (n, m)) if doubted else (None, None)
    found = near_pairs(a, b, covariance_a=of_a, covariance_b=of_b)
    assert found.shape == shape
    assert found.dtype == np.float32
    np.testing.assert_allclose(found, exact(a, b, of_a, of_b), atol=1e-6, rtol=0)


@pytest.mark.parametrize(("tau", "sigma"), [(4.0, 0.4), (10.0, 1.0), (1.5, 0.5), (2.0, 30.0)])
def test_other_thresholds(tau, sigma):
    d = np.linspace(0, 30, 20_000)
    a = np.stack([d, np.zeros_like(d)], axis=1)[None]
    found = near_pairs(a, np.zeros_like(a), tau_m=tau, sigma_m=sigma)[0, 0]
    np.testing.assert_allclose(found, near_probability(d, tau_m=tau, sigma_m=sigma), atol=1e-6)
    assert ((found >= 0) & (found <= 1)).all()


def test_a_kilometre_apart_costs_no_digits():
    a = np.array([[[0.0, 0.0]], [[2000.0, 1000.0]]])
    b = a + np.array([2.3, 2.9])
    np.testing.assert_allclose(near_pairs(a, b), exact(a, b), atol=1e-6)


def test_it_falls_with_distance():
    d = np.linspace(0.0, 12.0, 4_001)
    a = np.stack([d, np.zeros_like(d)], axis=1)[:, None]
    found = near_pairs(a, np.zeros((1, 1, 2)))[:, 0, 0]
    assert np.diff(found).max() <= 1.3e-7  # a digit of single precision


@settings(max_examples=20)
@given(st.integers(0, 2**32 - 1))
def test_where_somebody_is_not_there_it_is_nan_and_only_there(seed):
    rng = np.random.default_rng(seed)
    a, b = rng.uniform(-5, 5, (4, 6, 2)), rng.uniform(-5, 5, (3, 6, 2))
    a[rng.random((4, 6)) < 0.3] = np.nan
    b[rng.random((3, 6)) < 0.3] = np.nan
    found, expected = near_pairs(a, b), exact(a, b)
    np.testing.assert_array_equal(np.isnan(found), np.isnan(expected))
    np.testing.assert_allclose(found, expected, atol=1e-6)


def test_nobody_anywhere():
    nowhere = np.full((2, 3, 2), np.nan)
    assert np.isnan(near_pairs(nowhere, nowhere)).all()
    assert near_pairs(np.empty((0, 3, 2)), nowhere).shape == (0, 2, 3)


def test_in_one_place_the_spread_is_the_mean():
    a = np.zeros((1, 1, 2))
    spread = np.array([[[[4.0, 0.0], [0.0, 9.0]]]])
    found = near_pairs(a, a, covariance_a=spread, covariance_b=spread)
    expected = near_probability(0.0, distance_sigma_m=np.sqrt(13.0))
    assert found.item() == pytest.approx(float(expected), abs=1e-6)


def test_nothing_of_the_size_of_the_result_lies_beside_it():
    a, b = np.zeros((1000, 1, 2)), np.ones((4000, 1, 2))
    tracemalloc.start()
    result = near_pairs(a, b)
    peak = tracemalloc.get_traced_memory()[1]
    tracemalloc.stop()
    assert peak < result.nbytes + 5 * 4 * pairs._BLOCK + 1_000_000


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"sigma_m": 0.0}, "sigma_m must be finite and positive here, found 0.0"),
        ({"tau_m": np.nan}, "tau_m must be a distance"),
        ({"covariance_a": np.zeros((2, 1, 2, 2))}, "of both sides or of neither"),
    ],
)
def test_what_is_refused(bad, message):
    with pytest.raises(InputError, match=message):
        near_pairs(np.zeros((2, 1, 2)), np.zeros((3, 1, 2)), **bad)


def test_infinite_positions_are_refused():
    with pytest.raises(InputError, match="must be finite, or NaN"):
        near_pairs(np.full((1, 1, 2), np.inf), np.zeros((1, 1, 2)))
