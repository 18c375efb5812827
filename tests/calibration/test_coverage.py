"""Stated uncertainties against errors that are known: the 95 % intervals, and the ground."""

import numpy as np
import pytest
from scenes import draw_scene
from trials import trials

from scene4d import solve_camera

SETTINGS = [
    (30, {}),
    (100, {}),
    (100, {"outliers": 0.1}),
    (100, {"tracks": 20}),
]
SEEDS = 42


@pytest.mark.parametrize(("n", "view"), SETTINGS)
def test_intervals_hold_the_truth_as_often_as_they_say(n, view):
    """Four parameters of 42 cameras a setting: 95 % of 168, of which about half independent."""
    found = trials(n, SEEDS, **view)
    assert len(found.refused) <= 2
    assert 0.90 <= found.coverage <= 0.99
    each = (np.abs(found.z) < 1.96).mean(axis=0)
    assert (each >= 0.86).all(), each


def test_spreads_are_neither_shy_nor_boastful():
    """All settings together: the typical error is the stated one to 12 %."""
    z = np.concatenate([trials(n, SEEDS, **view).z for n, view in SETTINGS])
    typical = np.median(np.abs(z), axis=0) / 0.6745
    assert 0.9 < np.median(np.abs(z)) / 0.6745 < 1.12
    assert (typical > 0.8).all(), typical
    assert (typical < 1.25).all(), typical
    assert 0.925 < (np.abs(z) < 1.96).mean() < 0.975
    assert (np.abs(z) > 5).mean() < 0.002


def test_errors_of_parameters_go_together_as_stated():
    """Mahalanobis lengths of (log f, tilt, roll, log height) are those of four dimensions."""
    lengths = np.concatenate([
        np.einsum("ni,nij,nj->n", t.error, np.linalg.inv(t.covariance), t.error)
        for t in (trials(n, SEEDS, **view) for n, view in SETTINGS)
    ])  # fmt: skip
    # Quantiles of chi² with 4 degrees of freedom: median 3.36, 95 % 9.49.
    assert 2.3 < np.median(lengths) < 4.6
    assert 0.88 <= np.mean(lengths < 9.49) <= 0.99


@pytest.mark.parametrize(("n", "view"), SETTINGS)
def test_the_predicted_ground_error_is_that_of_the_ground(n, view):
    """``median`` is a root-mean-square error at a typical place; the actual error is a draw."""
    found = trials(n, SEEDS, **view)
    walked, view = found.ground_m / found.predicted_m, found.view_m / found.predicted_view_m
    for ratio in (walked, view):
        assert 0.4 < np.median(ratio) < 1.0
        assert (ratio < 2.0).mean() > 0.93
    # Where the prediction is worse the error is: it tells scenes apart.
    order = np.argsort(found.predicted_m)
    third = len(order) // 3
    best, worst = found.ground_m[order[:third]], found.ground_m[order[-third:]]
    assert np.median(worst) > 2 * np.median(best)


def test_ground_errors_grow_with_distance_as_predicted():
    near, far = [], []
    for seed in range(16):
        scene = draw_scene(seed, 100)
        people = scene.people
        found = solve_camera(
            people.foot_uv,
            people.head_uv,
            image_size=scene.camera.image_size,
            track=np.arange(100),
        )
        sigma = found.ground_sigma_m(people.foot_uv, from_camera=True)
        xy, seen = found.camera.locate(people.foot_uv, 0.04)
        miss = np.hypot(*(xy - people.xy_m).T)
        # Feet are noisy too: their own error at the true camera is no error of the camera.
        own = np.hypot(*(scene.camera.locate(people.foot_uv, 0.04)[0] - people.xy_m).T)
        order = np.argsort(np.hypot(*people.xy_m.T))
        ok = seen & np.isfinite(sigma)
        for rows, kept in ((order[:25], near), (order[-25:], far)):
            rows = rows[ok[rows]]
            kept.append(np.sqrt(np.mean(miss[rows] ** 2)) / np.hypot(
                np.sqrt(np.mean(sigma[rows] ** 2)), np.sqrt(np.mean(own[rows] ** 2))
            ))  # fmt: skip
    for ratio in (near, far):
        assert 0.6 < np.median(ratio) < 1.3
        assert np.mean(np.array(ratio) < 2) > 0.9
