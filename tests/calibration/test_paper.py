"""The paper's method: the height alone, with the orientation given."""

import numpy as np
import pytest
from scenes import FOOT_HEIGHT_M, draw_scene, solve_points

from scene4d import solve_camera
from scene4d.calibration import CalibrateOptions
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments


def told(camera, *spread: float) -> Orientation:
    return Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad, *spread)


def solved(scene, orientation=None, **kwargs):
    people = scene.people
    return solve_points(
        Segments.from_points(people.foot_uv, people.head_uv, track=people.track),
        image_size=scene.camera.image_size,
        method="paper",
        orientation=told(scene.camera) if orientation is None else orientation,
        **kwargs,
    )


@pytest.mark.parametrize("consensus", ["exact", "ransac"])
def test_exact_orientation_gives_the_height(consensus):
    """Feet lie 4 cm above the plane that the paper puts them on: a bias of about 2 %."""
    errors = []
    for seed in range(12):
        scene = draw_scene(seed, 300, outliers=0.2)
        found = solved(scene, consensus=consensus)
        assert found.method == "paper"
        np.testing.assert_allclose(found.camera.K[0, 0], scene.camera.focal_px)
        assert found.camera.tilt_rad == pytest.approx(scene.camera.tilt_rad)
        assert found.camera.roll_rad == pytest.approx(scene.camera.roll_rad)
        errors.append(np.log(found.camera.height_m / scene.camera.height_m))
    assert abs(np.median(errors) - FOOT_HEIGHT_M / 1.7) < 0.025
    assert np.abs(errors).max() < 0.15


def test_people_of_one_height_on_the_ground_give_it_exactly():
    scene = draw_scene(2, 50, noise=0.0, noise_px=0.0, height_sigma=0.0)
    camera, xy = scene.camera, scene.people.xy_m
    foot, _ = camera.project(np.column_stack([xy, np.zeros(50)]))
    head, _ = camera.project(np.column_stack([xy, np.full(50, 1.7)]))
    found = solve_camera(
        foot, head, image_size=camera.image_size, method="paper", prior=told(camera)
    )
    assert found.camera.height_m == pytest.approx(camera.height_m, rel=1e-9)
    assert found.inlier.all()
    assert found.residual.max() < 1e-6
    other = solve_camera(
        foot, head, image_size=camera.image_size, method="paper", prior=told(camera),
        person_height_m=1.8288,
    )  # fmt: skip
    assert other.camera.height_m / camera.height_m == pytest.approx(1.8288 / 1.7, rel=1e-9)


def test_outliers_are_no_inliers():
    scene = draw_scene(7, 400, outliers=0.4, noise=0.005, height_sigma=0.02)
    found = solved(scene)
    outlier = scene.people.outlier
    assert found.inlier[~outlier].mean() > 0.6
    assert found.inlier[outlier].mean() < 0.1
    assert np.nanmedian(found.residual[outlier]) > 3 * np.nanmedian(found.residual[~outlier])


@pytest.mark.parametrize("method", ["paper"])
def test_without_an_orientation_it_is_refused(method):
    scene = draw_scene(1, 20)
    people = scene.people
    with pytest.raises(InputError, match="orientation"):
        solve_camera(
            people.foot_uv, people.head_uv, image_size=scene.camera.image_size, method=method
        )


def test_an_unknown_consensus_is_named():
    with pytest.raises(InputError, match=r"consensus must be one of .*found 'vote'"):
        CalibrateOptions(consensus="vote")


def test_the_spread_counts_a_track_once_and_adds_that_of_the_orientation():
    scene = draw_scene(4, 300, tracks=15)
    people = scene.people
    tracked = solved(scene)
    strangers = solve_camera(
        people.foot_uv,
        people.head_uv,
        image_size=scene.camera.image_size,
        method="paper",
        prior=told(scene.camera),
        track=np.arange(300),
    )
    assert strangers.camera.height_m == pytest.approx(tracked.camera.height_m)
    persons = len(np.unique(people.track[tracked.inlier]))
    ratio = tracked.sigma["height_m"] / strangers.sigma["height_m"]
    assert ratio == pytest.approx(np.sqrt(tracked.inliers / persons), rel=0.02)
    assert ratio > 2
    # At least the spread of body heights, over so many people.
    least = 0.09 / 1.7 / np.sqrt(persons)
    assert least < tracked.sigma["height_m"] / tracked.camera.height_m < 3 * least
    vague = solved(scene, told(scene.camera, 0.05 * scene.camera.focal_px, 0.02, 0.01))
    assert vague.sigma["height_m"] > 1.2 * tracked.sigma["height_m"]
    assert vague.sigma["focal_px"] == pytest.approx(0.05 * scene.camera.focal_px)
    assert vague.sigma["tilt_deg"] == pytest.approx(np.degrees(0.02))
    assert vague.ground_error_m["median"] > tracked.ground_error_m["median"]


def test_a_wrong_focal_length_makes_the_error_that_the_paper_saw():
    """A wider field of view than the truth puts the camera lower and people nearer."""
    scene = draw_scene(3, 300, fov_deg=45.0, tilt_deg=20.0, height_m=7.0)
    right = solved(scene)
    wide = solved(
        scene,
        Orientation(0.7 * scene.camera.focal_px, scene.camera.tilt_rad, scene.camera.roll_rad),
    )
    assert wide.camera.height_m < 0.9 * right.camera.height_m
