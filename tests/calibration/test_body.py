"""The forward model: its derivatives, and what it predicts against independent projections."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scenes import FOOT_HEIGHT_M, parameters_of, solver_points

from scene4d.calibration._body import (
    N_PARAMETERS,
    predict_heads,
    undistort,
    up_vector,
)
from scene4d.core.body import BODY_RADIUS_M, HEAD_RADIUS_M
from scene4d.core.camera import Camera
from strategies import build_camera, build_lens, ground_in_view

SEED = st.integers(0, 2**32 - 1)
corners = st.sampled_from([-0.06, -0.02, 0.0, 0.03, 0.08])


@st.composite
def cameras(draw: st.DrawFn) -> Camera:
    """Square pixels, principal point in the middle, one radial coefficient."""
    lens = build_lens((1280, 720), draw(st.floats(15.0, 90.0)), radial=(draw(corners), 0.0, 0.0))
    return build_camera(
        lens, draw(st.floats(5.0, 60.0)), draw(st.floats(-20.0, 20.0)), draw(st.floats(3.0, 20.0))
    )


def footage_pixels(camera: Camera, xyz_m: np.ndarray) -> np.ndarray:
    """What the camera records of world points, written out: no code of the package."""
    there = xyz_m @ camera.R.T + camera.t
    xy = there[:, :2] / there[:, 2:]
    r2 = (xy**2).sum(axis=1, keepdims=True)
    return xy * (1 + camera.distortion[0] * r2) * np.diag(camera.K)[:2] + camera.K[:2, 2]


def upright_people(camera: Camera, rng: np.random.Generator, n: int) -> tuple:
    """Ground positions where feet are seen below the horizon, and heights of the people there."""
    xyz, _ = ground_in_view(camera, rng.uniform([0.02, 0.15], [0.98, 0.98], (n, 2)))
    return xyz[:, :2], rng.uniform(1.0, 2.0, n)


@settings(max_examples=40, deadline=None)
@given(cameras(), SEED)
def test_the_head_stands_over_the_foot(camera, seed):
    xy, height = upright_people(camera, np.random.default_rng(seed), 20)
    foot = footage_pixels(camera, np.column_stack([xy, np.full(20, FOOT_HEIGHT_M)]))
    head = footage_pixels(camera, np.column_stack([xy, height]))
    points = solver_points(camera, foot, head, False)
    found = predict_heads(parameters_of(camera), points, height)
    # Near the fold of a barrel lens an image point has two origins; the model refuses it.
    ok = found.valid
    assert ok.all() or camera.distortion[0] < 0
    np.testing.assert_allclose(found.head[:, ok], points.head[:, ok], rtol=0, atol=1e-8)


@settings(max_examples=40, deadline=None)
@given(cameras(), SEED)
def test_derivatives_agree_with_central_differences(camera, seed):
    rng = np.random.default_rng(seed)
    xy, height = upright_people(camera, rng, 12)
    foot = footage_pixels(camera, np.column_stack([xy, np.zeros(12)]))
    points = solver_points(camera, foot, foot, rng.random(12) < 0.5)
    parameters = parameters_of(camera)
    parameters[5:] = rng.normal(0, 0.05, 2)
    found = predict_heads(parameters, points, height)
    step = 1e-6

    def near(direction: np.ndarray, taller: float) -> np.ndarray:
        moved = [
            predict_heads(parameters + s * direction, points, height + s * taller).head
            for s in (-step, step)
        ]
        return (moved[1] - moved[0]) / (2 * step)

    ok = found.valid
    size = 1 + np.abs(found.by_parameter[:, :, ok]).max(initial=0)
    for index in range(N_PARAMETERS):
        numeric = near(np.eye(N_PARAMETERS)[index], 0.0)
        np.testing.assert_allclose(
            found.by_parameter[index][:, ok], numeric[:, ok], rtol=1e-5, atol=1e-7 * size
        )
    # By how much the touching point of a box wanders over the head as the person grows is left out.
    numeric = near(np.zeros(N_PARAMETERS), 1.0)
    for rows, rtol in ((ok & points.from_box, 1e-5), (ok & ~points.from_box, 1e-5)):
        np.testing.assert_allclose(
            found.by_height[1, rows], numeric[1, rows], rtol=rtol, atol=1e-7 * size
        )
        keypoint = rows & ~points.from_box
        np.testing.assert_allclose(
            found.by_height[0, keypoint], numeric[0, keypoint], rtol=rtol, atol=1e-7 * size
        )


@pytest.mark.parametrize("corner", [0.0, 1e-3, -0.05])
def test_the_derivative_by_distortion_is_continuous_through_zero(corner):
    """At D = 0 exactly the code takes a short cut; it must not lose the derivative."""
    camera = build_camera(build_lens((1280, 720), 60.0), 25.0, 5.0, 6.0)
    rng = np.random.default_rng(3)
    foot = rng.uniform([100, 300], [1180, 700], (15, 2))
    points = solver_points(camera, foot, foot, False)
    p = parameters_of(camera)
    p[4] = corner
    found = predict_heads(p, points, 1.7).by_parameter[4]
    up, down = p.copy(), p.copy()
    up[4], down[4] = corner + 1e-6, corner - 1e-6
    numeric = (predict_heads(up, points, 1.7).head - predict_heads(down, points, 1.7).head) / 2e-6
    np.testing.assert_allclose(found, numeric, rtol=1e-5, atol=1e-8)


BOX_TOLERANCE = {8.0: 0.005, 20.0: 0.005, 30.0: 0.005, 40.0: 0.005}
"""Largest error of a box's top, in lengths of the box, by tilt in degrees."""


