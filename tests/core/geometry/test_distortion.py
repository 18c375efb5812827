"""Lens distortion, forwards against OpenCV, backwards as its inverse, and where it folds."""

from xml.etree import ElementTree

import cv2
import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core import geometry
from scene4d.core.camera import Lens
from scene4d.formats.cameras import read_camera
from strategies import lenses

K = np.array([[1000.0, 0, 960], [0, 1000, 540], [0, 0, 1]])
COEFFICIENT = st.floats(-0.8, 0.8)


def grid(lens: Lens, n: int = 9) -> np.ndarray:
    width, height = lens.image_size
    u, v = np.meshgrid(np.linspace(0, width - 1, n), np.linspace(0, height - 1, n))
    return np.column_stack([u.ravel(), v.ravel()])


def radial(r, k1, k2, k3):
    return r * (1 + k1 * r**2 + k2 * r**4 + k3 * r**6)


def on_ray(r: np.ndarray, angle_rad: float = 0.5) -> np.ndarray:
    """Pixels at these normalised radii, along one direction from the principal point."""
    direction = np.array([np.cos(angle_rad), np.sin(angle_rad)])
    return 1000 * np.asarray(r)[:, None] * direction + K[:2, 2]


def radius_of(uv: np.ndarray) -> np.ndarray:
    return np.hypot(*((uv - K[:2, 2]) / 1000).T)


@given(lens=lenses())
def test_forward_against_opencv(lens):
    uv = grid(lens)
    rays = np.column_stack([uv, np.ones(len(uv))]) @ np.linalg.inv(lens.K).T
    expected, _ = cv2.projectPoints(rays, np.zeros(3), np.zeros(3), lens.K, lens.distortion)
    np.testing.assert_allclose(lens.distort(uv)[0], expected[:, 0], rtol=0, atol=1e-8)


@given(lens=lenses(), skew=st.floats(-20.0, 20.0))
def test_backward_is_the_inverse_inside_the_image(lens, skew):
    skewed = lens.K.copy()
    skewed[0, 1] = skew
    uv = grid(lens)
    back, valid = geometry.undistort(uv, skewed, lens.distortion)
    assert valid.all()
    np.testing.assert_allclose(
        geometry.distort(back, skewed, lens.distortion)[0], uv, rtol=0, atol=1e-6
    )


@given(lens=lenses())
def test_backward_against_opencv(lens):
    uv = grid(lens)
    # OpenCV iterates towards the same point; 200 steps leave it within a hundredth of a pixel.
    criteria = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 200, 1e-12)
    expected = cv2.undistortPointsIter(
        uv[:, None], lens.K, lens.distortion, np.eye(3), lens.K, criteria
    )
    found, _ = lens.undistort(uv)
    again, _ = lens.distort(expected[:, 0])
    settled = np.abs(again - uv).max(axis=1) < 1e-6
    assert settled.mean() > 0.5
    np.testing.assert_allclose(found[settled], expected[settled, 0], rtol=0, atol=1e-3)


def test_skew_moves_rows_sideways():
    skewed = np.array([[1000.0, 50, 960], [0, 1000, 540], [0, 0, 1]])
    d = np.array([-0.1, 0.0, 0.0, 0.0, 0.0])
    # y = 0.5 and x = 0: the radial factor is 1 - 0.1 * 0.25, and u = 50 y + 960.
    np.testing.assert_allclose(
        geometry.distort(np.array([[985.0, 1040.0]]), skewed, d)[0],
        [[960 + 25 * 0.975, 540 + 500 * 0.975]],
    )


def test_the_principal_point_stays_where_it_is():
    d = np.array([-0.3, 0.1, 0.01, -0.01, 0.02])
    centre = np.array([[960.0, 540.0]])
    np.testing.assert_array_equal(geometry.distort(centre, K, d)[0], centre)
    back, valid = geometry.undistort(centre, K, d)
    np.testing.assert_allclose(back, centre, atol=1e-9)
    assert valid.all()


def test_no_distortion_changes_nothing_and_shares_nothing():
    uv = np.array([[1.0, 2.0], [np.nan, 3.0], [np.inf, 4.0]])
    there, seen = geometry.distort(uv, K, geometry.NO_DISTORTION)
    back, valid = geometry.undistort(uv, K, geometry.NO_DISTORTION)
    assert valid.tolist() == seen.tolist() == [True, False, False]
    for found in (there, back):
        np.testing.assert_array_equal(found, [[1, 2], [np.nan, np.nan], [np.nan, np.nan]])
    assert not np.shares_memory(there, uv)
    assert not np.shares_memory(back, uv)


