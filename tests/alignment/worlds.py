"""Made sites: people who walk, cameras that see part of the ground and err, clocks that differ.

    site = made_site(seed=1, cameras=4, overlap=0.4)
    site.seen[0].tracks, site.seen[0].calibration, site.seen[0].truth

A camera's file is the true camera disturbed by a draw from the covariance that the file states, so
positions carry the bent ground of a wrong tilt, focal length, height, ... On top of it come errors
that stay with a track for seconds, noise, false tracks, gaps and broken identities.
"""

import itertools
from dataclasses import dataclass

import numpy as np
from scipy.signal import lfilter

from made_tracks import made_tracks
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.placement import Placement
from scene4d.core.tracks import Tracks

SIGMA = np.array([0.03, np.radians(1.0), np.radians(0.5), 0.05, 0.01, 0.012, 0.012])
"""Log focal, tilt, roll, log height, corner distortion, principal point: as calibrate states."""
RATE_HZ = 5.0
REACH_M = 22.0
"""Nobody is tracked further off."""
BIAS_M, BIAS_S, NOISE_M = 0.12, 4.0, 0.05


@dataclass(frozen=True, eq=False)
class Seen:
    """One camera of a site: what it tracked, what its file says, and what is true."""

    name: str
    tracks: Tracks
    calibration: Calibration
    camera: Camera
    truth: Placement
    who: np.ndarray
    """The person of each row, -1 for false tracks."""


@dataclass(frozen=True, eq=False)
class Site:
    """A made site; truths are relative to its first camera."""

    seen: tuple[Seen, ...]
    drift: np.ndarray


@dataclass(frozen=True, eq=False)
class Walk:
    """One person's way: times (n,) and positions (n, 2) in the world."""

    time_s: np.ndarray
    xy_m: np.ndarray


def walk(rng, start_s, low, high, *, stops=0.3, straight=False):
    """From one side of the area to another, past a place or two, with stops."""
    side = rng.permutation(4)[:2]
    gates = [_gate(rng, s, low, high) for s in side]
    between = [] if straight else [rng.uniform(low, high) for _ in range(rng.integers(1, 3))]
    places = np.array([gates[0], *between, gates[1]])
    speed = rng.normal(1.3, 0.2)
    time_s, xy = [0.0], [places[0]]
    for a, b in itertools.pairwise(places):
        time_s.append(time_s[-1] + np.linalg.norm(b - a) / max(speed, 0.6))
        xy.append(b)
        if rng.random() < stops:
            time_s.append(time_s[-1] + rng.exponential(6.0))
            xy.append(b)
    return sampled(np.array(time_s) + start_s, np.array(xy))


def sampled(time_s, xy, rate_hz=RATE_HZ):
    """A way through places at times, its corners rounded over a second and a half."""
    at = np.arange(np.ceil(time_s[0] * rate_hz), np.floor(time_s[-1] * rate_hz) + 1) / rate_hz
    path = np.column_stack([np.interp(at, time_s, xy[:, k]) for k in (0, 1)])
    width = max(1, int(1.5 * rate_hz)) // 2
    kernel = np.ones(2 * width + 1) / (2 * width + 1)
    if len(at) > 4 * width:
        padded = np.pad(path, ((width, width), (0, 0)), mode="edge")
        path = np.column_stack([np.convolve(padded[:, k], kernel, "valid") for k in (0, 1)])
    return Walk(at, path)


