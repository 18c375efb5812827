"""What the page computes itself, beside Python: the camera, flow, places on the Earth."""

import json
import re
from dataclasses import replace

import numpy as np
import pytest

from finding_scenes import people
from scene4d.app._contents import camera_of
from scene4d.app._page import asset
from scene4d.app._rows import rows_of
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.colours import PALETTE
from scene4d.core.placement import Placement
from scene4d.formats.scenes._geo import GeoAnchor


def a_camera(rng: np.random.Generator) -> Camera:
    """Any camera that looks at a ground, with a lens of either model."""
    fisheye = bool(rng.integers(2))
    distortion = rng.uniform(-0.12, 0.12, 5) * (1, 0.3, 0.02, 0.02, 0.05)
    return Camera.from_pose(
        image_size=(1280, 720),
        focal_px=rng.uniform(500, 1500),
        tilt_rad=rng.uniform(0.1, 1.3),
        roll_rad=rng.uniform(-0.3, 0.3),
        height_m=rng.uniform(2, 20),
        distortion=distortion[:4] if fisheye else distortion,
        distortion_model="fisheye" if fisheye else "pinhole",
    )


@pytest.fixture(scope="module")
def in_browser(browser):
    """Run a function of (Camera, said, values) with the page's own camera."""
    page = browser.new_page()
    code = re.sub(r"^export ", "", asset("camera.js") + asset("geo.js"), flags=re.MULTILINE)

    def answers(function: str, calibration: Calibration, values: list) -> list:
        said = camera_of(calibration)
        return page.evaluate(
            f"([said, values]) => {{ {code}; const camera = new Camera(said); "
            f"return values.map({function}); }}",
            [said, values],
        )

    yield answers
    page.close()


@pytest.mark.parametrize("seed", range(3))
def test_the_pages_camera_locates_and_projects_as_pythons(in_browser, seed):
    rng = np.random.default_rng(seed)
    for _ in range(10):
        camera = a_camera(rng)
        calibration = Calibration.of_camera(camera)
        uv = rng.uniform(0, (1279, 719), (40, 2))
        xy, valid = camera.locate(uv)
        found = in_browser("(uv) => camera.locate(...uv)", calibration, uv.tolist())
        assert [one is not None for one in found] == valid.tolist()
        near = valid & (np.hypot(*np.nan_to_num(xy).T) < 300)
        theirs = np.array([one for one, kept in zip(found, near, strict=True) if kept])
        assert np.abs(theirs - xy[near]).max() < 1e-3  # a millimetre
        back = in_browser("(xy) => camera.project(...xy)", calibration, xy[near].tolist())
        assert np.abs(np.array(back, float) - uv[near]).max() < 1e-3


def test_the_pages_error_of_a_length_is_that_of_the_covariance(in_browser):
    rng = np.random.default_rng(5)
    checked = 0
    for _ in range(12):
        root = np.diag([0.05, 0.02, 0.01, 0.04, 0.005, 0.02, 0.02]) @ np.tri(7)
        calibration = replace(Calibration.of_camera(a_camera(rng)), covariance=root @ root.T)
        uv = rng.uniform((0, 300), (1279, 719), (2, 2))
        xy, jacobian, valid = calibration.ground_jacobian(uv)
        if not valid.all() or np.hypot(*xy.T).max() > 150:
            continue
        along = (xy[0] - xy[1]) / np.hypot(*(xy[0] - xy[1]))
        slope = along @ (jacobian[0] - jacobian[1])
        sigma = np.sqrt(slope @ calibration.parameter_covariance @ slope)
        said = "(uv) => camera.sigma(distanceBetween, uv).camera"
        assert in_browser(said, calibration, [uv.tolist()]) == [pytest.approx(sigma, rel=1e-3)]
        checked += 1
    assert checked > 6


def test_the_likeliest_colours_of_a_track_are_told_with_their_probability():
    one = people()[0]
    colours = np.zeros((len(one), 2 * len(PALETTE)), np.float32)
    colours[:, PALETTE.index("dark blue")], colours[:, PALETTE.index("grey")] = 0.63, 0.37
    (told,) = rows_of(replace(one, colours=colours))["tracks"]
    assert told["colours"] == [["dark blue", pytest.approx(0.63)], None]
    assert rows_of(one)["tracks"][0]["colours"] == []


