"""Numbers as the report says them."""

import numpy as np
import pytest

import report_scenes as scenes
from scene4d.drawing.overlay import _rows_away
from scene4d.drawing.words import k1_sigma


def test_the_spread_of_k1_is_that_of_sampled_cameras():
    camera = scenes.camera(distortion=(-0.15, 0.0, 0.0, 0.0, 0.0))
    covariance = np.zeros((5, 5))
    covariance[0, 0], covariance[4, 4], covariance[0, 4] = 0.05**2, 0.01**2, 0.3 * 0.05 * 0.01
    covariance[4, 0] = covariance[0, 4]
    rng = np.random.default_rng(0)
    steps = rng.multivariate_normal(np.zeros(5), covariance, 4000)
    sampled = [camera.disturbed(step).distortion[0] for step in steps]
    assert k1_sigma(camera, covariance) == pytest.approx(np.std(sampled), rel=0.06)


def test_a_given_lens_has_no_spread():
    covariance = np.diag([0.05**2, 1e-4, 1e-4, 1e-4, 0.0])
    assert k1_sigma(scenes.camera(distortion=(-0.1, 0.0, 0.0, 0.0, 0.0)), covariance) == 0.0


def test_how_far_the_horizon_is_beyond_the_picture():
    # f tan(tilt) above the centre row, which is (h - 1) / 2 below the first.
    camera = scenes.camera(tilt_rad=0.5, roll_rad=0.0, focal_px=1000.0)
    expected = 1000 * np.tan(0.5) - (camera.image_size[1] - 1) / 2
    assert _rows_away(camera) == f"{expected:.0f} px "
    assert _rows_away(scenes.camera(tilt_rad=1.5)) == ""
