"""Smoothed tracks on the ground: positions, velocities and headings with their covariance.

Computes the posterior of a nearly-constant-velocity model given all detections of a track, as the
Rauch-Tung-Striebel smoother does (Rauch, Tung and Striebel, 1965), for all tracks at once
(:mod:`scene4d.tracking._chain`). Detections may be any time apart. Outliers get less weight, and
standing vehicles are held in place.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.columns import Columns
from scene4d.core.errors import InputError
from scene4d.core.tracks import CLASSES
from scene4d.tracking._chain import Chain
from scene4d.tracking._motion_model import GROUP, PERSON_GROUP, class_numbers
from scene4d.tracking._sightings import (
    BRIDGED,
    REMEMBERED,
    Memory,
    Sightings,
    TrackRows,
    in_order,
)


@dataclass(frozen=True)
class SmoothingSettings:
    """Assumptions of the smoother."""

    max_gap_s: float = 2.0
    """Longer gaps between two measured positions are not bridged. Chosen by hand: within 2 s a
    walker can turn back, and a straight bridge would be a guess."""
    max_hidden_s: float = 10.0
    """The same where somebody was hidden, and so stayed near: at most ``lag_s``."""
    outlier_sigma: float = 3.0
    """The variance of a detection further than this from the smoothed position is raised until
    its distance equals this limit, so that its influence falls with distance. In the plane, 99 %
    of Gaussian errors are within 3."""
    standing_window_s: float = 4.0
    """Vehicles stop at kerbs and lights for longer than this. Chosen by hand, like the three
    values below; ``python -m benchmarks.meva_scenes`` measures how far MEVA's parked vehicles move
    with them, and tests/tracking/test_smoothing.py covers cars that stop and one that creeps."""
    standing_move_m: float = 0.3
    """A vehicle stands if it moves less than this over the window (at 0.1 m/s it moves more)."""
    standing_move_sigma: float = 1.5
    """It also stands if it moves less than this many standard deviations of a detection, since
    distant vehicles jitter more."""
    standing_most_m: float = 1.5
    """Upper limit of both, a third of a car's length."""
    lag_s: float = 10.0
    """In a stream, rows older than this are final; at least ``max_gap_s``, ``max_hidden_s`` and
    ``standing_window_s``. Later detections change the position of a moving object by less than
    2 mm at 10 Hz."""

    def __post_init__(self) -> None:
        least_s = max(self.max_gap_s, self.max_hidden_s, self.standing_window_s)
        if not self.lag_s >= least_s:
            raise InputError(
                f"smoothing: lag_s must be at least {least_s} (max_gap_s, max_hidden_s, "
                f"standing_window_s), found {self.lag_s}"
            )