def test_two_streams_through_one_place_are_two_arrows(browser):
    """One goes east at 1 m/s, the other north-west at 2 m/s, and one stands."""
    page = browser.new_page()
    code = re.sub(r"^export |^import .*$", "", asset("look.js") + asset("flow.js"), flags=re.M)
    velocities = [(1.0, 0.0), (-(2**0.5), 2**0.5), (0.05, 0.0)]
    rows = {
        "step": 100,
        "starts": [0, 20, 40, 60],
        "brief": [{"k": k} for k in range(3)],
        "columns": {
            "x_m": [10.5] * 60,
            "y_m": [5.5] * 60,
            "vx_mps": [vx for vx, _ in velocities for _ in range(20)],
            "vy_mps": [vy for _, vy in velocities for _ in range(20)],
        },
    }
    said = "(rows) => flowField(rows, [0, 0, 45, 45], () => true)"
    found = page.evaluate(f"(rows) => {{ {code}; return ({said})(rows); }}", rows)
    assert found["most"] == pytest.approx(1.0)  # 95 % of two streams: the slower
    arrows = np.array([arrow for level in found["levels"] for arrow in level])
    assert np.allclose(arrows[:, :2], (10.5, 5.5))
    turns = sorted(np.degrees(np.arctan2(arrows[:, 3], arrows[:, 2])).tolist())
    assert turns == [pytest.approx(0.0, abs=0.1), pytest.approx(135.0, abs=0.1)]
    page.close()


@pytest.mark.parametrize("place", [(0.0, 0.0), (52.4, 179.99), (-33.9, 18.4), (78.2, 15.6)])
def test_longitude_and_latitude_are_those_of_pyproj(browser, place):
    page = browser.new_page()
    code = re.sub(r"^export ", "", asset("geo.js"), flags=re.M)
    xy = np.array([[0.0, 0.0], [120.0, -40.0], [-5_000.0, 9_000.0], [0.0, -1.0]])
    anchor = {"latitude_deg": place[0], "longitude_deg": place[1]}
    found = page.evaluate(
        f"([anchor, all]) => {{ {code}; return all.map((xy) => lonLat(anchor, xy)); }}",
        [anchor, xy.tolist()],
    )
    assert np.abs(np.array(found) - GeoAnchor.at(*place).to_lonlat(xy)).max() < 1e-9  # 0.1 mm
    page.close()


def test_the_error_of_a_place_on_the_earth_has_three_parts(in_browser):
    """That of the camera, that of its place in the site, and that of pointing."""
    rng = np.random.default_rng(3)
    camera = a_camera(rng)
    root = np.diag([0.05, 0.02, 0.01, 0.04, 0.005, 0.02, 0.02]) @ np.tri(7)
    calibration = replace(Calibration.of_camera(camera), covariance=root @ root.T)
    spread = np.diag([0.3, 0.2, 0.01, 0.02]) @ np.tri(4)
    covariance = np.zeros((5, 5))
    covariance[:4, :4] = spread @ spread.T
    placed = Placement(3.0, -4.0, 0.4, 1.1, 0.0, covariance)
    uv = np.array([[640.0, 700.0]])
    xy, jacobian, valid = calibration.ground_jacobian(uv)
    assert valid.all()
    expected = jacobian[0] @ calibration.parameter_covariance @ jacobian[0].T
    own = np.linalg.solve(placed.linear, xy[0] - (placed.x_m, placed.y_m))
    expected = expected + placed.point_covariances(own[None])[0]
    ahead, behind = (camera.locate(uv + step * np.eye(2))[0] for step in (0.5, -0.5))
    expected = expected + (ahead - behind).T @ (ahead - behind) * 2.0**2
    said = {"x_m": 3.0, "y_m": -4.0, "covariance": covariance[:4, :4].tolist()}
    point = {"uv": uv[0].tolist(), "xy": xy[0].tolist()}
    function = (
        f"(point) => (camera.said.placement = {json.dumps(said)}, placeSigma(camera, point, 2))"
    )
    (found,) = in_browser(function, calibration, [point])
    assert found == pytest.approx(np.sqrt(np.diag(expected)).tolist(), rel=1e-3)
