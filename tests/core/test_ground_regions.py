"""Regions with a ground of their own: their outline, their file, and what they do to positions."""

import json

import cv2
import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.ground_regions import GroundRegion
from strategies import build_camera, build_lens

CAMERA = build_camera(build_lens((1280, 720), 50.0), 25.0, 1.0, 6.0)
CORNERS = np.array([[600.0, 300], [1200, 320], [1100, 650], [800, 480], [560, 700]])
REGION = GroundRegion(CORNERS, 0.55, 0.06)
SIGMA = np.array([0.02, 0.01, 0.005, 0.03, 0.0])


def calibration(*regions: GroundRegion) -> Calibration:
    return Calibration(
        status="ok",
        method="joint",
        image_size=CAMERA.image_size,
        person_height_m=1.7,
        camera=CAMERA,
        covariance=np.diag(SIGMA**2),
        ground_regions=regions,
    )


@given(st.lists(st.tuples(st.floats(0, 1279), st.floats(0, 719)), min_size=1, max_size=20))
def test_inside_is_what_opencv_calls_inside(points):
    uv = np.array(points)
    outline = CORNERS.astype(np.float32)
    away = np.array([cv2.pointPolygonTest(outline, (u, v), True) for u, v in points])
    clear = np.abs(away) > 0.01
    np.testing.assert_array_equal(REGION.contains(uv)[clear], away[clear] > 0)


def test_nan_is_outside():
    assert not REGION.contains(np.array([[np.nan, 400.0], [700, np.nan]])).any()


def test_the_file_keeps_regions(tmp_path):
    calibration(REGION).save(tmp_path / "camera.json")
    (again,) = Calibration.load(tmp_path / "camera.json").ground_regions
    np.testing.assert_array_equal(again.polygon_uv, CORNERS)
    assert (again.height_m, again.sigma_m) == (0.55, 0.06)
    calibration().save(tmp_path / "flat.json")
    assert "ground_regions" not in json.loads((tmp_path / "flat.json").read_text())
    assert Calibration.load(tmp_path / "flat.json").ground_regions == ()


@pytest.mark.parametrize(
    ("changes", "named"),
    [
        ({"polygon_uv": [[0, 0], [1, 1]]}, "polygon_uv"),
        ({"polygon_uv": [[0, 0], [1, 1], [2, None]]}, "polygon_uv"),
        ({"height_m": 6.5}, "height_m"),
        ({"height_m": "high"}, "height_m"),
        ({"sigma_m": -0.1}, "sigma_m"),
        ({"level": 2}, "level"),
    ],
)
def test_bad_regions_are_refused_by_name(tmp_path, changes, named):
    values = calibration(REGION).to_dict()
    values["ground_regions"][0] |= changes
    (tmp_path / "camera.json").write_text(json.dumps(values))
    with pytest.raises(InputError, match=rf"camera\.json: .*{named}"):
        Calibration.load(tmp_path / "camera.json")
    values["ground_regions"] = {"polygon_uv": []}
    (tmp_path / "camera.json").write_text(json.dumps(values))
    with pytest.raises(InputError, match="ground_regions"):
        Calibration.load(tmp_path / "camera.json")


def test_feet_on_a_platform_are_where_the_platform_is():
    """Points of known height through the camera and back, on the region and beside it."""
    found = calibration(REGION)
    z = np.array([0.55, 0.55, 0.0])
    xy, _ = CAMERA.locate([[800, 400], [1000, 500], [300, 500]], z)
    uv, valid = CAMERA.project(np.column_stack([xy, z]))
    assert valid.all()
    np.testing.assert_array_equal(REGION.contains(uv), z > 0)
    np.testing.assert_allclose(found.ground_jacobian(uv)[0], xy, atol=1e-9)
    again, seen = found.ground_pixels(xy)
    assert seen.all()
    np.testing.assert_allclose(again, uv, atol=1e-6)
    np.testing.assert_array_equal(found.ground_height_m(uv), [z, np.where(z > 0, 0.06, 0.0)])


def test_the_uncertain_height_joins_the_covariance():
    """Against the points that a region one sigma higher gives."""
    uv = np.array([[800.0, 400.0], [300.0, 500.0]])
    with_sigma = calibration(REGION).ground_covariance(uv, from_camera=True)[0]
    exact = calibration(GroundRegion(CORNERS, 0.55, 0.0)).ground_covariance(uv, from_camera=True)[0]
    here, there = (CAMERA.locate(uv[0], z)[0] for z in (0.55, 0.55 + 1e-5))
    moved = (there - here) / 1e-5 * 0.06
    np.testing.assert_allclose((with_sigma - exact)[0], np.outer(moved, moved), rtol=1e-4)
    np.testing.assert_array_equal(with_sigma[1], exact[1])


def test_a_camera_over_another_ground_sees_the_same():
    xyz = np.array([[1.0, 9.0, 0.7], [-2.0, 15.0, 2.4]])
    over = CAMERA.on_ground(0.7)
    np.testing.assert_allclose(
        over.project(xyz - [0, 0, 0.7])[0], CAMERA.project(xyz)[0], atol=1e-9
    )
    assert over.height_m == pytest.approx(5.3)
