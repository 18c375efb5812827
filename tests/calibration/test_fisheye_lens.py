"""Cameras behind a fisheye lens: with a known lens, by both methods."""

from dataclasses import replace

import numpy as np
import pytest

from scene4d.calibration import solve_segments
from scene4d.calibration.options import POINTS, CalibrateOptions
from scene4d.core import geometry
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments
from strategies import build_fisheye, people_scene


def fisheye_camera(
    tilt_deg: float = 40.0, height_m: float = 3.2, focal_px: float = 420.0
) -> Camera:
    """A camera that sees 150 degrees across."""
    R = geometry.rotation_from_tilt_roll(np.radians(tilt_deg), np.radians(3))
    lens = build_fisheye((1280, 960), focal_px, (0.02, -0.005, 0.0, 0.0), centre_shift=(8.0, -5.0))
    return lens.posed(R, -R @ np.array([0.0, 0.0, height_m]))


def crowd_of(camera: Camera, seed: int = 0) -> tuple[Segments, np.ndarray]:
    """Segments in pixels of the footage, and the true ground points of the feet."""
    rng = np.random.default_rng(seed)
    people = people_scene(camera, 200, rng, tracks=30, distorted=True, height_sigma=0.05)
    return Segments.from_points(people.foot_uv, people.head_uv, track=people.track), people.xy_m


@pytest.mark.parametrize("tilt_deg", [15.0, 40.0, 60.0])
def test_a_known_fisheye_lens_is_used(tilt_deg):
    camera = fisheye_camera(tilt_deg)
    segments, xy_m = crowd_of(camera)
    found = solve_segments(segments, camera.image_size, replace(POINTS, lens=camera.lens))
    assert found and found.camera is not None and found.camera.is_fisheye, found.reason
    np.testing.assert_array_equal(found.camera.distortion, camera.distortion)
    np.testing.assert_array_equal(found.camera.K, camera.K)
    off = [found.camera.tilt_rad - camera.tilt_rad, found.camera.roll_rad - camera.roll_rad]
    off.append(np.log(found.camera.height_m / camera.height_m))
    assert found.covariance is not None
    z = np.array(off) / np.sqrt(np.diag(found.covariance)[1:4])
    assert np.abs(z).max() < 3.5
    uv, seen = camera.project(np.column_stack([xy_m, np.zeros(len(xy_m))]))
    near = seen & (np.hypot(*xy_m.T) < 12)
    assert np.hypot(*(found.camera.locate(uv)[0] - xy_m)[near].T).mean() < 0.15


def test_the_paper_s_method_undistorts_too():
    camera = fisheye_camera()
    segments, _ = crowd_of(camera)
    exact = Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad)
    options = CalibrateOptions(lens=camera.lens, orientation=exact, method="paper")
    found = solve_segments(segments, camera.image_size, options)
    assert found and found.camera is not None, found.reason
    assert found.camera.is_fisheye
    assert found.camera.height_m == pytest.approx(camera.height_m, rel=0.05)


def test_the_distortion_alone_of_a_fisheye_lens_cannot_be_used():
    options = CalibrateOptions(lens=build_fisheye(), estimate_focal=True)
    with pytest.raises(InputError, match="estimate_focal: which way a pixel of a fisheye lens"):
        options.read((1280, 960))