def silhouette(camera: Camera, xy: np.ndarray, height: float) -> tuple[float, float]:
    """Lowest and highest row (pixels) of a densely sampled body that stands at ``xy``."""
    turn = np.linspace(0, 2 * np.pi, 800, endpoint=False)
    circle = np.column_stack([np.cos(turn), np.sin(turn)])
    rim = np.column_stack([xy + BODY_RADIUS_M * circle, np.zeros(len(turn))])
    polar, turn = np.meshgrid(
        np.linspace(0, np.pi, 120), np.linspace(0, 2 * np.pi, 120, endpoint=False)
    )
    ball = np.stack(
        [np.sin(polar) * np.cos(turn), np.sin(polar) * np.sin(turn), np.cos(polar)], axis=-1
    ).reshape(-1, 3)
    head = np.array([*xy, height - HEAD_RADIUS_M]) + HEAD_RADIUS_M * ball
    return footage_pixels(camera, rim)[:, 1].max(), footage_pixels(camera, head)[:, 1].min()


@pytest.mark.parametrize(("tilt_deg", "tolerance"), BOX_TOLERANCE.items())
@pytest.mark.parametrize("corner", [0.0, -0.04])
@pytest.mark.parametrize("roll_deg", [0.0, 6.0])
def test_a_box_is_the_outline_of_a_body(tilt_deg, tolerance, corner, roll_deg):
    """Given the lowest row of a sampled body, the model finds its highest row.

    The model's rim point lies on the line of sight and its head point in the plane of sight and
    up; off to one side a row of the image touches beside them, the more so the steeper the view.
    """
    camera = build_camera(
        build_lens((1280, 720), 50.0, radial=(corner, 0.0, 0.0)), tilt_deg, roll_deg, 8.0
    )
    rng = np.random.default_rng(int(tilt_deg))
    xyz, _ = ground_in_view(camera, rng.uniform([0.1, 0.4], [0.9, 0.95], (25, 2)))
    misses, thin_misses = [], []
    for x, y, _ in xyz:
        bottom, top = silhouette(camera, np.array([x, y]), 1.7)
        middle = footage_pixels(camera, np.array([[x, y, 0.0]]))[0, 0]
        ends = np.array([[middle, bottom]]), np.array([[middle, top]])
        for box, missed in ((True, misses), (False, thin_misses)):
            points = solver_points(camera, *ends, box)
            found = predict_heads(parameters_of(camera), points, 1.7)
            assert found.valid.all()
            length = (points.foot - points.head)[1, 0]
            missed.append(abs(found.head - points.head)[1, 0] / length)
    assert max(misses) < tolerance
    # The test can tell: read as a thin upright, the same box is off by ten times as much.
    assert np.median(misses) < 0.1 * np.median(thin_misses)


