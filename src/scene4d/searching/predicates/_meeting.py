"""Which moments of two kinds of objects come close: by time first, then by place, never all pairs.

Tracks are cut at common times into pieces of :data:`_PIECE` moments with a bounding box each. Two
pieces can only meet where their times are the same, which sorting tells, and their boxes are within
reach, which a sweep along x tells. Only moments of such pieces are ever paired.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.errors import InputError
from scene4d.searching.predicates.stage import Stage, all_finite

_PIECE = 32
"""Moments of a piece, chosen by hand: few enough for a small box, enough for few pieces."""
BOUND_SIGMA = 2.4
"""Standard deviations by which a box grows: P(near) is below 0.01 beyond them."""
MOST_SPREAD_M = 10.0
"""A box grows by no more: what is so uncertain is near nothing in particular. Chosen by hand."""
_STANDS_MPS = 0.5
"""What is slower than this stands, as for :func:`motion.moving`."""
_MOST_ROWS = 40_000_000
"""Most rows of all casts together, one for each role at each moment: about 1 GB, and 40 s with four
roles. Of 19 people who all walk, "a walks, then b, then c, then d" has 56 million (measured on a
made half minute); every further role multiplies them."""


def meetings(
    stage: Stage,
    a: Int[np.ndarray, "n"],
    b: Int[np.ndarray, "m"],
    *,
    reach_m: float,
    margin: int = 0,
    lag: int = 0,
) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]:
    """Rows of ``a`` and, ``lag`` moments before, rows of ``b``, of tracks that come within
    ``reach_m``, and up to ``margin`` moments before and after they do.

    ``a`` and ``b`` are ascending rows in use (:attr:`Stage.used`); a track does not meet itself
    unless there is a lag. The pairs are ordered by (track of a, track of b, moment). Rows of a
    piece of :data:`_PIECE` moments come all or none, so some that are further apart come too.
    """
    none = np.zeros(0, np.int64)
    if len(a) == 0 or len(b) == 0:
        return none, none
    pieces_a = _pieces(stage, a, 0)
    pieces_b = _pieces(stage, b, lag)
    i, j = _close(pieces_a, pieces_b, reach_m)
    if lag == 0:
        other = pieces_a.track[i] != pieces_b.track[j]
        i, j = i[other], j[other]
    if len(i) == 0:
        return none, none
    piece, track_b = _with_neighbours(pieces_a, i, pieces_b.track[j], margin)
    check_count(int(pieces_a.count[piece].sum()), 2)
    owner, position = expand(pieces_a.first[piece], pieces_a.count[piece])
    row_a = a[position]
    row_b = stage.row_at(track_b[owner], stage.tick[row_a] - lag)
    there = row_b >= 0
    if len(b) < len(stage.tick):
        allowed = np.zeros(len(stage.tick), bool)
        allowed[b] = True
        there &= allowed[row_b]
    return row_a[there], row_b[there]


def earlier(
    stage: Stage, a: Int[np.ndarray, "n"], b: Int[np.ndarray, "m"], *, reach_m: float
) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]:
    """Rows of ``a`` with, for each track of ``b`` that was within reach before, the row nearest.

    ``b`` are ascending rows. Ordered by (track of a, track of b, moment). Of a track's rows in a
    square of a tenth of ``reach_m`` only the first counts at which it stood, or else was there, so
    that a parked vehicle is one row.
    """
    tracks = stage.tracks
    a = a[all_finite(tracks.xy_m[a])]
    b = b[all_finite(tracks.xy_m[b])]
    fine = np.floor(tracks.xy_m[b] / (reach_m / 10)).astype(np.int64)
    speed = np.linalg.norm(tracks.velocity_mps[b], axis=1)
    track = stage.track_of_row[b]
    order = np.lexsort((b, ~(speed < _STANDS_MPS), fine[:, 1], fine[:, 0], track))
    head = runs(track[order], fine[order, 0], fine[order, 1])
    b = b[order][head]
    if len(a) == 0 or len(b) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    i, j = _same_place(tracks.xy_m[a], tracks.xy_m[b], reach_m)
    row_a, row_b = a[i], b[j]
    track_a, track_b = stage.track_of_row[row_a], stage.track_of_row[row_b]
    keep = (stage.tick[row_b] < stage.tick[row_a]) & (track_a != track_b)
    row_a, row_b, track_a, track_b = row_a[keep], row_b[keep], track_a[keep], track_b[keep]
    apart = np.linalg.norm(tracks.xy_m[row_a] - tracks.xy_m[row_b], axis=1)
    order = np.lexsort((apart, row_a, track_b, track_a))
    order = order[runs(track_b[order], row_a[order])]
    return row_a[order], row_b[order]


@dataclass(frozen=True, eq=False)
class _Pieces:
    """Pieces of tracks in a common window of time, ordered by (track, window)."""

    track: Int[np.ndarray, "p"]
    window: Int[np.ndarray, "p"]
    first: Int[np.ndarray, "p"]
    count: Int[np.ndarray, "p"]
    low: Float[np.ndarray, "p 2"]
    high: Float[np.ndarray, "p 2"]


def _pieces(stage: Stage, rows: Int[np.ndarray, "n"], lag: int) -> _Pieces:
    """Pieces of the rows; without positions their box is empty, and nothing meets it."""
    track = stage.track_of_row[rows]
    window = (stage.tick[rows] + lag) // _PIECE
    first = runs(track, window)
    count = np.diff(np.append(first, len(rows)))
    tracks = stage.tracks
    variance = tracks.covariance_m2[:, 0, 0][rows] + tracks.covariance_m2[:, 1, 1][rows]
    spread = np.fmin(BOUND_SIGMA * np.sqrt(np.maximum(variance, 0)), MOST_SPREAD_M)
    # Column by column: along rows of two, a reduction takes ten times as long.
    xy = [tracks.xy_m[:, axis][rows] for axis in (0, 1)]
    low = np.column_stack([np.fmin.reduceat(x - spread, first) for x in xy])
    high = np.column_stack([np.fmax.reduceat(x + spread, first) for x in xy])
    return _Pieces(track[first], window[first], first, count, low, high)


def _close(
    a: _Pieces, b: _Pieces, reach_m: float
) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]:
    """Pieces of the same window whose boxes are within reach, by a sweep along x."""
    if np.isinf(reach_m):
        order = np.argsort(b.window, kind="stable")
        begin = np.searchsorted(b.window[order], a.window)
        end = np.searchsorted(b.window[order], a.window, side="right")
        i, at = expand(begin, end - begin)
        return i, order[at]
    known = np.flatnonzero(all_finite(b.low))
    if len(known) == 0:
        return np.zeros(0, np.int64), np.zeros(0, np.int64)
    low_x, window = b.low[known, 0], b.window[known]
    widest = float((b.high[known, 0] - low_x).max())
    left = min(float(low_x.min()), float(np.nanmin(a.low[:, 0], initial=np.inf)))
    right = max(float(low_x.max()), float(np.nanmax(a.high[:, 0], initial=-np.inf)))
    # Windows side by side on one axis, so that (window, x) sorts as one number.
    wide = right - left + widest + 2 * reach_m + 1.0
    base = min(int(a.window.min()), int(window.min()))
    order = np.argsort((window - base) * wide + (low_x - left), kind="stable")
    axis = ((window - base) * wide + (low_x - left))[order]
    finite = all_finite(a.low)
    x_low = np.where(finite, a.low[:, 0] - left, 0.0)
    x_high = np.where(finite, a.high[:, 0] - left, 0.0)
    place = (a.window - base) * wide
    slack = 1e-6 * wide  # rounding of the long axis; the boxes are compared exactly below
    begin = np.searchsorted(axis, place + x_low - reach_m - widest - slack)
    end = np.searchsorted(axis, place + x_high + reach_m + slack, side="right")
    i, at = expand(begin, np.where(finite, np.maximum(end - begin, 0), 0))
    j = known[order[at]]
    gap = np.maximum(np.maximum(a.low[i] - b.high[j], b.low[j] - a.high[i]), 0)
    near = ((gap**2).sum(axis=1) <= reach_m**2) & (a.window[i] == b.window[j])
    return i[near], j[near]


def _with_neighbours(
    pieces: _Pieces, i: Int[np.ndarray, "p"], track_b: Int[np.ndarray, "p"], margin: int
) -> tuple[Int[np.ndarray, "w"], Int[np.ndarray, "w"]]:
    """Pieces of ``a`` with a track of ``b``, and those up to ``margin`` moments around, each once;
    ordered by (track of a, track of b, window).
    """
    around = min(-(-margin // _PIECE), len(pieces.track))
    key = _window_key(pieces, pieces.track, pieces.window)
    track_a, window = pieces.track[i], pieces.window[i]
    begin = np.searchsorted(key, _window_key(pieces, track_a, window - around))
    end = np.searchsorted(key, _window_key(pieces, track_a, window + around), side="right")
    order = np.lexsort((begin, track_b, track_a))
    begin, end, track_a, track_b = begin[order], end[order], track_a[order], track_b[order]
    # Within a pair of tracks both ends ascend: what overlaps the range before is left to that.
    same = (track_a[1:] == track_a[:-1]) & (track_b[1:] == track_b[:-1])
    begin[1:] = np.where(same, np.maximum(begin[1:], end[:-1]), begin[1:])
    owner, piece = expand(begin, end - begin)
    return piece, track_b[owner]


def _window_key(
    pieces: _Pieces, track: Int[np.ndarray, "p"], window: Int[np.ndarray, "p"]
) -> Int[np.ndarray, "p"]:
    low, high = int(pieces.window.min()), int(pieces.window.max())
    return track * (high - low + 3) + np.clip(window - low, -1, high - low + 1) + 1


def _same_place(
    a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "m 2"], reach_m: float
) -> tuple[Int[np.ndarray, "p"], Int[np.ndarray, "p"]]:
    """Pairs within reach, by squares of that size: a point's own and the eight around it."""
    low = np.minimum(a.min(axis=0), b.min(axis=0))
    cell_a, cell_b = (np.floor((xy - low) / reach_m).astype(np.int64) + 1 for xy in (a, b))
    high = int(max(cell_a[:, 1].max(), cell_b[:, 1].max())) + 2
    order = np.argsort(cell_b[:, 0] * high + cell_b[:, 1], kind="stable")
    key = (cell_b[:, 0] * high + cell_b[:, 1])[order]
    found_i, found_j = [], []
    for column in (-1, 0, 1):
        middle = (cell_a[:, 0] + column) * high + cell_a[:, 1]
        begin = np.searchsorted(key, middle - 1)
        end = np.searchsorted(key, middle + 1, side="right")
        i, at = expand(begin, end - begin)
        j = order[at]
        near = ((a[i] - b[j]) ** 2).sum(axis=1) <= reach_m**2
        found_i.append(i[near])
        found_j.append(j[near])
    return np.concatenate(found_i), np.concatenate(found_j)


def check_count(moments: int, roles: int) -> None:
    """Raise :class:`InputError` for more moments of casts than can be judged."""
    if moments * roles > _MOST_ROWS:
        raise InputError(
            f"there are {moments:,} moments at which {roles} roles can be cast, expected at most "
            f"{_MOST_ROWS // roles:,}: ask for fewer roles, say which of them are near one "
            "another, or search shorter clips"
        )


def expand(
    first: Int[np.ndarray, "n"], count: Int[np.ndarray, "n"]
) -> tuple[Int[np.ndarray, "m"], Int[np.ndarray, "m"]]:
    """The ranges ``first, first + 1, ...`` one after the other: which range, and the number."""
    owner = np.repeat(np.arange(len(first)), count)
    begins = np.cumsum(count) - count
    return owner, first[owner] + np.arange(len(owner)) - begins[owner]


def runs(*keys: Int[np.ndarray, "n"]) -> Int[np.ndarray, "w"]:
    """Where rows begin whose keys differ from those of the row before."""
    new = np.zeros(len(keys[0]), bool)
    new[:1] = True
    for key in keys:
        new[1:] |= key[1:] != key[:-1]
    return np.flatnonzero(new)
