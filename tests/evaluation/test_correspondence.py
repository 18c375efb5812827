"""The paper's measure against values worked out by hand."""

import numpy as np
import pytest
from scipy.spatial.distance import pdist

from scene4d.core.errors import InputError
from scene4d.evaluation import correspondence_error, spread_points

SQUARE = np.array([[0.0, 0.0], [2.0, 0.0], [2.0, 2.0], [0.0, 2.0]])


def test_a_rigid_motion_is_no_error():
    angle = 0.7
    R = np.array([[np.cos(angle), -np.sin(angle)], [np.sin(angle), np.cos(angle)]])
    error = correspondence_error(SQUARE @ R.T + [5.0, -3.0], SQUARE)
    assert error.mean_m == pytest.approx(0, abs=1e-12)
    np.testing.assert_allclose(error.aligned_xy_m, SQUARE, atol=1e-12)


def test_scale_is_an_error():
    # A square blown up by a half about its centre: every corner is sqrt(2) / 2 too far out.
    error = correspondence_error(1.5 * SQUARE, SQUARE)
    np.testing.assert_allclose(error.distance_m, np.sqrt(2) / 2)
    assert error.sd_m == pytest.approx(0, abs=1e-12)


def test_mean_and_spread_of_one_wrong_corner():
    # Two points 4 m apart in truth and 2 m apart in the estimate: 1 m at each end.
    error = correspondence_error(np.array([[0.0, 0.0], [2.0, 0.0]]), np.array([[0.0, 0], [4.0, 0]]))
    np.testing.assert_allclose(error.distance_m, [1, 1])


def test_a_mirrored_map_is_an_error():
    # A mirrored square fits no rotation at all: the best are as bad as its own half turn.
    assert correspondence_error(SQUARE * [-1, 1], SQUARE).mean_m == pytest.approx(2.0)


def test_a_missing_point_is_a_failure():
    with pytest.raises(InputError, match="1 correspondence points have no estimated"):
        correspondence_error(np.vstack([SQUARE[:3], [[np.nan, 0]]]), SQUARE)


def test_points_are_spread():
    rng = np.random.default_rng(0)
    crowd = np.vstack([rng.normal(0, 0.1, (500, 2)), SQUARE * 10])
    rows = spread_points(crowd, 5)
    assert set(range(501, 504)) <= set(rows.tolist())  # the corners that are no crowd
    assert len(set(rows.tolist())) == 5
    by_chance = [pdist(crowd[rng.choice(504, 5, replace=False)]).min() for _ in range(50)]
    assert pdist(crowd[rows]).min() > max(by_chance)


def test_too_few_points_are_refused():
    with pytest.raises(InputError, match="12 spread points were asked for, and only 4"):
        spread_points(SQUARE)