@pytest.mark.parametrize(
    "d", [[-0.2, 0, 0, 0, 0], [0.2, 0.1, 0, 0, 0], [-0.2, 0, 1e-3, 1e-3, 0], [0, 0, 0.01, 0, 0]]
)
def test_pixels_that_are_no_numbers_have_no_undistorted_position(d):
    uv = np.array([[np.nan, 540], [960, np.nan], [np.inf, 540], [-np.inf, np.inf], [1000, 500]])
    for function in (geometry.undistort, geometry.distort):
        found, valid = function(uv, K, np.array(d, float))
        assert valid.tolist() == [False, False, False, False, True]
        assert np.isnan(found[:4]).all()


def test_no_pixels_are_no_pixels():
    d = np.array([-0.2, 0.0, 0.0, 0.0, 0.0])
    assert geometry.undistort(np.empty((0, 2)), K, d)[0].shape == (0, 2)
    assert geometry.distort(np.empty((0, 2)), K, d)[0].shape == (0, 2)


def test_barrel_ends_at_its_fold():
    # r (1 - 0.3 r²) is largest at r² = 1 / 0.9, where it reaches 2/3 of the radius.
    d = np.array([-0.3, 0.0, 0.0, 0.0, 0.0])
    fold = np.sqrt(1 / 0.9)
    reach = 2 / 3 * fold
    back, valid = geometry.undistort(on_ray([0.999 * reach, 1.001 * reach, 2.0, 50.0]), K, d)
    assert valid.tolist() == [True, False, False, False]
    assert 0.9 * fold < radius_of(back)[0] < fold
    assert np.isnan(back[1:]).all()


@pytest.mark.parametrize(
    ("k1", "k2", "k3", "fold"),
    [
        # Slope 1 - 0.9 s + 0.1 s²: it falls through zero at s = 1.2984 and rises again at 7.70.
        (-0.3, 0.02, 0.0, np.sqrt((0.9 - np.sqrt(0.41)) / 0.2)),
        # Grows at first, folds, and grows again.
        (0.86554041, -0.46170179, 0.05695395, np.sqrt(2.08060264)),
        (0.5, -1.0, 0.0, np.sqrt((1.5 + np.sqrt(22.25)) / 10)),
        # Nearly folds before it does: Newton's method needs its bracket around the root.
        (-0.76346225, 0.31421204, -0.03094414, 2.3400834),
    ],
)
@pytest.mark.parametrize("tangential", [(0.0, 0.0), (1e-4, -1e-4)])
def test_solutions_behind_the_fold_are_none(k1, k2, k3, fold, tangential):
    d = np.array([k1, k2, *tangential, k3])
    slope = 1 + fold**2 * (3 * k1 + fold**2 * (5 * k2 + fold**2 * 7 * k3))
    assert abs(slope) < 1e-3
    before = np.linspace(0, 0.99 * fold, 300)
    back, valid = geometry.undistort(geometry.distort(on_ray(before), K, d)[0], K, d)
    assert valid.all()
    np.testing.assert_allclose(radius_of(back), before, atol=1e-6)
    beyond = np.linspace(1.01 * radial(fold, k1, k2, k3), 40, 200)
    back, valid = geometry.undistort(on_ray(beyond), K, d)
    assert not valid.any()
    assert np.isnan(back).all()


@settings(max_examples=200)
@given(k=st.tuples(COEFFICIENT, COEFFICIENT, st.sampled_from([0.0, 0.0, -0.1, 0.05, 0.1])))
def test_every_point_before_the_first_fold_comes_back_and_none_from_behind(k):
    # The first fold by brute force: where a dense table of the radial map stops growing.
    r = np.linspace(0, 3, 30_001)
    table = radial(r, *k)
    falls = np.flatnonzero(np.diff(table) <= 0)
    fold = r[falls[0]] if len(falls) else r[-1]
    d = np.array([k[0], k[1], 0, 0, k[2]])
    before = np.linspace(0, 0.99 * fold, 25)
    back, valid = geometry.undistort(on_ray(radial(before, *k)), K, d)
    assert valid.all()
    np.testing.assert_allclose(radius_of(back), before, atol=1e-5)
    if len(falls):
        reach = table[: falls[0] + 1].max()
        beyond = on_ray(reach * np.geomspace(1.001, 20, 50))
        assert not geometry.undistort(beyond, K, d)[1].any()


