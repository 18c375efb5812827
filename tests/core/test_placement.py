"""Placements: a group of motions, with covariances that a numerical derivative confirms."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.core.placement import PLACED, Drift, Placement
from strategies import build_camera

FAR = st.floats(-200.0, 200.0)
ANGLE = st.floats(-3.0, 3.0)
SEED = st.integers(0, 2**32 - 1)


def build(x, y, heading, log_scale, offset, seed) -> Placement:
    factor = 0.1 * np.random.default_rng(seed).normal(size=(5, 5))
    return Placement.from_parameters(
        np.array([x, y, heading, log_scale, offset]), factor @ factor.T
    )


PLACEMENTS = st.builds(build, FAR, FAR, ANGLE, st.floats(-0.7, 0.7), FAR, SEED)
POINTS = st.tuples(SEED, st.integers(1, 5)).map(
    lambda drawn: np.random.default_rng(drawn[0]).uniform(-50, 50, (drawn[1], 2))
)


def derivative(function, at: np.ndarray) -> np.ndarray:
    """Central differences of a vector function, one column per parameter."""
    steps = 1e-5 * np.eye(len(at))
    return np.column_stack([(function(at + d) - function(at - d)) / 2e-5 for d in steps])


def moved(parameters: np.ndarray) -> Placement:
    return Placement.from_parameters(parameters, np.zeros((5, 5)))


def unwound(placement: Placement, near: Placement) -> np.ndarray:
    """Parameters with the heading on the same turn as another's."""
    found = placement.parameters
    found[2] = near.heading_rad + (found[2] - near.heading_rad + np.pi) % (2 * np.pi) - np.pi
    return found


@given(PLACEMENTS, POINTS)
def test_there_and_back_is_where_one_was(placement, xy):
    back = placement.inverse()
    np.testing.assert_allclose(back.points(placement.points(xy)), xy, atol=1e-9)
    np.testing.assert_allclose(back.velocities(placement.velocities(xy)), xy, atol=1e-9)
    np.testing.assert_allclose(back.times(placement.times(xy[:, 0])), xy[:, 0], atol=1e-9)
    whole = placement.then(back)
    np.testing.assert_allclose(whole.parameters, np.zeros(5), atol=1e-9)


RATES = st.floats(-0.01, 0.01)
DRIFTS = st.none() | st.builds(Drift, RATES, st.floats(0, 1e-4), FAR)


@given(PLACEMENTS, PLACEMENTS, DRIFTS, DRIFTS, POINTS)
def test_clocks_that_drift_go_there_and_back_and_through_another(inner, outer, one, other, xy):
    inner, outer, time_s = replace(inner, drift=one), replace(outer, drift=other), xy[:, 0]
    back = inner.inverse().times(inner.times(time_s))
    np.testing.assert_allclose(back, time_s, atol=1e-9)
    both = inner.then(outer)
    np.testing.assert_allclose(both.times(time_s), outer.times(inner.times(time_s)), atol=1e-9)
    assert (both.drift is None) == (one is None and other is None)


@given(PLACEMENTS, PLACEMENTS, POINTS)
def test_composing_is_mapping_twice(inner, outer, xy):
    both = inner.then(outer)
    np.testing.assert_allclose(both.points(xy), outer.points(inner.points(xy)), atol=1e-8)
    turned = outer.headings(inner.headings(xy[:, 0] / 50))
    np.testing.assert_allclose(np.exp(1j * both.headings(xy[:, 0] / 50)), np.exp(1j * turned))
    np.testing.assert_allclose(both.times(xy[:, 0]), outer.times(inner.times(xy[:, 0])), atol=1e-9)


@given(PLACEMENTS)
def test_the_covariance_of_an_inverse_is_that_of_its_derivative(placement):
    inverse = placement.inverse()
    J = derivative(lambda at: unwound(moved(at).inverse(), inverse), placement.parameters)
    np.testing.assert_allclose(
        inverse.covariance, J @ placement.covariance @ J.T, rtol=1e-4, atol=1e-3
    )


@given(PLACEMENTS, PLACEMENTS)
def test_the_covariance_of_two_in_a_row_is_that_of_both_derivatives(inner, outer):
    both = inner.then(outer)
    J = derivative(lambda at: unwound(moved(at).then(outer), both), inner.parameters)
    K = derivative(lambda at: unwound(inner.then(moved(at)), both), outer.parameters)
    expected = J @ inner.covariance @ J.T + K @ outer.covariance @ K.T
    np.testing.assert_allclose(both.covariance, expected, rtol=1e-4, atol=1e-3)


