"""Where two cameras may lie to each other: pieces of paths that have one shape, and their votes.

Two stretches of path of equal duration are laid onto each other by the best rotation and shift,
which complex numbers give in closed form: with centred positions z_a and z_b as complex numbers,
the rotation is the angle of ``g = Σ conj(z_b) z_a`` and the remainder ``Σ|z_a|² + Σ|z_b|² - 2|g|``.
So one matrix product compares all stretches of one camera with all of the other. A match votes for
a time offset, a heading and a shift; people in common vote alike.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.alignment._paths import STEP_S, Paths
from scene4d.core.columns import Columns

_LENGTHS = (8, 24)
"""Ticks in a stretch: 4 s show a turn and are left of broken tracks, 12 s tell more. Chosen: on
made sites these two found the true place most often among the first few."""
_LEAST_EXTENT_M = 0.4
"""Least root-mean-square extent (m): who moves less shows no shape beside the noise."""
_JITTER_M = 0.12
"""What a stretch's shape errs by beside the rows' own noise (m): steps and boxes."""
_SCALE_SIGMA = 0.1
"""Log-scale difference of two cameras: both heights err by 5 to 10 %."""
_REACH = 9.0
"""Matches of a larger normalised remainder do not vote (chi-squared of a few facts)."""
_MOST_STRETCHES = 1500
"""Of more stretches of one length those are kept that bend or change their speed most: steady
walks along a line fit each other anyway. Of twenty cameras for an hour 1,000 join the same pairs as
4,000, in half the time."""
_BLOCK = 500_000
"""Comparisons in memory at once."""
_MOST_VOTES = 25_000
"""Votes of one length that are counted: the heaviest."""
_BIN = np.array([1.0, np.radians(15.0), 1.5, 1.5])
"""Width of a ballot's box: seconds, radians, metres at the middle of the people."""
_KEPT = 40


