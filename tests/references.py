"""A calibration of real footage held against the published camera."""

import numpy as np
import pytest

from scene4d.core.calibration import Calibration
from scene4d.evaluation import Reference


def assert_good(
    found: Calibration, reference: Reference, error_m: float, *, undistorted: bool = False
) -> None:
    """Near the truth, with spreads that are neither a lie nor useless."""
    assert found.camera is not None, found.reason
    camera, true = found.camera, reference.camera
    assert reference.score(camera, undistorted=undistorted).mean_m <= error_m
    assert camera.focal_px == pytest.approx(true.focal_px, rel=0.10)
    off = {
        "focal_px": camera.focal_px - true.focal_px,
        "tilt_deg": np.degrees(camera.tilt_rad - true.tilt_rad),
        "roll_deg": np.degrees(camera.roll_rad - true.roll_rad),
        "height_m": camera.height_m - true.height_m,
    }
    for name, value in off.items():
        assert abs(value) < 3.5 * found.sigma[name], (name, value, found.sigma)
    assert found.sigma["focal_px"] < 0.12 * true.focal_px
    assert found.ground_error_m is not None
    assert 0.05 < found.ground_error_m["median"] < 1.2