@given(PLACEMENTS, POINTS, SEED)
def test_points_err_by_the_place_the_scale_and_the_clock(placement, xy, seed):
    velocity = np.random.default_rng(seed).uniform(-5, 5, xy.shape)

    def seen(at: np.ndarray) -> np.ndarray:
        """Where everybody is at one moment of the site's clock."""
        there = moved(at)
        ago_s = there.time_offset_s - placement.time_offset_s
        return there.points(xy - ago_s * velocity).ravel()

    J = derivative(seen, placement.parameters).reshape(len(xy), 2, 5)
    np.testing.assert_allclose(placement.point_jacobian(xy, velocity), J, rtol=1e-5, atol=1e-4)
    expected = J @ placement.covariance @ J.swapaxes(1, 2)
    np.testing.assert_allclose(
        placement.point_covariances(xy, velocity), expected, rtol=1e-3, atol=1e-3
    )
    standing = placement.point_covariances(xy)
    np.testing.assert_allclose(standing, placement.point_covariances(xy, 0 * velocity))


@given(PLACEMENTS, POINTS)
def test_velocities_err_by_the_heading_and_the_scale(placement, velocity):
    J = derivative(lambda at: moved(at).velocities(velocity).ravel(), placement.parameters)
    J = J.reshape(len(velocity), 2, 5)
    expected = J @ placement.covariance @ J.swapaxes(1, 2)
    found = placement.velocity_covariances(velocity)
    np.testing.assert_allclose(found, expected, rtol=1e-4, atol=1e-4)


def test_a_sample_of_placements_has_the_covariance_that_is_told():
    placement = build(30.0, -12.0, 2.0, 0.1, 7.3, 0)
    small = 1e-6 * placement.covariance
    drawn = np.random.default_rng(0).multivariate_normal(placement.parameters, small, 1000)
    at = np.array([[7.0, 20.0]])
    there = np.array([moved(parameters).points(at)[0] for parameters in drawn])
    told = 1e-6 * placement.point_covariances(at)[0]
    assert 0.9 < np.trace(np.cov(there.T)) / np.trace(told) < 1.1


def test_one_placement_worked_out_by_hand():
    quarter = Placement(10.0, 0.0, np.pi / 2, 2.0, 7.3, np.diag([1.0, 4.0, 0.01, 0.0, 0.25]))
    np.testing.assert_allclose(quarter.points(np.array([[1.0, 3.0]])), [[4.0, 2.0]])
    np.testing.assert_allclose(quarter.times(np.array([1.0])), [8.3])
    assert quarter.sigma == pytest.approx(
        {"x_m": 1.0, "y_m": 2.0, "heading_rad": 0.1, "scale": 0.0, "time_offset_s": 0.5}
    )
    found = quarter.point_covariances(np.array([[1.0, 3.0]]), np.array([[0.0, 1.0]]))
    np.testing.assert_allclose(found, [[[1 + 0.04 + 1, 0.12], [0.12, 4 + 0.36]]], atol=1e-12)
    np.testing.assert_allclose(quarter.heading_sigmas(np.array([0.1])), [np.sqrt(0.02)])
    assert PLACED[2] == "heading_rad"


@given(PLACEMENTS)
def test_a_camera_in_the_site_sees_the_same_picture(placement):
    camera = build_camera(tilt_deg=25.0, roll_deg=2.0, height_m=5.0)
    ground = np.array([[0.0, 8.0], [3.0, 12.0], [-2.0, 15.0]])
    head = np.column_stack([ground, [0.0, 1.7, 1.0]])
    uv, valid = camera.project(head)
    in_site = np.column_stack([placement.points(ground), placement.scale * head[:, 2]])
    again, seen = placement.camera(camera).project(in_site)
    assert valid.all() and seen.all()
    np.testing.assert_allclose(again, uv, atol=1e-5)


def test_what_is_undetermined_puts_nothing_anywhere():
    nowhere = Placement.undetermined("it shares nobody with another camera")
    assert not nowhere and nowhere.reason
    assert np.isnan(nowhere.points(np.ones((2, 2)))).all()
    assert np.isnan(nowhere.times(np.ones(2))).all()
    assert nowhere.inverse() is nowhere
    assert nowhere.then(Placement.identity()) is nowhere
    assert Placement.identity().then(nowhere) is nowhere
    with pytest.raises(InputError, match="shares nobody"):
        nowhere.camera(build_camera())


@pytest.mark.parametrize(
    ("values", "word"),
    [
        ((0.0, 0.0, 0.0, 0.0, 0.0), "positive"),
        ((0.0, 0.0, 0.0, -1.0, 0.0), "positive"),
        ((np.nan, 0.0, 0.0, 1.0, 0.0), "finite"),
        ((0.0, 0.0, 0.0, 1.0, np.inf), "finite"),
    ],
)
def test_impossible_numbers_are_refused(values, word):
    with pytest.raises(InputError, match=word):
        Placement(*values)


def test_an_undetermined_placement_says_why():
    with pytest.raises(InputError, match="reason"):
        Placement(*[float("nan")] * 5, status="undetermined")