@dataclass(frozen=True, eq=False)
class Hypotheses(Columns):
    """Candidates: ``offset_s``, ``heading_rad`` and ``shift_m`` so that a point p of camera b at
    its time t is ``Rot(heading) p + shift`` in the ground of camera a at ``t + offset``.
    """

    offset_s: Float[np.ndarray, "n"]
    heading_rad: Float[np.ndarray, "n"]
    shift_m: Float[np.ndarray, "n 2"]
    votes: Float[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class _Stretches(Columns):
    """Stretches of one length: centred shape as complex numbers (n, length), its mean square, and
    its middle.
    """

    shape: np.ndarray
    energy: np.ndarray
    middle: np.ndarray
    tick: np.ndarray
    track: np.ndarray
    kind: np.ndarray
    noise_m2: np.ndarray


def hypotheses(a: Paths, b: Paths, offsets_s: tuple[float, float]) -> Hypotheses:
    """The alignments for which most votes were cast, best first."""
    pivot = complex(*b.xy_m.mean(axis=0)) if len(b) else 0j
    ballots = [_ballots(a, b, length, offsets_s, pivot) for length in _LENGTHS]
    vote, who, weight = (np.concatenate(column) for column in zip(*ballots, strict=True))
    return _counted(vote, who, weight, pivot)


def _stretches(paths: Paths, length: int) -> _Stretches:
    """Stretches of one length that move, begun at every tick, in order of time."""
    n = len(paths) - length + 1
    start = np.flatnonzero(paths.piece[: max(n, 0)] == paths.piece[length - 1 :])
    z = (paths.xy_m[:, 0] + 1j * paths.xy_m[:, 1]).astype(np.complex64)
    shape = z[start[:, None] + np.arange(length)]
    middle = shape.mean(axis=1)
    shape = shape - middle[:, None]
    energy = (shape.real**2 + shape.imag**2).mean(axis=1)
    steady = np.linspace(-np.sqrt(3.0), np.sqrt(3.0), length, dtype=np.float32)
    bent = energy - np.abs(shape @ steady / length) ** 2
    kept = np.flatnonzero(energy > _LEAST_EXTENT_M**2)
    if len(kept) > _MOST_STRETCHES:
        kept = kept[np.argpartition(-bent[kept], _MOST_STRETCHES)[:_MOST_STRETCHES]]
    kept = kept[np.argsort(paths.tick[start[kept]], kind="stable")]
    start = start[kept]
    return _Stretches(
        shape[kept],
        energy[kept],
        middle[kept].astype(complex),
        paths.tick[start] + (length - 1) / 2,
        paths.track[start],
        paths.kind[start],
        paths.noise_m2[start + length // 2],
    )


def _ballots(
    a: Paths, b: Paths, length: int, offsets_s: tuple[float, float], pivot: complex
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Votes (m, 4), the pairs of tracks that cast them (m,), and their weights (m,)."""
    of_a, of_b = _stretches(a, length), _stretches(b, length)
    of_a = of_a.select(slice(0, None, length // 3))
    low, high = np.array(offsets_s) / STEP_S
    first = np.searchsorted(of_b.tick, of_a.tick - high)
    last = np.searchsorted(of_b.tick, of_a.tick - low, side="right")
    parts = []
    size = max(1, _BLOCK // max(1, int((last - first).max(initial=1))))
    for k in range(0, len(of_a.tick), size):
        rows = np.arange(k, min(k + size, len(of_a.tick)))
        begin, end = int(first[rows].min()), int(last[rows].max())
        if end > begin:
            parts.append(_matches(of_a.select(rows), of_b.select(slice(begin, end)), (low, high)))
    if not parts:
        return np.zeros((0, 4)), np.zeros(0, np.int64), np.zeros(0)
    columns = list(map(np.concatenate, zip(*parts, strict=True)))
    if len(columns[-1]) > _MOST_VOTES:
        best = np.argpartition(-columns[-1], _MOST_VOTES)[:_MOST_VOTES]
        columns = [column[best] for column in columns]
    offset, heading, shift_a, shift_b, who, weight = columns
    at = shift_a - np.exp(1j * heading) * (shift_b - pivot)
    vote = np.column_stack([offset, heading, at.real, at.imag])
    return vote, who, weight


def _matches(
    a: _Stretches, b: _Stretches, ticks: tuple[float, float]
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Offsets, headings, both middles, pairs of tracks and weights of stretches of one shape."""
    length = a.shape.shape[1]
    g = a.shape @ b.shape.conj().T / np.float32(length)
    noise = 2 * _JITTER_M**2 + a.noise_m2 + np.median(b.noise_m2)
    # What remains of a's energy beside b's shape, |g|² / energy_b, is noise: cheap, so it is first.
    least = np.maximum(a.energy - _REACH * noise * 4 / length, 0.25 * a.energy)
    i, j = np.nonzero(g.real**2 + g.imag**2 > np.outer(least, b.energy).astype(np.float32))
    offset = a.tick[i] - b.tick[j]
    size = np.abs(g[i, j])
    unlike = a.energy[i] - size**2 / b.energy[j]
    growth = np.log(size / b.energy[j]) / _SCALE_SIGMA
    remainder = np.maximum(unlike, 0.0) * (length / 4) / noise[i] + growth**2
    near = (remainder < _REACH) & (a.kind[i] == b.kind[j])
    near &= (offset >= ticks[0]) & (offset <= ticks[1])
    i, j, offset, remainder = i[near], j[near], offset[near], remainder[near]
    # A stretch that matches whatever comes tells nothing: how rarely it does is its worth.
    rare = np.log((len(b.tick) + 1.0) / (np.bincount(i, minlength=len(a.tick)) + 1.0))
    weight = rare[i] * (1 - remainder / _REACH)
    who = a.track[i].astype(np.int64) * (1 << 31) + b.track[j]
    return offset * STEP_S, np.angle(g[i, j]), a.middle[i], b.middle[j], who, weight


def _counted(vote: np.ndarray, who: np.ndarray, weight: np.ndarray, pivot: complex) -> Hypotheses:
    """The fullest boxes of two ballots, one shifted by half a box; a pair of tracks counts once."""
    found = []
    for half in (0.0, 0.5):
        box = np.floor(vote / _BIN + half).astype(np.int64)
        box[:, 1] %= round(2 * np.pi / _BIN[1])
        box -= box.min(axis=0, initial=0)
        wide = box.max(axis=0, initial=0) + 1
        key = ((box[:, 0] * wide[1] + box[:, 1]) * wide[2] + box[:, 2]) * wide[3] + box[:, 3]
        order = np.lexsort((-weight, who, key))
        key, pair = key[order], who[order]
        once = (np.diff(key, prepend=-1) != 0) | (np.diff(pair, prepend=-1) != 0)
        boxes, of = np.unique(key[once], return_inverse=True)
        total = np.bincount(of, weight[order][once], len(boxes))
        for best in np.argsort(-total)[:_KEPT]:
            rows = order[
                np.searchsorted(key, boxes[best]) : np.searchsorted(key, boxes[best], "right")
            ]
            w = weight[rows] + 1e-9
            turn = np.angle((w * np.exp(1j * vote[rows, 1])).sum())
            mean = (w[:, None] * vote[rows]).sum(axis=0) / w.sum()
            found.append((mean[0], turn, mean[2] + 1j * mean[3], total[best]))
    found.sort(key=lambda one: -one[3])
    offset, heading, at, total = (np.array([one[k] for one in found]) for k in range(4))
    shift = at - np.exp(1j * heading) * pivot if len(found) else np.zeros(0, complex)
    return Hypotheses(
        offset.astype(float),
        heading.astype(float),
        np.column_stack([shift.real, shift.imag]),
        total,
    )
