"""The consensus on a camera height: intervals, the exact maximum, and the paper's RANSAC."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.calibration._linear import height_system
from scene4d.calibration.consensus import (
    Intervals,
    exact_consensus,
    inlier_intervals,
    ransac_consensus,
)
from scene4d.core.camera import Camera
from strategies import build_camera, build_lens, cameras_over_people, people_scene

SEED = st.integers(0, 2**32 - 1)


def reprojected(camera, foot_uv, head_uv, height_m, person_height_m):
    """Distance from each head to the head of someone at the foot, for a camera at that height."""
    there = Camera(camera.image_size, camera.K, camera.distortion, camera.R,
                   -camera.R @ np.array([0.0, 0.0, height_m]))  # fmt: skip
    xy, on_ground = there.locate(foot_uv)
    head, seen = there.project(np.column_stack([xy, np.full(len(xy), person_height_m)]))
    miss = np.hypot(*(head - head_uv).T)
    return np.where(on_ground & seen, miss, np.inf)


@settings(max_examples=25, deadline=None)
@given(cameras_over_people(), st.floats(1.0, 15.0), SEED)
def test_intervals_are_where_reprojection_says_so(camera, tolerance, seed):
    rng = np.random.default_rng(seed)
    people = people_scene(camera, 25, rng, outliers=0.2, noise=0.05)
    foot, head = people.foot_uv, people.head_uv
    intervals = inlier_intervals(camera.K, camera.R, foot, head, 1.7, tolerance)
    for height in np.geomspace(0.4, 60, 80):  # from below the heads up
        miss = reprojected(camera, foot, head, height, 1.7)
        told = intervals.inliers(1 / height)
        clear = np.abs(miss - tolerance) > 1e-6 * (1 + np.where(np.isfinite(miss), miss, 0))
        np.testing.assert_array_equal(told[clear], (miss < tolerance)[clear])


@settings(max_examples=25, deadline=None)
@given(cameras_over_people(), SEED)
def test_interval_ends_lie_on_the_tolerance(camera, seed):
    people = people_scene(camera, 20, np.random.default_rng(seed), noise=0.03)
    intervals = inlier_intervals(camera.K, camera.R, people.foot_uv, people.head_uv, 1.7, 5.0)
    for end in (intervals.low, intervals.high):
        for i in np.flatnonzero(np.isfinite(end) & (end > 1e-4) & (end < 0.5)):
            row = slice(i, i + 1)
            miss = reprojected(
                camera, people.foot_uv[row], people.head_uv[row], 1 / float(end[i]), 1.7
            )
            assert miss[0] == pytest.approx(5.0, abs=1e-4)


@st.composite
def interval_sets(draw):
    n = draw(st.integers(1, 12))
    # Few distinct ends, so that they often coincide: the boundaries are open.
    ends = st.integers(0, 8)
    pairs = draw(st.lists(st.tuples(ends, ends), min_size=n, max_size=n))
    low, high = np.array(pairs, float).reshape(-1, 2).T / 8
    bad = low >= high
    return Intervals(np.where(bad, np.nan, low), np.where(bad, np.nan, high))


@given(interval_sets())
def test_exact_is_the_maximum_over_all_heights(intervals):
    # Between two neighbouring ends nothing changes, so their middles are all there is to try.
    ends = np.unique(np.concatenate([intervals.low, intervals.high]))
    ends = ends[np.isfinite(ends)]
    best = max((intervals.inliers(m).sum() for m in (ends[1:] + ends[:-1]) / 2), default=0)
    found = exact_consensus(intervals)
    assert found.sum() == best
    if found.any():  # and it is a set that one height has in common
        assert intervals.low[found].max() < intervals.high[found].min()


@given(interval_sets(), SEED)
def test_exact_is_never_worse_than_ransac_on_any_intervals(intervals, seed):
    rng = np.random.default_rng(seed)
    own = rng.uniform(0, 1, len(intervals.low))
    found = ransac_consensus(intervals, own, rng=rng, trials=100)
    assert found.sum() <= exact_consensus(intervals).sum()


@settings(max_examples=40, deadline=None)
@given(cameras_over_people(), st.integers(1, 40), st.floats(0.0, 0.6), st.floats(2.0, 12.0), SEED)
def test_exact_is_never_worse_than_ransac_on_people(camera, n, outliers, tolerance, seed):
    rng = np.random.default_rng(seed)
    people = people_scene(camera, n, rng, outliers=outliers, noise=0.05)
    args = camera.K, camera.R, people.foot_uv, people.head_uv, 1.7
    intervals = inlier_intervals(*args, tolerance)
    system = height_system(*args)
    with np.errstate(all="ignore"):
        own = system.information / system.moment
    exact = exact_consensus(intervals)
    for trials in (1, 10, 200):
        assert ransac_consensus(intervals, own, rng=rng, trials=trials).sum() <= exact.sum()


def test_ransac_finds_the_crowd_among_outliers():
    camera = build_camera(build_lens((1920, 1080), 50.0), 20.0, 0.0, 6.0)
    rng = np.random.default_rng(1)
    people = people_scene(camera, 200, rng, outliers=0.4, noise=0.0, height_sigma=0.01)
    args = camera.K, camera.R, people.foot_uv, people.head_uv, 1.7
    intervals, system = inlier_intervals(*args), height_system(*args)
    found = ransac_consensus(intervals, system.information / system.moment, rng=rng)
    assert found[~people.outlier].mean() > 0.9
    assert found[people.outlier].mean() < 0.2
    # Far people tell heights apart less than near ones: the exact set may hold a few more.
    assert found.sum() <= exact_consensus(intervals).sum() < 1.2 * (~people.outlier).sum()


def test_nobody_agrees_where_nobody_can():
    never = Intervals(np.full(3, np.nan), np.full(3, np.nan))
    assert not exact_consensus(never).any()
    assert not exact_consensus(Intervals(np.empty(0), np.empty(0))).any()
    rng = np.random.default_rng(0)
    assert not ransac_consensus(never, np.array([np.nan, -1.0, np.inf]), rng=rng).any()


def test_heads_below_feet_belong_to_no_camera():
    camera = build_camera(build_lens((1280, 720), 50.0), 20.0, 0.0, 6.0)
    foot, head = np.array([[640.0, 300.0]]), np.array([[640.0, 420.0]])
    intervals = inlier_intervals(camera.K, camera.R, foot, head, 1.7)
    assert np.isnan(intervals.low).all()
    # Nor do feet above the horizon.
    above = np.array([[640.0, -400.0]])
    assert np.isnan(inlier_intervals(camera.K, camera.R, above, above - [0, 50], 1.7).low).all()


def test_heads_behind_the_camera_are_not_meant():
    """Below the nadir lies the image of heads behind the camera: no height puts a head there."""
    camera = build_camera(build_lens((1280, 720), 90.0), 70.0, 0.0, 6.0)
    nadir = camera.K[1, 2] + camera.focal_px * np.tan(np.radians(20))
    foot, head = np.array([[639.5, 300.0]]), np.array([[639.5, nadir + 60]])
    assert head[0, 1] < 720
    assert np.isnan(inlier_intervals(camera.K, camera.R, foot, head, 1.7).low).all()
