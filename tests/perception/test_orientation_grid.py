"""Beliefs about a camera's pose: normalised, conditioned, fused, and turned into focal lengths."""

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.perception.orientation import Belief, crop_size, fused, modal
from scene4d.perception.orientation.grid import ROLL_RAD, SHAPE, TILT_RAD, VFOV_RAD

STEP = (np.radians(1.5), np.radians(2.5), np.log(VFOV_RAD[1] / VFOV_RAD[0]))
degrees = st.floats(-12, 12), st.floats(0, 50), st.floats(18, 55)


def gaussian(roll_deg, tilt_deg, vfov_deg, wide=1.5):
    mean = (np.radians(roll_deg), np.radians(tilt_deg), np.log(np.radians(vfov_deg)))
    return Belief.gaussian(mean, tuple(wide * step for step in STEP))


@given(*degrees, st.floats(1.0, 1.8))
@settings(max_examples=40, deadline=None)
def test_moments_are_those_of_the_gaussian_it_was_made_from(roll, tilt, vfov, wide):
    belief = gaussian(roll, tilt, vfov, wide)
    assert belief.p.sum() == pytest.approx(1)
    np.testing.assert_allclose(np.degrees(belief.mean()), [roll, tilt, vfov], rtol=0.02, atol=0.15)
    # Nodes of a Gaussian have its variance; that of a place within a cell is added.
    expected = np.hypot(wide, np.sqrt(1 / 12)) * np.array(STEP) * [1, 1, np.radians(vfov)]
    np.testing.assert_allclose(belief.sigma(), expected, rtol=0.06)
    for axis, value in enumerate((roll, tilt, vfov)):
        low, high = np.degrees(belief.interval(axis))
        assert low < value < high


def test_intervals_hold_their_share():
    rng = np.random.default_rng(0)
    belief = gaussian(3.0, 20.0, 35.0, 1.6)
    drawn = rng.normal(np.radians(20.0), 1.6 * STEP[1], 4000)
    for share in (0.5, 0.95):
        low, high = belief.interval(1, share)
        inside = np.mean((low < drawn) & (drawn < high))
        # Cells of finite width make the interval a little wider, never narrower.
        assert share - 0.02 < inside < share + 0.05


@given(st.integers(1, SHAPE[0] - 2), st.integers(1, SHAPE[1] - 2), st.integers(1, SHAPE[2] - 2))
@settings(max_examples=15, deadline=None)
def test_a_belief_of_one_cell_knows_no_place_within_it(roll, tilt, vfov):
    """Cameras anywhere in the only cell: as far off as σ says, and all inside the interval."""
    nodes = np.array([ROLL_RAD[roll], TILT_RAD[tilt], np.log(VFOV_RAD[vfov])])
    narrow = Belief.gaussian(tuple(nodes), tuple(0.05 * step for step in STEP))
    rng = np.random.default_rng(roll)
    cameras = nodes + rng.uniform(-0.5, 0.5, (2000, 3)) * STEP
    cameras[:, 2] = np.exp(cameras[:, 2])
    for belief in (narrow, narrow.given_vfov(float(np.exp(nodes[2])))):
        z = (cameras - belief.mean()) / belief.sigma()
        np.testing.assert_allclose(np.sqrt(np.mean(z**2, axis=0)), 1, atol=0.05)
        assert (np.abs(z) < 1.96).all()
    told = narrow.orientation((640, 480))
    z = np.column_stack(
        [
            (240 / np.tan(cameras[:, 2] / 2) - told.focal_px) / told.focal_sigma_px,
            (cameras[:, 1] - told.tilt_rad) / told.tilt_sigma_rad,
            (cameras[:, 0] - told.roll_rad) / told.roll_sigma_rad,
        ]
    )
    np.testing.assert_allclose(np.sqrt(np.mean(z**2, axis=0)), 1, atol=0.07)


@given(*degrees, st.floats(0.6, 1.8), st.floats(-0.7, 0.7))
@settings(max_examples=30, deadline=None)
def test_the_mode_lies_between_the_grids_nodes(roll, tilt, vfov, wide, together):
    mean = np.array([np.radians(roll), np.radians(tilt), np.log(np.radians(vfov))])
    axes = np.meshgrid(ROLL_RAD, TILT_RAD, np.log(VFOV_RAD), indexing="ij")
    z = (np.stack(axes, -1) - mean) / STEP / wide
    inverse = np.linalg.inv([[1, 0, 0], [0, 1, together], [0, together, 1]])
    belief = Belief.normalised(-0.5 * np.einsum("...i,ij,...j", z, inverse, z))
    found = modal([belief] * 3)
    np.testing.assert_allclose(found, [*mean[:2], np.exp(mean[2])], rtol=1e-6, atol=1e-9)
    edge = Belief.gaussian((0.0, TILT_RAD[0] - 1.0, np.log(VFOV_RAD[-1]) + 1), (0.1, 0.1, 0.1))
    apart = (modal([edge]) - [0.0, TILT_RAD[0], VFOV_RAD[-1]]) / [1, STEP[1], VFOV_RAD[-1]]
    np.testing.assert_allclose(apart, [0, -1, np.expm1(STEP[2])], atol=1e-6)
    # Where nothing is known there is no peak to move to.
    assert np.isin(modal([Belief.even()])[1], TILT_RAD)