@pytest.mark.parametrize("k2", [0.0, 0.02])
def test_points_beyond_the_fold_have_no_image(k2):
    """d/dr of r - 0.3 r³ + k2 r⁵ is zero; with k2 the model rises again further out."""
    fold = min(
        root.real
        for root in np.roots([5 * k2, 0, -0.9, 0, 1.0])
        if abs(root.imag) < 1e-9 and root.real > 0
    )
    radius = fold * np.array([0.5, 0.999, 1.001, 1.5, 3.0, 5.0])
    d = np.array([-0.3, k2, 0, 0, 0])
    for angle in np.linspace(0, 6, 25):
        uv, valid = geometry.distort(on_ray(radius, angle), K, d)
        assert valid.tolist() == [True] * 2 + [False] * 4
        assert np.isnan(uv[2:]).all() and np.isfinite(uv[:2]).all()


def test_every_visible_grid_point_comes_back():
    """W5: of the points that fold back into the picture none may pass for a visible one."""
    d = np.array([-0.3, 0.0, 0.0, 0.0, 0.0])
    flat = np.stack(np.meshgrid(np.linspace(-9000, 9000, 200), np.linspace(-9000, 9000, 200)), -1)
    flat = flat.reshape(-1, 2)
    uv, valid = geometry.distort(flat, K, d)
    back, again = geometry.undistort(uv[valid], K, d)
    assert 100 < valid.sum() < 2000 and again.all()
    np.testing.assert_allclose(back, flat[valid], atol=1e-4)


def test_a_tangential_lens_folds_earlier_to_one_side():
    d = np.array([-0.3, 0.0, 0.05, 0.02, 0.0])
    angle = np.linspace(0, 2 * np.pi, 72, endpoint=False)
    for radius in (0.5, 0.9, 0.95, 1.0, 1.04):
        flat = 1000 * radius * np.column_stack([np.cos(angle), np.sin(angle)]) + K[:2, 2]
        uv, valid = geometry.distort(flat, K, d)
        back, again = geometry.undistort(uv[valid], K, d)
        assert again.all() and valid.any()
        np.testing.assert_allclose(back, flat[valid], atol=1e-4)
    assert not valid.all()


def test_a_lens_without_a_fold_shows_everything():
    uv = on_ray(np.linspace(0, 8, 100))
    assert geometry.distort(uv, K, np.array([0.2, 0, 0, 0, 0]))[1].all()


def tsai_by_hand(u, v, *, cx, cy, sx, dpx, dpy, kappa1):
    """DATA.md's formula, one pixel at a time."""
    xd, yd = dpx * (u - cx) / sx, dpy * (v - cy)
    factor = 1 + kappa1 * (xd**2 + yd**2)
    return xd * factor * sx / dpx + cx, yd * factor / dpy + cy


def test_tsai_of_pets_as_opencv_coefficients(shared_data):
    path = shared_data / "pets2009" / "View_001.xml"
    root = ElementTree.parse(path).getroot()
    v = {name: float(x) for e in root for name, x in e.attrib.items()}
    camera = read_camera(path)
    uv = grid(camera, 25)
    expected = np.array(
        [
            tsai_by_hand(
                *p, cx=v["cx"], cy=v["cy"], sx=v["sx"], dpx=v["dpx"], dpy=v["dpy"],
                kappa1=v["kappa1"],
            )
            for p in uv
        ]
    )  # fmt: skip
    assert np.abs(expected - uv).max() > 10  # there is something to undo
    found, valid = camera.undistort(uv)
    assert valid.all()
    np.testing.assert_allclose(found, expected, rtol=0, atol=5e-4)
    np.testing.assert_allclose(camera.distort(expected)[0], uv, rtol=0, atol=3e-4)


@given(kappa1=st.floats(-0.004, 0.006), focal_mm=st.floats(4.0, 12.0))
def test_opencv_coefficients_undo_tsai_over_the_sensor(kappa1, focal_mm):
    d = geometry.opencv_from_tsai(kappa1, focal_mm, 2.5)
    assert d[2] == d[3] == 0
    r_d = np.linspace(0, 2.5, 60)
    r_u = r_d * (1 + kappa1 * r_d**2)
    # Pixels of 5 µm: a fiftieth of a pixel at the very most.
    np.testing.assert_allclose(
        focal_mm * radial(r_u / focal_mm, d[0], d[1], d[4]), r_d, rtol=0, atol=1e-4
    )
