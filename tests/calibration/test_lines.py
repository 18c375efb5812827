"""Straight edges of the scene: derivatives, what a town tells, and what chaos does not."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import draw_scene, half_diagonal, solve_points

from scene4d.calibration._body import Points
from scene4d.calibration._lines import Lines, best_azimuths, directions, line_terms
from scene4d.calibration._prior import Prior
from scene4d.calibration._problem import Noise, Problem, State
from scene4d.calibration._refine import linearise, minimise
from scene4d.core.camera import Camera
from scene4d.core.people import Segments
from strategies import build_camera, build_lens, ground_in_view
from type_checks import unchecked

SEED = st.integers(0, 2**32 - 1)
AZIMUTH = np.radians(35.0)


def town(camera: Camera, n: int, rng: np.random.Generator, noise_px: float = 0.7) -> np.ndarray:
    """End points (n, 4) of edges along up and two horizontal directions, as seen with noise."""
    c, s = np.cos(AZIMUTH), np.sin(AZIMUTH)
    axes = np.array([[0, 0, 1.0], [c, s, 0], [-s, c, 0]])
    found = [np.empty((0, 4))]
    last = np.array(camera.image_size) - 1
    while sum(map(len, found)) < n:
        start, _ = ground_in_view(camera, rng.uniform(size=(3 * n, 2)))
        start = start + np.array([0, 0, 1.0]) * rng.uniform(0, 3, (3 * n, 1))
        end = start + axes[np.arange(3 * n) % 3] * rng.uniform(1, 5, (3 * n, 1))
        flat = [camera.project(at, undistorted=True)[0] for at in (start, end)]
        ends = np.stack(flat, axis=1)
        inside = ((ends >= 0) & (ends <= last)).all(axis=(1, 2))
        inside &= np.hypot(*(ends[:, 1] - ends[:, 0]).T) > 40
        found.append(camera.distort(ends[inside].reshape(-1, 2))[0].reshape(-1, 4))
    edges = np.concatenate(found)
    return edges[:n] + noise_px * rng.normal(size=(n, 4))


def chaos(camera: Camera, n: int, rng: np.random.Generator) -> np.ndarray:
    """Lines of any place and direction."""
    size = np.array(camera.image_size, float)
    middle = rng.uniform([0, 0], size, (n, 2))
    turn, half = rng.uniform(0, np.pi, n), rng.uniform(30, 100, n)[:, None]
    along = half * np.column_stack([np.cos(turn), np.sin(turn)])
    return np.column_stack([middle - along, middle + along])


def in_frame(camera: Camera, xyxy: np.ndarray) -> Lines:
    return Lines.from_pixels(xyxy, camera.K[:2, 2], half_diagonal(camera))


def full_parameters(camera: Camera, azimuth: float) -> np.ndarray:
    focal = camera.focal_px / half_diagonal(camera)
    corner = camera.distortion[0] / focal**2
    return np.array(
        [
            np.log(focal),
            camera.tilt_rad,
            camera.roll_rad,
            np.log(camera.height_m),
            corner,
            0,
            0,
            azimuth,
        ]
    )


def cameras() -> st.SearchStrategy[Camera]:
    lens = st.builds(
        build_lens,
        st.just((1280, 720)),
        st.floats(30.0, 80.0),
        radial=st.tuples(st.sampled_from([0.0, -0.04, 0.05]), st.just(0.0), st.just(0.0)),
    )
    return st.builds(
        build_camera, lens, st.floats(5.0, 45.0), st.floats(-10.0, 10.0), st.floats(4.0, 10.0)
    )


@settings(max_examples=30, deadline=None)
@given(cameras(), st.floats(0.0, 1.5), SEED)
def test_derivatives_agree_with_central_differences(camera, azimuth, seed):
    rng = np.random.default_rng(seed)
    lines = in_frame(camera, chaos(camera, 30, rng))
    p = full_parameters(camera, azimuth)
    found = line_terms(p, lines)
    step = 1e-6
    for index in range(8):
        ends = [line_terms(p + s * step * np.eye(8)[index], lines) for s in (-1, 1)]
        # Where the nearest direction changes there is no derivative.
        smooth = np.abs(ends[1].residual - ends[0].residual) < 0.5
        numeric = (ends[1].residual - ends[0].residual) / (2 * step)
        scale = 1 + np.abs(numeric[smooth]).max(initial=0)
        np.testing.assert_allclose(
            found.derivative[index][smooth], numeric[smooth], rtol=1e-4, atol=1e-5 * scale
        )
    # The weights are those of the cost: half its gradient is what the normal equations use.
    gradient = found.derivative @ (found.weight * found.residual)
    for index in range(8):
        ends = [line_terms(p + s * 1e-7 * np.eye(8)[index], lines).cost for s in (-1, 1)]
        assert gradient[index] == pytest.approx((ends[1] - ends[0]) / 4e-7, rel=1e-3, abs=1e-2)


@given(st.floats(-0.2, 1.4), st.floats(-0.5, 0.5), st.floats(-4.0, 4.0))
@settings(deadline=None)
def test_the_three_directions_are_a_level_frame(tilt, roll, azimuth):
    axes, by = directions(tilt, roll, azimuth)
    np.testing.assert_allclose(axes @ axes.T, np.eye(3), atol=1e-12)
    camera = Camera.from_pose(
        image_size=(640, 480), focal_px=500.0, tilt_rad=tilt, roll_rad=roll, height_m=4.0
    )
    world = axes @ camera.R
    np.testing.assert_allclose(world[0], [0, 0, 1], atol=1e-12)
    np.testing.assert_allclose(world[1], [np.cos(azimuth), np.sin(azimuth), 0], atol=1e-12)
    np.testing.assert_allclose(world[2], [-np.sin(azimuth), np.cos(azimuth), 0], atol=1e-12)
    assert (by[:, [0, 3, 4]] == 0).all()


@settings(max_examples=20, deadline=None)
@given(cameras(), SEED)
def test_edges_of_a_town_miss_nothing_at_the_truth(camera, seed):
    rng = np.random.default_rng(seed)
    lines = in_frame(camera, town(camera, 30, rng, noise_px=0.0))
    exact = line_terms(full_parameters(camera, AZIMUTH), lines)
    assert np.abs(exact.residual).max() < 1e-6
    assert exact.cost < 1e-9
    noisy = line_terms(
        full_parameters(camera, AZIMUTH), in_frame(camera, town(camera, 200, rng, noise_px=0.7))
    )
    # 0.7 px at both ends is the stated error of the ends; the other half degree is not there.
    assert 0.1 < np.std(noisy.residual) < 1.1
    assert (
        pytest.approx(
            min(
                (a % (np.pi / 2) for a in best_azimuths(full_parameters(camera, 0.0)[:7], lines)),
                key=lambda a: abs(a - AZIMUTH),
            ),
            abs=np.radians(1.6),
        )
        == AZIMUTH
    )


def nobody() -> Points:
    return Points(np.empty((2, 0)), np.empty((2, 0)), np.empty(0, bool), 0.04)


@pytest.mark.parametrize("seed", range(4))
def test_a_town_pulls_a_biased_prior_to_the_truth(seed):
    camera = build_camera(build_lens((1920, 1080), 60.0), 22.0, 3.0, 7.0)
    rng = np.random.default_rng(seed)
    truth = full_parameters(camera, AZIMUTH)
    sigma = np.array([0.2, np.radians(4), np.radians(4), 0.3, 0.0, 0.0, 0.0])
    biased = Prior(truth[:7] + sigma * [1, -1, 1, 0, 0, 0, 0], sigma)
    lines = in_frame(camera, town(camera, 300, rng))
    problem = Problem(nobody(), np.empty(0, int), np.empty(0), 1.7, biased, lines)
    start = State(biased.mean, np.empty(0), Noise())
    candidates = [
        minimise(
            problem,
            State(start.parameters, start.delta_m, Noise(), azimuth),
            steps=50,
            tolerance=1e-9,
        )
        for azimuth in best_azimuths(start.parameters, lines)
    ]
    found = min(candidates, key=lambda state: linearise(problem, state).cost)
    before = np.abs(biased.mean - truth[:7])[:3]
    after = np.abs(found.parameters - truth[:7])[:3]
    assert (after < 0.35 * before).all(), after / before
    assert found.parameters[3] == pytest.approx(truth[3], abs=1e-9)  # lines know no metres


def _solved(scene, lines=None):
    people = scene.people
    with unchecked():
        return solve_points(
            Segments.from_points(people.foot_uv, people.head_uv, track=people.track),
            image_size=scene.camera.image_size,
            estimate_distortion=False,
            edges_xyxy=lines,
        )


def test_lines_help_few_people_and_chaos_does_not_move_them():
    """Over 12 views of 12 people: error in tilt falls with a town, and stays with random lines."""
    error, moved, claimed = {"none": [], "town": []}, [], []
    for seed in range(12):
        scene = draw_scene(seed, 12, fov_deg=55.0, tilt_deg=22.0, height_m=7.0)
        rng = np.random.default_rng(seed)
        alone = _solved(scene)
        helped = _solved(scene, town(scene.camera, 120, rng))
        troubled = _solved(scene, chaos(scene.camera, 120, rng))
        assert alone
        assert helped
        assert troubled
        for name, found in (("none", alone), ("town", helped)):
            error[name].append(abs(found.camera.tilt_rad - scene.camera.tilt_rad))
        sigma = np.sqrt(np.diag(alone.covariance))
        step = [
            np.log(troubled.camera.focal_px / alone.camera.focal_px) / sigma[0],
            (troubled.camera.tilt_rad - alone.camera.tilt_rad) / sigma[1],
            (troubled.camera.roll_rad - alone.camera.roll_rad) / sigma[2],
        ]
        moved.append(np.abs(step).max())
        claimed.append(helped.sigma["tilt_deg"] / alone.sigma["tilt_deg"])
    assert np.median(error["town"]) < 0.6 * np.median(error["none"])
    assert np.median(claimed) < 0.8
    assert np.median(moved) < 0.7
    assert np.quantile(moved, 0.9) < 2.0


def test_no_lines_are_no_information():
    scene = draw_scene(1, 40)
    alone = _solved(scene)
    empty = _solved(scene, np.empty((0, 4)))
    assert alone
    np.testing.assert_array_equal(alone.camera.P, empty.camera.P)


@pytest.mark.parametrize("count", [0, 1, 3])
def test_few_lines_that_say_nothing_of_the_azimuth_are_no_obstacle(count):
    """Uprights alone leave the azimuth free; lines that the lens cannot undo leave all free."""
    scene = draw_scene(1, 40, fov_deg=55.0, tilt_deg=22.0, height_m=7.0)
    camera = scene.camera
    foot = np.array([[-3.0, 14, 0], [0, 18, 0], [4, 15, 0]])[:count]
    ends = [camera.project(p)[0] for p in (foot, foot + np.array([0, 0, 2.0]))]
    uprights = np.column_stack(ends) if count else np.full((3, 4), np.nan)
    alone, helped = _solved(scene), _solved(scene, uprights)
    assert helped
    np.testing.assert_allclose(helped.camera.height_m, alone.camera.height_m, rtol=0.02)
    assert helped.sigma["tilt_deg"] <= 1.001 * alone.sigma["tilt_deg"]
