"""Numbers as the report says them."""

from dataclasses import replace

import numpy as np
import pytest

import report_scenes as scenes
from scene4d.drawing.overlay import _rows_away
from scene4d.drawing.words import k1_sigma, parameter_rows


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


def centre_rows(sigma: float, off_px: tuple[float, float]) -> list[tuple[str, str]]:
    camera = scenes.camera()
    K = camera.K.copy()
    K[:2, 2] = 383.5, 287.5
    K[:2, 2] += off_px
    covariance = np.diag([1e-4, 1e-4, 1e-4, 1e-4, 0.0, sigma**2, sigma**2])
    found = scenes.calibration(replace(camera, K=K), covariance=covariance)
    rows = [row for row in parameter_rows(found) if row.name.startswith("Principal")]
    return [(row.value.replace("\xa0", " "), row.meaning.replace("\xa0", " ")) for row in rows]


def test_the_principal_point_is_shown_with_its_error_or_its_origin():
    # Half the diagonal of 768x576 is 480 px.
    assert centre_rows(0.05, (-12.0, 20.0)) == [
        ("372 ± 24 px", "12 px left of the picture's middle"),
        ("308 ± 24 px", "20 px below the picture's middle"),
    ]
    assert centre_rows(0.0, (-12.0, 20.0)) == [("372, 308 px", "from the lens file")]
    assert centre_rows(0.0, (0.0, 0.0)) == [
        ("384, 288 px", "the picture's middle, not estimated"),
    ]


def test_how_far_the_horizon_is_beyond_the_picture():
    # f tan(tilt) above the centre row, which is (h - 1) / 2 below the first.
    camera = scenes.camera(tilt_rad=0.5, roll_rad=0.0, focal_px=1000.0)
    expected = 1000 * np.tan(0.5) - (camera.image_size[1] - 1) / 2
    assert _rows_away(camera) == f"{expected:.0f} px "
    assert _rows_away(scenes.camera(tilt_rad=1.5)) == ""
