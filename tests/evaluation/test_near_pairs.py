"""Distances of people and places by a calibration, and the spread that it expects of them."""

import json
from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st
from scipy.spatial.distance import cdist

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.evaluation.datasets._reference import Meetings
from scene4d.evaluation.measures._near import NearPairs, near_pairs
from scene4d.evaluation.measures._probability import reliability
from strategies import build_camera, build_lens, cameras, lenses

LENS = build_lens((1280, 720), 60.0, radial=(-0.05, 0.0, 0.0))
CAMERA = build_camera(LENS, 25.0, 4.0, 6.0)
PEOPLE = np.array([[100.0, 500.0], [640.0, 400.0], [1100.0, 650.0], [700.0, 300.0]])
PLACES = np.array([[200.0, 450.0], [900.0, 350.0], [641.0, 400.0]])
SPREADS = [0.004, 0.002, 0.002, 0.006, 0.003]


def calibration(camera: Camera = CAMERA, covariance: np.ndarray | None = None) -> Calibration:
    return Calibration(
        status="ok",
        method="joint",
        image_size=camera.image_size,
        person_height_m=1.7,
        camera=camera,
        covariance=covariance,
    )


def correlated(rng: np.random.Generator, spreads=SPREADS) -> np.ndarray:
    """A covariance whose terms off the diagonal count."""
    mix = rng.normal(size=(5, 5)) * spreads
    return mix.T @ mix


def ground(camera: Camera, uv: np.ndarray) -> np.ndarray:
    return camera.locate(uv)[0]


def distances(camera: Camera, person_uv: np.ndarray, place_uv: np.ndarray) -> np.ndarray:
    xy = ground(camera, np.vstack([person_uv, place_uv]))
    return cdist(xy[: len(person_uv)], xy[len(person_uv) :]).ravel()


def pairs(found: Calibration, person_uv=PEOPLE, place_uv=PLACES, **more) -> NearPairs:
    rows = Meetings.every(person_uv, place_uv).rows
    return near_pairs(found, person_uv, place_uv, rows, np.arange(float(len(rows))), **more)


def test_distances_are_those_of_every_pair():
    found = pairs(calibration())
    people, places = ground(CAMERA, PEOPLE), ground(CAMERA, PLACES)
    one_by_one = [np.linalg.norm(a - b) for a in people for b in places]
    np.testing.assert_allclose(found.estimated_m, one_by_one)
    np.testing.assert_array_equal(found.true_m, np.arange(12.0))
    np.testing.assert_array_equal(found.positive, np.arange(12) < 4)


def test_tau_decides_who_is_near_and_what_p_says():
    found = pairs(calibration(), tau_m=7.0)
    np.testing.assert_array_equal(found.positive, np.arange(12) < 7)
    at = replace(found, estimated_m=np.full(12, 7.0))
    np.testing.assert_allclose(at.readings()["paper"], 0.5)
    np.testing.assert_allclose(at.readings()["expected"], 0.5)


def test_an_exact_calibration_expects_no_spread():
    found = pairs(calibration())
    np.testing.assert_array_equal(found.sigma_m, 0)
    np.testing.assert_array_equal(found.readings()["expected"], found.readings()["paper"])


def test_an_uncertain_height_is_an_uncertain_scale():
    """σ(log C_Z) = 2 %: every distance is off by 2 % of itself, wherever it lies."""
    found = pairs(calibration(covariance=np.diag([0, 0, 0, 0.02**2, 0])))
    np.testing.assert_allclose(found.sigma_m, 0.02 * found.estimated_m, rtol=1e-6)


def test_distances_of_sampled_cameras_spread_as_predicted():
    """Two-sided: 250 cameras from the covariance; 19 % is more than four standard errors.

    First order holds down to nothing: both ends of a short distance move alike, so its spread is a
    share of it.
    """
    rng = np.random.default_rng(1)
    covariance = correlated(rng)
    beside = PEOPLE[0] + np.outer([30.0, 3.0, 0.03], [0.6, 0.8])
    places = np.vstack([PLACES, beside])
    found = pairs(calibration(covariance=covariance), PEOPLE, places)
    steps = rng.multivariate_normal(np.zeros(5), covariance, 250)
    drawn = np.array([distances(CAMERA.disturbed(step), PEOPLE, places) for step in steps])
    np.testing.assert_allclose(drawn.std(axis=0), found.sigma_m, rtol=0.19)
    np.testing.assert_allclose(drawn.mean(axis=0), found.estimated_m, rtol=0.01)
    share = (found.sigma_m / found.estimated_m)[3:6]
    np.testing.assert_allclose(share, share[2], rtol=0.05)


def test_a_pair_in_one_place_is_certain():
    found = pairs(calibration(covariance=correlated(np.random.default_rng(5))), PEOPLE, PEOPLE[:1])
    assert found.estimated_m[0] == found.sigma_m[0] == 0 < found.sigma_m[1]


