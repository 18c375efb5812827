"""Footprints, heights and areas against the scene they were made from."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st

import report_scenes as scenes
from scene4d.calibration.report._errormap import error_grid
from scene4d.drawing import ground
from scene4d.drawing._uncertainty import field_of_view, propagated
from scene4d.drawing.birdseye import rectify, wedge, with_camera
from scene4d.drawing.scenery import image_of


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.25, 0.05, 0.001, -0.001, 0.0)])
def test_footprints_and_heights_return_to_the_truth(distortion):
    camera = scenes.camera(distortion=distortion)
    segments, xy, height = scenes.people(camera, 60)
    np.testing.assert_allclose(ground.footprints(camera, segments), xy, atol=1e-6)
    np.testing.assert_allclose(ground.implied_heights(camera, segments), height, atol=1e-6)


def test_box_feet_stand_on_the_ground_itself():
    camera = scenes.camera()
    xy = np.array([[1.0, 20.0], [-3.0, 30.0]])
    foot = image_of(camera, np.column_stack([xy, np.zeros(2)]))
    head = image_of(camera, np.column_stack([xy, [1.8, 1.6]]))
    boxes = ground.Segments.from_points(foot, head, from_box=True)
    np.testing.assert_allclose(ground.implied_heights(camera, boxes), [1.8, 1.6], atol=1e-9)


def test_a_foot_above_the_horizon_has_no_height():
    camera = scenes.camera(tilt_rad=0.05)
    segments = ground.Segments.from_points(np.array([[300.0, 5.0]]), np.array([[300.0, 1.0]]))
    assert np.isnan(ground.implied_heights(camera, segments)).all()
    assert np.isnan(ground.footprints(camera, segments)).all()


def test_track_medians_against_one_by_one():
    rng = np.random.default_rng(3)
    track, height = rng.integers(-1, 9, 300), rng.normal(1.7, 0.1, 300)
    height[::17] = np.nan
    expected = [np.nanmedian(height[track == t]) for t in range(9)]
    np.testing.assert_allclose(ground.track_medians(height, track), expected)
    assert len(ground.track_medians(height, np.full(300, -1))) == 0


@given(st.integers(1, 40), st.integers(1, 12))
def test_spread_takes_the_farthest_point_each_time(n, count):
    xy = np.random.default_rng(n).uniform(-20, 20, (n, 2))
    rows = ground.spread(xy, count)
    assert len(rows) == min(n, count) == len(set(rows.tolist()))
    for k in range(1, len(rows)):
        gap = np.linalg.norm(xy[:, None] - xy[rows[:k]][None], axis=2).min(axis=1)
        assert gap[rows[k]] == pytest.approx(gap.max())


def test_spread_stops_where_places_repeat():
    assert len(ground.spread(np.zeros((5, 2)), 3)) == 1
    assert len(ground.spread(np.empty((0, 2)), 3)) == 0


@given(st.integers(0, 300), st.integers(1, 100))
def test_thinning_keeps_shares(n, limit):
    rows = np.arange(n) % 5 == 0
    kept = ground.thinned(rows, limit, n)
    assert rows[kept].all() and len(set(kept.tolist())) == len(kept)
    assert len(kept) == (rows.sum() if n <= limit else -(-rows.sum() * limit // n))


def test_one_bad_footprint_does_not_stretch_the_area():
    camera = scenes.camera()
    _, xy, _ = scenes.people(camera, 300)
    area = ground.walked_area(xy, camera)
    wild = ground.walked_area(np.vstack([xy, [[900.0, 5000.0]]]), camera)
    assert area is not None and wild is not None
    assert wild.depth == pytest.approx(area.depth, rel=0.05)
    assert area.y_min < np.percentile(xy[:, 1], 1) and area.y_max > np.percentile(xy[:, 1], 99)


def test_one_person_still_has_an_area_and_nobody_has_none():
    area = ground.walked_area(np.array([[1.0, 20.0]]), scenes.camera())
    assert area is not None and area.width == pytest.approx(6) and area.depth == pytest.approx(6)
    assert ground.walked_area(np.full((3, 2), np.nan), scenes.camera()) is None


def test_sane_distance_is_where_a_pixel_covers_a_metre():
    camera = scenes.camera(roll_rad=0.0)
    far = ground.sane_distance(camera)
    pair = image_of(camera, np.array([[0.0, far - 0.5, 0.0], [0.0, far + 0.5, 0.0]]))
    assert np.linalg.norm(pair[1] - pair[0]) == pytest.approx(1.0, rel=0.1)


@given(st.floats(3, 400), st.floats(3, 400))
def test_the_grid_is_round_and_readable(width, depth):
    area = ground.Area(-width / 2, width / 2, 1.0, 1.0 + depth)
    step = ground.grid_step(area)
    lines = ground.grid_values(area.y_min, area.y_max, step)
    assert 0 <= len(lines) <= 10 and max(width, depth) / step <= 9 + 1e-9
    assert f"{step:e}"[0] in "125"


@pytest.mark.parametrize("distortion", [(0.0,) * 5, (-0.2, 0.03, 0.0, 0.0, 0.0)])
def test_the_view_from_above_shows_each_place_where_it_is(distortion):
    """A frame whose colours encode its own pixel coordinates is rectified and read back."""
    camera = scenes.camera(distortion=distortion)
    v, u = np.mgrid[0:576, 0:768]
    frame = np.dstack([u // 4, v // 4, np.zeros_like(u)]).astype(np.uint8)
    area = ground.Area(-4.0, 4.0, 18.0, 26.0)
    view = rectify(camera, area, frame, max_side_px=400)
    assert view.seen.shape == (400, 400) and view.seen.all() and view.image_rgb is not None
    x, y = area.x_min + (100.5 / 400) * 8, area.y_max - (300.5 / 400) * 8
    uv = image_of(camera, np.array([[x, y, 0.0]]))[0]
    np.testing.assert_allclose(view.image_rgb[300, 100, [2, 1]] * 4.0, uv, atol=4.0)


def test_what_the_frame_does_not_show_is_not_seen_from_above():
    camera = scenes.camera()
    view = rectify(camera, ground.Area(-30.0, 30.0, -5.0, 40.0), None, max_side_px=120)
    assert view.image_rgb is None
    assert not view.seen[-1].any() and view.seen[20, 60] and not view.seen[60, 0]
    assert max(view.seen.shape) <= 120


def test_the_wedge_opens_from_the_camera_to_the_sides_of_the_view():
    camera = scenes.camera(roll_rad=0.0)
    xy = np.array([[-3.0, 10.0], [0.0, 9.0], [4.0, 11.0], [8.0, 22.0], [0.0, 30.0]])
    np.testing.assert_allclose(wedge(camera, xy), [[-3.0, 10.0], [4.0, 11.0]])
    assert len(wedge(camera, np.vstack([xy, [[0.0, -5.0]]]))) == 0


def test_a_near_camera_is_in_the_picture_and_a_far_one_is_not():
    camera = scenes.camera()
    near = with_camera(ground.Area(-8.0, 8.0, 10.0, 30.0), camera)
    assert near.y_min < 0 < near.y_max
    far = with_camera(ground.Area(-8.0, 8.0, 110.0, 130.0), camera)
    assert far.y_min > 100


def test_the_error_grid_asks_for_pixels_of_the_footage():
    camera = scenes.camera(tilt_rad=0.1, distortion=(-0.2, 0.0, 0.0, 0.0, 0.0))
    found = scenes.calibration(camera, 60)
    u, v, sigma = error_grid(found, columns=40)
    assert sigma[25, 10] == pytest.approx(found.ground_sigma_m([[u[10], v[25]]])[0])
    assert np.isnan(sigma[0]).all()


def test_propagation_of_a_linear_function_is_exact():
    covariance = scenes.COVARIANCE.copy()
    covariance[0, 3] = covariance[3, 0] = -0.7 * 0.02 * 0.02
    value = propagated(
        scenes.camera(),
        covariance,
        lambda c: np.array([np.log(c.focal_px) + 2 * np.log(c.height_m), c.tilt_rad]),
    )
    expected = 0.02 * np.sqrt(1 + 4 - 2 * 2 * 0.7)
    np.testing.assert_allclose(value, [expected, np.radians(0.3)], rtol=1e-5)
    still = propagated(scenes.camera(), np.zeros((5, 5)), lambda c: np.array([c.focal_px]))
    assert still.tolist() == [0.0]


def test_field_of_view_of_a_pinhole():
    view = np.degrees(field_of_view(scenes.camera()))
    expected = [2 * np.degrees(np.arctan(s / 2 / 1185)) for s in (768, 576)]
    np.testing.assert_allclose(view, expected, rtol=1e-9)
