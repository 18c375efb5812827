"""Many drawn cameras: errors of the expected size, and stated uncertainties that hold them."""

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


# Median errors over the seeds: focal length (fraction), tilt (degrees), height (fraction), ground
# where people walked (m, after rigid alignment). Half as large would mean that the noise did not
# reach the solver, twice as large that the solver wastes what it is given.
EXPECTED = [
    (5, {}, 20, (0.070, 1.03, 0.067, 0.16)),
    (10, {}, 20, (0.032, 0.82, 0.030, 0.16)),
    (30, {}, 42, (0.021, 0.33, 0.018, 0.09)),
    (100, {}, 42, (0.013, 0.25, 0.013, 0.075)),
    (1000, {}, 20, (0.0037, 0.081, 0.0037, 0.021)),
    (10_000, {}, 5, (0.0016, 0.017, 0.0006, 0.011)),
    (100, {"outliers": 0.1}, 42, (0.015, 0.30, 0.016, 0.082)),
    (1000, {"outliers": 0.4}, 20, (0.0057, 0.104, 0.0084, 0.036)),
    (100, {"noise": 0.005, "noise_px": 0.2}, 20, (0.0074, 0.140, 0.012, 0.051)),
    (100, {"noise": 0.08, "noise_px": 2.0}, 20, (0.037, 0.65, 0.0195, 0.182)),
    (100, {"tilt_deg": 5.0}, 20, (0.046, 0.184, 0.0105, 0.41)),
    (100, {"tilt_deg": 60.0}, 20, (0.0189, 0.438, 0.0125, 0.048)),
    (100, {"fov_deg": 15.0}, 20, (0.052, 1.147, 0.0455, 0.224)),
    (100, {"fov_deg": 90.0}, 20, (0.0057, 0.206, 0.0076, 0.094)),
    (100, {"tracks": 20}, 42, (0.014, 0.28, 0.014, 0.11)),
]


@pytest.mark.parametrize(("n", "view", "seeds", "expected"), EXPECTED)
def test_errors_are_of_the_size_that_the_noise_explains(n, view, seeds, expected):
    found = trials(n, seeds, **view)
    # Of five people several cameras may be nearly as likely.
    assert len(found.refused) <= (0.2 if n < 10 else 0.1) * seeds, found.refused
    median = np.median(np.abs(found.error), axis=0)
    measured = np.array([median[0], np.degrees(median[1]), median[3], np.median(found.ground_m)])
    ratio = measured / expected
    assert (ratio > 0.5).all(), ratio
    assert (ratio < 1.8).all(), ratio
    # No single scene goes astray unannounced.
    assert (found.ground_m < 6 * found.predicted_m).all()


def test_more_people_and_less_noise_help_as_they_should():
    """Errors fall with the square root of the crowd; four times the noise does not stay hidden."""
    few = np.median(np.abs(trials(30, 42).error), axis=0)
    many = np.median(np.abs(trials(1000, 20).error), axis=0)
    gain = few / many  # sqrt(1000 / 30) = 5.8
    assert (gain > 3.0).all(), gain
    assert (gain < 11.0).all(), gain
    quiet = trials(100, 20, noise=0.005, noise_px=0.2).error
    loud = trials(100, 20, noise=0.08, noise_px=2.0).error
    # Roll hangs on the direction of people, which heights do not disturb: it follows the noise.
    assert 8 < np.median(np.abs(loud[:, 2])) / np.median(np.abs(quiet[:, 2])) < 32


def test_errors_have_no_direction():
    """Over all seeds the errors are symmetric: the mean is small beside their spread."""
    z = np.concatenate([trials(n, 42).z for n in (30, 100)])
    assert (np.abs(z.mean(axis=0)) < 0.3).all(), z.mean(axis=0)
