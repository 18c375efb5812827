"""The tester tested: the cameras, points and crowds that other tests stand on are what they say."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from strategies import (
    FOOT_HEIGHT_M,
    TALLEST_M,
    build_camera,
    build_lens,
    cameras,
    cameras_over_people,
    lenses,
    people_scene,
    views,
)

SEED = st.integers(0, 2**32 - 1)
EXACT = {"noise": 0.0, "noise_px": 0.0}


@given(camera=cameras(anywhere=True))
def test_cameras_keep_their_ranges(camera):
    assert np.radians(4.99) < camera.tilt_rad < np.radians(60.01)
    assert abs(camera.roll_rad) < np.radians(20.01)
    assert 1.99 < camera.height_m < 20.01
    half_width = camera.image_size[0] / 2
    assert np.radians(7.49) < np.arctan(half_width / camera.K[0, 0]) < np.radians(45.01)


@given(lens=lenses())
def test_lenses_fold_outside_the_image_only(lens):
    """Along the way to each corner the undistorted radius exists and grows."""
    width, height = lens.image_size
    for corner in ([0, 0], [width - 1, 0], [0, height - 1], [width - 1, height - 1]):
        centre = lens.K[:2, 2]
        way = centre + np.linspace(0, 1, 50)[:, None] * (np.array(corner) - centre)
        uv, valid = lens.undistort(way)
        assert valid.all()
        assert (np.diff(np.hypot(*(uv - centre).T)) > 0).all()


@given(view=views())
def test_views_see_their_points(view):
    camera, points, uv = view
    np.testing.assert_array_equal(np.round(points[:, 2], 9), 0)
    assert ((uv >= 0) & (uv <= np.array(camera.image_size) - 1)).all()
    np.testing.assert_allclose(camera.project(points, undistorted=True)[0], uv, atol=1e-6)


def test_the_builder_s_numbers_are_the_camera_s():
    camera = build_camera(build_lens((1280, 720), 90.0), 25.0, -7.0, 5.0, 130.0, (3.0, -4.0))
    assert np.degrees(camera.tilt_rad) == pytest.approx(25)
    assert np.degrees(camera.roll_rad) == pytest.approx(-7)
    np.testing.assert_allclose(camera.centre_m, [3, -4, 5], atol=1e-12)
    assert camera.focal_px == pytest.approx(640)
    heading = np.arctan2(-camera.R[2, 0], camera.R[2, 1])
    assert np.degrees(heading) == pytest.approx(130)
    np.testing.assert_allclose(camera.K[:2, 2], [639.5, 359.5])


@settings(max_examples=40)
@given(camera=cameras_over_people(), seed=SEED)
def test_people_are_where_the_scene_says(camera, seed):
    scene = people_scene(camera, 30, np.random.default_rng(seed), **EXACT)
    xy, valid = camera.locate(scene.foot_uv, FOOT_HEIGHT_M)
    assert valid.all()
    np.testing.assert_allclose(xy, scene.xy_m, rtol=1e-6, atol=1e-6)
    xy, valid = camera.locate(scene.head_uv, scene.height_m)
    seen_from_afar = np.abs(scene.height_m - camera.height_m) > 0.3
    np.testing.assert_allclose(xy[seen_from_afar], scene.xy_m[seen_from_afar], rtol=1e-5, atol=1e-5)
    tallest, _ = camera.project(np.column_stack([scene.xy_m, np.full(30, TALLEST_M)]))
    last = np.array(camera.image_size) - 1
    for ends in (scene.foot_uv, tallest):
        assert ((ends >= 0) & (ends <= last)).all()


def test_the_view_selects_nobody_by_height():
    """A camera over whose upper edge tall people would often stick out."""
    camera = build_camera(build_lens((1280, 720), 35.0), 30.0, 0.0, 7.0)
    scene = people_scene(camera, 40_000, np.random.default_rng(1), **EXACT)
    assert scene.height_m.mean() == pytest.approx(1.70, abs=4 * 0.09 / 200)
    assert scene.height_m.std() == pytest.approx(0.09, rel=0.03)
    # Least room for heads: whoever stands where only 2.05 m just fits is as tall as the others.
    head, _ = camera.project(np.column_stack([scene.xy_m, np.full(len(scene), TALLEST_M)]))
    at_the_edge = head[:, 1] < np.quantile(head[:, 1], 0.1)
    assert scene.height_m[at_the_edge].mean() == pytest.approx(1.70, abs=4 * 0.09 / 60)


def test_tracks_walk_and_keep_their_height():
    camera = build_camera()
    scene = people_scene(camera, 200, np.random.default_rng(2), tracks=10, **EXACT)
    assert np.bincount(scene.track).tolist() == [20] * 10
    for track in range(10):
        rows = scene.track == track
        assert np.ptp(scene.height_m[rows]) == 0
        strides = np.diff(scene.xy_m[rows], axis=0)
        np.testing.assert_allclose(strides, strides[:1].repeat(19, axis=0), atol=1e-9)
        assert 0 < np.hypot(*strides[0]) < 1 + 1e-9
    assert len(np.unique(scene.height_m)) == 10


def test_single_sightings_are_different_people():
    scene = people_scene(build_camera(), 50, np.random.default_rng(3))
    assert len(np.unique(scene.track)) == len(np.unique(scene.height_m)) == 50


def test_outliers_are_people_without_legs():
    camera = build_camera()
    scenes = [
        people_scene(camera, 1000, np.random.default_rng(4), outliers=share, **EXACT)
        for share in (0.0, 0.25)
    ]
    whole, cut = (np.hypot(*(s.foot_uv - s.head_uv).T) for s in scenes)
    np.testing.assert_array_equal(scenes[0].head_uv, scenes[1].head_uv)
    left = cut / whole
    outlier = scenes[1].outlier
    assert outlier.sum() == 250
    np.testing.assert_allclose(left[~outlier], 1)
    assert left[outlier].min() > 0.3 - 1e-9
    assert left[outlier].max() < 0.85 + 1e-9
    assert np.ptp(left[outlier]) > 0.5


def test_noise_is_as_large_as_it_says():
    camera = build_camera()
    exact, relative, pixels = (
        people_scene(camera, 4000, np.random.default_rng(5), **options)
        for options in (EXACT, {"noise": 0.02, "noise_px": 0.0}, {"noise": 0.0, "noise_px": 2.0})
    )
    length = np.hypot(*(exact.foot_uv - exact.head_uv).T)
    up = (exact.head_uv - exact.foot_uv) / length[:, None]
    moved = (relative.head_uv - exact.head_uv) / length[:, None]
    assert np.std((moved * up).sum(axis=1)) == pytest.approx(0.02, rel=0.05)
    sideways = moved[:, 0] * -up[:, 1] + moved[:, 1] * up[:, 0]
    assert np.std(sideways) == pytest.approx(0.03, rel=0.05)
    np.testing.assert_allclose(relative.foot_uv, exact.foot_uv, atol=1e-9)
    for end in ("foot_uv", "head_uv"):
        spread = np.std(getattr(pixels, end) - getattr(exact, end), axis=0)
        np.testing.assert_allclose(spread, 2, rtol=0.05)


def test_footage_of_a_lens_is_distorted():
    camera = build_camera(build_lens(radial=(-0.08, 0.0, 0.0)))
    scene = people_scene(camera, 100, np.random.default_rng(6), distorted=True, **EXACT)
    flat, _ = camera.project(np.column_stack([scene.xy_m, scene.height_m]), undistorted=True)
    np.testing.assert_allclose(scene.head_uv, camera.distort(flat)[0])
    assert np.abs(scene.head_uv - flat).max() > 5
    assert ((scene.foot_uv >= 0) & (scene.foot_uv <= [1279, 719])).all()


def test_the_same_seed_is_the_same_crowd():
    one, two = (
        people_scene(build_camera(), 20, np.random.default_rng(7), tracks=4) for _ in range(2)
    )
    np.testing.assert_array_equal(one.foot_uv, two.foot_uv)
    np.testing.assert_array_equal(one.head_uv, two.head_uv)


def test_a_view_that_holds_nobody_says_so():
    camera = build_camera(build_lens((1920, 1080), 15.0), tilt_deg=60.0, height_m=2.0)
    with pytest.raises(ValueError, match="only 0 of 5 people"):
        people_scene(camera, 5, np.random.default_rng(8))
