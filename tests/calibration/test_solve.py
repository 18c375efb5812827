"""``solve_camera``: known people and noise in, errors of the expected size out."""

import tracemalloc
from dataclasses import replace

import numpy as np
import pytest
from scenes import (
    Scene,
    correspondence_error,
    draw_scene,
    errors_of,
    parameters_of,
    sigmas_of,
    solve_points,
)

import scene4d
from scene4d import solve_camera
from scene4d.core.camera import Lens
from scene4d.core.orientation import Orientation
from scene4d.core.people import Segments
from strategies import build_camera, build_lens, people_scene


@pytest.mark.parametrize("seed", range(3))
def test_a_perfect_crowd_gives_the_camera_exactly(seed):
    """No noise at all and everybody 1.70 m: what remains is the solver's own tolerance."""
    scene = draw_scene(seed, 60, noise=0.0, noise_px=0.0, height_sigma=0.0)
    people = scene.people
    found = solve_camera(people.foot_uv, people.head_uv, image_size=scene.camera.image_size)
    assert (np.abs(errors_of(scene, found)) < [2e-3, 1e-3, 1e-3, 2e-3]).all()
    error = correspondence_error(scene.camera, found.camera, people.xy_m)
    assert np.median(error) < 0.02
    assert found.inlier.all()
    assert found.residual.max() < 0.01


@pytest.mark.parametrize("share", [0.1, 0.4])
def test_outliers_are_told_apart(share):
    """Those cut by more than a quarter are found; people as modelled are kept."""
    scene = draw_scene(8, 400, outliers=share)
    people = scene.people
    found = solve_camera(people.foot_uv, people.head_uv, image_size=scene.camera.image_size)
    length = np.hypot(*(people.foot_uv - people.head_uv).T)
    truth, _ = scene.camera.project(np.column_stack([people.xy_m, np.full(400, 0.04)]))
    whole = np.hypot(*(truth - people.head_uv).T)
    badly = people.outlier & (length < 0.7 * whole)
    assert found.inlier[~people.outlier].mean() > 0.9
    assert found.inlier[badly].mean() < 0.05
    assert np.median(found.residual[badly]) > 0.25
    assert 0.02 < np.median(found.residual[~people.outlier]) < 0.09
    assert found.inliers == found.inlier.sum()
    assert found.people == 400


def test_one_height_per_track_sees_through_a_small_crowd():
    """Four people who walk: one height each leaves less to noise than a height per sighting."""
    gain = []
    for seed in range(12):
        scene = draw_scene(seed, 80, tracks=4, noise=0.01, noise_px=0.3, height_sigma=0.12)
        people, size = scene.people, scene.camera.image_size
        tracked = solve_camera(people.foot_uv, people.head_uv, image_size=size, track=people.track)
        strangers = solve_camera(people.foot_uv, people.head_uv, image_size=size)
        if tracked and strangers:
            gain.append(np.abs(errors_of(scene, tracked) / errors_of(scene, strangers))[:2])
    assert len(gain) >= 10
    assert (np.median(gain, axis=0) < 0.75).all(), np.median(gain, axis=0)


def _few(seed: int) -> Scene:
    return draw_scene(seed, 15, fov_deg=40.0, tilt_deg=18.0)


def test_a_told_orientation_narrows_and_guides():
    narrower, error = [], {"none": [], "told": []}
    for seed in range(12):
        scene = _few(seed)
        camera, people = scene.camera, scene.people
        rng = np.random.default_rng(seed)
        spread = np.array([0.02 * camera.focal_px, np.radians(0.5), np.radians(0.5)])
        wrong = spread * rng.normal(size=3)
        told = Orientation(
            camera.focal_px + wrong[0],
            camera.tilt_rad + wrong[1],
            camera.roll_rad + wrong[2],
            *spread,
        )
        for name, prior in (("none", None), ("told", told)):
            found = solve_camera(
                people.foot_uv, people.head_uv, image_size=camera.image_size, prior=prior
            )
            error[name].append(np.abs(errors_of(scene, found)))
            if prior is None:
                alone = sigmas_of(found)
            else:
                narrower.append(sigmas_of(found) / alone)
                assert (sigmas_of(found)[:3] <= 1.05 * np.array([0.02, 0.00873, 0.00873])).all()
    assert (np.max(narrower, axis=0) < 1.02).all()
    assert (np.median(narrower, axis=0)[:2] < 0.8).all()
    assert np.median(error["told"], axis=0)[0] < 0.8 * np.median(error["none"], axis=0)[0]


