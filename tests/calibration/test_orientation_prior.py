"""The told orientation as a prior: a Gaussian with a correlation of focal length and tilt."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.calibration._body import FOCAL, ROLL, TILT
from scene4d.calibration._prior import default_prior
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation


def told(correlation, focal_sigma=150.0, tilt_sigma=0.05):
    return Orientation(1500.0, 0.3, 0.0, focal_sigma, tilt_sigma, 0.02, correlation)


@given(st.floats(-0.95, 0.95), st.floats(20, 500), st.floats(0.01, 0.2))
def test_precision_is_the_inverse_of_the_covariance(correlation, focal_sigma, tilt_sigma):
    prior = default_prior().with_orientation(told(correlation, focal_sigma, tilt_sigma), 1000.0)
    free = np.flatnonzero(prior.free)
    covariance = np.diag(prior.sigma**2)
    covariance[FOCAL, TILT] = correlation * prior.sigma[FOCAL] * prior.sigma[TILT]
    covariance[TILT, FOCAL] = covariance[FOCAL, TILT]
    precision = prior.precision[np.ix_(free, free)]
    np.testing.assert_allclose(
        precision @ covariance[np.ix_(free, free)], np.eye(len(free)), atol=1e-9
    )
    assert prior.sigma[FOCAL] == pytest.approx(focal_sigma / 1500)


def test_unknown_values_have_no_correlation():
    prior = default_prior().with_orientation(told(0.8, tilt_sigma=np.inf), 1000.0)
    assert prior.focal_tilt_correlation == 0
    assert prior.sigma[TILT] == default_prior().sigma[TILT]
    assert prior.sigma[ROLL] == 0.02
    fixed = default_prior().with_orientation(told(0.8), 1000.0).with_focal(1500.0, 1000.0)
    assert fixed.precision[FOCAL, TILT] == 0
    assert fixed.precision[TILT, TILT] == pytest.approx(1 / 0.05**2)


@pytest.mark.parametrize("correlation", [1.0, -1.5, float("nan")])
def test_impossible_correlations_are_refused(correlation):
    with pytest.raises(InputError, match="focal_tilt_correlation"):
        told(correlation)
