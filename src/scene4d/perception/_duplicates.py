"""One box per vehicle, whatever a detector takes it for."""

import numpy as np
import supervision as sv

from scene4d.core.tracks import VEHICLES

_SAME_IOU = 0.5
"""Boxes of cars, trucks and buses (or of bicycles and motorcycles) that overlap more are merged;
the usual threshold."""
_PART_SHARE = 0.8
"""A box with this share inside a better one of its class is a part of it; chosen by hand."""

_WHEELS = {name: 2 if name in ("bicycle", "motorcycle") else 4 for name in VEHICLES}


def one_per_vehicle(found: sv.Detections) -> sv.Detections:
    """The vehicles among detections, one row each, best first.

    Of boxes of several classes that overlap by more than ``_SAME_IOU`` (a pick-up detected as car
    and truck) the best is kept. Two-wheelers are treated separately from cars, trucks and buses,
    since one can stand in front of the other. Then boxes inside a better one of their own class
    are removed as parts.
    """
    names = np.asarray(found.data.get("class_name", []), dtype=object)
    kept = np.flatnonzero([name in VEHICLES for name in names])
    if not len(kept):
        return sv.Detections.empty()
    box, score = boxes_of(found)
    kept = kept[np.argsort(-score[kept], kind="stable")]
    kind = names[kept].astype(str)
    vehicles = sv.Detections(
        xyxy=box[kept],
        confidence=score[kept],
        class_id=np.array([_WHEELS[name] for name in kind]),
        data={"class_name": kind},
    ).with_nms(_SAME_IOU)
    vehicles.class_id = np.array([VEHICLES.index(name) for name in vehicles.data["class_name"]])
    return vehicles.with_nms(_PART_SHARE, overlap_metric=sv.OverlapMetric.IOS)


def boxes_of(found: sv.Detections) -> tuple[np.ndarray, np.ndarray]:
    """Boxes (n, 4) and scores (n,), 1 where the detector gives none."""
    box = np.asarray(found.xyxy, float).reshape(-1, 4)
    score = np.ones(len(box)) if found.confidence is None else np.asarray(found.confidence, float)
    return box, score
