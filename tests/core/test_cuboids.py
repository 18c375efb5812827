"""Cuboids of tracked objects: corners, centres, and sizes by a disturbed camera."""

import numpy as np
import pytest

from made_tracks import made_tracks
from scene4d.core.calibration import PARAMETERS, Calibration
from scene4d.core.cuboids import centroids, cuboid_corners, cuboid_covariance, size_jacobian
from scene4d.core.tracks import Tracks
from strategies import build_camera, build_lens

CAMERA = build_camera(build_lens((1280, 720), 55.0, radial=(-0.05, 0.0, 0.0)), 25.0, 4.0, 6.0)
AHEAD = CAMERA.R[2, :2] / np.hypot(*CAMERA.R[2, :2])


def cars(n: int = 1, **changes) -> Tracks:
    """Cars of 4 x 2 x 1.5 m on a platform of 0.5 m, that face +Y."""
    values = {
        "class_name": "car", "frame": 0, "covariance_m2": 0.04, "shared_covariance_m2": 0.05,
        "velocity_mps": 0.0, "velocity_covariance": 1.0, "heading_rad": np.pi / 2,
        "heading_sigma_rad": 0.1, "box_xyxy": 0.0, "z_m": 0.5, "z_sigma_m": 0.1,
        "size_m": [4.0, 2.0, 1.5], "size_sigma_m": [0.3, 0.2, 0.12],
        "xy_m": np.tile([3.0, 10.0], (n, 1)),
    } | changes  # fmt: skip
    return made_tracks(np.arange(n), np.zeros(n), **values)


def test_corners_stand_around_the_centre():
    (corners,) = cuboid_corners(cars())
    np.testing.assert_allclose(corners.min(axis=0), [2.0, 8.0, 0.5])
    np.testing.assert_allclose(corners.max(axis=0), [4.0, 12.0, 2.0])
    (centre,), _ = centroids(cars())
    np.testing.assert_allclose(corners.mean(axis=0), centre)


def test_covariances_are_those_of_sampled_cuboids():
    tracks, rng, n = cars(), np.random.default_rng(0), 200_000
    size = tracks.size_m[0] + tracks.size_sigma_m[0] * rng.normal(size=(n, 3))
    xy = tracks.xy_m[0] + 0.3 * rng.normal(size=(n, 2))
    z = 0.5 + 0.1 * rng.normal(size=n) + size[:, 2] / 2
    heading = np.pi / 2 + 0.1 * rng.normal(size=n)
    sampled = np.cov(np.column_stack([xy, z, heading, size]).T)
    np.testing.assert_allclose(cuboid_covariance(tracks)[0], sampled, atol=0.002)
    np.testing.assert_allclose(centroids(tracks)[1][0], sampled[:3, :3], atol=0.002)


def test_what_is_unknown_has_no_cuboid():
    nothing = cars(3, size_m=np.array([[np.nan, np.nan, 1.7], [4, 2, 1.5], [4, 2, 1.5]]))
    nothing.size_sigma_m[0, :2] = np.nan
    nothing.heading_sigma_rad[1] = np.nan  # only the axis is known
    nothing.xy_m[2] = np.nan
    known = np.isfinite(cuboid_corners(nothing)).all(axis=(1, 2))
    assert known.tolist() == [False, True, False]
    variances = np.diagonal(cuboid_covariance(nothing), axis1=1, axis2=2)
    unknown = np.isnan(variances).astype(int).tolist()
    assert unknown == [[0, 0, 0, 0, 1, 1, 0], [0, 0, 0, 1, 0, 0, 0], [1] * 7]
    assert np.isfinite(centroids(nothing)[0]).all(axis=1).tolist() == [True, True, False]


@pytest.mark.parametrize("parameter", range(len(PARAMETERS)))
def test_sizes_move_as_those_of_a_disturbed_camera(parameter):
    xyz_m = np.array([[*(AHEAD * 12.0 + CAMERA.centre_m[:2]), 0.4]])
    size_m, heading = np.array([[4.5, 1.8, 1.6]]), np.array([0.7])
    found = size_jacobian(Calibration.of_camera(CAMERA), size_m, xyz_m, heading)[0, :, parameter]
    step = np.zeros(7)
    step[parameter] = 1e-5

    def sizes(camera) -> np.ndarray:
        """As another camera measures the ends that are seen at the same pixels."""
        c, s = np.cos(0.7), np.sin(0.7)
        halves = (2.25 * np.array([c, s, 0.0]), 0.9 * np.array([-s, c, 0.0]))
        ends = [xyz_m[0] + sign * half for half in halves for sign in (1, -1)]
        uv = CAMERA.project(np.array([*ends, xyz_m[0], xyz_m[0] + [0, 0, 1.6]]))[0]
        a, b, d, e, foot = camera.locate(uv[:5], 0.4)[0]
        low, high = camera.locate(uv[5:], 0.4 + 1.5)[0][0], camera.locate(uv[5:], 0.4 + 1.7)[0][0]
        way = (high - low) / 0.2
        height = 1.5 + (foot - low) @ way / (way @ way)
        return np.array([np.hypot(*(a - b)), np.hypot(*(d - e)), height])

    moved = (sizes(CAMERA.disturbed(step)) - sizes(CAMERA.disturbed(-step))) / 2e-5
    np.testing.assert_allclose(found, moved, rtol=2e-3, atol=2e-3)
