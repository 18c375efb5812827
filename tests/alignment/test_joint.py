"""Cameras refined by what they see together: nearer the true ones, by as much as they say."""

from dataclasses import replace

import numpy as np
import pytest

from alignment.test_pairs import errors, linked
from scene4d.alignment._graph import solve
from scene4d.alignment._joint import errors_together, refined
from scene4d.core.calibration import Calibration
from scene4d.core.placement import Placement
from scene4d.store.site_errors import SiteErrors

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


def test_the_way_between_people_of_two_cameras_is_as_sure_as_it_says(solutions):
    """By what the cameras err together; by each alone it would be taken for twice as unsure."""
    ratios, alone = [], []
    for site, seen, solution in solutions:
        errors, found = errors_together(seen, solution), refined(seen, solution)
        assert errors.cameras == tuple(one.name for one in site.seen)
        off, modes, own = [], [], []
        for one, better in zip(site.seen, found, strict=True):
            rows = np.linspace(0, len(one.tracks) - 1, 40).astype(int)
            uv, _ = one.calibration.ground_pixels(one.tracks.xy_m[rows])
            xy = better.calibration.camera.locate(uv)[0]
            true = replace(one.truth, scale=1.0).points(one.camera.locate(uv)[0])
            if one is site.seen[0]:
                true = one.camera.locate(uv)[0]
            off.append(better.placement.points(xy) - true)
            modes.append(errors.modes_m(one.name, better.placement, better.calibration, xy))
            shared, _ = better.calibration.ground_covariance(uv, from_camera=True)
            turned = better.placement.own_covariances(shared)
            own.append(turned + better.placement.point_covariances(xy))
        apart, by = off[1] - off[0], modes[1] - modes[0]
        covariance = by @ by.swapaxes(1, 2)
        solved = np.linalg.solve(covariance, apart[:, :, None])[:, :, 0]
        ratios.append((apart * solved).sum(axis=1).mean() / 2)
        alone.append(np.median(np.trace(sum(own), 0, 1, 2) / np.trace(covariance, 0, 1, 2)))
    assert 0.4 < np.mean(ratios) < 1.8
    assert np.median(alone) > 2.0


def test_what_cameras_err_by_together_is_moved_with_the_site(solutions):
    """Turned and scaled as the site is, and off by the frame's own errors as one."""
    site, seen, solution = solutions[0]
    errors, found = errors_together(seen, solution), refined(seen, solution)
    placements = {one.name: two.placement for one, two in zip(site.seen, found, strict=True)}
    frame = Placement(400.0, -50.0, 1.2, 1.1, 0.0, np.diag([0.3, 0.2, 1e-4, 0.0, 0.0]))
    moved = errors.then(frame, placements)
    xy = np.array([[1.0, 9.0], [-2.0, 12.0]])
    for one, better in zip(site.seen, found, strict=True):
        before, after = (
            e.modes_m(one.name, place, better.calibration, xy)
            for e, place in (
                (errors, better.placement),
                (moved, better.placement.then(replace(frame, covariance=np.zeros((5, 5))))),
            )
        )
        inside = frame.own_covariances(before @ before.swapaxes(1, 2))
        expected = inside + frame.point_covariances(better.placement.points(xy))
        np.testing.assert_allclose(after @ after.swapaxes(1, 2), expected, rtol=1e-6, atol=1e-9)
    both = moved.beside(SiteErrors.alone("far", frame, found[0].calibration))
    assert not both.of("far", "cam0").any()
    np.testing.assert_allclose(both.of("far", "far")[:5, :5], frame.covariance)


def test_a_camera_whose_file_states_no_error_stays(solutions):
    _, seen, solution = solutions[0]
    exact = replace(seen[0], calibration=Calibration.of_camera(seen[0].calibration.camera))
    assert refined([exact, seen[1]], solution)[0] is None
