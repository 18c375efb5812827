"""The estimator's mathematics: gradient, elimination, noise, and what must not change a camera."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import Scene, draw_scene, parameters_of, solver_points
from test_lines import chaos, in_frame, town

from scene4d import solve_camera
from scene4d.calibration._body import N_PARAMETERS
from scene4d.calibration._drift import N_DRIFTS, Drift
from scene4d.calibration._joint import position_weights, solve
from scene4d.calibration._prior import Prior, default_prior
from scene4d.calibration._problem import Noise, Problem, State
from scene4d.calibration._refine import linearise, minimise, normal_equations
from scene4d.calibration._uncertainty import covariance
from scene4d.core.orientation import Orientation

SEED = st.integers(0, 2**32 - 1)
AZIMUTH = N_PARAMETERS  # the unknowns: camera, azimuth of the lines, drift of boxes


def problem_of(scene: Scene, prior: Prior, *, box=False, lines=None) -> Problem:
    people = scene.people
    points = solver_points(scene.camera, people.foot_uv, people.head_uv, box)
    rng = np.random.default_rng(0)
    return Problem(points, people.track, rng.uniform(0.2, 1.0, len(people)), 1.7, prior, lines)


def mixed_problem(seed: int) -> tuple[Problem, State]:
    """Tracks and strangers, boxes and keypoints, outliers, lines: near the truth, not at it."""
    rng = np.random.default_rng(seed)
    scene = draw_scene(seed % 50, 60, tracks=25, outliers=0.3, noise=0.04, fov_deg=50.0)
    lines = np.vstack([town(scene.camera, 12, rng), chaos(scene.camera, 12, rng)])
    problem = problem_of(
        scene,
        default_prior(estimate_distortion=True, centre_sigma=0.05),
        box=rng.random(60) < 0.4,
        lines=in_frame(scene.camera, lines),
    )
    track = problem.track.copy()
    track[:10] = 1000 + np.arange(10)  # seen once
    track = np.unique(track, return_inverse=True)[1]
    problem = replace(problem, track=track, drift=Drift.of(problem.points, track))
    off = np.array([0.05, 0.02, 0.01, 0.05, 0.01, 0.02, 0.02]) * rng.normal(size=7)
    parameters = parameters_of(scene.camera) + off
    noise = Noise(along=0.04, across=0.05, box_along=0.06, height_m=0.08, short=0.2, stray=0.07)
    delta = rng.normal(0, 0.1, problem.n_heights)
    drift = np.array([0.05, -0.03, 0.04, -0.1, 0.02, 0.08])
    return problem, State(parameters, delta, noise, azimuth=0.6, drift=drift)


@settings(max_examples=12, deadline=None)
@given(SEED)
def test_the_gradient_is_half_that_of_the_cost(seed):
    problem, state = mixed_problem(seed)
    lin = linearise(problem, state)
    system = normal_equations(problem, state, lin)
    # Undo the elimination of the heights.
    eliminated = system.coupling @ (system.height_gradient / system.height_information)
    gradient = system.gradient + eliminated

    def slope(up: State, down: State, step: float) -> float:
        return (linearise(problem, up).cost - linearise(problem, down).cost) / (4 * step)

    step = 1e-6
    scale = np.sqrt(np.diag(system.hessian)) + 1
    for index in problem.columns:
        d = step * np.eye(N_PARAMETERS)[index]
        up, down = (replace(state, parameters=state.parameters + s * d) for s in (1, -1))
        found = slope(up, down, step)
        assert gradient[index] == pytest.approx(found, rel=2e-3, abs=2e-3 * scale[index])
    up, down = (replace(state, azimuth=state.azimuth + s * step) for s in (1, -1))
    found = slope(up, down, step)
    assert gradient[AZIMUTH] == pytest.approx(found, rel=2e-3, abs=2e-3 * scale[AZIMUTH])
    for index in range(N_DRIFTS):
        d = step * np.eye(N_DRIFTS)[index]
        found = slope(*(replace(state, drift=state.drift + s * d) for s in (1, -1)), step)
        column = AZIMUTH + 1 + index
        assert gradient[column] == pytest.approx(found, rel=2e-3, abs=2e-3 * scale[column])
    # The heights too: a box's touching point is held while its person grows (test_body).
    for person in range(0, problem.n_heights, 4):
        d = step * np.eye(problem.n_heights)[person]
        up, down = (replace(state, delta_m=state.delta_m + s * d) for s in (1, -1))
        found = slope(up, down, step)
        assert system.height_gradient[person] == pytest.approx(found, rel=5e-3, abs=5e-2)


@settings(max_examples=15, deadline=None)
@given(SEED)
def test_elimination_gives_the_step_of_the_dense_system(seed):
    """Camera and heights together, with one dense matrix, written out person by person."""
    problem, state = mixed_problem(seed)
    problem = replace(problem, lines=None)
    lin = linearise(problem, state)
    system = normal_equations(problem, state, lin)
    free, t = np.flatnonzero(problem.free), problem.n_heights
    p, hessian = len(free), system.hessian[np.ix_(free, free)]
    dense, right = np.zeros((p + t, p + t)), np.zeros(p + t)
    for row, person in zip(problem.tracked, problem.person, strict=True):
        assert (
            problem.track[problem.tracked][problem.person == person] == problem.track[row]
        ).all()
    owner = dict(zip(problem.tracked.tolist(), problem.person.tolist(), strict=True))
    for i in range(len(problem.track)):
        for axis in range(2):
            j = np.zeros(p + t)
            j[:p] = lin.by_parameter[:, axis, i]
            if i in owner:
                j[p + owner[i]] = lin.by_height[axis, i]
            dense += lin.weight[axis, i] * np.outer(j, j)
            right += j * lin.force[axis, i]
    precision = np.zeros((len(problem.free), len(problem.free)))
    precision[:N_PARAMETERS, :N_PARAMETERS] = problem.prior.precision
    precision[AZIMUTH + 1 :, AZIMUTH + 1 :] = np.diag(problem.drift.precision)
    off = np.concatenate([state.parameters - problem.prior.mean, [0.0], state.drift])
    dense[:p, :p] += precision[np.ix_(free, free)]
    right[:p] += (precision @ off)[free]
    stiff = lin.height_weight / state.noise.height_m**2
    dense[p:, p:] += np.diag(stiff)
    right[p:] += stiff * state.delta_m
    right[:p] += lin.pull[0]
    for i, person in owner.items():
        right[p + person] += lin.pull[1][i]
    expected = np.linalg.solve(dense, right)
    found = np.linalg.solve(hessian, system.gradient[free])
    np.testing.assert_allclose(found, expected[:p], rtol=1e-6, atol=1e-9)
    heights = (system.height_gradient - system.coupling[free].T @ found) / system.height_information
    np.testing.assert_allclose(heights, expected[p:], rtol=1e-6, atol=1e-9)
    # Marginalised, not conditional: the camera's block of the inverse.
    np.testing.assert_allclose(np.linalg.inv(hessian), np.linalg.inv(dense)[:p, :p], rtol=1e-6)


def test_the_minimum_is_where_it_says():
    scene = draw_scene(4, 80, tracks=20, outliers=0.2)
    problem = replace(problem_of(scene, default_prior()), weight=np.ones(80))
    found = solve(problem)
    assert found is not None
    best = minimise(problem, found, steps=100, tolerance=1e-12)
    sigma = np.sqrt(np.diag(covariance(problem, best)))[:4]
    # Stopped early, yet within a small part of its uncertainty.
    assert (np.abs(best.parameters - found.parameters)[:4] < 0.1 * sigma).all()
    gradient = normal_equations(problem, best, linearise(problem, best)).gradient[:4]
    assert (np.abs(gradient) * sigma < 1e-3).all()
    # No camera a standard deviation away is more probable, with heights free to follow.
    for direction in np.vstack([np.eye(4), -np.eye(4)]):
        away = best.parameters.copy()
        away[:4] += direction * sigma
        there = replace(best, parameters=away)
        assert linearise(problem, there).cost > linearise(problem, best).cost


def test_the_cost_falls_about_as_the_covariance_says():
    """On the profile over everything else the cost rises by z² at z standard deviations."""
    rises = []
    for seed in range(6):
        scene = draw_scene(seed, 150, tracks=30)
        problem = replace(problem_of(scene, default_prior()), weight=np.ones(150))
        found = solve(problem)
        assert found is not None
        best = minimise(problem, found, steps=100, tolerance=1e-12)
        cov = covariance(problem, best)
        for index in range(4):
            sigma = np.sqrt(cov[index, index])
            for sign in (-1.0, 1.0):
                moved = best.parameters + sign * cov[index] / sigma  # the ridge of the Gaussian
                prior = replace(
                    problem.prior,
                    mean=np.where(np.arange(N_PARAMETERS) == index, moved, problem.prior.mean),
                    sigma=np.where(np.arange(N_PARAMETERS) == index, 0.0, problem.prior.sigma),
                )
                held = replace(problem, prior=prior)
                there = replace(best, parameters=moved)
                profile = minimise(held, there, steps=50, tolerance=1e-12)
                rises.append(linearise(problem, profile).cost - linearise(problem, best).cost)
    assert 0.75 < np.median(rises) < 1.3
    assert min(rises) > 0.3


@pytest.mark.parametrize("noise", [0.015, 0.03, 0.06])
def test_noise_and_heights_are_read_off_the_people(noise):
    """What tracks of many people scatter about: their noise, not that of the first guess."""
    found = []
    for seed in range(5):
        scene = draw_scene(seed, 600, tracks=100, noise=noise, noise_px=0.0, height_sigma=0.07)
        problem = replace(problem_of(scene, default_prior()), weight=np.ones(600))
        state = solve(problem)
        assert state is not None
        found.append([state.noise.along, state.noise.across, state.noise.height_m])
    along, across, height = np.median(found, axis=0)
    assert along == pytest.approx(noise, rel=0.15)
    assert across == pytest.approx(1.5 * noise, rel=0.15)
    assert height == pytest.approx(0.07, rel=0.2)


@pytest.mark.parametrize("share", [0.0, 0.2, 0.4])
def test_the_share_of_shortened_people_is_read_off_too(share):
    found = []
    for seed in range(5):
        scene = draw_scene(seed, 500, outliers=share)
        state = solve(replace(problem_of(scene, default_prior()), weight=np.ones(500)))
        assert state is not None
        found.append(state.noise.short)
    # Those cut by little pass for people, so the share may be read low, never high.
    assert 0.75 * share - 0.01 < np.median(found) < 1.1 * share + 0.03


def _camera(scene: Scene, rows=slice(None), *, track=None, mirror=False, zoom=1.0, **kwargs):
    people, (width, height) = scene.people, scene.camera.image_size
    foot, head = people.foot_uv[rows].copy(), people.head_uv[rows].copy()
    for uv in (foot, head):
        if mirror:
            uv[:, 0] = width - 1 - uv[:, 0]
        uv += 0.5  # pixel centres lie at whole numbers
        uv *= zoom
        uv -= 0.5
    found = solve_camera(
        foot,
        head,
        image_size=(round(width * zoom), round(height * zoom)),
        track=people.track[rows] if track is None else track,
        **kwargs,
    )
    assert found, found.reason
    return found


def _difference(a, b, *, roll_sign=1.0) -> np.ndarray:
    """Largest difference of the four parameters, in standard deviations of ``a``."""
    p, q = parameters_of(a.camera), parameters_of(b.camera)
    q[2] *= roll_sign
    sigma = np.sqrt(np.diag(a.covariance))[:4]
    return np.abs((p - q)[:4] / sigma).max()


@pytest.mark.parametrize("seed", range(6))
def test_order_and_labels_of_people_do_not_matter(seed):
    scene = draw_scene(seed, 90, tracks=30, outliers=0.1)
    rng = np.random.default_rng(seed)
    as_is = _camera(scene)
    # Tracks interleaved in another way, each in its own order (one walk per track is in time).
    order = np.argsort(rng.permutation(90), kind="stable")
    shuffled = scene.people.track[order]
    order[np.argsort(shuffled, kind="stable")] = np.argsort(scene.people.track, kind="stable")
    assert _difference(as_is, _camera(scene, order)) < 0.02
    # Out of time a walk has more new positions, which weighs it a little differently.
    assert _difference(as_is, _camera(scene, rng.permutation(90))) < 0.4
    labels = rng.permutation(5000)[: scene.people.track.max() + 1]
    renamed = _camera(scene, track=labels[scene.people.track])
    assert _difference(as_is, renamed) < 0.02
    np.testing.assert_allclose(renamed.covariance, as_is.covariance, rtol=0.02, atol=1e-12)
    np.testing.assert_array_equal(renamed.inlier, as_is.inlier)


def test_strangers_may_be_labelled_or_not():
    scene = draw_scene(3, 80)
    named = _camera(scene)
    unknown = _camera(scene, track=np.full(80, -1))
    assert _difference(named, unknown) < 1e-6


@pytest.mark.parametrize("seed", range(4))
@pytest.mark.parametrize("zoom", [2.0, 0.5])
def test_resolution_changes_the_focal_length_alone(seed, zoom):
    scene = draw_scene(seed, 120, outliers=0.1)
    small, large = _camera(scene), _camera(scene, zoom=zoom)
    assert large.camera.focal_px == pytest.approx(zoom * small.camera.focal_px, rel=1e-6)
    for name in ("tilt_rad", "roll_rad", "height_m"):
        assert getattr(large.camera, name) == pytest.approx(
            getattr(small.camera, name), rel=1e-6, abs=1e-8
        )
    np.testing.assert_allclose(large.covariance, small.covariance, rtol=1e-4, atol=1e-14)


@pytest.mark.parametrize("seed", range(6))
def test_a_mirrored_image_is_rolled_the_other_way(seed):
    scene = draw_scene(seed, 120, outliers=0.1, roll_deg=5.0)
    assert _difference(_camera(scene), _camera(scene, mirror=True), roll_sign=-1.0) < 0.02


def test_heights_scale_the_world():
    """Everybody (feet too) 10 % taller means a camera 10 % higher: pixels hold no metres."""
    scene = draw_scene(5, 150)
    told = Orientation(scene.camera.focal_px, scene.camera.tilt_rad, scene.camera.roll_rad,
                       50.0, 0.02, 0.02)  # fmt: skip
    low = _camera(scene, prior=told)
    high = _camera(scene, prior=told, person_height_m=1.87, foot_height_m=0.044)
    assert high.camera.height_m / low.camera.height_m == pytest.approx(1.1, rel=0.01)


def _weights(foot, track, length=0.2):
    foot = np.asarray(foot, float).T
    return position_weights(foot, np.full(foot.shape[1], length), np.asarray(track))


def test_someone_who_stands_still_counts_once():
    still = _weights([[0.1, 0.2]] * 50 + [[0.5, 0.1]], [3] * 50 + [1])
    np.testing.assert_allclose(still[:50], 1 / 50)
    assert still[50] == 1.0
    # Walks by more than a quarter of their length each time: every sighting is news.
    walk = np.column_stack([0.06 * np.arange(20), np.zeros(20)])
    np.testing.assert_allclose(_weights(walk, np.zeros(20, int)), 1.0)
    # At half of that every other one is.
    slow = _weights(walk / 2, np.zeros(20, int))
    np.testing.assert_allclose(slow.sum(), 10, atol=1)


def test_places_of_one_person_are_correlated():
    """Kish's design effect: twenty places of one person count as 20 / (1 + 19 c)."""
    foot = np.array([0.06 * np.arange(20), np.zeros(20)])
    track, length = np.zeros(20, int), np.full(20, 0.2)
    for correlation in (0.0, 0.12, 1.0):
        weight = position_weights(foot, length, track, correlation)
        assert weight.sum() == pytest.approx(20 / (1 + 19 * correlation))


def test_weights_follow_their_rows():
    rng = np.random.default_rng(0)
    foot, track = rng.uniform(0, 0.3, (60, 2)), rng.integers(0, 6, 60)
    weights = _weights(foot, track)
    order = np.argsort(track, kind="stable")
    np.testing.assert_allclose(_weights(foot[order], track[order]), weights[order])
    assert (weights <= 1).all()


def test_repeating_the_same_frames_makes_nobody_surer():
    scene = draw_scene(2, 60, tracks=60)
    once = _camera(scene)
    rows = np.tile(np.arange(60), 5)
    again = _camera(scene, rows)
    ratio = np.sqrt(np.diag(again.covariance)[:4] / np.diag(once.covariance)[:4])
    assert (ratio > 0.7).all(), ratio
    assert (ratio < 1.4).all(), ratio
