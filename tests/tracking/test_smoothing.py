"""The smoother against a dense solution of the same model, and against simulated truth."""

from dataclasses import replace

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.core.errors import InputError
from scene4d.tracking._chain import solve_chain
from scene4d.tracking._fixed_lag import FixedLagSmoother
from scene4d.tracking._motion_model import LASTING_S, LASTING_SHARE, MOTIONS
from scene4d.tracking._sightings import Sightings
from scene4d.tracking._smoothing import Smoothed, SmoothingSettings, smooth

CHI2_95 = 5.991
TRUSTING = SmoothingSettings(outlier_sigma=1e6)
"""Every sighting counts in full: the linear model alone."""
SPREAD = np.array([[0.04, 0.02], [0.02, 0.16]])


def sightings(track, time_s, xy, kind="person", spread=SPREAD, frame=None):
    n = len(time_s)
    return Sightings(
        np.full(n, track),
        np.full(n, kind),
        np.asarray(time_s, float),
        np.arange(n) if frame is None else np.asarray(frame),
        np.asarray(xy, float),
        np.broadcast_to(spread, (n, 2, 2)).copy(),
    )


def errors(rng, time_s, spread=SPREAD):
    """Drawn from the error model: a lasting and a fresh part."""
    root = np.linalg.cholesky(spread)
    lasting = rng.normal(size=2)
    out = np.empty((len(time_s), 2))
    for k, dt in enumerate(np.diff(time_s, prepend=time_s[0])):
        alike = np.exp(-dt / LASTING_S)
        lasting = alike * lasting + np.sqrt(1 - alike**2) * rng.normal(size=2)
        fresh = rng.normal(size=2)
        out[k] = root @ (np.sqrt(LASTING_SHARE) * lasting + np.sqrt(1 - LASTING_SHARE) * fresh)
    return out


def walk(rng, time_s):
    """Positions and velocities drawn from the motion model."""
    q, speed = MOTIONS["person"].acceleration ** 2, MOTIONS["person"].speed
    xy, v = np.array([5.0, 12.0]), rng.normal(0, speed, 2)
    out = []
    for dt in np.diff(time_s, prepend=time_s[0]):
        noise = q * np.array([[dt**3 / 3, dt**2 / 2], [dt**2 / 2, dt]]) + 1e-15 * np.eye(2)
        shift = np.linalg.cholesky(noise) @ rng.normal(size=(2, 2))
        xy, v = xy + dt * v + shift[0], v + shift[1]
        out.append((xy, v))
    return tuple(np.array(a) for a in zip(*out, strict=True))


def dense(time_s, xy, spread):
    """Gaussian conditioning with full covariance matrices, no chain and no information form.

    Covariance functions: integrated white noise for position and velocity (Rasmussen and
    Williams, "Gaussian Processes for Machine Learning", 2006, section 6.3.1), exponential for the
    lasting error. Returns positions and velocities with their covariances, (n, 4) and (n, 4, 4).
    """
    motion = MOTIONS["person"]
    t = time_s - time_s[0]
    low, a, b = np.minimum(t[:, None], t), t[:, None], t[None]
    q, v0 = motion.acceleration**2, motion.speed**2
    pp = q * (a * b * low - (a + b) * low**2 / 2 + low**3 / 3) + v0 * a * b + 100.0**2
    pv = q * (a * low - low**2 / 2) + v0 * a + 0 * b
    vv = q * low + v0
    alike = LASTING_SHARE * np.exp(-abs(a - b) / LASTING_S) + (1 - LASTING_SHARE) * np.eye(len(t))
    seen = np.isfinite(xy[:, 0])
    m = int(seen.sum())
    root = np.linalg.cholesky(spread[seen])
    noise = np.einsum("iab,ij,jcb->iajc", root, alike[np.ix_(seen, seen)], root)
    total = np.kron(pp[np.ix_(seen, seen)], np.eye(2)) + noise.reshape(2 * m, 2 * m)
    gain = np.linalg.inv(total)
    origin = xy[seen][0]
    away = (xy[seen] - origin).ravel()
    mean, cov = np.empty((len(t), 4)), np.empty((len(t), 4, 4))
    for k in range(len(t)):
        cross = np.concatenate([np.kron(pp[k, seen], np.eye(2)), np.kron(pv[seen, k], np.eye(2))])
        own = np.kron(np.array([[pp[k, k], pv[k, k]], [pv[k, k], vv[k, k]]]), np.eye(2))
        mean[k] = cross @ gain @ away
        cov[k] = own - cross @ gain @ cross.T
    mean[:, :2] += origin
    return mean, cov


