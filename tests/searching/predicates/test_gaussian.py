"""Probabilities of Gaussian numbers against independent references."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from scipy.stats import multivariate_normal

from scene4d.searching.predicates._gaussian import (
    above,
    angle_between,
    both_positive,
    direction,
    in_wedge,
)

Z = st.floats(-5.0, 5.0)


@given(h=Z, k=Z, rho=st.floats(-0.99, 0.99))
def test_both_positive_is_scipys_bivariate_normal(h, k, rho):
    expected = multivariate_normal([0, 0], [[1, rho], [rho, 1]]).cdf([h, k])
    found = both_positive(np.array([h]), np.array([k]), np.array([rho]))[0]
    assert found == pytest.approx(expected, abs=2e-4)


@pytest.mark.parametrize("rho", [-1.0, 1.0])
def test_wholly_correlated_values_give_a_probability(rho):
    found = both_positive(np.array([0.5, -2.0, 0.0]), np.array([1.0, 2.0, 0.0]), np.full(3, rho))
    expected = {1.0: [0.691, 0.023, 0.5], -1.0: [0.533, 0.0, 0.0]}[rho]
    np.testing.assert_allclose(found, expected, atol=0.02)


@pytest.mark.parametrize("half_angle", [0.3, np.pi / 4, 1.2])
def test_a_wedge_holds_the_share_of_draws_that_fall_into_it(half_angle):
    rng = np.random.default_rng(1)
    for _ in range(6):
        point, root = rng.normal(size=2), rng.normal(size=(2, 2)) * 0.6
        course = rng.uniform(-np.pi, np.pi)
        axis = np.array([[np.cos(course), np.sin(course)]])
        draws = point + rng.normal(size=(20_000, 2)) @ root.T - 0.4 * axis
        off = np.arctan2(*(draws @ np.column_stack([[-axis[0, 1], axis[0, 0]], axis[0]])).T)
        found = in_wedge(
            point[None],
            (root @ root.T)[None],
            axis,
            apex=0.4,
            half_angle_rad=half_angle,
            axis_sigma_rad=np.zeros(1),
            sigma=1e-6,
        )
        assert found[0] == pytest.approx((np.abs(off) < half_angle).mean(), abs=0.02)


@pytest.mark.parametrize("sigma", [0.05, 0.8, 2.0, 10.0])
def test_angles_on_the_circle(sigma):
    rng = np.random.default_rng(2)
    angle = np.array([-3.1, -1.0, 0.2, 3.0])
    draws = angle + sigma * rng.normal(size=(40_000, 4))
    draws = np.angle(np.exp(1j * draws))
    found = angle_between(angle, np.full(4, sigma), -0.5, 2.0)
    np.testing.assert_allclose(found, ((draws > -0.5) & (draws < 2.0)).mean(axis=0), atol=0.015)
    whole = angle_between(angle, np.full(4, sigma), -np.pi, np.pi)
    np.testing.assert_allclose(whole, 1.0, atol=1e-3)


@given(value=st.floats(-1e3, 1e3), spread=st.floats(0.0, 100.0))
def test_above_and_below_sum_to_one(value, spread):
    first = above(np.array([value]), 2.0, spread, 0.5)
    second = above(np.array([-value]), -2.0, spread, 0.5)
    assert first[0] + second[0] == pytest.approx(1.0)


def test_without_spread_it_is_a_step():
    found = above(np.array([1.0, 2.0, 3.0]), 2.0, 0.0)
    np.testing.assert_array_equal(found, [0.0, 0.5, 1.0])


def test_a_vector_without_length_points_anywhere():
    angle, sigma = direction(
        np.array([[0.0, 0.0], [10.0, 0.0]]), np.tile(0.01 * np.eye(2), (2, 1, 1))
    )
    np.testing.assert_allclose(sigma, [np.pi, 0.01])
    assert angle[1] == 0
