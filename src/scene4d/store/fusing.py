"""What several cameras saw of the same people and vehicles, as one track each."""

from collections.abc import Callable, Sequence
from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.tracks import Tracks

_FLOOR_M2 = 1e-6
"""Variance that every position has at least: a millimetre, so that annotations without errors have
an inverse."""
_REACH = 0.75
"""A row stands for moments this many steps away: neighbours meet, with some room for uneven frame
times; farther away is a gap."""


Modes = Callable[[Float[np.ndarray, "n 2"]], Float[np.ndarray, "n 2 r"]]
"""How points of the common frame move with every error that several cameras share, as one camera
sees them; columns mean the same in all."""
_BLOCK = 2_000
"""Rows whose modes are in memory at once."""


def fused(parts: Sequence[Tracks], step_s: float, modes: Sequence[Modes] | None = None) -> Tracks:
    """One track per number, ordered by (track, time), from those of several cameras.

    ``parts`` are in one frame and on one clock, each ordered by (track, time), with the same number
    for the same object. Rows lie at multiples of ``step_s``. Positions and velocities are weighted
    by information (the inverse of own and shared covariance together). A camera errs
    the same way in all its rows: own errors and shared ones are carried over apart, so that the
    shared part stays what it is however long one looks. ``modes`` tell of each part what it errs by
    together with others; without them cameras err independently. Boxes and keypoints
    belong to one picture and are left out; other columns are those of the surest camera.
    """
    known = [part.select(np.isfinite(part.xy_m).all(axis=1)) for part in parts]
    placed = [at_ticks(_without_picture(part), step_s) for part in known]
    rows = Tracks.concatenate([one for one, _ in placed])
    tick = np.concatenate([ticks for _, ticks in placed])
    part = np.repeat(np.arange(len(placed)), [len(one) for one, _ in placed])
    total = rows.covariance_m2 + rows.shared_covariance_m2
    surest = np.trace(total, axis1=1, axis2=2)
    order = np.lexsort((surest, tick, rows.track))
    rows, tick, part = rows.select(order), tick[order], part[order]
    new = np.append(
        np.ones(min(len(rows), 1), bool), (np.diff(rows.track) != 0) | (np.diff(tick) != 0)
    )
    first, group = np.flatnonzero(new), np.cumsum(new) - 1
    if len(first) == len(rows):
        return _told(rows, tick, step_s)
    weight, _ = _weights(total[order], first, group)
    out = _merged(rows, first, group, weight)
    if modes is not None:
        _share(out, rows, group, part, weight, modes)
    return _told(out, tick[first], step_s)


def at_ticks(tracks: Tracks, step_s: float) -> tuple[Tracks, Int[np.ndarray, "m"]]:
    """The nearest row for each moment that a track lasts, moved there by its velocity."""
    if not len(tracks):
        return tracks, np.zeros(0, int)
    time_s, track = tracks.time_s, tracks.track
    first = np.flatnonzero(np.append(True, track[1:] != track[:-1]))
    last = np.append(first[1:], len(track)) - 1
    begin = np.rint(time_s[first] / step_s).astype(int)
    count = np.rint(time_s[last] / step_s).astype(int) - begin + 1
    of = np.repeat(np.arange(len(first)), count)
    tick = begin[of] + np.arange(len(of)) - np.repeat(np.cumsum(count) - count, count)
    row = _nearest(time_s, first, last, of, tick * step_s)
    away_s = tick * step_s - time_s[row]
    own_s = float(np.median(np.diff(time_s)[np.diff(track) == 0])) if len(of) > len(first) else 0.0
    near = np.abs(away_s) <= _REACH * max(step_s, own_s)
    row, away_s, tick = row[near], away_s[near], tick[near]
    moved = tracks.select(row)
    way = np.nan_to_num(moved.velocity_mps) * away_s[:, None]
    return replace(moved, xy_m=moved.xy_m + way), tick


def _nearest(
    time_s: Float[np.ndarray, "n"],
    first: Int[np.ndarray, "t"],
    last: Int[np.ndarray, "t"],
    of: Int[np.ndarray, "m"],
    wanted_s: Float[np.ndarray, "m"],
) -> Int[np.ndarray, "m"]:
    """The row of a track (its position in ``first``) that is nearest in time."""
    start, span = time_s.min(), 2 * np.ptp(time_s) + 1.0
    number = np.zeros(len(time_s), int)
    number[first[1:]] = 1
    line = time_s - start + span * np.cumsum(number)
    after = np.searchsorted(line, wanted_s - start + span * of)
    after = np.clip(after, first[of], last[of])
    before = np.maximum(after - 1, first[of])
    nearer = np.abs(time_s[before] - wanted_s) <= np.abs(time_s[after] - wanted_s)
    return np.where(nearer, before, after)


