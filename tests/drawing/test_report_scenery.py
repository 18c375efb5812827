"""What is drawn lies where the camera says: every line is checked against Camera.project."""

from typing import Any

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

import report_scenes as scenes
from scene4d.core.camera import Camera
from scene4d.drawing import scenery
from scene4d.drawing.ground import Area

BARREL = (-0.3, 0.0, 0.0, 0.0, 0.0)


# Plain numbers, from which each test builds its camera: a strategy that makes the camera itself
# would run beartype's checks inside Hypothesis, and those draw from the global random state.
POSES = st.fixed_dictionaries(
    {
        "width": st.sampled_from([320, 768, 1920, 3840]),
        "height": st.sampled_from([240, 576, 1080, 2160]),
        "focal_of_width": st.floats(0.5, 3.0),
        "tilt_deg": st.floats(3.0, 85.0),
        "roll_deg": st.floats(-10.0, 10.0),
        "height_m": st.floats(2.5, 15.0),
        "k1": st.floats(-0.3, 0.1),
        "fisheye": st.booleans(),
    }
)


def built(pose: dict[str, float]) -> Camera:
    """A fisheye camera sees 36 to 180 degrees across."""
    lens: dict[str, Any] = {"distortion": (pose["k1"], 0.0, 0.0, 0.0, 0.0)}
    if pose["fisheye"]:
        lens = {"distortion": (pose["k1"] / 5, 0, 0, 0), "distortion_model": "fisheye"}
    return Camera.from_pose(
        image_size=(int(pose["width"]), int(pose["height"])),
        focal_px=pose["width"] * pose["focal_of_width"] * (0.64 if pose["fisheye"] else 1.0),
        tilt_rad=float(np.radians(pose["tilt_deg"])),
        roll_rad=float(np.radians(pose["roll_deg"])),
        height_m=pose["height_m"],
        **lens,
    )


def frame_pixels(camera: Camera, xyz: np.ndarray) -> np.ndarray:
    """Independent of the package's lens: OpenCV's projection of world points."""
    rotation, _ = cv2.Rodrigues(camera.R)
    project = cv2.fisheye.projectPoints if camera.is_fisheye else cv2.projectPoints
    uv, _ = project(xyz.reshape(-1, 1, 3), rotation, camera.t, camera.K, camera.distortion)
    return uv.reshape(-1, 2)


@settings(max_examples=40, deadline=None)
@given(POSES, st.floats(-10, 10), st.floats(1, 40), st.floats(0.5, 2.2))
def test_uprights_stand_where_opencv_projects_them(pose, x, y, height_m):
    camera = built(pose)
    curve = scenery.upright_curves(camera, np.array([[x, y]]), height_m, samples=5)[0]
    z = np.linspace(0, height_m, 5)
    expected = frame_pixels(camera, np.column_stack([np.full(5, x), np.full(5, y), z]))
    seen = np.isfinite(curve[:, 0])
    np.testing.assert_allclose(curve[seen], expected[seen], atol=1e-6 * max(camera.image_size))


def test_an_upright_in_the_middle_of_the_frame_is_seen_whole():
    camera = scenes.camera(distortion=BARREL)
    curve = scenery.upright_curves(camera, np.array([[0.0, 24.0]]), 1.7)[0]
    assert np.isfinite(curve).all()
    assert curve[0, 1] > curve[-1, 1] + 40


@settings(max_examples=40, deadline=None)
@given(POSES)
def test_the_horizon_is_the_image_of_far_points_at_camera_height(pose):
    camera = built(pose)
    curve = scenery.horizon_curve(camera)
    seen = scenery.in_frame(curve, camera.image_size)
    back, valid = camera.undistort(curve[seen])
    assert valid.all()
    # A ray to the horizon runs level: it never meets the ground, and rises nowhere.
    ray = np.column_stack([back, np.ones(len(back))]) @ np.linalg.inv(camera.K).T @ camera.R
    assert np.abs(ray[:, 2]).max(initial=0.0) < 1e-6
    far = np.array([[0.0, 1e9, camera.height_m]])
    at = scenery.image_of(camera, far)
    if scenery.in_frame(at, camera.image_size)[0]:
        gap = np.nanmin(np.linalg.norm(curve - at, axis=1))
        assert gap < 0.02 * max(camera.image_size)