@settings(max_examples=12)
@given(
    camera=cameras(lenses()),
    turn=st.floats(-np.pi, np.pi),
    shift=st.tuples(st.floats(-100.0, 100.0), st.floats(-100.0, 100.0)),
)
def test_a_rigid_motion_of_the_world_changes_nothing(camera, turn, shift):
    c, s = np.cos(turn), np.sin(turn)
    world = np.array([[c, -s, 0], [s, c, 0], [0, 0, 1]])
    moved = replace(camera, R=camera.R @ world.T, t=camera.t - camera.R @ world.T @ [*shift, 0])
    width, height = camera.image_size
    low = np.array([[0.1, 0.95], [0.5, 0.9], [0.9, 0.95], [0.4, 0.8]]) * [width, height]
    covariance = correlated(np.random.default_rng(0))
    here, there = (pairs(calibration(x, covariance), low, low[:2]) for x in (camera, moved))
    np.testing.assert_allclose(there.estimated_m, here.estimated_m, rtol=1e-6, atol=1e-6)
    np.testing.assert_allclose(there.sigma_m, here.sigma_m, rtol=1e-3, atol=1e-6)


def test_what_is_above_the_horizon_is_infinitely_far():
    sky = np.array([[640.0, 5.0]])
    camera = build_camera(LENS, 5.0, 0.0, 6.0)
    covariance = correlated(np.random.default_rng(0))
    found = pairs(
        calibration(camera, covariance), np.vstack([PEOPLE, sky]), np.vstack([sky, PLACES])
    )
    grid = found.estimated_m.reshape(5, 4)
    assert np.isinf(grid[4]).all() and np.isinf(grid[:, 0]).all()
    assert np.isfinite(grid[:4, 1:]).all()
    gone = np.isinf(found.estimated_m)
    for p in found.readings().values():
        assert (p[gone] == 0).all()
    assert np.isfinite(found.sigma_m).all()
    assert (found.sigma_m[~gone] > 0).all()


def test_above_the_horizon_nothing_is_claimed():
    """No position, no slope, invalid."""
    camera = build_camera(build_lens((1280, 720), 60.0), 10.0, 0.0, 6.0)
    below_rad = np.array([-5e-6, 1e-3])
    v = camera.K[1, 2] - camera.focal_px * np.tan(np.radians(10.0) - below_rad)
    found = calibration(camera, np.diag(np.square(SPREADS)))
    xy, jacobian, valid = found.ground_jacobian(np.column_stack([[640.0, 640.0], v]))
    np.testing.assert_array_equal(valid, [False, True])
    np.testing.assert_array_equal(np.isnan(xy).all(axis=1), [True, False])
    np.testing.assert_array_equal(np.isnan(jacobian).all(axis=(1, 2)), [True, False])
    # Y = h / tan(depression): 6 km away.
    assert xy[1, 1] == pytest.approx(6 / np.tan(1e-3), rel=1e-6)


def test_the_jacobian_is_that_of_the_formulas():
    """Along the view Y = h / tan θ: dY/dtilt = -(h² + Y²) / h, dY/dlog h = Y, X = 0."""
    camera = build_camera(build_lens((1280, 720), 60.0), 25.0, 0.0, 6.0)
    uv = np.array([[639.5, 500.0], [639.5, 300.0]])
    xy, jacobian, valid = calibration(camera, np.eye(5)).ground_jacobian(uv)
    assert valid.all()
    y = xy[:, 1]
    np.testing.assert_allclose(jacobian[:, 1, 1], -(36 + y**2) / 6, rtol=1e-6)
    np.testing.assert_allclose(jacobian[:, 1, 3], y, rtol=1e-6)
    # v - v0 = f tan(θ - tilt): dθ/dlog f = -sin cos of the angle from the axis.
    off_axis = np.arctan((uv[:, 1] - 359.5) / camera.focal_px)
    slope = np.sin(off_axis) * np.cos(off_axis) * (36 + y**2) / 6
    np.testing.assert_allclose(jacobian[:, 1, 0], slope, rtol=1e-6)
    np.testing.assert_allclose(jacobian[:, 0, [0, 1, 3]], 0, atol=1e-6)


def test_without_a_camera_there_are_no_pairs():
    nothing = replace(calibration(), status="undetermined", camera=None, reason="nobody was seen")
    with pytest.raises(InputError, match="there is no camera: nobody was seen"):
        pairs(nothing)


def beyond_chance(p: np.ndarray, near: np.ndarray, bins: int = 5) -> np.ndarray:
    """Excess of near pairs in each bin of p (calibrations, pairs), in its standard errors.

    All pairs of one true camera err together, so a camera is one draw, whatever it sees.
    """
    z = []
    for low in np.arange(bins) / bins:
        held = (p >= low) & ((p < low + 1 / bins) | (low + 1 / bins == 1))
        excess = ((near - p) * held).sum(axis=1)
        z.append(excess.sum() / np.sqrt((excess**2).sum()))
    return np.array(z)


