"""Cameras refined by what they see together: nearer the true ones, by as much as they say."""

from dataclasses import replace

import numpy as np
import pytest

from alignment.test_pairs import errors, linked
from scene4d.alignment._graph import solve
from scene4d.alignment._joint import refined
from scene4d.core.calibration import Calibration

SEEDS = (3, 4, 6, 7, 9, 10)


def solved(seed):
    site, seen, found = linked(seed)
    return (site, seen, solve(seen, [found])) if found else None


@pytest.fixture(scope="module")
def solutions():
    return [one for one in map(solved, SEEDS) if one is not None]


def ground_error_m(calibration: Calibration, one) -> float:
    """Where the people's feet are by this camera and by the true one: root mean square."""
    uv, _ = one.calibration.ground_pixels(one.tracks.xy_m[::7])
    step = calibration.camera.locate(uv)[0] - one.camera.locate(uv)[0]
    return float(np.sqrt((step**2).sum(axis=1).mean()))


def test_refined_cameras_are_nearer_to_the_true_ones(solutions):
    before, after = [], []
    for site, seen, solution in solutions:
        for one, found in zip(site.seen, refined(seen, solution), strict=True):
            before.append(ground_error_m(one.calibration, one))
            after.append(ground_error_m(found.calibration, one))
    assert np.mean(after) < 0.8 * np.mean(before)
    assert np.mean(np.array(after) < np.array(before)) > 0.6


def test_refined_cameras_know_how_well(solutions):
    squares = []
    for site, seen, solution in solutions:
        for one, found in zip(site.seen, refined(seen, solution), strict=True):
            camera, true = found.calibration.camera, one.camera
            apart = [
                np.log(camera.focal_px / true.focal_px),
                camera.tilt_rad - true.tilt_rad,
                camera.roll_rad - true.roll_rad,
                np.log(camera.height_m / true.height_m),
            ]
            sigma = np.sqrt(np.diag(found.calibration.covariance))[:4]
            squares.append((np.array(apart) / sigma) ** 2)
            assert np.all(sigma <= np.sqrt(np.diag(one.calibration.covariance))[:4] * 1.0001)
    assert 0.5 < np.mean(squares) < 1.7


def test_placements_know_how_well(solutions):
    squares = [
        errors(solution.placements[1], site.seen[1].truth)[1] ** 2
        for site, _, solution in solutions
    ]
    assert len(squares) >= 5
    assert 0.4 < np.mean(squares) < 1.8


def test_a_camera_whose_file_states_no_error_stays(solutions):
    _, seen, solution = solutions[0]
    exact = replace(seen[0], calibration=Calibration.of_camera(seen[0].calibration.camera))
    assert refined([exact, seen[1]], solution)[0] is None
