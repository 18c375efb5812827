"""What is true of a recording: through a lens, or by a map of the ground alone."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.geometry import rigid_fit
from scene4d.core.ground_map import GroundMap
from scene4d.evaluation.datasets import _reference as reference
from scene4d.evaluation.datasets._reference import Reference
from strategies import build_camera, build_lens

LENS = build_lens((1280, 720), 60.0, radial=(-0.08, 0.01, 0.0), tangential=(0.002, -0.001))
CAMERA = build_camera(LENS, 22.0, 4.0, 6.0, 30.0, (2.0, -1.0))
STRAIGHT = replace(CAMERA, distortion=np.zeros(5))
WRONG = np.array([0.1, 0.02, -0.02, 0.05, 0.0])
"""How far off the estimates below are: log f, tilt, roll, log height."""
VEHICLES = np.array([[300.0, 420.0], [950.0, 380.0], [640.0, 640.0]])


def feet(n: int = 60, seed: int = 0) -> np.ndarray:
    """Pixels of the footage that lie on the ground."""
    rng = np.random.default_rng(seed)
    return np.column_stack([rng.uniform(50, 1230, n), rng.uniform(280, 700, n)])


def known(truth: Camera | GroundMap = CAMERA, uv: np.ndarray | None = None, **more) -> Reference:
    return Reference("a square", truth, feet() if uv is None else uv, **more)


def map_of(camera: Camera, world: np.ndarray | None = None) -> GroundMap:
    H = np.linalg.inv(camera.P[:, [0, 1, 3]])
    return GroundMap(camera.image_size, H if world is None else world @ H)


def found(camera: Camera) -> Calibration:
    return Calibration(
        status="ok",
        method="joint",
        image_size=camera.image_size,
        person_height_m=1.7,
        camera=camera,
        covariance=np.diag(np.square([0.02, 0.005, 0.005, 0.02, 0.0])),
    )


def ground(camera: Camera, uv: np.ndarray) -> np.ndarray:
    return camera.locate(uv)[0]


def same(a, b) -> None:
    for one, other in zip(a, b, strict=True):
        np.testing.assert_allclose(one, other, rtol=1e-6, atol=1e-6)


def numbers(pairs) -> tuple:
    return pairs.true_m, pairs.estimated_m, pairs.sigma_m, pairs.placed_m


@pytest.mark.parametrize("truth", [CAMERA, map_of(STRAIGHT)])
def test_the_truth_is_no_error(truth):
    camera = CAMERA if truth is CAMERA else STRAIGHT
    error = known(truth).score(camera)
    assert len(error.distance_m) == 12
    assert error.mean_m == pytest.approx(0, abs=1e-6)
    pairs = known(truth).near(found(camera))
    np.testing.assert_allclose(pairs.estimated_m, pairs.true_m, atol=1e-6)
    np.testing.assert_allclose(pairs.placed_m, pairs.true_m, atol=1e-6)


@pytest.mark.parametrize("share", [0.7, 1.4])
def test_a_wrong_scale_costs_area_under_the_curve(share):
    """Within one scene every distance grows alike, and the order stays; true places show it."""
    scaled = replace(CAMERA, t=-CAMERA.R @ (CAMERA.centre_m * [1, 1, share]))
    scene = known(uv=feet(400), vehicle_uv=VEHICLES)
    pairs = scene.near(found(scaled))
    np.testing.assert_allclose(pairs.estimated_m, share * pairs.true_m)
    assert replace(pairs, placed_m=None).auc == 1
    assert 0.7 < pairs.auc < 0.995

    here, there = (ground(c, scene.points_uv) for c in (scaled, CAMERA))
    R, t = rigid_fit(here, there)
    people = ground(scaled, scene.judged[0].person_uv) @ R.T + t
    np.testing.assert_allclose(pairs.placed_m, cdist(people, ground(CAMERA, VEHICLES)).ravel())
    half = pairs.select(pairs.true_m < 10)
    np.testing.assert_array_equal(half.placed_m, pairs.placed_m[pairs.true_m < 10])


def test_the_score_is_the_distance_after_a_rigid_motion():
    wrong = CAMERA.disturbed(WRONG)
    scene = known()
    at, true = ground(wrong, scene.points_uv), ground(CAMERA, scene.points_uv)
    R, t = rigid_fit(at, true)
    error = scene.score(wrong)
    np.testing.assert_allclose(error.distance_m, np.linalg.norm(at @ R.T + t - true, axis=1))
    assert error.mean_m > 0.1


def test_straightened_footage_is_scored_as_the_footage_through_its_lens():
    """An estimate with the true lens on the footage is one without a lens on straight footage."""
    wrong = replace(CAMERA.disturbed(WRONG), K=CAMERA.K, distortion=CAMERA.distortion)
    without = replace(wrong, distortion=np.zeros(5))
    scene = known()
    through, straight = scene.score(wrong), scene.score(without, undistorted=True)
    np.testing.assert_allclose(straight.distance_m, through.distance_m, atol=1e-6)
    same(numbers(scene.near(found(without), undistorted=True)), numbers(scene.near(found(wrong))))
    # And the lens is no detail: left out, the score is another one.
    assert abs(scene.score(without).mean_m - through.mean_m) > 0.01


def test_a_map_of_the_ground_scores_as_its_camera():
    wrong = STRAIGHT.disturbed(WRONG)
    by_camera = known(STRAIGHT)
    for world in (
        np.eye(3),
        np.diag([1.0, -1.0, 1.0]),
        np.array([[0, -1.0, 50], [1, 0, 9], [0, 0, 1]]),
    ):
        by_map = known(map_of(STRAIGHT, world))
        np.testing.assert_array_equal(by_map.points_uv, by_camera.points_uv)
        same([by_map.score(wrong).distance_m], [by_camera.score(wrong).distance_m])
        same(numbers(by_map.near(found(wrong))), numbers(by_camera.near(found(wrong))))


def test_a_map_has_no_lens_to_straighten_with():
    scene = known(map_of(STRAIGHT))
    wrong = STRAIGHT.disturbed(WRONG)
    same([scene.score(wrong, undistorted=True).distance_m], [scene.score(wrong).distance_m])


def test_the_camera_of_a_reference():
    assert known().camera is CAMERA
    camera = known(map_of(STRAIGHT)).camera
    assert camera.focal_px == pytest.approx(STRAIGHT.focal_px)
    assert camera.height_m == pytest.approx(6.0)
    assert known().image_size == known(map_of(STRAIGHT)).image_size == (1280, 720)


def test_correspondence_points_stand_in_for_vehicles():
    scene = known()
    pairs = scene.near(found(CAMERA.disturbed(WRONG)))
    other = (cdist(feet(), scene.points_uv) > 0).ravel()  # nobody is paired with its own feet
    assert len(pairs.true_m) == other.sum() == 12 * len(feet()) - 12
    people, places = ground(CAMERA, feet()), ground(CAMERA, scene.points_uv)
    np.testing.assert_allclose(pairs.true_m, cdist(people, places).ravel()[other])
    wrong = CAMERA.disturbed(WRONG)
    people, places = ground(wrong, feet()), ground(wrong, scene.points_uv)
    np.testing.assert_allclose(pairs.estimated_m, cdist(people, places).ravel()[other])


def test_vehicles_are_the_places_where_there_are_any():
    sky = np.array([[640.0, -400.0]])
    scene = known(vehicle_uv=np.vstack([VEHICLES, sky]))
    pairs = scene.near(found(CAMERA))
    true = cdist(ground(CAMERA, feet()), ground(CAMERA, VEHICLES)).ravel()
    np.testing.assert_allclose(pairs.true_m, true)
    # The correspondence error stays that of where people walked.
    np.testing.assert_array_equal(scene.points_uv, known().points_uv)


@pytest.mark.parametrize("truth", [CAMERA, map_of(STRAIGHT)])
def test_feet_that_are_not_seen_on_the_ground_are_left_out(truth):
    inside = np.array([[100.0, 719.0], [640.0, 500.0]])
    below = np.array([[100.0, 719.5], [640.0, 800.0]])
    sky = np.array([[640.0, -400.0], [200.0, -900.0]])
    scene = known(truth, np.vstack([sky[:1], inside[:1], below, inside[1:], sky[1:]]))
    np.testing.assert_array_equal(scene.walked_uv, inside)


def test_too_few_feet_are_refused():
    with pytest.raises(InputError, match="12 spread points were asked for, and only 11"):
        known(uv=feet(11)).score(CAMERA)
    assert len(known(uv=feet(11), n_points=5).score(CAMERA).distance_m) == 5


def test_points_above_an_estimates_horizon_are_a_failure():
    scene = known()
    flat = build_camera(build_lens((1280, 720), 60.0), -20.0, 0.0, 6.0)
    with pytest.raises(InputError, match="correspondence points have no estimated ground"):
        scene.score(flat)
    assert np.isinf(scene.near(found(flat)).estimated_m).any()


def test_an_estimate_for_other_images_is_refused():
    half = build_camera(build_lens((640, 360), 60.0), 22.0, 4.0, 6.0)
    message = "a square: the calibration is for 640x360 images and the reference for 1280x720"
    with pytest.raises(InputError, match=message):
        known().score(half)
    with pytest.raises(InputError, match=message):
        known().near(found(half))


def test_the_error_that_a_calibration_expects_is_that_of_its_sampled_cameras():
    """Two-sided: 200 cameras from the covariance, scored as estimates are."""
    rng = np.random.default_rng(7)
    mix = rng.normal(size=(5, 5)) * [0.006, 0.002, 0.002, 0.008, 0.003]
    calibration = replace(found(CAMERA), covariance=mix.T @ mix)
    scene = known()
    steps = rng.multivariate_normal(np.zeros(5), mix.T @ mix, 200)
    scores = [scene.score(CAMERA.disturbed(step)).rms_m for step in steps]
    rms = float(np.sqrt(np.mean(np.square(scores))))
    assert scene.predicted_m(calibration) == pytest.approx(rms, rel=0.15)
    assert scene.predicted_m(found(CAMERA.disturbed(np.zeros(5)))) > 0
    assert scene.predicted_m(replace(calibration, covariance=np.zeros((5, 5)))) == 0
    with pytest.raises(InputError, match="not known"):
        scene.predicted_m(replace(calibration, covariance=None))


def test_an_undetermined_calibration_has_no_pairs():
    nothing = replace(found(CAMERA), status="undetermined", camera=None, reason="too few people")
    with pytest.raises(InputError, match="there is no camera: too few people"):
        known().near(nothing)


@settings(max_examples=25)
@given(n=st.integers(13, 400), most=st.integers(1, 60))
def test_few_of_many_people_are_taken_over_the_whole_clip(n, most):
    uv = np.column_stack([np.linspace(50, 1230, n), np.full(n, 600.0)])  # in order of time
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr(reference, "MAX_PEOPLE", most)
        pairs = known(uv=uv, vehicle_uv=VEHICLES).near(replace(found(CAMERA), covariance=None))
    true = cdist(ground(CAMERA, uv), ground(CAMERA, VEHICLES))
    rows = pairs.true_m.reshape(-1, 3)
    taken = np.array([int(np.argmin(np.abs(true - row).sum(axis=1))) for row in rows])
    np.testing.assert_allclose(true[taken], rows)
    assert min(most, n) / 2 <= len(taken) <= most
    steps = np.diff(taken)
    assert taken[0] == 0
    assert len(set(steps)) <= 1
    assert n - taken[-1] <= (steps[0] if len(steps) else n)


def test_at_most_two_thousand_people():
    pairs = known(uv=feet(4100), vehicle_uv=VEHICLES).near(found(CAMERA))
    assert len(pairs.true_m) == 3 * 1367