def _gate(rng, side, low, high):
    point = rng.uniform(low, high)
    point[side % 2] = (low, high)[side // 2][side % 2]
    return point


def true_camera(rng):
    tilt = rng.uniform(0.3, 0.55)
    return Camera.from_pose(
        image_size=(1280, 720),
        focal_px=rng.uniform(850.0, 1100.0),
        tilt_rad=tilt,
        roll_rad=rng.normal(0.0, 0.02),
        height_m=rng.uniform(3.0, 6.0),
    )


def made_site(
    seed=0,
    *,
    cameras=2,
    overlap=0.4,
    minutes=2.0,
    per_minute=8.0,
    missed=0.15,
    false=0.1,
    offset_s=60.0,
    drift_ppm=0.0,
    walks=None,
    errors=1.0,
):
    """A row of cameras along a street, each seeing ``overlap`` of what its neighbour sees.

    Cameras look at the street alternately from its two sides and obliquely. ``errors`` scales all
    errors of calibrations. ``walks`` replaces the people, in the world's metres and seconds: the
    street runs along x, the first camera sees around the origin.
    """
    rng = np.random.default_rng(seed)
    spacing = 14.0 * (1.0 - overlap)
    low, high = np.array([-9.0, -5.0]), np.array([(cameras - 1) * spacing + 9.0, 5.0])
    seconds = 60.0 * minutes
    if walks is None:
        count = rng.poisson(per_minute * minutes * (1 + 0.5 * (cameras - 1) * (1 - overlap)))
        walks = [walk(rng, rng.uniform(-20.0, seconds), low, high) for _ in range(count)]
    offsets = np.append(0.0, rng.uniform(-offset_s, offset_s, cameras - 1))
    drift = np.append(0.0, rng.normal(0.0, drift_ppm * 1e-6, cameras - 1))
    seen, first = [], None
    for k in range(cameras):
        true = true_camera(rng)
        pose = _pose(rng, k * spacing, 1 if k % 2 == 0 else -1, true)
        first = pose if first is None else first
        rate = (5.0, 10.0, 12.5)[k % 3]
        clock = (offsets[k], drift[k])
        seen.append(
            _seen(
                rng,
                f"cam{k}",
                true,
                pose,
                first,
                walks,
                seconds,
                clock,
                rate,
                missed,
                false,
                errors,
            )
        )
    return Site(tuple(seen), drift)


def _pose(rng, along, side, camera):
    """Position and heading (radians, of the optical axis from the world's +Y)."""
    far = min(camera.height_m / np.tan(camera.tilt_rad), 11.0)
    turn = rng.uniform(-0.4, 0.4)
    heading = (0.0 if side > 0 else np.pi) + turn
    look = np.array([-np.sin(heading), np.cos(heading)])
    centre = np.array([along, 0.0]) - far * look
    return np.append(centre, heading)


def _into(pose, xy):
    c, s = np.cos(pose[2]), np.sin(pose[2])
    return (xy - pose[:2]) @ np.array([[c, -s], [s, c]])


def _seen(rng, name, true, pose, first, walks, seconds, clock, rate, missed, false, errors):
    offset, drift = clock
    step = errors * SIGMA * rng.standard_normal(7)
    stated = true.disturbed(step)
    calibration = Calibration(
        status="ok",
        method="made",
        image_size=true.image_size,
        person_height_m=1.7,
        camera=stated,
        covariance=np.diag((errors * SIGMA) ** 2),
    )
    people = [(k, _into(pose, w.xy_m), w.time_s) for k, w in enumerate(walks)]
    for _ in range(rng.poisson(false * max(len(walks), 1))):
        start = rng.uniform(0, seconds)
        ghost = walk(rng, start, np.array([-5.0, 6.0]), np.array([5.0, 16.0]))
        cut = ghost.time_s < start + rng.uniform(2.0, 8.0)
        people.append((-1, ghost.xy_m[cut], ghost.time_s[cut]))
    rows = []
    number = 0
    for person, xy, time_s in people:
        # The camera's clock t' with t = t' + offset + drift t, and its own frames.
        own = time_s * (1 - drift) - offset
        frames = np.arange(np.ceil(own[0] * rate), np.floor(own[-1] * rate) + 1)
        at = frames / rate
        if len(at) < 5:
            continue
        world = np.column_stack([np.interp(at, own, xy[:, j]) for j in (0, 1)])
        good = _visible(true, world) & (at >= -offset) & (at <= seconds - offset)
        good &= ~_gaps(rng, at, missed)
        for part in _parts(rng, good, frames, rate):
            at_part, place = at[part], world[part]
            place = place + _errors(rng, at_part)
            uv, _ = true.project(np.column_stack([place, np.zeros(len(place))]))
            said, valid = stated.locate(uv)
            if len(said) < 5 or not valid.all():
                continue
            rows.append((number, person, frames[part], at_part, said, world[part]))
            number += 1
    truth = _truth(pose, first, rows, offset)
    return Seen(name, _tracks(rows), calibration, true, truth, _column(rows, 1))


def _visible(camera, xy):
    uv, valid = camera.project(np.column_stack([xy, np.zeros(len(xy))]))
    with np.errstate(invalid="ignore"):
        inside = (uv >= 0).all(axis=1) & (uv < camera.image_size).all(axis=1)
    return valid & inside & (np.linalg.norm(xy, axis=1) < REACH_M)


def _gaps(rng, at, missed):
    """Seconds in which a person is not found, as a share of all."""
    lost = np.zeros(len(at), bool)
    span = at[-1] - at[0]
    for _ in range(rng.poisson(missed * span / 4.0)):
        start = rng.uniform(at[0], at[-1])
        lost |= (at >= start) & (at < start + rng.exponential(4.0))
    return lost


def _parts(rng, good, frames, rate):
    """Runs of rows with one identity: short gaps are bridged by half the trackers."""
    index = np.flatnonzero(good)
    if not len(index):
        return []
    away = np.diff(frames[index]) / rate
    cut = (away > 2.0) | ((away > 0.5) & (rng.random(len(away)) < 0.5))
    return np.split(index, np.flatnonzero(cut) + 1)


def _errors(rng, at):
    """What stays for seconds, and noise as smoothing leaves it."""
    n = len(at)
    step = float(np.median(np.diff(at))) if n > 1 else 1.0
    keep = np.exp(-step / BIAS_S)
    kick = BIAS_M * np.sqrt(1 - keep**2) * rng.standard_normal((n, 2))
    kick[0] *= 1 / np.sqrt(1 - keep**2)
    error = lfilter([1.0], [1.0, -keep], kick, axis=0)
    return error + NOISE_M * rng.standard_normal((n, 2))


def _truth(pose, first, rows, offset):
    """The camera in the first one's frame; the scale makes reported metres true ones, on average
    over the tracks.
    """
    x, y = _into(first, pose[None, :2])[0]
    said, true = (np.concatenate([row[k] for row in rows] or [np.ones((1, 2))]) for k in (4, 5))
    scale = (said * true).sum() / (said**2).sum()
    return Placement(float(x), float(y), float(pose[2] - first[2]), float(scale), offset)


def _column(rows, k):
    return np.concatenate([np.full(len(row[2]), row[k]) for row in rows] or [np.zeros(0, int)])


def _tracks(rows):
    time_s = np.concatenate([row[3] for row in rows] or [np.zeros(0)])
    frame = np.concatenate([row[2] for row in rows] or [np.zeros(0)]).astype(int)
    xy = np.concatenate([row[4] for row in rows] or [np.zeros((0, 2))])
    velocity = np.concatenate(
        [np.gradient(_smooth(row[4]), row[3], axis=0) for row in rows] or [np.zeros((0, 2))]
    )
    return made_tracks(
        _column(rows, 0), time_s, xy, frame=frame, covariance_m2=0.08**2,
        shared_covariance_m2=0.1**2, velocity_mps=velocity, velocity_covariance=0.2**2,
        heading_sigma_rad=0.2, score=0.9, existence_probability=0.95,
    )  # fmt: skip


def _smooth(xy, width=3):
    padded = np.pad(xy, ((width, width), (0, 0)), mode="edge")
    kernel = np.ones(2 * width + 1) / (2 * width + 1)
    return np.column_stack([np.convolve(padded[:, k], kernel, "valid") for k in (0, 1)])