def test_the_probability_of_being_below_tau_is_calibrated():
    """Twelve calibrations, for each 40 true cameras drawn from its covariance.

    ``below_tau`` is right within four standard errors in every bin, two-sided. The
    paper's P(near), which takes the distance as exact and hedges by a fixed 1 m, is not.
    """
    rng = np.random.default_rng(11)
    stated, paper, near = [], [], []
    for _ in range(12):
        camera = build_camera(LENS, rng.uniform(20, 35), rng.uniform(-5, 5), rng.uniform(5, 9))
        covariance = correlated(rng, [0.01, 0.004, 0.004, 0.015, 0.01])
        low = np.column_stack([rng.uniform(100, 1180, 40), rng.uniform(330, 690, 40)])
        found = pairs(calibration(camera, covariance), low, low[:8])
        close = np.abs(found.estimated_m - 4) < 1.0
        for step in rng.multivariate_normal(np.zeros(5), covariance, 40):
            true = replace(found, true_m=distances(camera.disturbed(step), low, low[:8]))
            said = true.readings()
            for rows, name in ((stated, "below_tau"), (paper, "paper")):
                rows.append(np.where(close, said[name], np.nan))
            near.append(true.positive)
    held = ~np.isnan(np.array(stated))
    p, q, y = (np.array(rows) for rows in (stated, paper, near))
    assert held.sum() > 4000
    assert (np.abs(beyond_chance(np.nan_to_num(p) * held, y & held)) < 4).all()
    assert reliability(p[held], y[held]).expected_error < 0.04
    assert np.abs(beyond_chance(np.nan_to_num(q) * held, y & held)).max() > 6
    assert reliability(q[held], y[held]).expected_error > 0.1


def test_figures_by_hand():
    """Two near pairs, two far ones; one far pair is above the horizon, one near pair 5 m off."""
    known = NearPairs(
        true_m=np.array([1.0, 3.0, 9.0, 20.0]),
        estimated_m=np.array([1.0, 10.0, 9.5, np.inf]),
        sigma_m=np.array([0.0, 6.0, 0.0, 0.0]),
    )
    figures = known.to_dict()
    assert (figures["pairs"], figures["near"], figures["tau_m"]) == (4, 2, 4.0)
    assert figures["auc"] == 0.75  # of four pairs of a near and a far one, 10 m > 9.5 m is wrong
    assert figures["auc_expected"] == 1.0  # 10 ± 6 m is likelier to be near than 9.5 m
    p = 0.15865525393145707  # Φ(-1): 10 m is one spread of 6 m beyond 4 m
    assert figures["brier"]["below_tau"] == pytest.approx((1 - p) ** 2 / 4)
    assert figures["calibration_error"]["below_tau"] == pytest.approx((1 - p) / 4)
    hedged = 0.0013498980316301035  # Φ(-3), 1 m with a softness of 1 m
    assert figures["brier"]["paper"] == pytest.approx((hedged**2 + 1) / 4, rel=1e-6)
    json.dumps(figures, allow_nan=False)


def test_order_alone_does_not_see_a_wrong_scale():
    """Why AUC needs the other measures beside it."""
    true = np.linspace(0.5, 12, 40)
    far_off = NearPairs(true_m=true, estimated_m=2 * true, sigma_m=np.zeros(40))
    figures = far_off.to_dict()
    assert figures["auc"] == pytest.approx(1)
    assert figures["brier"]["below_tau"] == pytest.approx(np.mean((true >= 2) & (true < 4)))
    exact = replace(far_off, estimated_m=true).to_dict()
    assert exact["brier"]["below_tau"] == 0
    assert exact["brier"]["paper"] > 0.01


def test_far_pairs_stay_in_order_where_p_underflows():
    true, estimated = np.array([1.0, 3.0, 50.0, 60.0]), np.array([1.0, 200.0, 300.0, 400.0])
    assert NearPairs(true, estimated, np.zeros(4)).to_dict()["auc"] == 1


@pytest.mark.parametrize("true_m", [1.0, 9.0])
def test_where_all_or_none_are_near_there_is_no_curve(true_m):
    alike = NearPairs(np.full(3, true_m), np.array([1.0, 3.0, 6.0]), np.ones(3))
    figures = alike.to_dict()
    assert figures["auc"] is figures["auc_expected"] is None
    assert 0 < figures["brier"]["below_tau"] < 1


def test_far_pairs_make_an_auc_look_good():
    """One wrong order of two close pairs weighs more where far pairs are left out."""
    true = np.array([3.0, 5.0, 50.0, 60.0, 70.0])
    estimated = np.array([5.5, 4.5, 50.0, 60.0, 70.0])
    figures = NearPairs(true, estimated, np.zeros(5)).to_dict()
    assert figures["auc"] == pytest.approx(3 / 4)
    assert figures["auc_within_two_tau"] == 0.0
    alone = NearPairs(true[[0, 2]], estimated[[0, 2]], np.zeros(2)).to_dict()
    assert (alone["auc"], alone["auc_within_two_tau"]) == (1.0, None)
