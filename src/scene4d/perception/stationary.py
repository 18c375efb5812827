"""Finds "people" that never move: mannequins, posters, reflections.

Detectors report them like people, always in the same place, and a camera calibrated on them is
biased towards their size. Time separates them: nobody stands still to within a few percent of
their height for most of a long clip.
"""

import numpy as np
from jaxtyping import Bool, Float
from scipy.spatial import cKDTree

from scene4d.core.boxes import iou
from scene4d.core.people import Detections

# Chosen by hand on the tuning cameras (TownCentre has mannequins, PETS has none).
_MIN_DURATION_S = 45.0
"""People in conversation stand in one place for half a minute."""
_MIN_FRAMES = 10
"""Fewer frames with detections are too few to compute a share."""
_CLIP_SHARE = 0.6
"""Share of the clip between the first and the last detection."""
_SEEN_SHARE = 0.5
"""Share of the frames between them with a detection: separates one object that stays from many
people passing the same spot."""
_MIN_IOU = 0.7
"""Boxes with at least this IoU are at the same place."""
_STILL = 0.025
"""Median shift of a detection from the median box, in heights. A standing person sways and turns
by more; a detector's jitter on a still figure is about 0.01."""


def stationary(detections: Detections) -> Bool[np.ndarray, "n"]:
    """Which detections (n,) show something that stays in place through most of the clip.

    All False for a clip shorter than 45 s, with fewer than 10 frames with detections, or without
    times, since it cannot be decided.
    """
    nothing = np.zeros(len(detections), bool)
    time, frame = detections.time_s, detections.frame
    if not len(time) or not np.isfinite(time).all() or len(np.unique(frame)) < _MIN_FRAMES:
        return nothing
    duration = float(time.max() - time.min())
    if duration < _MIN_DURATION_S:
        return nothing
    needed_s = max(_MIN_DURATION_S, _CLIP_SHARE * duration)
    frames = np.unique(frame)
    out = nothing
    for members in _same_place(detections.box_xyxy):
        if time[members].max() - time[members].min() < needed_s:
            continue
        seen = np.unique(frame[members])
        between = np.searchsorted(frames, seen[-1]) - np.searchsorted(frames, seen[0]) + 1
        if len(seen) >= _SEEN_SHARE * between and _is_still(detections.box_xyxy[members]):
            out[members] = True
    return out


def _same_place(box_xyxy: Float[np.ndarray, "n 4"]) -> list[np.ndarray]:
    """For every box, the rows of those with an IoU of at least 0.7, including itself."""
    # With an IoU of s, no edge is further off than (1 - s) / s of a box's longer side.
    side = np.maximum(box_xyxy[:, 2] - box_xyxy[:, 0], box_xyxy[:, 3] - box_xyxy[:, 1])
    radius = side * (1 - _MIN_IOU) / _MIN_IOU
    near = cKDTree(box_xyxy).query_ball_point(box_xyxy, radius, p=np.inf)
    return [
        np.array(rows)[iou(box, box_xyxy[rows]) >= _MIN_IOU]
        for box, rows in zip(box_xyxy, near, strict=True)
    ]


def _is_still(box_xyxy: np.ndarray) -> bool:
    height = np.median(box_xyxy[:, 3] - box_xyxy[:, 1])
    shift = np.abs(box_xyxy - np.median(box_xyxy, axis=0)).max(axis=1)
    return bool(np.median(shift) <= _STILL * height)