def test_the_mode_does_not_jump_where_two_cells_are_read_equally_often():
    """Frames that read a tilt at the border of two cells, a little more often on either side."""
    border = np.degrees((TILT_RAD[12] + TILT_RAD[13]) / 2)
    below, above = gaussian(0.0, border - 0.1, 40.0), gaussian(0.0, border + 0.1, 40.0)
    modes = [modal([below] * n + [above] * (9 - n)) for n in (4, 5)]
    assert below.mode()[1] != above.mode()[1]
    np.testing.assert_allclose(np.degrees(modes)[:, 1], border, atol=0.1)


@pytest.mark.parametrize(
    ("image_size", "crop"),
    [
        ((640, 480), (640, 480)),
        ((1920, 1080), (1440, 1080)),
        ((1080, 1920), (1080, 810)),
        ((1, 2), (1, 0)),
    ],
)
def test_crop_is_the_largest_of_four_to_three(image_size, crop):
    if min(crop) == 0:
        with pytest.raises(InputError, match="1x2 pixels is too small"):
            crop_size(image_size)
        return
    assert crop_size(image_size) == crop


@given(*degrees, st.sampled_from([(640, 480), (1920, 1080), (1080, 1920)]))
@settings(max_examples=30, deadline=None)
def test_focal_length_is_that_of_the_crop(roll, tilt, vfov, image_size):
    found = gaussian(roll, tilt, vfov).orientation(image_size)
    focal = crop_size(image_size)[1] / 2 / np.tan(np.radians(vfov) / 2)
    assert found.focal_px == pytest.approx(focal, rel=0.03)
    assert np.degrees(found.tilt_rad) == pytest.approx(tilt, abs=0.2)
    assert np.degrees(found.roll_rad) == pytest.approx(roll, abs=0.2)
    # d log f / d log vfov = -(vfov / 2) / (sin(vfov / 2) cos(vfov / 2)), at 15-70° 1.0 to 1.3
    relative = found.focal_sigma_px / found.focal_px
    slope = np.radians(vfov) / np.sin(np.radians(vfov))
    assert relative == pytest.approx(1.5 * STEP[2] * slope, rel=0.15)


def test_a_known_lens_sharpens_what_depends_on_it():
    # Tilt and field of view trade off along a valley, as where only the horizon's row is seen.
    tilt, vfov = np.meshgrid(np.degrees(TILT_RAD), np.degrees(VFOV_RAD), indexing="ij")
    valley = -0.5 * ((tilt - vfov / 2) / 2.5) ** 2 - 0.5 * ((vfov - 45) / 20) ** 2
    belief = Belief.normalised(np.broadcast_to(valley, SHAPE).copy())
    known = belief.given_vfov(np.radians(50))
    assert np.degrees(known.mean()[1]) == pytest.approx(25, abs=1)
    assert known.sigma()[1] < 0.6 * belief.sigma()[1]
    with pytest.raises(InputError, match="vfov_rad must lie in"):
        belief.given_vfov(0.0)


def test_fusing_counts_correlated_frames_as_few():
    one = gaussian(2.0, 20.0, 40.0, 2.0)
    same = fused([one] * 50, correlation=1.0)
    np.testing.assert_allclose(same.sigma(), one.sigma(), rtol=0.15)
    apart = fused([one] * 9, correlation=0.0)
    np.testing.assert_allclose(apart.sigma()[:2], one.sigma()[:2] / 3, rtol=0.15)
    assert fused([]).log_p == pytest.approx(Belief.even().log_p)


def test_a_few_blinded_frames_move_little():
    good, blinded = gaussian(0.0, 20.0, 40.0), gaussian(15.0, 55.0, 90.0, 0.5)
    mixed = fused([good] * 9 + [blinded])
    np.testing.assert_allclose(np.degrees(mixed.mean()), [0, 20, 40], atol=1.5)
    mode = np.degrees(modal([good] * 9 + [blinded]))
    np.testing.assert_allclose(mode, [0, 20, 40], atol=1e-6)


def test_marginals():
    belief = gaussian(-4.0, 10.0, 30.0)
    assert [len(belief.marginal(axis)) for axis in range(3)] == list(SHAPE)
    assert abs(ROLL_RAD[np.argmax(belief.marginal(0))] - np.radians(-4)) < STEP[0]
    assert belief.log_density_at(*belief.mode()) == belief.log_p.max()


def test_focal_length_and_tilt_err_together_where_only_the_horizon_is_seen():
    tilt, vfov = np.meshgrid(np.degrees(TILT_RAD), np.degrees(VFOV_RAD), indexing="ij")
    horizon = -0.5 * ((tilt - vfov / 2) / 2.5) ** 2 - 0.5 * ((vfov - 45) / 10) ** 2
    told = Belief.normalised(np.broadcast_to(horizon, SHAPE).copy()).orientation((640, 480))
    # The wider the field of view, the shorter the focal length and the steeper the tilt.
    assert -0.98 <= told.focal_tilt_correlation < -0.7
    free = gaussian(0.0, 20.0, 40.0).orientation((640, 480))
    assert abs(free.focal_tilt_correlation) < 0.02
    assert Belief.even().information() == pytest.approx(0, abs=1e-9)
    assert gaussian(0.0, 20.0, 40.0).information() > 4
