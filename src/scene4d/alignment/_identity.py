"""One number for every person and vehicle of a site, whichever cameras saw them.

Tracks that several cameras saw at one time are joined by distance on the ground over the time in
common (:mod:`._sameness`), then what is left across gaps by way, speed and time (:mod:`._transit`).
Pairs that exclude each other share one probability (:mod:`._marginals`); likely ones are joined
first, and none that puts one person into two places at once.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from itertools import combinations, permutations

import numpy as np
from jaxtyping import Float, Int

from scene4d.alignment._marginals import all_of, marginals, named
from scene4d.alignment._paths import ranges
from scene4d.alignment._sameness import TICK_S, Pairs, Passages, met
from scene4d.alignment._transit import transits
from scene4d.core.tracks import Tracks
from scene4d.store.fusing import at_ticks
from scene4d.store.identities import Identities

JOINED_AT = 0.5
"""Probability above which two tracks get one number: more likely one than two."""
_OVERLAP_TICKS = 2
"""Two tracks of one camera that last this many moments at once are two people: a tracker that loses
somebody finds him again a moment before it gives him up."""
_COMES, _OF = 1.0, 4.0
"""Every fourth who leaves a view is expected in another, which counts as much as four who left."""
_ROUNDS = 6
_IMPOSSIBLE = -10.0
"""Log-ratio at which a pair that would be joined by way of others is refused."""


@dataclass(frozen=True, eq=False)
class _Joins:
    """Pairs of tracks by their numbers in the site, with probabilities."""

    a: Int[np.ndarray, "n"]
    b: Int[np.ndarray, "n"]
    probability: Float[np.ndarray, "n"]


def passages_of(camera: str, tracks: Tracks) -> Passages:
    """A camera's tracks, in the site's frame and on its clock, as they are compared."""
    known = tracks.select(np.isfinite(tracks.xy_m).all(axis=1))
    rows, tick = at_ticks(known, TICK_S)
    return Passages.of_camera(camera, rows, tick)


def identified(cameras: Sequence[Passages]) -> Identities:
    """Which tracks of several cameras are one and the same, numbered in the order in which they
    begin. Every track gets a number.
    """
    if not any(len(one) for one in cameras):
        nobody = np.zeros(0, np.int64)
        return Identities(np.zeros(0, "U1"), nobody, nobody, np.zeros(0))
    base: list[int] = np.cumsum([0, *(len(one) for one in cameras)]).tolist()
    group = _Groups(cameras, base)
    together = [
        (base[p], base[q], met(cameras[p], cameras[q]))
        for p, q in combinations(range(len(cameras)), 2)
    ]
    group.refuse(together)
    group.join(_overlapping(together, group))
    chains = group.chains()
    later = []
    for p, q in permutations(range(len(cameras)), 2):
        open_ends = chains.ends(base[p], cameras[p]), chains.begins(base[q], cameras[q])
        pairs = transits(cameras[p], cameras[q], _span_s(cameras[q]), open_ends)
        later.append((base[p], base[q], pairs))
    group.join(_across_gaps(later, chains))
    return group.identities()


def _overlapping(together: Sequence[tuple[int, int, Pairs]], group: "_Groups") -> _Joins:
    """Pairs of each two cameras, of whom at most one of those at the same time is the same."""
    found = [(np.zeros(0, int), np.zeros(0, int), np.zeros(0))]
    for base_a, base_b, pairs in together:
        a, b = pairs.a + base_a, pairs.b + base_b
        by_row, by_column = (named(len(a), _rivals(x, y, group)) for x, y in ((a, b), (b, a)))
        found.append((a, b, marginals(pairs.log_ratio, by_row, by_column)))
    return _Joins(*(np.concatenate(column) for column in zip(*found, strict=True)))


def _rivals(
    one: Int[np.ndarray, "n"], other: Int[np.ndarray, "n"], group: "_Groups"
) -> Int[np.ndarray, "k 2"]:
    """Numbers of pairs that share ``one`` and whose others are two people."""
    i, j = _sharing(one).T
    apart = group.at_once(other[i], other[j])
    return np.column_stack([i[apart], j[apart]])


def _across_gaps(later: Sequence[tuple[int, int, Pairs]], chains: "_Chains") -> _Joins:
    """Pairs of an end of one chain and a beginning of another, each of which has one partner.

    How often who leaves one camera comes to another is learned from the pairs themselves
    (expectation and maximisation, :data:`_COMES` of :data:`_OF` before anything is seen).
    """
    a = np.concatenate([pairs.a + base for base, _, pairs in later] or [np.zeros(0, int)])
    b = np.concatenate([pairs.b + base for _, base, pairs in later] or [np.zeros(0, int)])
    odds = np.concatenate([pairs.log_ratio for *_, pairs in later] or [np.zeros(0)])
    way = np.repeat(np.arange(len(later)), [len(pairs.a) for *_, pairs in later])
    kept = chains.number[a] != chains.number[b]
    a, b, odds, way = a[kept], b[kept], odds[kept], way[kept]
    by_end, by_beginning = all_of(a), all_of(b)
    leave = np.array([len(np.unique(a[way == k])) for k in range(len(later))])
    come = np.full(len(later), _COMES / _OF)
    found = np.zeros(len(a))
    for _ in range(_ROUNDS if len(a) else 0):
        found = marginals(odds + np.log(come[way]), by_end, by_beginning)
        come = (np.bincount(way, found, len(later)) + _COMES) / (leave + _OF)
    return _Joins(a, b, found)


def _sharing(one: Int[np.ndarray, "n"]) -> Int[np.ndarray, "k 2"]:
    """Pairs of places of one value, in both orders."""
    order = np.argsort(one, kind="stable")
    _, first, count = np.unique(one[order], return_index=True, return_counts=True)
    i, j = ranges(np.repeat(first, count), np.repeat(count, count))
    pairs: np.ndarray = np.column_stack([order[i], order[j]])[i != j]
    return pairs


def _span_s(one: Passages) -> float:
    return float(np.ptp(one.tick)) * TICK_S if len(one.tick) else 0.0


@dataclass(frozen=True, eq=False)
class _Chains:
    """Tracks that are one so far: of each track its chain, of each chain the track that begins
    first and the one that ends last.
    """

    number: Int[np.ndarray, "t"]
    first: Int[np.ndarray, "k"]
    last: Int[np.ndarray, "k"]

    def ends(self, base: int, camera: Passages) -> Int[np.ndarray, "n"]:
        """Tracks of a camera with which a chain ends, by their places in the camera."""
        inside = (self.last >= base) & (self.last < base + len(camera))
        return np.sort(self.last[inside] - base)

    def begins(self, base: int, camera: Passages) -> Int[np.ndarray, "n"]:
        """Those with which a chain begins."""
        inside = (self.first >= base) & (self.first < base + len(camera))
        return np.sort(self.first[inside] - base)


class _Groups:
    """Tracks by their numbers in the site, and which are one so far."""

    def __init__(self, cameras: Sequence[Passages], base: Sequence[int]) -> None:
        self._cameras = cameras
        self._camera = np.repeat(np.arange(len(cameras)), np.diff(base))
        self._begin = np.concatenate([one.begin for one in cameras])
        self._end = np.concatenate([one.end for one in cameras])
        n = len(self._camera)
        self._members = {k: [k] for k in range(n)}
        self._group = np.arange(n)
        self._probability = np.ones(n)
        self._refused: set[tuple[int, int]] = set()

    def at_once(self, i: Int[np.ndarray, "n"], j: Int[np.ndarray, "n"]) -> np.ndarray:
        """Whether two tracks of one camera last at the same time."""
        common = np.minimum(self._end[i], self._end[j]) - np.maximum(self._begin[i], self._begin[j])
        at_once: np.ndarray = common + 1 > _OVERLAP_TICKS
        return at_once

    def refuse(self, together: Sequence[tuple[int, int, Pairs]]) -> None:
        """Never join tracks that were far from each other at the same time."""
        for base_a, base_b, pairs in together:
            far = pairs.log_ratio < _IMPOSSIBLE
            a, b = (pairs.a[far] + base_a).tolist(), (pairs.b[far] + base_b).tolist()
            self._refused.update(zip(a, b, strict=True))

    def join(self, joins: _Joins) -> None:
        """The likeliest first; what contradicts an earlier one stays apart."""
        likely = np.flatnonzero(joins.probability > JOINED_AT)
        for k in likely[np.argsort(-joins.probability[likely], kind="stable")]:
            a, b = int(joins.a[k]), int(joins.b[k])
            self._join(a, b, float(joins.probability[k]))

    def _join(self, a: int, b: int, probability: float) -> None:
        ga, gb = int(self._group[a]), int(self._group[b])
        if ga == gb or self._contradict(self._members[ga], self._members[gb]):
            return
        later = max(a, b, key=lambda k: int(self._begin[k]))
        self._probability[later] = min(self._probability[later], probability)
        small, large = sorted((ga, gb), key=lambda g: len(self._members[g]))
        for member in self._members[small]:
            self._group[member] = large
        self._members[large] += self._members.pop(small)

    def _contradict(self, some: list[int], others: list[int]) -> bool:
        i = np.repeat(some, len(others))
        j = np.tile(others, len(some))
        same = self._camera[i] == self._camera[j]
        if (same & self.at_once(i, j)).any():
            return True
        low, high = np.minimum(i, j).tolist(), np.maximum(i, j).tolist()
        return any(pair in self._refused for pair in zip(low, high, strict=True))

    def chains(self) -> _Chains:
        """What is one so far."""
        _, number = np.unique(self._group, return_inverse=True)
        by_begin = np.lexsort((self._begin, number))
        first = by_begin[np.flatnonzero(np.diff(number[by_begin], prepend=-1))]
        by_end = np.lexsort((self._end, number))
        last = by_end[np.flatnonzero(np.diff(number[by_end], append=number.max(initial=0) + 1))]
        return _Chains(number, first, last)

    def identities(self) -> Identities:
        """Numbers from 1, in the order in which they begin."""
        chains = self.chains()
        rank = np.empty(len(chains.first), int)
        rank[np.argsort(self._begin[chains.first], kind="stable")] = np.arange(len(rank)) + 1
        names = np.array([one.camera for one in self._cameras])
        return Identities(
            camera=names[self._camera],
            track=np.concatenate([one.track for one in self._cameras]).astype(np.int64),
            identity=rank[chains.number].astype(np.int64),
            probability=self._probability,
        )
