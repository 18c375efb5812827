"""P(near): the paper's curve, and its expectation where the distance is uncertain."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.integrate import quad
from scipy.special import erf
from scipy.stats import norm

from scene4d.core.errors import InputError
from scene4d.searching.predicates import NEAR_SIGMA_M, NEAR_TAU_M, near_probability

ONE_SIGMA = 0.8413447460685429
"""Φ(1), from tables."""
METRES = st.floats(0.0, 1e6)
SPREAD = st.floats(0.0, 100.0)


def test_the_papers_threshold_is_the_default():
    assert NEAR_TAU_M == 4.0
    assert NEAR_SIGMA_M == 1.0


def test_values_by_hand():
    found = near_probability(np.array([4.0, 3.0, 5.0, 2.0, np.inf]))
    np.testing.assert_allclose(
        found, [0.5, ONE_SIGMA, 1 - ONE_SIGMA, 0.9772498680518208, 0.0], rtol=1e-12
    )


def test_tau_and_sigma_are_in_metres():
    found = near_probability(np.array([10.0, 8.0, 12.0]), tau_m=10.0, sigma_m=2.0)
    np.testing.assert_allclose(found, [0.5, ONE_SIGMA, 1 - ONE_SIGMA], rtol=1e-12)


@given(d=METRES, tau=METRES, sigma=st.floats(1e-3, 100.0))
def test_it_is_the_formula_of_the_paper(d, tau, sigma):
    paper = 0.5 * (1 - erf((d - tau) / (np.sqrt(2) * sigma)))
    found = near_probability(np.array([d]), tau_m=tau, sigma_m=sigma)
    np.testing.assert_allclose(found, [paper], rtol=1e-9, atol=1e-12)


@pytest.mark.parametrize("d", [0.5, 3.0, 4.0, 7.5])
@pytest.mark.parametrize(("sigma", "s"), [(1.0, 0.4), (0.3, 1.5), (2.0, 2.0)])
def test_the_expectation_is_the_integral(d, sigma, s):
    """The paper's curve averaged over a Gaussian distance, by quadrature."""
    over = norm(d, s)
    value, error = quad(
        lambda x: 0.5 * (1 - erf((x - 4.0) / (np.sqrt(2) * sigma))) * over.pdf(x),
        d - 12 * s,
        d + 12 * s,
        points=[4.0, d],
    )
    assert error < 1e-6
    found = near_probability(np.array([d]), sigma_m=sigma, distance_sigma_m=s)
    assert found[0] == pytest.approx(value, abs=1e-7)


def test_the_expectation_is_the_mean_of_draws():
    """Two-sided, within four standard errors of 40,000 draws."""
    rng = np.random.default_rng(3)
    d, s = np.array([2.0, 4.0, 6.0, 9.0]), np.array([2.0, 0.5, 1.5, 3.0])
    draws = near_probability(d + s * rng.normal(size=(40_000, 4)))
    band = 4 * draws.std(axis=0) / np.sqrt(len(draws))
    found = near_probability(d, distance_sigma_m=s)
    assert (np.abs(draws.mean(axis=0) - found) < band).all()
    # The band is narrow enough to tell the expectation from the value at the mean.
    taken_as_exact = np.abs(draws.mean(axis=0) - near_probability(d))
    assert (taken_as_exact[[0, 2, 3]] > band[[0, 2, 3]]).all()


def test_without_softness_it_is_the_probability_of_being_below_tau():
    rng = np.random.default_rng(4)
    d, s = np.array([3.0, 4.5, 6.0]), 1.3
    share = np.mean(d + s * rng.normal(size=(40_000, 3)) < 4.0, axis=0)
    found = near_probability(d, sigma_m=0.0, distance_sigma_m=s)
    np.testing.assert_allclose(found, share, atol=4 * 0.5 / np.sqrt(40_000))


def test_without_any_spread_it_is_a_step():
    d = np.array([0.0, np.nextafter(4.0, 0), 4.0, np.nextafter(4.0, 5), np.inf])
    np.testing.assert_array_equal(near_probability(d, sigma_m=0.0), [1, 1, 0.5, 0, 0])
    # Exact and uncertain distances in one array.
    mixed = near_probability(
        np.array([3.0, 3.0]), sigma_m=0.0, distance_sigma_m=np.array([0.0, 1.0])
    )
    np.testing.assert_allclose(mixed, [1.0, ONE_SIGMA])


@given(
    d=st.lists(st.floats(0.0, np.inf), min_size=2, max_size=8), tau=METRES, sigma=SPREAD, s=SPREAD
)
def test_it_is_a_probability_that_falls_with_distance(d, tau, sigma, s):
    found = near_probability(np.sort(np.array(d)), tau_m=tau, sigma_m=sigma, distance_sigma_m=s)
    assert ((found >= 0) & (found <= 1)).all()
    assert (np.diff(found) <= 0).all()


@given(d=METRES, s=st.floats(0.01, 100.0), more=st.floats(0.01, 100.0))
def test_doubt_draws_it_towards_a_half(d, s, more):
    sure, unsure = (
        float(near_probability(np.array([d]), distance_sigma_m=x)[0]) for x in (s, s + more)
    )
    assert abs(unsure - 0.5) <= abs(sure - 0.5)


def test_what_is_unknown_stays_unknown():
    np.testing.assert_array_equal(
        np.isnan(near_probability(np.array([np.nan, 1.0, np.nan]))), [True, False, True]
    )
    spread = np.array([np.nan, np.nan, 0.5])
    found = near_probability(np.array([3.0, 4.0, 4.0]), distance_sigma_m=spread)
    np.testing.assert_array_equal(found, [np.nan, np.nan, 0.5])


@pytest.mark.parametrize("shape", [(), (0,), (3,), (2, 3), (2, 1, 4)])
def test_any_shape_comes_back(shape):
    found = near_probability(np.full(shape, 3.0), distance_sigma_m=np.zeros(shape))
    assert isinstance(found, np.ndarray)
    assert found.shape == shape
    np.testing.assert_allclose(found, ONE_SIGMA)


@pytest.mark.parametrize("number", [3.0, np.float64(3.0)])
def test_a_number_is_an_array_without_axes(number):
    found = near_probability(number)
    assert found.shape == ()
    assert float(found) == pytest.approx(ONE_SIGMA)


@pytest.mark.parametrize(
    ("bad", "message"),
    [
        ({"sigma_m": -1.0}, "sigma_m must be finite and not negative, found -1.0"),
        ({"sigma_m": np.nan}, "sigma_m must be .* found nan"),
        ({"sigma_m": np.inf}, "sigma_m must be .* found inf"),
        ({"distance_sigma_m": -0.1}, "distance_sigma_m must be .* found -0.1"),
        ({"distance_sigma_m": np.array([0.1, -0.2])}, "distance_sigma_m must be .* found -0.2"),
        ({"distance_sigma_m": np.array([np.inf, 0.2])}, "distance_sigma_m must be .* found inf"),
        ({"tau_m": np.nan}, "tau_m must be a distance in metres, found nan"),
        ({"tau_m": np.inf}, "tau_m must be a distance in metres, found inf"),
    ],
)
def test_bad_spreads_are_refused(bad, message):
    with pytest.raises(InputError, match=message):
        near_probability(np.array([3.0, 4.0]), **bad)
