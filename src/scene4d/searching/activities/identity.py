"""One object under two numbers: tracks whose boxes coincide, or take up where another ended."""

from dataclasses import replace

import numpy as np
from jaxtyping import Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scene4d.core.boxes import iou
from scene4d.searching.predicates._meeting import expand, meetings, runs
from scene4d.searching.predicates.stage import Stage

# Chosen by hand on the tuning cameras (MEVA G341 and G424): 0.1 more or less of the shares changes
# the mean average precision, 0.457, by at most 0.005, half or twice the time by at most 0.007
# (benchmarks/search_constants.py).
_SAME_BOX = 0.6
"""Overlap (intersection over union) of two boxes from which they are around one thing."""
_SAME_SHARE = 0.7
"""Share of two tracks' common moments at which their boxes must be."""
_SAME_PLACE_M = 3.0
"""Tracks further apart than this on the ground are not compared: their boxes cannot coincide."""
_RESUMED_S = 1.0
"""Longest time after which a track may be taken up by another."""


def unite_tracks(stage: Stage, united: Int[np.ndarray, "t"] | None = None) -> Stage:
    """The stage with one track for each object that has several.

    Two tracks of one class are one object where their boxes coincide at most of their common
    moments, or where one begins within :data:`_RESUMED_S` in the box in which the other ended.
    A united track has the smallest number of its parts, and at each moment the row of the part that
    has most rows. Annotations that draw an actor anew for every activity need this. ``united`` are
    its :func:`united_numbers` where they are known.
    """
    united = united_numbers(stage) if united is None else united
    length = stage.last_row - stage.first_row + 1
    of = stage.track_of_row
    track = united[of]
    if np.array_equal(track, stage.tracks.track):
        return stage
    order = np.lexsort((of, -length[of], stage.tick, track))
    order = order[runs(track[order], stage.tick[order])]
    return replace(stage, tracks=replace(stage.tracks.select(order), track=track[order]))


def united_numbers(stage: Stage) -> Int[np.ndarray, "t"]:
    """The number that each track has in :func:`unite_tracks`, in the order of the rows."""
    number = stage.tracks.track[stage.first_row]
    n = len(number)
    if n == 0:
        return number
    pairs = np.vstack([_coinciding(stage), _resumed(stage)])
    links = coo_array((np.ones(len(pairs)), (pairs[:, 0], pairs[:, 1])), shape=(n, n))
    group = connected_components(links, directed=False)[1]
    least = np.full(group.max() + 1, np.iinfo(np.int64).max)
    np.minimum.at(least, group, number)
    return np.asarray(least[group])


def _coinciding(stage: Stage) -> Int[np.ndarray, "p 2"]:
    """Pairs of tracks whose boxes coincide."""
    everybody = np.flatnonzero(stage.used)
    a, b = meetings(stage, everybody, everybody, reach_m=_SAME_PLACE_M)
    kind, of = stage.tracks.class_name, stage.track_of_row
    keep = (of[a] < of[b]) & (kind[a] == kind[b])
    a, b = a[keep], b[keep]
    if len(a) == 0:
        return np.zeros((0, 2), np.int64)
    same = iou(stage.tracks.box_xyxy[a], stage.tracks.box_xyxy[b]) >= _SAME_BOX
    first = runs(of[a], of[b])
    share = np.add.reduceat(same.astype(float), first) / np.diff(np.append(first, len(a)))
    hit = first[share >= _SAME_SHARE]
    return np.column_stack([of[a[hit]], of[b[hit]]])


def _resumed(stage: Stage) -> Int[np.ndarray, "p 2"]:
    """Pairs of tracks of which the second begins where and when the first ended."""
    end, begin = stage.last_row, stage.first_row
    tracks = stage.tracks
    order = np.argsort(tracks.time_s[begin], kind="stable")
    starts = tracks.time_s[begin][order]
    low = np.searchsorted(starts, tracks.time_s[end], side="right")
    high = np.searchsorted(starts, tracks.time_s[end] + _RESUMED_S, side="right")
    first, position = expand(low, high - low)
    second = order[position]
    same = tracks.class_name[end[first]] == tracks.class_name[begin[second]]
    near = iou(tracks.box_xyxy[end[first]], tracks.box_xyxy[begin[second]]) >= _SAME_BOX
    keep = same & near & (first != second)
    return np.column_stack([first[keep], second[keep]])
