"""What a notebook shows of cameras, calibrations and tracks, and what other libraries get."""

import re
import subprocess
import sys
from dataclasses import replace

import cv2
import numpy as np
import pyarrow
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core import geometry
from scene4d.core.body import COCO17
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.notebook import camera_svg, plan_svg
from scene4d.core.tracks import Tracks
from strategies import build_camera, build_lens, cameras, views

CAMERA = build_camera(build_lens((1280, 720), 60.0, radial=(-0.1, 0.0, 0.0)), 20.0, 3.0, 6.0)


@given(camera=cameras(anywhere=True))
def test_opencv_takes_the_pose(camera):
    points = camera.centre_m + 10 * camera.R[2] + np.array([[0.0, 0, 0], [1, 2, 0.5]])
    expected, _ = cv2.projectPoints(points, camera.rvec, camera.tvec, camera.K, camera.distortion)
    uv, valid = camera.project(points)
    np.testing.assert_allclose(uv[valid], expected[:, 0][valid], atol=1e-5)


@pytest.mark.parametrize("angle", [0.0, 1e-9, 1.0, np.pi - 1e-6, np.pi])
def test_rotation_vectors_have_the_angle_as_their_length(angle):
    axis = np.array([2.0, -1.0, 2.0]) / 3
    found = geometry.rotation_vector(cv2.Rodrigues(axis * angle)[0])
    assert np.linalg.norm(found) == pytest.approx(angle, abs=1e-7)
    np.testing.assert_allclose(np.abs(found), np.abs(axis * angle), atol=1e-6)


@given(view=views(cameras(anywhere=True)))
def test_the_homography_maps_the_ground_to_undistorted_pixels_and_back(view):
    camera, xyz_m, flat = view
    there = np.column_stack([xyz_m[:, :2], np.ones(len(xyz_m))]) @ camera.homography.T
    np.testing.assert_allclose(there[:, :2] / there[:, 2:], flat, atol=1e-6)
    back = np.column_stack([flat, np.ones(len(flat))]) @ np.linalg.inv(camera.homography).T
    np.testing.assert_allclose(back[:, :2] / back[:, 2:], xyz_m[:, :2], rtol=1e-5, atol=1e-4)


def lines_of(svg: str, colour: str) -> list[np.ndarray]:
    found = re.findall(r'points="([^"]*)" stroke="(#\w+)"', svg)
    return [
        np.array([point.split(",") for point in points.split()], float)
        for points, stroke in found
        if stroke == colour
    ]


def test_a_camera_shows_its_horizon_its_grid_and_people():
    svg = camera_svg(CAMERA)
    level = np.concatenate(lines_of(svg, "#0072B2"))
    ray = np.column_stack([CAMERA.undistort(level)[0], np.ones(len(level))])
    rise = ray @ np.linalg.inv(CAMERA.K).T @ CAMERA.R[:, 2]
    inside = (level > 0).all(axis=1) & (level < CAMERA.image_size).all(axis=1)
    assert inside.sum() > 10 and np.abs(rise[inside]).max() < 1e-3
    uprights = lines_of(svg, "#D55E00")
    assert 5 <= len(uprights) <= 20
    for line in uprights:
        foot = CAMERA.locate(line[0])[0]
        head = CAMERA.project([*foot, 1.70])[0]
        np.testing.assert_allclose(line[-1], head, atol=0.5)
    grid = [CAMERA.locate(line) for line in lines_of(svg, "#777777")]
    assert 6 <= len(grid) <= 30
    for xy, valid in grid:
        spread = np.ptp(xy[valid], axis=0).min() if valid.any() else 0.0
        assert spread < 0.05 * max(1.0, float(np.abs(xy[valid]).max(initial=1.0)))


@given(camera=cameras(anywhere=True))
def test_every_camera_can_be_shown(camera):
    html = camera._repr_html_()
    assert "<svg" in html and "nan" not in html and "http" not in html
    assert len(html) < 200_000


@pytest.mark.parametrize("tilt_deg", [-40.0, 0.0, 90.0])
def test_cameras_without_ground_or_horizon_can_be_shown(tilt_deg):
    assert "<svg" in build_camera(build_lens((640, 480)), tilt_deg, 0.0, 5.0)._repr_html_()


