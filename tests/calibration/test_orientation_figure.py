"""The orientation's figure, and the network's horizon in the report of a calibration."""

import cv2
import numpy as np
import pytest

import report_scenes as scenes
from scene4d.calibration.report._captions import caption
from scene4d.calibration.report._orientation import draw_orientation, horizon_rows
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.geometry import horizon_line
from scene4d.drawing.overlay import draw_overlay
from scene4d.perception.orientation import Belief

SIZE = (640, 480)
CAMERA = Camera.from_pose(
    image_size=SIZE, focal_px=500.0, tilt_rad=np.radians(10), roll_rad=np.radians(6), height_m=5.0
)
VFOV = 2 * np.arctan(240 / 500.0)


def belief(sigma: float = 1.0) -> Belief:
    spread = np.radians(1.0) * sigma, np.radians(2.0) * sigma, 0.1 * sigma
    return Belief.gaussian((CAMERA.roll_rad, CAMERA.tilt_rad, float(np.log(VFOV))), spread)


def horizon_of(camera: Camera, u: np.ndarray) -> np.ndarray:
    a, b, c = horizon_line(camera.K, camera.R)
    return -(a * u + c) / b


def test_the_band_holds_the_horizon_and_widens_with_doubt():
    u = np.array([0.0, 319.5, 639.0])
    true = horizon_of(CAMERA, u)
    narrow, wide = (horizon_rows(belief(s), SIZE, u) for s in (1.0, 3.0))
    assert (narrow[:, 0] < true).all() and (true < narrow[:, 1]).all()
    assert (np.ptp(wide, axis=1) > 2 * np.ptp(narrow, axis=1)).all()


def test_the_band_is_that_of_drawn_cameras():
    """An independent way: cameras drawn from the Gaussian itself, projected one by one."""
    rng = np.random.default_rng(5)
    u, rows = np.array([100.0, 600.0]), []
    for _ in range(3000):
        # A cell's evenness adds a twelfth of its squared width to the variance.
        cell = np.array([1.5, 2.5]) ** 2 / 12
        roll = CAMERA.roll_rad + np.radians(rng.normal(0, np.sqrt(1 + cell[0])))
        tilt = CAMERA.tilt_rad + np.radians(rng.normal(0, np.sqrt(4 + cell[1])))
        log_step = np.log(110 / 9) / 20
        vfov = VFOV * np.exp(rng.normal(0, np.sqrt(0.01 + log_step**2 / 12)))
        drawn = Camera.from_pose(
            image_size=SIZE, focal_px=float(240 / np.tan(vfov / 2)), tilt_rad=float(tilt),
            roll_rad=float(roll), height_m=1.0,
        )  # fmt: skip
        rows.append(horizon_of(drawn, u))
    expected = np.quantile(rows, [0.025, 0.975], axis=0).T
    np.testing.assert_allclose(horizon_rows(belief(), SIZE, u), expected, atol=6.0)


def test_a_told_focal_length_makes_the_band_narrower():
    u = np.array([319.5])
    steep = Belief.gaussian((0.0, np.radians(30), float(np.log(VFOV))), (0.02, 0.02, 0.3))
    free, told = (horizon_rows(steep, SIZE, u, focal_px=f) for f in (None, 500.0))
    assert np.ptp(told) < 0.5 * np.ptp(free)


@pytest.mark.parametrize("given", [belief(), Belief.even()], ids=["sure", "ignorant"])
def test_the_figure_is_a_picture(given):
    image = np.full((480, 640, 3), 90, np.uint8)
    png = draw_orientation(given, CAMERA, image, frames=3)
    assert cv2.imdecode(np.frombuffer(png, np.uint8), cv2.IMREAD_COLOR).shape[1] > 900
    assert draw_orientation(given, CAMERA, focal_known=True) != png
    with pytest.raises(InputError, match="report"):
        draw_orientation(given, CAMERA, image[:100])


@pytest.mark.parametrize("status", ["ok", "undetermined"])
def test_the_networks_horizon_lies_beside_the_peoples(status):
    """The overlay changes along the second horizon, and hardly anywhere else above the legend."""
    found = scenes.calibration(scenes.camera(tilt_rad=np.radians(8)), status=status)
    other = Camera.from_pose(
        image_size=(768, 576), focal_px=1185.0, tilt_rad=np.radians(3), roll_rad=0.0, height_m=1.0
    )
    plain, both = (
        cv2.imdecode(np.frombuffer(draw_overlay(found, None, n).png, np.uint8), cv2.IMREAD_COLOR)
        for n in (None, other)
    )
    picture = slice(0, round(plain.shape[0] * 0.85))
    changed = np.flatnonzero((plain[picture] != both[picture]).any(axis=(1, 2)))
    row = float(horizon_of(other, np.array([383.5]))[0])
    scale = plain.shape[1] / 768
    assert len(changed) > 0
    np.testing.assert_allclose(changed, row * scale, atol=0.02 * plain.shape[0])


def test_the_caption_speaks_of_the_dashed_line_where_it_is_drawn():
    found = scenes.calibration()
    near, far = scenes.camera(roll_rad=0.1), scenes.camera(tilt_rad=np.radians(40))
    assert "second opinion" in caption("overlay", found, near)
    assert "second opinion" not in caption("overlay", found)
    assert "second opinion" not in caption("overlay", found, far)
    legends = [dict(draw_overlay(found, network=network).legend) for network in (near, far)]
    assert "network's horizon" in legends[0]
    assert any(label.startswith("network's horizon:") for label in legends[1])