def test_an_exact_orientation_is_held():
    scene = _few(1)
    camera, people = scene.camera, scene.people
    told = Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad)
    found = solve_camera(
        people.foot_uv,
        people.head_uv,
        image_size=camera.image_size,
        prior=told,
        track=np.arange(len(people.foot_uv)),
    )
    np.testing.assert_allclose(parameters_of(found.camera)[:3], scene.truth[:3], atol=1e-9)
    assert found.covariance[:3, :3] == pytest.approx(np.zeros((3, 3)))
    assert 0 < found.sigma["height_m"] < 0.05 * found.camera.height_m
    # What is infinitely uncertain says nothing.
    vague = Orientation(300.0, 1.0, 0.5, np.inf, np.inf, np.inf)
    free, alone = (
        solve_camera(people.foot_uv, people.head_uv, image_size=camera.image_size, prior=p)
        for p in (vague, None)
    )
    np.testing.assert_array_equal(free.camera.P, alone.camera.P)


def test_a_confident_wrong_orientation_is_believed_as_told():
    """The prior is a Gaussian, not a hint: a tight one wins against a few people."""
    scene = _few(2)
    people = scene.people
    told = Orientation(
        1.3 * scene.camera.focal_px, scene.camera.tilt_rad, scene.camera.roll_rad, 1.0, 1.0, 1.0
    )
    found = solve_camera(
        people.foot_uv, people.head_uv, image_size=scene.camera.image_size, prior=told
    )
    if found:
        assert found.camera.focal_px == pytest.approx(told.focal_px, rel=0.01)


def test_a_mean_height_is_a_scale():
    scene = draw_scene(5, 300, mean_height_m=1.6)
    people = scene.people
    right = solve_camera(
        people.foot_uv, people.head_uv, image_size=scene.camera.image_size, person_height_m=1.6
    )
    wrong = solve_camera(people.foot_uv, people.head_uv, image_size=scene.camera.image_size)
    assert right.camera.height_m == pytest.approx(scene.camera.height_m, rel=0.03)
    assert wrong.camera.height_m / right.camera.height_m == pytest.approx(1.7 / 1.6, rel=0.015)
    assert wrong.camera.focal_px == pytest.approx(right.camera.focal_px, rel=0.01)


# --- what solve_segments knows besides: lens, distortion, shared errors ---


def _distorted(seed: int, *, centre=(0.0, 0.0), aspect=1.0, n: int = 250) -> Scene:
    lens = build_lens((1280, 720), 60.0, aspect, centre, (-0.06, 0.01, 0.002), (0.003, -0.002))
    camera = build_camera(lens, 22.0, 3.0, 8.0)
    return Scene(camera, people_scene(camera, n, np.random.default_rng(seed), distorted=True))


def _segments(scene: Scene) -> Segments:
    people = scene.people
    return Segments.from_points(people.foot_uv, people.head_uv, track=people.track)


@pytest.mark.parametrize("estimate_focal", [False, True])
def test_a_lens_is_used_with_its_centre_and_aspect(estimate_focal):
    scene = _distorted(0, centre=(0.03, -0.02), aspect=1.05)
    lens = scene.camera.lens
    if estimate_focal:  # the same bend of the sensor, with a focal length that is off by a fifth
        K = lens.K * [[0.8, 1, 1], [1, 0.8, 1], [1, 1, 1]]
        lens = Lens(lens.image_size, K, lens.distortion * 0.8 ** np.array([2, 4, 1, 1, 6]))
    found = solve_points(
        _segments(scene), image_size=(1280, 720), lens=lens, estimate_focal=estimate_focal
    )
    camera = found.camera
    if estimate_focal:
        np.testing.assert_allclose(camera.K, scene.camera.K, rtol=0.03)
        assert found.sigma["focal_px"] > 1
    else:
        np.testing.assert_array_equal(camera.K, lens.K)
        np.testing.assert_array_equal(camera.distortion, lens.distortion)
        assert found.sigma["focal_px"] == 0
    stretch = camera.K[0, 0] / lens.K[0, 0]
    np.testing.assert_allclose(
        camera.distortion, lens.distortion * stretch ** np.array([2, 4, 1, 1, 6]), atol=1e-9
    )
    assert np.degrees(camera.tilt_rad) == pytest.approx(22.0, abs=0.6)
    assert np.degrees(camera.roll_rad) == pytest.approx(3.0, abs=0.4)
    assert camera.height_m == pytest.approx(8.0, rel=0.03)


