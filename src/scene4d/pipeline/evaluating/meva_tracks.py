"""MEVA's annotated boxes as tracks of objects.

MEVA exports the boxes of each labelled activity under track numbers of their own: whoever does two
things has two tracks, with the same boxes where both things happen at once, and every track begins
and ends with one label. So before anything is followed, tracks with the same boxes become one, and
one that ends where another begins goes on as that. Only boxes are compared, never labels.
"""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float, Int
from scipy.sparse import coo_array
from scipy.sparse.csgraph import connected_components

from scene4d.model import Calibration, Detections, Tracks
from scene4d.pipeline.tracking.following import Follower, Look
from scene4d.pipeline.tracking.options import TrackOptions, TrackRun
from scene4d.pipeline.tracking.placing import known_classes

SAME_IOU = 0.9
"""Median overlap of boxes that are the same. On the cameras that were tuned on, pairs of tracks lie
above it (identical boxes) or below 0.8 (other objects), and hardly any between."""
NEXT_IOU, NEXT_S = 0.5, 1.0
"""How well the first box of a track must lie on the last one of another, and how soon after it."""
FRAMES_PER_LOOK = 300


def followed(
    annotated: Detections, calibration: Calibration, options: TrackOptions, fps: float
) -> Tracks:
    """What ``scene4d track --annotations`` writes into a scene, for tracks of one object each.

    Rows are ordered by (track, time). Frames are looked at as often as ``options`` says, from 0 on.
    """
    found, _ = known_classes(annotated)
    every = max(1, round(fps / options.rate_hz))
    found = one_track_per_object(found.select(found.frame % every == 0), NEXT_S * fps)
    run = TrackRun(Path(), str(options.name), str(options.annotations))
    follower = Follower(calibration, options.height_m(calibration), run)
    frames = np.arange(0, int(found.frame.max(initial=-1)) + 1, every)
    parts = []
    for begin in range(0, len(frames), FRAMES_PER_LOOK):
        some = frames[begin : begin + FRAMES_PER_LOOK]
        rows = np.arange(*np.searchsorted(found.frame, [some[0], some[-1] + 1]))
        parts += list(follower.follow(Look(some, some / fps, found.select(rows))))
    tracks = Tracks.concatenate([*parts, follower.finish()])
    return tracks.select(np.lexsort([tracks.time_s, tracks.track]))


def one_track_per_object(found: Detections, longest_gap: float) -> Detections:
    """The boxes with one track per object, ordered by frame; see the module.

    ``longest_gap`` is the most frames from the end of a track to the beginning of the next. Where
    several tracks of one object have a box in a frame, their mean stays. The number of an object is
    the lowest of its tracks'.
    """
    if not len(found):
        return found
    found = found.select(np.lexsort([found.track, found.frame]))
    found = _merged(found, _groups(found, _twins(found)))
    found = _merged(found, _groups(found, _successors(found, longest_gap)))
    return found.select(np.lexsort([found.track, found.frame]))


def _twins(found: Detections) -> Int[np.ndarray, "p 2"]:
    """Pairs of tracks of one class whose boxes are the same in the frames that both have."""
    pairs: dict[tuple[int, int], list[float]] = {}
    starts = np.flatnonzero(np.diff(found.frame, prepend=-1))
    for rows in np.split(np.arange(len(found)), starts[1:]):
        shared = np.triu(_iou(found.box_xyxy[rows], found.box_xyxy[rows]), 1)
        shared[found.class_name[rows][:, None] != found.class_name[rows][None]] = 0.0
        for i, j in np.argwhere(shared > 0):
            key = (int(found.track[rows[i]]), int(found.track[rows[j]]))
            pairs.setdefault(key, []).append(float(shared[i, j]))
    same = [pair for pair, ious in pairs.items() if np.median(ious) >= SAME_IOU]
    return np.array(same, np.int64).reshape(-1, 2)


def _successors(found: Detections, longest_gap: float) -> Int[np.ndarray, "p 2"]:
    """Pairs (one, next) of tracks where the first one's end is the second one's beginning; each
    track has at most one before and one behind it, the best ones.
    """
    order = np.lexsort([found.frame, found.track])
    first = np.flatnonzero(np.diff(found.track[order], prepend=found.track[order][0] - 1))
    begin, end = order[first], order[np.append(first[1:], len(order)) - 1]
    gap = found.frame[begin][None] - found.frame[end][:, None]
    fit = _iou(found.box_xyxy[end], found.box_xyxy[begin])
    fit[(gap <= 0) | (gap > longest_gap)] = 0.0
    fit[found.class_name[end][:, None] != found.class_name[begin][None]] = 0.0
    pairs = []
    free_end, free_begin = np.ones(len(end), bool), np.ones(len(begin), bool)
    for i, j in sorted(np.argwhere(fit >= NEXT_IOU).tolist(), key=lambda ij: -fit[ij[0], ij[1]]):
        if free_end[i] and free_begin[j]:
            free_end[i] = free_begin[j] = False
            pairs.append((found.track[end[i]], found.track[begin[j]]))
    return np.array(pairs, np.int64).reshape(-1, 2)


def _groups(found: Detections, pairs: Int[np.ndarray, "p 2"]) -> Int[np.ndarray, "n"]:
    """Track of each row when the pairs are one: the lowest number of each connected group."""
    numbers = np.unique(found.track)
    ends = np.searchsorted(numbers, pairs)
    links = coo_array((np.ones(len(pairs)), (ends[:, 0], ends[:, 1])), shape=(len(numbers),) * 2)
    _, group = connected_components(links, directed=False)
    lowest = np.full(group.max() + 1, np.iinfo(np.int64).max)
    np.minimum.at(lowest, group, numbers)
    new: np.ndarray = lowest[group][np.searchsorted(numbers, found.track)]
    return new


def _merged(found: Detections, track: Int[np.ndarray, "n"]) -> Detections:
    """The rows with other tracks, one per track and frame: the mean of the boxes."""
    order = np.lexsort([track, found.frame])
    found, track = found.select(order), track[order]
    fresh = np.append(True, (np.diff(found.frame) != 0) | (np.diff(track) != 0))
    place = np.cumsum(fresh) - 1
    total = np.zeros((int(place[-1]) + 1, 4))
    np.add.at(total, place, found.box_xyxy)
    rows = np.flatnonzero(fresh)
    return replace(
        found.select(rows), track=track[rows], box_xyxy=total / np.bincount(place)[:, None]
    )


def _iou(a: Float[np.ndarray, "n 4"], b: Float[np.ndarray, "m 4"]) -> Float[np.ndarray, "n m"]:
    """Intersection over union of boxes."""
    low = np.maximum(a[:, None, :2], b[None, :, :2])
    high = np.minimum(a[:, None, 2:], b[None, :, 2:])
    shared = np.clip(high - low, 0, None).prod(axis=2)
    area_a, area_b = ((box[:, 2:] - box[:, :2]).prod(axis=1) for box in (a, b))
    return np.asarray(shared / (area_a[:, None] + area_b[None] - shared))