@dataclass(frozen=True, eq=False)
class Smoothed(Columns):
    """Smoothed tracks, ordered by (track, time).

    ``source`` is the row of the input, -1 where a gap is bridged (``observed`` is false).
    ``class_name`` is the track's most frequent class. Positions are NaN where a detection has no
    ground point and no neighbours within ``max_gap_s``. ``heading_rad`` is NaN where the speed is
    not significantly above zero (99 %).
    """

    source: Int[np.ndarray, "n"]
    track: Int[np.ndarray, "n"]
    class_name: np.ndarray
    time_s: Float[np.ndarray, "n"]
    frame: Int[np.ndarray, "n"]
    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]
    velocity_mps: Float[np.ndarray, "n 2"]
    velocity_covariance: Float[np.ndarray, "n 2 2"]
    heading_rad: Float[np.ndarray, "n"]
    heading_sigma_rad: Float[np.ndarray, "n"]
    standing: Bool[np.ndarray, "n"]
    observed: Bool[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Estimates:
    """Rows with their estimated states; ``placed`` rows have a position. ``factor`` is the factor
    by which a detection's stated variance was raised.
    """

    rows: TrackRows
    placed: Bool[np.ndarray, "n"]
    standing: Bool[np.ndarray, "n"]
    factor: Float[np.ndarray, "n"]
    mean: Float[np.ndarray, "n 6"]
    covariance: Float[np.ndarray, "n 6 6"]


def smooth(
    sightings: Sightings,
    frame_time_s: Float[np.ndarray, "m"] | None = None,
    frame: Int[np.ndarray, "m"] | None = None,
    *,
    settings: SmoothingSettings | None = None,
) -> Smoothed:
    """Smooth finished tracks.

    ``frame`` (m,) and ``frame_time_s`` (m,), both ascending, are the frames that were analysed.
    Where a track is missing from some of them for at most ``max_gap_s``, it is bridged there.
    Without them no gap is bridged.

    Raises :class:`InputError` if two detections of a track have the same time or frame, frames or
    times are not ascending, or a scene cannot hold a class.
    """
    s = SmoothingSettings() if settings is None else settings
    if (frame_time_s is None) != (frame is None):
        raise InputError("smoothing: give frame_time_s and frame together")
    if frame_time_s is None or frame is None:
        frame_time_s, frame = np.empty(0), np.empty(0, np.int64)
    found = estimate(sightings, frame, frame_time_s, Memory.none(), s)
    counts = np.zeros((len(np.unique(sightings.track)), len(CLASSES)), np.int64)
    track, at = np.unique(sightings.track, return_inverse=True)
    np.add.at(counts, (at, class_numbers(sightings.class_name)), 1)
    return finished(found, np.ones(len(found.rows), bool), track, counts)


def estimate(
    sightings: Sightings,
    frame: Int[np.ndarray, "m"],
    frame_time_s: Float[np.ndarray, "m"],
    memory: Memory,
    s: SmoothingSettings,
) -> Estimates:
    """All rows with their states; see :func:`smooth`."""
    rows = in_order(sightings, frame, frame_time_s, memory, s.max_gap_s, s.max_hidden_s)
    placed, n = rows.placed(), len(rows)
    used = placed | (rows.source == REMEMBERED)
    found = Estimates(
        rows,
        placed,
        standing=np.zeros(n, bool),
        factor=np.ones(n),
        mean=np.full((n, 6), np.nan),
        covariance=np.full((n, 6, 6), np.nan),
    )
    found.standing[used], found.factor[used], found.mean[used], found.covariance[used] = _solved(
        rows.select(used), memory, s
    )
    return found


def remembered(found: Estimates, memory: Memory, until_s: float) -> Memory:
    """The state of each track at its last row up to ``until_s``, given detections up to then."""
    used = found.placed | (found.rows.source == REMEMBERED)
    used &= found.rows.time_s <= until_s
    if not used.any():
        return Memory.none()
    rows = found.rows.select(used)
    chain = Chain(rows, memory)
    mean, cov = chain.solve(found.standing[used], found.factor[used], covariance=True)
    assert cov is not None  # it was asked for
    # Every track begins with a row that has a position.
    knows = np.where(np.isfinite(rows.measured_s), np.arange(len(rows)), 0)
    last = np.append(rows.first[1:], True)
    return Memory(
        track=rows.track[last],
        kind=rows.kind[last],
        time_s=rows.time_s[last],
        frame=rows.frame[last],
        measured_s=rows.measured_s[np.maximum.accumulate(knows)][last],
        mean=mean[last],
        covariance=cov[last],
    )


def _solved(
    rows: TrackRows, memory: Memory, s: SmoothingSettings
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Which rows stand, their variance factors, states and state covariances."""
    chain = Chain(rows, memory)
    n = len(rows)
    standing, factor = np.zeros(n, bool), np.ones(n)
    vehicle = GROUP[rows.kind] != PERSON_GROUP
    for _ in range(2):
        mean, _ = chain.solve(standing, factor, covariance=False)
        factor = np.maximum(1.0, chain.misfit(mean[:, :2]) / s.outlier_sigma**2)
        if not vehicle.any() and factor.max(initial=1.0) == 1.0:
            break
    if vehicle.any():
        # Twice: the rows pinned first show that those between them did not move either.
        for _ in range(2):
            standing = vehicle & _stands(rows, mean[:, :2], s)
            mean, _ = chain.solve(standing, factor, covariance=False)
    mean, cov = chain.solve(standing, factor, covariance=True)
    assert cov is not None  # it was asked for
    return standing, factor, mean, cov


def _stands(
    rows: TrackRows, xy_m: Float[np.ndarray, "n 2"], s: SmoothingSettings
) -> Bool[np.ndarray, "n"]:
    """Rows around which the track moves less than the settings' limits."""
    first = rows.first
    number = np.cumsum(first) - 1
    begin, end = np.flatnonzero(first), np.flatnonzero(np.append(first[1:], True))
    # All tracks on one time axis, one after another.
    time = rows.time_s - rows.time_s[begin][number]
    length = time[end]
    offset = np.concatenate([[0.0], np.cumsum(length + 1.0)[:-1]])[number] if len(time) else time
    # At a track's ends the window is shifted to fit inside it.
    window, whole = s.standing_window_s, length[number]
    low = np.clip(time - window / 2, 0.0, np.maximum(whole - window, 0.0))
    high = np.minimum(low + window, whole)
    moved = np.empty_like(xy_m)
    for axis in range(2):
        at_high = np.interp(high + offset, time + offset, xy_m[:, axis])
        moved[:, axis] = at_high - np.interp(low + offset, time + offset, xy_m[:, axis])
    distance = np.hypot(moved[:, 0], moved[:, 1])
    # Rows without a measurement take the covariance of the last one.
    measured = np.isfinite(rows.xy_m[:, 0])
    last = np.maximum.accumulate(np.where(measured, np.arange(len(measured)), begin[number]))
    sigma = np.sqrt(np.trace(rows.covariance_m2[last], axis1=1, axis2=2) / 2)
    limit = np.fmax(s.standing_move_m, s.standing_move_sigma * sigma)
    share = (high - low) / window
    return (share >= 0.5) & (distance < share * np.minimum(limit, s.standing_most_m))


def finished(
    found: Estimates,
    wanted: Bool[np.ndarray, "n"],
    track: Int[np.ndarray, "t"],
    counts: Int[np.ndarray, "t c"],
) -> Smoothed:
    """The wanted rows in their final form. ``counts`` (t, classes) holds how often each ``track``
    (t,), ascending, was seen as each class.
    """
    keep = wanted & (found.rows.source != REMEMBERED)
    rows = found.rows.select(keep)
    names = np.array(CLASSES)[counts.argmax(axis=1)]
    mean, cov, placed = found.mean[keep], found.covariance[keep], found.placed[keep]
    mean[~placed], cov[~placed] = np.nan, np.nan
    velocity, velocity_cov = mean[:, 2:4], cov[:, 2:4, 2:4]
    heading, sigma = _headings(velocity, velocity_cov)
    return Smoothed(
        source=rows.source,
        track=rows.track,
        class_name=names[np.searchsorted(track, rows.track)],
        time_s=rows.time_s,
        frame=rows.frame,
        xy_m=mean[:, :2],
        covariance_m2=cov[:, :2, :2],
        velocity_mps=velocity,
        velocity_covariance=velocity_cov,
        heading_rad=heading,
        heading_sigma_rad=sigma,
        standing=found.standing[keep],
        observed=rows.source != BRIDGED,
    )


_SIGNIFICANT = 9.21
"""99 % quantile of chi-squared with two degrees of freedom."""


def _headings(velocity: np.ndarray, covariance: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Direction of motion and its standard deviation, NaN where the speed may be zero."""
    heading, sigma = np.full((2, len(velocity)), np.nan)
    known = np.isfinite(velocity[:, 0])
    v, cov = velocity[known], covariance[known]
    squared = (v * np.linalg.solve(cov, v[:, :, None])[:, :, 0]).sum(axis=1)
    clear = squared > _SIGNIFICANT
    known[known] = clear
    v, cov = v[clear], cov[clear]
    speed = np.hypot(v[:, 0], v[:, 1])
    across = np.column_stack([-v[:, 1], v[:, 0]]) / speed[:, None]
    heading[known] = np.arctan2(v[:, 1], v[:, 0])
    sigma[known] = np.sqrt(np.einsum("ni,nij,nj->n", across, cov, across)) / speed
    return heading, sigma