@given(st.integers(1, 40), st.integers(1, 4), st.integers(0, 2**32 - 1))
@settings(max_examples=40)
def test_a_chain_is_its_dense_matrix(n, s, seed):
    rng = np.random.default_rng(seed)
    matrix = 0.1 * np.eye(n * s)
    for k in range(n - 1):
        link = rng.normal(size=(s, 2 * s))
        at = slice(k * s, (k + 2) * s)
        matrix[at, at] += link.T @ link
    blocks = matrix.reshape(n, s, n, s).swapaxes(1, 2)
    row, vector = np.arange(n), rng.normal(size=(n, s))
    coupling = blocks[row[:-1], row[1:]].reshape(-1, s, s)
    mean, cov = solve_chain(blocks[row, row], coupling, vector)
    inverse = np.linalg.inv(matrix)
    np.testing.assert_allclose(mean.ravel(), inverse @ vector.ravel(), rtol=1e-8, atol=1e-8)
    expected = inverse.reshape(n, s, n, s).swapaxes(1, 2)[row, row]
    np.testing.assert_allclose(cov, expected, rtol=1e-8, atol=1e-8)
    alone, none = solve_chain(blocks[row, row], coupling, vector, covariance=False)
    np.testing.assert_allclose(alone, mean, rtol=1e-9, atol=1e-9)
    assert none is None


@given(st.integers(2, 25), st.integers(0, 2**32 - 1))
@settings(max_examples=25)
def test_smoothing_is_the_posterior_of_its_model(n, seed):
    rng = np.random.default_rng(seed)
    time_s = 3.0 + np.cumsum(rng.uniform(0.02, 0.8, n))
    xy = walk(rng, time_s)[0] + errors(rng, time_s)
    spread = SPREAD * rng.uniform(0.2, 3.0, n)[:, None, None]
    xy[1:-1][rng.random(n - 2) < 0.3] = np.nan
    other = sightings(9, time_s, -xy[::-1])
    both = Sightings.joined([other, sightings(4, time_s, xy, spread=spread)])
    found = smooth(both, settings=replace(TRUSTING, max_gap_s=60.0, lag_s=60.0))
    mine = found.select(found.track == 4)
    mean, cov = dense(time_s, xy, spread)
    # The dense solution loses digits: its prior is 10 000 m², what it is after 0.01 m².
    np.testing.assert_allclose(mine.xy_m, mean[:, :2], atol=1e-5)
    np.testing.assert_allclose(mine.velocity_mps, mean[:, 2:], atol=1e-5)
    np.testing.assert_allclose(mine.covariance_m2, cov[:, :2, :2], atol=1e-5)
    np.testing.assert_allclose(mine.velocity_covariance, cov[:, 2:, 2:], atol=1e-5)


def test_ellipses_hold_the_truth_as_often_as_they_say():
    rng = np.random.default_rng(0)
    time_s = np.cumsum(rng.uniform(0.05, 0.2, 60))
    parts, truth, speeds = [], [], []
    for track in range(250):
        xy, v = walk(rng, time_s)
        parts.append(sightings(track, time_s, xy + errors(rng, time_s)))
        truth.append(xy)
        speeds.append(v)
    found = smooth(Sightings.joined(parts), settings=TRUSTING)
    for error, cov in (
        (found.xy_m - np.concatenate(truth), found.covariance_m2),
        (found.velocity_mps - np.concatenate(speeds), found.velocity_covariance),
    ):
        squared = (error * np.linalg.solve(cov, error[..., None])[..., 0]).sum(axis=1)
        inside = (squared < CHI2_95).reshape(250, 60)[:, 5::20]
        assert 0.92 < inside.mean() < 0.98
    assert np.trace(found.covariance_m2, axis1=1, axis2=2).mean() < np.trace(SPREAD)