def test_the_horizon_spans_the_frame_and_bends_with_the_lens():
    straight = scenery.horizon_curve(scenes.camera(tilt_rad=0.1))
    inside = straight[scenery.in_frame(straight, (768, 576))]
    assert inside[0, 0] < 15 and inside[-1, 0] > 752
    bent = scenery.horizon_curve(scenes.camera(tilt_rad=0.1, roll_rad=0.0, distortion=BARREL))
    bent = bent[scenery.in_frame(bent, (768, 576))]
    assert bent[len(bent) // 2, 1] < bent[0, 1] - 0.5


def test_a_fisheye_bends_the_horizon_and_the_grid_and_its_ticks_are_as_long_as_elsewhere():
    camera = Camera.from_pose(
        image_size=(1280, 960), focal_px=420.0, tilt_rad=0.5, roll_rad=0.0, height_m=4.0,
        distortion=(-0.01, 0.0, 0.0, 0.0), distortion_model="fisheye",
    )  # fmt: skip
    curve = scenery.horizon_curve(camera)
    curve = curve[scenery.in_frame(curve, (1280, 960))]
    assert curve[0, 0] < 5 and curve[-1, 0] > 1275
    assert np.hypot(*np.diff(curve, axis=0).T).max() < 10
    assert curve[0, 1] > curve[len(curve) // 2, 1] + 100  # it sags towards the sides
    far = scenery.image_of(camera, np.array([[1e6, 1e6, 4.0]]))[0]  # 60 degrees to the right
    assert np.hypot(*(curve - far).T).min() < 10
    across = [
        g for g in scenery.grid_lines(camera, Area(-30.0, 30.0, 1.0, 30.0), 5.0) if g.axis == "y"
    ]
    uv = across[0].uv[np.isfinite(across[0].uv[:, 0])]
    assert uv[0, 1] < uv[len(uv) // 2, 1] - 50
    ticks = scenery.vertical_ticks(camera)
    length = np.hypot(*(ticks[:, -1] - ticks[:, 0]).T)
    assert len(ticks) > 40 and length.min() > 0.6 * length.max()


def test_steep_and_straight_down_cameras_show_no_horizon():
    steep = scenes.camera(tilt_rad=np.radians(60))
    assert not scenery.in_frame(scenery.horizon_curve(steep), (768, 576)).any()
    down = scenes.camera(tilt_rad=np.pi / 2)
    assert len(scenery.horizon_curve(down)) == 0


def test_the_horizon_band_is_the_spread_of_sampled_horizons():
    """Monte Carlo over the covariance, an independent way to the same width."""
    camera = scenes.camera(tilt_rad=0.15, roll_rad=0.05)
    curve = scenery.horizon_curve(camera)
    middle = curve[scenery.in_frame(curve, camera.image_size)]
    at = middle[np.argmin(np.abs(middle[:, 0] - 600))]
    upper, lower = scenery.horizon_band(camera, scenes.COVARIANCE, at[None])
    width = np.linalg.norm(upper - lower) / np.cos(0.05)
    rng = np.random.default_rng(1)
    rows = []
    for f, tilt, roll, _, _ in rng.multivariate_normal(np.zeros(5), scenes.COVARIANCE, 400):
        other = scenes.camera(
            focal_px=camera.focal_px * np.exp(f), tilt_rad=0.15 + tilt, roll_rad=0.05 + roll
        )
        line = scenery.horizon_curve(other)
        rows.append(np.interp(at[0], line[:, 0], line[:, 1]))
    assert width == pytest.approx(2 * 1.96 * np.std(rows), rel=0.12)
    assert upper[0, 1] < at[1] < lower[0, 1]


@settings(max_examples=40, deadline=None)
@given(POSES)
def test_vertical_ticks_run_along_plumb_lines(pose):
    camera = built(pose)
    ticks = scenery.vertical_ticks(camera)
    middle = np.array([[(camera.image_size[0] - 1) / 2, camera.image_size[1] * 0.25]])
    assert len(ticks) > 0 or not camera.undistort(middle)[1].all()  # the lens does not reach there
    for tick in ticks[np.isfinite(ticks).all(axis=(1, 2))][::7]:
        uv, _ = camera.undistort(tick)
        ray = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(camera.K).T @ camera.R
        # All rays to one vertical line lie in one vertical plane through the camera.
        normal = np.cross(ray[0], ray[-1])
        assert abs(normal[2]) < 1e-6 * np.linalg.norm(normal) + 1e-9


def test_the_nadir_is_marked_only_where_the_frame_shows_it():
    assert scenery.nadir_pixel(scenes.camera()) is None
    down = scenes.camera(tilt_rad=np.radians(75), focal_px=500.0)
    expected = frame_pixels(down, np.array([[0.0, 0.0, 0.0]]))[0]
    np.testing.assert_allclose(scenery.nadir_pixel(down), expected, atol=1e-6)


@settings(max_examples=30, deadline=None)
@given(POSES)
def test_grid_lines_lie_on_their_ground_lines(pose):
    camera = built(pose)
    for line in scenery.grid_lines(camera, Area(-12.0, 12.0, 2.0, 30.0), 5.0, samples=60):
        seen = np.isfinite(line.uv[:, 0])
        assert seen.sum() >= 2
        xy, valid = camera.locate(line.uv[seen])
        assert valid.all()
        held = xy[:, 0 if line.axis == "x" else 1]
        np.testing.assert_allclose(held, line.value_m, atol=1e-3)
        assert line.value_m % 5.0 == 0


def test_points_beyond_the_fold_are_not_drawn_inside_the_frame():
    camera = scenes.camera(focal_px=384.0, tilt_rad=0.0, distortion=BARREL)
    # Normalised radius 2.5: the polynomial throws it back to 2.5 (1 - 0.3 * 6.25) < 0.
    seen = np.isfinite(scenery.image_of(camera, np.array([[50.0, 20, 7], [4.0, 20, 5]])))
    assert seen.all(axis=1).tolist() == [False, True]


def test_uprights_are_spread_inside_the_frame_and_apart():
    camera = scenes.camera()
    _, xy, _ = scenes.people(camera, 200)
    rows = scenery.upright_rows(camera, xy, 1.7)
    assert 4 <= len(rows) <= 7
    curves = scenery.upright_curves(camera, xy[rows], 1.7)
    assert scenery.in_frame(curves.reshape(-1, 2), camera.image_size).all()
    heads = curves[:, -1]
    gaps = np.abs(heads[:, None] - heads[None]) / (768 * 0.09, 576 * 0.075)
    assert (gaps.max(axis=2) + np.eye(len(rows)) * 9 >= 1).all()
    ranges = np.hypot(*xy[rows].T)
    assert ranges.max() > 2 * ranges.min()


def test_no_upright_where_nobody_walked():
    assert len(scenery.upright_rows(scenes.camera(), np.empty((0, 2)), 1.7)) == 0
    assert len(scenery.upright_rows(scenes.camera(), np.array([[0.0, -20.0]]), 1.7)) == 0