def test_the_lens_is_estimated_where_nobody_tells_it():
    corners, sigma, error = [], [], []
    for seed in range(5):
        lens = build_lens((1280, 720), 60.0, radial=(-0.06, 0.0, 0.0))
        camera = build_camera(lens, 22.0, 3.0, 8.0)
        crowd = people_scene(camera, 250, np.random.default_rng(seed), distorted=True)
        scene = Scene(camera, crowd)
        found = solve_points(_segments(scene), image_size=(1280, 720))
        straight = solve_points(_segments(scene), image_size=(1280, 720), estimate_distortion=False)
        corners.append(parameters_of(found.camera)[4] - scene.truth[4])
        sigma.append(np.sqrt(found.covariance[4, 4]))
        error.append([np.abs(errors_of(scene, found))[0], np.abs(errors_of(scene, straight))[0]])
    assert scene.truth[4] < -0.03
    assert np.abs(corners).max() < 3.5 * np.median(sigma)
    assert 0.002 < np.median(sigma) < 0.02
    # It matters: with the bend ignored the focal length is off by more.
    estimated, ignored = np.median(error, axis=0)
    assert estimated < 0.6 * ignored


def test_shared_errors_widen_what_is_stated_and_nothing_else():
    scene = draw_scene(1, 150)
    segments, size = _segments(scene), scene.camera.image_size
    known = {"image_size": size, "lens": scene.camera.lens, "estimate_focal": True}
    plain = solve_points(segments, **known)
    wide = solve_points(segments, **known, population_sigma_m=0.05, systematics=True)
    assert (np.diag(wide.covariance)[:4] > np.diag(plain.covariance)[:4]).all()
    population = solve_points(segments, **known, population_sigma_m=0.05)
    grown = population.covariance - plain.covariance
    assert grown[3, 3] == pytest.approx((0.05 / 1.7) ** 2, rel=1e-6)
    grown[3, 3] = 0
    np.testing.assert_allclose(grown, 0, atol=1e-15)
    assert wide.ground_error_m["median"] > 1.2 * plain.ground_error_m["median"]


def test_few_tracks_on_real_footage_count_less_than_as_many_strangers(monkeypatch):
    """What one person gets wrong (gait, posture) repeats itself: of thirty sightings, about ten in
    new places, remain 10 / (1 + 9 · 0.12) = 4.8 facts, and sigma is 1.4 times that of bare points.
    """
    monkeypatch.setattr("scene4d.calibration._solve.Drift.of", lambda points, track: None)
    scene = draw_scene(4, 300, tracks=10)
    people, size = _segments(scene), scene.camera.image_size
    bare, real = (
        solve_points(people, size, lens=scene.camera.lens, estimate_focal=True, systematics=real)
        for real in (False, True)
    )
    ratio = sigmas_of(real)[:3] / sigmas_of(bare)[:3]
    assert (ratio > 1.2).all() and (ratio < 1.7).all(), ratio


def test_boxes_with_a_known_focal_length():
    """Boxes drawn around sampled bodies, not with the model: the camera comes out nonetheless."""
    from test_body import silhouette

    camera = build_camera(build_lens((1280, 720), 50.0), 18.0, 2.0, 6.0)
    crowd = people_scene(camera, 60, np.random.default_rng(4), noise=0.0, noise_px=0.0)
    foot, head = [], []
    for xy, height in zip(crowd.xy_m, crowd.height_m, strict=True):
        low, high = silhouette(camera, xy, height)
        middle = camera.project(np.array([[*xy, height / 2]]))[0][0, 0]
        foot.append([middle, low])
        head.append([middle, high])
    boxes = Segments.from_points(np.array(foot), np.array(head), from_box=True)
    thin = Segments.from_points(np.array(foot), np.array(head))
    told = Orientation(camera.focal_px, 0.3, 0.0, 0.0, np.inf, np.inf)
    kwargs = {"image_size": (1280, 720), "estimate_distortion": False, "orientation": told}
    found, misread = solve_points(boxes, **kwargs), solve_points(thin, **kwargs)
    assert found
    error = np.abs(parameters_of(found.camera) - parameters_of(camera))
    assert error[1] < np.radians(1.0)
    assert error[3] < 0.03
    wrong = np.abs(parameters_of(misread.camera) - parameters_of(camera))
    assert wrong[1] > error[1]