def test_many_sightings_of_one_moment_are_not_many_facts():
    """Ten times the frames, of errors that last, must not make it three times as certain."""
    sigma = []
    for rate in (10, 100):
        time_s = np.arange(0, 4, 1 / rate)
        found = smooth(sightings(0, time_s, np.zeros((len(time_s), 2))))
        sigma.append(np.sqrt(found.covariance_m2[len(found) // 2, 0, 0]))
    assert 0.75 < sigma[1] / sigma[0] < 1.0


def test_one_wild_sighting_hardly_counts():
    rng = np.random.default_rng(4)
    time_s = np.arange(0, 6, 0.1)
    line = np.column_stack([1.3 * time_s, 0.2 * time_s])
    xy = line + 0.1 * rng.normal(size=line.shape)
    wild = xy.copy()
    wild[30] += [4.0, -3.0]
    calm, shaken = (smooth(sightings(0, time_s, z)).xy_m for z in (xy, wild))
    linear = smooth(sightings(0, time_s, wild), settings=TRUSTING).xy_m
    assert np.abs(shaken - calm).max() < 0.08
    assert np.abs(linear - calm).max() > 3 * np.abs(shaken - calm).max()


def test_short_gaps_are_bridged_and_long_ones_stay():
    clock = np.arange(200)
    line = np.column_stack([0.13 * clock, np.full(200, 5.0)])
    gone = ((clock >= 40) & (clock < 55)) | ((clock >= 100) & (clock < 125))
    seen = sightings(3, 0.1 * clock, line).select(~gone & (clock < 180))
    found = smooth(seen, 0.1 * clock, clock)
    assert found.frame.tolist() == [*range(100), *range(125, 180)]
    bridged = ~found.observed
    assert found.frame[bridged].tolist() == list(range(40, 55))
    assert (found.source[bridged] == -1).all()
    assert (seen.frame[found.source[found.observed]] == found.frame[found.observed]).all()
    np.testing.assert_allclose(found.xy_m, line[found.frame], atol=0.05)
    size = np.trace(found.covariance_m2, axis1=1, axis2=2)
    assert size[47] > 1.5 * size[30]
    assert len(smooth(seen)) == len(seen)  # without a clock nothing is bridged


def test_sightings_without_a_ground_point_lie_between_their_neighbours():
    time_s = 0.1 * np.arange(100)
    xy = np.column_stack([1.3 * time_s, np.zeros(100)])
    hidden = np.isin(np.arange(100), [0, 1, *range(20, 30), *range(50, 80), 99])
    found = smooth(sightings(0, time_s, np.where(hidden[:, None], np.nan, xy)))
    placed = np.isfinite(found.xy_m).all(axis=1)
    assert np.flatnonzero(~placed).tolist() == [0, 1, *range(50, 80), 99]
    assert found.observed.all()
    for name in ("covariance_m2", "velocity_mps", "velocity_covariance"):
        values = getattr(found, name).reshape(100, -1)
        assert (np.isfinite(values).all(axis=1) == placed).all()
    np.testing.assert_allclose(found.xy_m[placed], xy[placed], atol=0.03)


def test_headings_are_those_of_the_motion_and_only_of_motion():
    rng = np.random.default_rng(5)
    time_s = np.arange(0, 20, 0.1)
    there = np.column_stack([-1.0 * time_s, 0.5 * time_s])
    moving = smooth(sightings(0, time_s, there + errors(rng, time_s)))
    known = np.isfinite(moving.heading_rad)
    assert known.mean() > 0.9
    turn = np.angle(np.exp(1j * (moving.heading_rad[known] - np.arctan2(0.5, -1.0))))
    assert np.median(np.abs(turn)) < 0.25
    assert (np.abs(turn) < 4 * moving.heading_sigma_rad[known]).all()
    assert (np.isfinite(moving.heading_sigma_rad) == known).all()
    still = smooth(sightings(0, time_s, errors(rng, time_s)))
    assert np.isfinite(still.heading_rad).mean() < 0.1


def drive(time_s):
    """A car that comes, stands for 60 s and leaves."""
    return np.column_stack([np.interp(time_s, [0, 10, 70, 80], [-60, 0, 0, 50]), 0 * time_s])


def test_a_parked_car_stays_put_and_drives_on():
    rng = np.random.default_rng(6)
    time_s = np.arange(0, 80, 0.1)
    xy = drive(time_s) + rng.multivariate_normal([0, 0], SPREAD, len(time_s))
    found = smooth(sightings(0, time_s, xy, "car"))
    middle = (time_s > 15) & (time_s < 65)
    assert found.standing[middle].all()
    assert not found.standing[(time_s < 9) | (time_s > 71)].any()
    assert found.xy_m[middle].std(axis=0).max() < 0.05
    assert np.abs(found.xy_m[middle]).max() < 0.15
    assert np.hypot(*found.velocity_mps[middle].T).max() < 0.1
    assert np.isnan(found.heading_rad[middle]).all()
    moving = (time_s > 1) & (time_s < 8)
    assert np.abs(found.xy_m - drive(time_s))[moving].max() < 0.6
    # What lasts of the error does not average out while it stands.
    least = LASTING_SHARE * SPREAD[1, 1]
    assert 0.8 * least < found.covariance_m2[400, 1, 1] < 1.3 * least
    waiting = sightings(1, time_s[150:650], xy[150:650])
    both = smooth(Sightings.joined([waiting, sightings(0, time_s, xy, "car")]))
    assert not both.standing[both.track == 1].any()


def test_a_car_that_creeps_does_not_stand():
    rng = np.random.default_rng(7)
    time_s = np.arange(0, 40, 0.1)
    xy = np.column_stack([0.5 * time_s, 0 * time_s])
    found = smooth(sightings(0, time_s, xy + 0.1 * rng.normal(size=xy.shape), "bus"))
    assert not found.standing.any()


def test_the_usual_class_is_taken():
    time_s = 0.1 * np.arange(8)
    one = sightings(5, time_s, np.zeros((8, 2)), "car")
    one.class_name[[0, 3, 7]] = "bus"
    assert set(smooth(one).class_name) == {"car"}


def test_the_order_of_rows_decides_nothing_and_nothing_is_left_to_chance():
    rows = street()
    order = np.random.default_rng(8).permutation(len(rows))
    a, again, b = smooth(rows), smooth(rows), smooth(rows.select(order))
    for name in ("track", "frame", "xy_m", "covariance_m2", "velocity_mps", "standing"):
        np.testing.assert_array_equal(getattr(a, name), getattr(again, name))
        np.testing.assert_array_equal(getattr(a, name), getattr(b, name))
    assert (order[b.source] == a.source).all()


def street():
    """Walkers with gaps, a parked car that is hidden at times, one that stops and goes."""
    rng = np.random.default_rng(9)
    clock = np.arange(900)
    time_s = 0.1 * clock
    parts = []
    for track, begin in enumerate((0, 0, 120, 250, 400)):
        mine = slice(begin, begin + 350)
        xy = walk(rng, time_s[mine])[0] + errors(rng, time_s[mine])
        parts.append(sightings(track, time_s[mine], xy, frame=clock[mine]))
    parked = np.tile([8.0, 3.0], (900, 1)) + rng.multivariate_normal([0, 0], SPREAD, 900)
    parts.append(sightings(50, time_s, parked, "car"))
    moved = drive(time_s) + rng.multivariate_normal([0, 0], SPREAD, 900)
    parts.append(sightings(51, time_s, moved, "truck"))
    rows = Sightings.joined(parts)
    keep = rng.random(len(rows)) > 0.15
    keep &= ~((rows.track == 50) & (rows.frame > 300) & (rows.frame < 500))
    keep &= ~((rows.track == 1) & (rows.frame > 190) & (rows.frame < 207))
    rows.xy_m[rng.random(len(rows)) < 0.05] = np.nan
    return rows.select(keep)


def streamed(rows, frames, **options):
    smoother, parts, fed, most = FixedLagSmoother(**options), [], [], 0
    for frame in range(frames):
        now = np.flatnonzero(rows.frame == frame)
        fed.append(now)
        out = smoother.update(0.1 * frame, frame, rows.select(now))
        most = max(most, smoother.pending)
        parts += [] if out is None else [out]
    parts.append(smoother.finish())
    ends = [part.time_s.max() for part in parts if len(part)]
    assert ends == sorted(ends)
    joined = Smoothed.joined(parts)
    found = joined.select(np.lexsort((joined.frame, joined.track)))
    source = np.append(np.concatenate(fed), -1)[found.source]
    return replace(found, source=source), most


def test_a_stream_says_what_the_whole_says():
    rows, clock = street(), np.arange(900)
    whole = smooth(rows, 0.1 * clock, clock)
    stream, most = streamed(rows, 900)
    for name in ("track", "frame", "source", "observed", "class_name"):
        np.testing.assert_array_equal(getattr(stream, name), getattr(whole, name))
    np.testing.assert_array_equal(np.isnan(stream.xy_m), np.isnan(whole.xy_m))
    away = np.hypot(*(stream.xy_m - whole.xy_m).T)
    people = whole.track < 50
    assert np.nanmax(away[people]) < 0.002
    assert np.nanmax(away[~people]) < 0.1
    assert (stream.standing != whole.standing)[~people].mean() < 0.02
    ratio = stream.covariance_m2[:, 0, 0] / whole.covariance_m2[:, 0, 0]
    assert np.nanmax(np.abs(ratio[people] - 1)) < 0.01
    assert np.nanquantile(ratio[~people], 0.01) > 0.95
    assert most <= 220 * 5


def test_a_stream_does_not_remember_for_ever():
    clock = np.arange(900)
    parked = sightings(7, 0.1 * clock, np.zeros((900, 2)), "car")
    passing = Sightings.joined(
        [
            sightings(
                100 + k, 0.1 * (clock[:40] + 40 * k), np.ones((40, 2)), frame=clock[:40] + 40 * k
            )
            for k in range(22)
        ]
    )
    rows = Sightings.joined([parked, passing])
    smoother, most, held = FixedLagSmoother(forget_s=20.0), 0, 0
    for frame in range(900):
        smoother.update(0.1 * frame, frame, rows.select(rows.frame == frame))
        most = max(most, smoother.pending)
        held = max(held, smoother.remembered)
    assert most <= 2 * 225
    assert held <= 15


def test_bad_input_is_named():
    good = sightings(3, [0.0, 0.1, 0.2], np.zeros((3, 2)))
    with pytest.raises(InputError, match=r"track 3 has frame 1 at 0\.1 s and then frame 1"):
        smooth(Sightings.joined([good, good.select(np.array([1]))]))
    with pytest.raises(InputError, match="times that rise"):
        smooth(replace(good, time_s=np.array([0.0, 0.2, 0.1])))
    with pytest.raises(InputError, match="found class 'dog'"):
        smooth(replace(good, class_name=np.full(3, "dog")))
    with pytest.raises(InputError, match=r"covariance_m2 of row 0 \(track 3, frame 0\)"):
        replace(good, covariance_m2=np.zeros((3, 2, 2)))
    with pytest.raises(InputError, match="time_s must be finite"):
        replace(good, time_s=np.full(3, np.nan))
    clock = np.arange(3)
    for time_s, frame, words in (
        (clock / 10, None, "together"),
        (clock[::-1] / 10, clock, "frame_time_s must be finite and ascending"),
        (clock / 10, clock[::-1].copy(), "frame must be ascending"),
    ):
        with pytest.raises(InputError, match=words):
            smooth(good, time_s, frame)
    with pytest.raises(InputError, match="lag_s must be at least 10"):
        SmoothingSettings(lag_s=1.0)


def test_a_stream_takes_frames_in_order_only():
    row = sightings(0, [1.0], [[0, 0]], frame=[10])
    smoother = FixedLagSmoother()
    smoother.update(1.0, 10, row)
    with pytest.raises(InputError, match=r"found frame 11 at 1.0 s after frame 10"):
        smoother.update(1.0, 11, row.select(np.array([], int)))
    with pytest.raises(InputError, match="another frame or time"):
        smoother.update(1.1, 11, row)
    with pytest.raises(InputError, match="found time nan s"):
        smoother.update(float("nan"), 11, row.select(np.array([], int)))
    assert len(smoother.finish()) == 1


def test_nothing_gives_nothing():
    none = sightings(0, [], np.empty((0, 2)))
    assert len(smooth(none, 0.1 * np.arange(5), np.arange(5))) == 0
    smoother = FixedLagSmoother()
    for frame in range(400):
        out = smoother.update(0.1 * frame, frame, none)
        assert out is None or len(out) == 0
    assert len(smoother.finish()) == 0
    blind = smooth(sightings(0, [0.0, 0.1], np.full((2, 2), np.nan)))
    assert np.isnan(blind.xy_m).all()
    assert blind.observed.all()
