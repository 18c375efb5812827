"""How much more likely tracks of two cameras are if they show one person or vehicle than if not."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from scene4d.alignment._paths import ranges
from scene4d.core.colours import CLOTHES, PALETTE, PARTS, VEHICLES
from scene4d.core.tracks import Tracks

TICK_S = 0.5
"""Time between the moments that are compared."""
_OWN_S = 1.0
"""A smoothed position errs alike for about this long, so that moments closer than that count as
parts of one."""
_CARRIED_M = {"person": 0.15, "cycle": 0.3, "vehicle": 0.5}
"""Standard deviation (m) of what a track of each kind errs by in all its rows beside what its
camera does: where boxes end on this body, seen from this side. For people the wander that alignment
reckons with; for what has wheels about an eighth of its length. Chosen."""
_LONGEST_M = 6.0
"""Tracks whose median distance is larger are not compared: no placed camera errs by that much."""
_LEAST_TICKS = 2
_COMPANY_M, _STROLL_M = 1.5, 1.0
"""Somebody else walks beside at about the first distance (m), or goes a way of his own: within a
second his place beside this one changes by the second."""
_SPREAD_M = 5.0
"""And is about so far away (m) where both cameras see."""
_COMPANY = 0.2
"""Share of strangers who walk beside: every fifth person whose own track is missing. Chosen."""
SEEN = 0.8
"""Probability that who is in the view of two cameras is tracked by both. Chosen: what the trackers
here reach on PETS."""
_SIZE_SIGMA = np.array([[np.nan, np.nan, 0.09], [0.25, 0.1, 0.15], [0.6, 0.12, 0.25]])
"""Standard deviations of length, width, height (m) among people (adults), cycles and vehicles."""
_KINDS = ("person", "cycle", "vehicle")
_TRUE_COLOURS, _MOST_COLOURS = 0.6, 10.0
"""Probability that colours of two cameras can be compared (white balance; people from ahead and
behind), and the factor by which they make one person likelier at most: chosen to be weak. To learn
the first for each two cameras was no better on made sites, also where one showed colours wrong."""


@dataclass(frozen=True, eq=False)
class Pairs:
    """Pairs of tracks (their places in two lists), with the logarithm of how much more likely they
    are if they show the same, and the numbers of moments compared.
    """

    a: Int[np.ndarray, "n"]
    b: Int[np.ndarray, "n"]
    log_ratio: Float[np.ndarray, "n"]
    ticks: Int[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Passages:
    """The tracks of one camera, one entry each, and their moments (:func:`.at_ticks`).

    ``rows`` are moments in the site's frame, ordered by (track, time), ``tick`` their numbers and
    ``of`` the entry of each; ``kind`` is 0 for people, 1 for cycles, 2 for vehicles.
    ``colours`` are those of :class:`Tracks`.
    """

    camera: str
    track: Int[np.ndarray, "t"]
    kind: Int[np.ndarray, "t"]
    size_m: Float[np.ndarray, "t 3"]
    size_sigma_m: Float[np.ndarray, "t 3"]
    begin: Int[np.ndarray, "t"]
    end: Int[np.ndarray, "t"]
    rows: Tracks
    tick: Int[np.ndarray, "n"]
    of: Int[np.ndarray, "n"]
    colours: Float[np.ndarray, "t c"]

    def __len__(self) -> int:
        return len(self.track)

    @classmethod
    def of_camera(cls, camera: str, tracks: Tracks, tick: Int[np.ndarray, "n"]) -> "Passages":
        """From rows at ticks, ordered by (track, time)."""
        track, first, of = np.unique(tracks.track, return_index=True, return_inverse=True)
        last = np.append(first[1:], len(tracks))[: len(first)] - 1
        wheels = np.isin(tracks.class_name[last], ("bicycle", "motorcycle"))
        kind = np.where(tracks.class_name[last] == "person", 0, np.where(wheels, 1, 2))
        size, sigma = tracks.size_m[last], tracks.size_sigma_m[last]
        colours = tracks.colours[last].astype(float)
        begin, end = tick[first], tick[last]
        return cls(camera, track, kind, size, sigma, begin, end, tracks, tick, of, colours)


def met(a: Passages, b: Passages) -> Pairs:
    """Pairs of tracks of one kind that two cameras saw at the same moments, near each other."""
    i, j = _meetings(a, b)
    key = a.of[i].astype(np.int64) * max(len(b), 1) + b.of[j]
    order = np.argsort(key, kind="stable")
    i, j, key = i[order], j[order], key[order]
    first = np.flatnonzero(np.diff(key, prepend=-1))
    if not len(first):
        nobody = np.zeros(0, int)
        return Pairs(nobody, nobody, np.zeros(0), nobody)
    ticks = np.diff(np.append(first, len(key)))
    group = np.repeat(np.arange(len(first)), ticks)
    apart = a.rows.xy_m[i] - b.rows.xy_m[j]
    noise = a.rows.covariance_m2[i] + b.rows.covariance_m2[j]
    together = a.rows.shared_covariance_m2[i] + b.rows.shared_covariance_m2[j]
    near = _medians(np.hypot(*apart.T), first, group) < _LONGEST_M
    carried = np.array([_CARRIED_M[kind] for kind in _KINDS])[a.kind[a.of[i[first]]]]
    shared = np.add.reduceat(together, first, axis=0) / ticks[:, None, None]
    shared = shared + (2 * carried**2)[:, None, None] * np.eye(2)
    ratio = _log_ratio(apart, noise, shared, first, group)
    pa, pb = a.of[i[first]], b.of[j[first]]
    ratio = ratio + size_log_ratio(a, b, pa, pb)
    kept = near & (ticks >= _LEAST_TICKS)
    return Pairs(pa[kept], pb[kept], ratio[kept], ticks[kept])


def size_log_ratio(
    a: Passages, b: Passages, i: Int[np.ndarray, "n"], j: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """What lengths, widths and heights say; nothing where they are not known."""
    apart = a.size_m[i] - b.size_m[j]
    same = a.size_sigma_m[i] ** 2 + b.size_sigma_m[j] ** 2
    other = same + 2 * _SIZE_SIGMA[a.kind[i]] ** 2
    with np.errstate(invalid="ignore", divide="ignore"):
        ratio = (np.log(other / same) - apart**2 / same + apart**2 / other) / 2
    return np.where(np.isfinite(ratio), ratio, 0.0).sum(axis=1)


def colour_log_ratio(
    a: Passages, b: Passages, i: Int[np.ndarray, "n"], j: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "n"]:
    """What colours of both parts say: Σ p q / (how common each is) where they can be compared;
    nothing where one of them was not seen.
    """
    if not (a.colours.shape[1] and b.colours.shape[1]):
        return np.zeros(len(i))
    common = np.where((a.kind[i] == 0)[:, None], CLOTHES, VEHICLES)[:, None]
    p, q = (
        one.colours.reshape(-1, len(PARTS), len(PALETTE))[rows] for one, rows in ((a, i), (b, j))
    )
    seen = (p.sum(axis=2) > 0) & (q.sum(axis=2) > 0)
    alike = np.where(seen, (p * q / common).sum(axis=2), 1.0).prod(axis=1)
    ratio = 1 + _TRUE_COLOURS * (np.minimum(alike, _MOST_COLOURS) - 1)
    return np.asarray(np.log(ratio))


def _meetings(a: Passages, b: Passages) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """Rows of both at one moment, of one kind, where the views of the two cameras meet."""
    here, there = _common(a, b), _common(b, a)
    here = here[np.argsort(a.tick[here], kind="stable")]
    there = there[np.argsort(b.tick[there], kind="stable")]
    first = np.searchsorted(b.tick[there], a.tick[here])
    last = np.searchsorted(b.tick[there], a.tick[here], side="right")
    of, at = ranges(first, last - first)
    i, j = here[of], there[at]
    alike = a.kind[a.of[i]] == b.kind[b.of[j]]
    return i[alike], j[alike]


def _common(a: Passages, b: Passages) -> Int[np.ndarray, "n"]:
    """Rows of a where b sees anybody, within the distance at which tracks are compared."""
    if not len(a) or not len(b):
        return np.zeros(0, int)
    low, high = b.rows.xy_m.min(axis=0) - _LONGEST_M, b.rows.xy_m.max(axis=0) + _LONGEST_M
    inside = np.all((a.rows.xy_m >= low) & (a.rows.xy_m <= high), axis=1)
    return np.flatnonzero(inside)


def _medians(
    values: Float[np.ndarray, "n"], first: Int[np.ndarray, "k"], group: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "k"]:
    order = np.lexsort((values, group))
    count = np.diff(np.append(first, len(values)))
    return values[order][first + count // 2]


def _log_ratio(
    apart: Float[np.ndarray, "n 2"],
    noise: Float[np.ndarray, "n 2 2"],
    shared: Float[np.ndarray, "k 2 2"],
    first: Int[np.ndarray, "k"],
    group: Int[np.ndarray, "n"],
) -> Float[np.ndarray, "k"]:
    """One and the same, against a mixture of who walks beside and who goes a way of his own."""
    same = _log_density(apart, noise, shared, first)
    wide = np.eye(2)
    beside = _log_density(apart, noise, shared + _COMPANY_M**2 * wide, first)
    own = _log_density(apart, noise + _STROLL_M**2 * wide, shared + _SPREAD_M**2 * wide, first)
    other = np.logaddexp(np.log(_COMPANY) + beside, np.log1p(-_COMPANY) + own)
    return np.asarray(np.log(SEEN / (1 - SEEN)) + same - other)


def _log_density(
    apart: Float[np.ndarray, "n 2"],
    noise: Float[np.ndarray, "n 2 2"],
    shared: Float[np.ndarray, "k 2 2"],
    first: Int[np.ndarray, "k"],
) -> Float[np.ndarray, "k"]:
    """Log density of all differences of each group: a common one with covariance ``shared``, and
    noise of every row, of which those within :data:`_OWN_S` count as one.

    With A = Σ N⁻¹ and b = Σ N⁻¹ d the remainder is Σ dᵀN⁻¹d - bᵀ(S⁻¹ + A)⁻¹b, and the determinant
    ∏|N| · |I + S A| (matrix inversion lemma).
    """
    part = TICK_S / _OWN_S
    inverse = np.linalg.inv(noise + 1e-6 * np.eye(2))
    pull = np.einsum("nij,nj->ni", inverse, apart)
    A = part * np.add.reduceat(inverse, first, axis=0)
    b = part * np.add.reduceat(pull, first, axis=0)
    rest = part * np.add.reduceat(np.einsum("ni,ni->n", apart, pull), first)
    room = part * np.add.reduceat(np.log(np.linalg.det(noise + 1e-6 * np.eye(2))), first)
    explained = np.einsum("gi,gij,gj->g", b, np.linalg.inv(np.linalg.inv(shared) + A), b)
    room = room + np.log(np.linalg.det(np.eye(2) + shared @ A))
    return np.asarray(-(rest - explained + room) / 2)