@pytest.mark.parametrize("method", ["joint", "paper"])
def test_a_camera_below_the_heads(method):
    """1.20 m above the ground: the heads of people of 1.70 m lie above the horizon."""
    size, errors, sigma = (1280, 720), [], []
    camera = build_camera(build_lens(size, 60.0), 4.0, 1.0, 1.2)
    prior = Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad)
    for seed in range(6):
        people = people_scene(camera, 150, np.random.default_rng(seed), noise=0.01)
        horizon = camera.K[1, 2] - camera.focal_px * np.tan(camera.tilt_rad)
        assert (people.head_uv[:, 1] < horizon + 30).all()
        found = solve_camera(
            people.foot_uv,
            people.head_uv,
            image_size=size,
            method=method,
            prior=prior if method == "paper" else None,
            track=np.arange(150),
        )
        assert found, found.reason
        errors.append(found.camera.height_m - 1.2)
        sigma.append(found.sigma["height_m"])
    assert np.abs(np.mean(errors)) < 0.06
    assert np.median(sigma) < 0.1


def test_sightings_without_a_track_may_all_be_one_person():
    """A man of 1.84 m seen 296 times puts the camera 8 % too high: sigma must know it."""
    z, ratio = [], []
    for seed in range(8):
        scene = draw_scene(seed, 296, height_sigma=0.0, noise=0.01)
        people, size = scene.people, scene.camera.image_size
        points = {"foot_uv": people.foot_uv, "head_uv": people.head_uv, "image_size": size}
        unknown = solve_camera(**points, person_height_m=1.70 * 1.70 / 1.84)
        one = solve_camera(**points, person_height_m=1.70 * 1.70 / 1.84, track=np.zeros(296, int))
        z.append((unknown.camera.height_m - scene.camera.height_m) / unknown.sigma["height_m"])
        ratio.append(unknown.sigma["height_m"] / one.sigma["height_m"])
    assert -2.5 < np.median(z) < -0.8
    assert 0.7 < np.median(ratio) < 1.4


def test_people_of_one_frame_are_different_people():
    scene = draw_scene(2, 100)
    people = replace(_segments(scene), track=np.full(100, -1))
    one_frame = solve_points(people, scene.camera.image_size)
    apart = solve_points(replace(people, frame=np.arange(100)), scene.camera.image_size)
    height = scene.camera.height_m
    added = apart.sigma["height_m"] ** 2 - one_frame.sigma["height_m"] ** 2
    assert added == pytest.approx((height * 0.09 / 1.7) ** 2, rel=0.15)


# --- sizes ---


@pytest.mark.parametrize("sightings", [1, 100])
def test_memory_grows_in_proportion_and_stays_small(sightings):
    """``sightings`` of each person; a dense system of 20,000 people would take 13 GB."""
    peaks = []
    for n in (2_000, 20_000):
        tracks = None if sightings == 1 else n // sightings
        scene = draw_scene(11, n, outliers=0.1, tracks=tracks)
        camera, people = scene.camera, scene.people
        tracemalloc.start()
        found = solve_camera(
            people.foot_uv, people.head_uv, image_size=camera.image_size, track=people.track
        )
        peaks.append(tracemalloc.get_traced_memory()[1])
        tracemalloc.stop()
        assert found
        assert found.camera.focal_px == pytest.approx(camera.focal_px, rel=0.03)
    assert peaks[1] < 40e6
    assert peaks[1] < 14 * peaks[0]


def test_the_package_offers_it_at_the_top():
    assert scene4d.solve_camera is solve_camera