def _merged(
    rows: Tracks,
    first: Int[np.ndarray, "k"],
    group: Int[np.ndarray, "n"],
    weight: Float[np.ndarray, "n 2 2"],
) -> Tracks:
    """One row of each group, the first of which is the surest; ``weight`` is that of positions."""
    out = rows.select(first)
    out.xy_m[:] = _sum(weight, rows.xy_m, first)
    out.covariance_m2[:] = _spread(weight, rows.covariance_m2, first)
    out.shared_covariance_m2[:] = _spread(weight, rows.shared_covariance_m2, first)
    known = np.isfinite(rows.velocity_covariance).all(axis=(1, 2))
    known &= np.isfinite(rows.velocity_mps).all(axis=1)
    covariance = np.where(known[:, None, None], rows.velocity_covariance, 0.0)
    weight, some = _weights(covariance, first, group, known)
    velocity = _sum(weight, np.nan_to_num(rows.velocity_mps), first)
    out.velocity_mps[some] = velocity[some]
    out.velocity_covariance[some] = _spread(weight, covariance, first)[some]
    _merge_headings(out, rows, first)
    out.observed[:] = np.logical_or.reduceat(rows.observed, first)
    out.existence_probability[:] = np.fmax.reduceat(rows.existence_probability, first)
    return out


def _share(
    out: Tracks,
    rows: Tracks,
    group: Int[np.ndarray, "n"],
    part: Int[np.ndarray, "n"],
    weight: Float[np.ndarray, "n 2 2"],
    modes: Sequence[Modes],
) -> None:
    """The shared covariance of what several cameras saw, by what they err by together."""
    several = np.flatnonzero(np.bincount(group) > 1)
    for block in np.array_split(several, -(-len(several) // _BLOCK) or 1):
        here = np.flatnonzero(np.isin(group, block))
        moved: np.ndarray | None = None
        for number in np.unique(part[here]).tolist():
            mine = part[here] == number
            found = weight[here[mine]] @ modes[number](rows.xy_m[here[mine]])
            moved = np.zeros((len(here), *found.shape[1:])) if moved is None else moved
            moved[mine] = found
        if moved is None:
            continue
        start = np.searchsorted(group[here], block)
        together = np.add.reduceat(moved, start, axis=0)
        shared = together @ together.swapaxes(1, 2)
        known = np.isfinite(shared).all(axis=(1, 2))
        out.shared_covariance_m2[block[known]] = shared[known]


def _weights(
    covariance: Float[np.ndarray, "n 2 2"],
    first: Int[np.ndarray, "k"],
    group: Int[np.ndarray, "n"],
    known: Bool[np.ndarray, "n"] | None = None,
) -> tuple[Float[np.ndarray, "n 2 2"], Bool[np.ndarray, "k"]]:
    """Matrix weights that add up to one within each group, and which groups have any."""
    information = np.linalg.inv(covariance + _FLOOR_M2 * np.eye(2))
    if known is not None:
        information[~known] = 0.0
    total = np.add.reduceat(information, first, axis=0)
    with np.errstate(invalid="ignore"):  # where nothing is known of one: the group has none
        some = np.linalg.det(total) > 0
    total[~some] = np.eye(2)
    return np.linalg.inv(total)[group] @ information, some


def _sum(weight: np.ndarray, values: np.ndarray, first: np.ndarray) -> Float[np.ndarray, "k 2"]:
    summed: np.ndarray = np.add.reduceat(np.einsum("nij,nj->ni", weight, values), first, axis=0)
    return summed


def _spread(
    weight: np.ndarray, covariance: np.ndarray, first: np.ndarray
) -> Float[np.ndarray, "k 2 2"]:
    part = weight @ covariance @ weight.swapaxes(1, 2)
    spread: np.ndarray = np.add.reduceat(part, first, axis=0)
    return spread


def _merge_headings(out: Tracks, rows: Tracks, first: Int[np.ndarray, "k"]) -> None:
    """Weighted by information, on the circle; NaN where no camera knows it."""
    known = np.isfinite(rows.heading_rad) & (rows.heading_sigma_rad > 0)
    weight = np.where(known, np.where(known, rows.heading_sigma_rad, 1.0) ** -2, 0.0)
    turn = weight * np.exp(1j * np.where(known, rows.heading_rad, 0.0))
    total, information = np.add.reduceat(turn, first), np.add.reduceat(weight, first)
    some = information > 0
    out.heading_rad[some] = np.angle(total[some])
    out.heading_sigma_rad[some] = information[some] ** -0.5


def _without_picture(tracks: Tracks) -> Tracks:
    n = len(tracks)
    return replace(
        tracks,
        box_xyxy=np.full((n, 4), np.nan),
        keypoint_uv=np.zeros((n, 0, 2)),
        keypoint_score=np.zeros((n, 0)),
        score=np.full(n, np.nan),
    )


def _told(rows: Tracks, tick: Int[np.ndarray, "n"], step_s: float) -> Tracks:
    """On the common clock; a track has one class."""
    return replace(
        rows,
        frame=tick,
        time_s=tick * step_s,
        class_name=_main_classes(rows.track, rows.class_name),
    )


def _main_classes(track: Int[np.ndarray, "n"], class_name: np.ndarray) -> np.ndarray:
    """For each row the class that most rows of its track have; of several, the first."""
    names, code = np.unique(class_name, return_inverse=True)
    _, number = np.unique(track, return_inverse=True)
    count = np.zeros((number.max(initial=-1) + 1, len(names)), int)
    np.add.at(count, (number, code), 1)
    return names[count.argmax(axis=1)[number]] if len(track) else class_name