def test_the_body_matters_least_at_eye_level():
    """Seen horizontally, the rim adds nothing and the head's top is the height."""
    camera = build_camera(build_lens((1280, 720), 20.0), 2.0, 0.0, 3.0)
    foot = footage_pixels(camera, np.array([[0.0, 60.0, 0.0]]))
    parameters = parameters_of(camera)
    thin, body = (
        predict_heads(
            parameters,
            solver_points(camera, foot, foot, box),
            1.7,
        ).head[1, 0]
        for box in (False, True)
    )
    length = abs(thin - solver_points(camera, foot, foot, False).foot[1, 0])
    assert abs(thin - body) < 0.03 * length


@settings(deadline=None)
@given(st.floats(-0.08, 0.3), SEED)
def test_undistort_inverts_the_lens(corner, seed):
    rng = np.random.default_rng(seed)
    flat = rng.uniform(-0.75, 0.75, (2, 30))
    seen = flat * (1 + corner * (flat**2).sum(axis=0))
    found, by_corner, valid = undistort(seen, corner)
    assert valid.all()
    np.testing.assert_allclose(found, flat, rtol=0, atol=1e-9)
    step = 1e-6
    numeric = (undistort(seen, corner + step)[0] - undistort(seen, corner - step)[0]) / (2 * step)
    np.testing.assert_allclose(by_corner, numeric, rtol=1e-4, atol=1e-7)


def test_points_beyond_the_fold_of_a_barrel_lens_are_invalid():
    corner = -0.3  # folds at r_d = 2/3 sqrt(1 / 0.9) = 0.70
    points = np.array([[0.1, 0.6, 0.72, 1.0], [0.0, 0.0, 0.0, 0.0]])
    found, by_corner, valid = undistort(points, corner)
    assert valid.tolist() == [True, True, False, False]
    assert np.isfinite(found).all()
    assert np.isfinite(by_corner).all()


def test_what_cannot_be_seen_is_invalid():
    camera = build_camera(build_lens((1280, 720), 50.0), 10.0, 0.0, 5.0)
    p = parameters_of(camera)
    horizon = camera.K[1, 2] - camera.focal_px * np.tan(np.radians(10))
    foot = np.array([[640.0, horizon - 30], [640.0, horizon + 30], [640.0, 600.0]])
    points = solver_points(camera, foot, foot, False)
    found = predict_heads(p, points, 1.7)
    assert found.valid.tolist() == [False, True, True]
    assert np.isfinite(found.head).all()
    # Straight below, whoever is taller than the camera reaches behind it.
    camera = build_camera(build_lens((1280, 720), 50.0), 80.0, 0.0, 2.0)
    below = solver_points(camera, np.array([[640.0, 600.0]]), np.array([[640.0, 600.0]]), False)
    tall = predict_heads(parameters_of(camera), below, 4.5)
    assert not tall.valid.any()


@settings(deadline=None)
@given(st.floats(-0.2, 1.4), st.floats(-1.5, 1.5))
def test_up_is_the_third_column_of_the_rotation(tilt, roll):
    camera = Camera.from_pose(
        image_size=(640, 480), focal_px=500.0, tilt_rad=tilt, roll_rad=roll, height_m=4.0
    )
    up, by = up_vector(tilt, roll)
    np.testing.assert_allclose(up, camera.R[:, 2], atol=1e-12)
    step = 1e-6
    for index, (dt, dr) in {1: (step, 0.0), 2: (0.0, step)}.items():
        ends = [up_vector(tilt + s * dt, roll + s * dr)[0] for s in (-1, 1)]
        np.testing.assert_allclose(by[index], (ends[1] - ends[0]) / (2 * step), atol=1e-8)