def test_a_calibration_shows_its_errors_by_name():
    found = replace(
        Calibration.of_camera(CAMERA),
        covariance=np.diag([0.01, 0.002, 0.002, 0.01, 0]) ** 2,
        ground_error_m={"median": 0.21, "p90": 0.5},
        ground_error_from_camera_m={"median": 1.43, "p90": 2.5},
        warnings=("<few> people",),
    )
    html = found._repr_html_()
    assert "<th>Error within the scene</th><td>0.21 m (median)</td>" in html
    assert "<th>Error from the camera</th><td>1.43 m (median)</td>" in html
    assert "± 0.06 m" in html and "&lt;few&gt; people" in html and "<svg" in html
    refused = replace(found, status="undetermined", camera=None, reason="nobody <here>")
    assert "nobody &lt;here&gt;" in refused._repr_html_() and "<svg" not in refused._repr_html_()


def tracks(n: int = 6) -> Tracks:
    rng = np.random.default_rng(0)
    matrix = rng.normal(size=(n, 2, 2))
    matrix = matrix @ matrix.swapaxes(1, 2)
    return Tracks(
        track=np.arange(n) // 3,
        class_name=np.where(np.arange(n) < 3, "person", "car"),
        time_s=np.arange(n) / 5,
        frame=np.arange(n),
        xy_m=rng.normal(size=(n, 2)),
        covariance_m2=matrix,
        shared_covariance_m2=2 * matrix,
        velocity_mps=rng.normal(size=(n, 2)),
        velocity_covariance=3 * matrix,
        heading_rad=np.full(n, np.nan),
        heading_sigma_rad=np.full(n, np.nan),
        box_xyxy=rng.normal(size=(n, 4)),
        keypoint_uv=np.zeros((n, 2, 2)),
        keypoint_score=np.zeros((n, 2)),
        score=np.ones(n),
        observed=np.arange(n) % 2 == 0,
    )


def test_tracks_are_tables_for_other_libraries():
    rows = tracks()
    frame, table = rows.to_pandas(), pyarrow.table(rows)
    assert list(frame.columns) == table.column_names
    assert table.num_rows == len(frame) == 6
    np.testing.assert_array_equal(frame[["x_m", "y_m"]].to_numpy(), rows.xy_m)
    np.testing.assert_array_equal(frame["var_xy"], rows.covariance_m2[:, 0, 1])
    np.testing.assert_array_equal(frame["shared_yy"], rows.shared_covariance_m2[:, 1, 1])
    np.testing.assert_array_equal(frame["var_vxx"], rows.velocity_covariance[:, 0, 0])
    assert frame["class"].tolist() == table["class"].to_pylist() == ["person"] * 3 + ["car"] * 3
    assert frame["observed"].dtype == bool and frame["track"].tolist() == [0, 0, 0, 1, 1, 1]
    assert tracks(0).to_pandas().empty


def test_tracks_have_the_columns_of_a_scene():
    from scene4d.store.schema import COLUMN_NAMES, KEYPOINT_COLUMNS

    extra = {"camera", "time", "colours", *KEYPOINT_COLUMNS}
    assert list(tracks().columns()) == [name for name in COLUMN_NAMES if name not in extra]


def test_a_notebook_shows_paths():
    html = tracks()._repr_html_()
    assert "1 x car, 1 x person" in html and html.count("<polyline") == 2
    assert "<polyline" not in tracks(0)._repr_html_()
    assert plan_svg([("person", np.full((3, 2), np.nan))]) == ""


@given(st.integers(1, 5))
def test_gaps_split_a_path(gap):
    xy = np.column_stack([np.arange(12.0), np.arange(12.0)])
    camera = Camera.from_pose(
        image_size=(64, 48), focal_px=50.0, tilt_rad=0.3, roll_rad=0.0, height_m=3.0
    )
    assert camera_svg(camera).count("nan") == 0
    xy[gap] = np.nan
    assert plan_svg([("person", xy)]).count("<polyline") == 1  # places that are not known go


def test_showing_a_camera_loads_nothing_heavy():
    code = (
        "import sys, numpy as np, scene4d; c = scene4d.Camera.from_pose(image_size=(64, 48), "
        "focal_px=50.0, tilt_rad=0.3, roll_rad=0.0, height_m=3.0); c._repr_html_(); "
        "print([m for m in ('cv2', 'matplotlib', 'arro3', 'pandas', 'scipy', 'supervision') "
        "if m in sys.modules])"
    )
    done = subprocess.run([sys.executable, "-c", code], capture_output=True, text=True, check=True)
    assert done.stdout.strip() == "[]"


def test_keypoints_keep_their_names():
    """H3: what takes tracks had to know by itself which keypoints they hold."""
    assert tracks().keypoint_names == ("nose", "left_eye")
    coco = replace(tracks(), keypoint_uv=np.zeros((6, 17, 2)), keypoint_score=np.zeros((6, 17)))
    assert coco.keypoint_names == COCO17
