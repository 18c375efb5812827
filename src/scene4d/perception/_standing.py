"""Vehicles in successive frames; those that stand are taken from the last few looks."""

from collections import deque

import numpy as np
import supervision as sv
from jaxtyping import Float

from scene4d.core.tracks import VEHICLES
from scene4d.perception._duplicates import one_per_vehicle
from scene4d.perception._gaze import Gaze
from scene4d.perception._scene import Scene
from scene4d.perception.detectors._base import Detector

_EVERY_S = 5.0
"""Seconds after which a region is looked at again even if nothing changed; chosen by hand."""
_LOOKS = 3
"""Looks that decide whether a vehicle stands where nothing changes: what is seen in fewer than half
of them is no vehicle but a doubtful score."""
_AFTER_CHANGE = 2
"""Looks at what has changed: with one, whatever the detector takes it for would stay."""
_WIDTH, _HEIGHT = 0.7, 0.5
"""Smallest change that can be a vehicle, in heights of a person there: a bicycle is 1.0 by 0.6, a
car 1.0 by 0.9 when seen from the front. Changes are coarse; chosen by hand on PETS 2009, where
changes beside the boxes of people are mostly smaller."""
_TOUCHED, _COVERED = 0.05, 0.15
"""Shares of a vehicle's box that must change for it to be looked at, and for earlier looks to be
forgotten: it may have moved, or gone. Chosen by hand."""
_SAME_IOU = 0.5
_BESIDE_IOU = 0.3
"""Boxes of a vehicle that stands overlap by more; those of two things by less than the second."""
_TWO_WHEELS = ("bicycle", "motorcycle")


class Vehicles:
    """Vehicles in successive frames; those that stand are taken from the last few looks."""

    def __init__(self, detector: Detector) -> None:
        self._gaze = Gaze(
            detector, _EVERY_S, first=_LOOKS, after_change=_AFTER_CHANGE, rigid=True, kinds=VEHICLES
        )
        self._looks: deque[tuple[sv.Detections, np.ndarray]] = deque(maxlen=_LOOKS)
        self._standing = sv.Detections.empty()

    def look(self, scene: Scene, person_box_xyxy: Float[np.ndarray, "n 4"]) -> sv.Detections:
        """The vehicles in one frame."""
        gaze, large = self._gaze, self._gaze.large(scene, _WIDTH, _HEIGHT)

        def matters(mask: np.ndarray) -> np.ndarray:
            kept = _apart(self._standing, gaze.found)
            touched = scene.share(mask, kept.xyxy) >= _TOUCHED
            return np.concatenate([large(mask), kept.xyxy[touched]])

        people = scene.cells_of(self._on_foot(person_box_xyxy))
        if gaze.look(scene, people, matters):
            self._looks.append((one_per_vehicle(gaze.found), gaze.moved))
            self._standing = self._that_stand(scene)
        found = one_per_vehicle(gaze.found)
        return sv.Detections.merge([found, _apart(self._standing, found)])

    def _on_foot(self, person_box: np.ndarray) -> np.ndarray:
        """Boxes of people who ride nothing."""
        kinds = self._standing.data.get("class_name", [])
        ridden = (
            self._standing.xyxy[np.isin(kinds, _TWO_WHEELS)] if len(kinds) else np.empty((0, 4))
        )
        if not len(ridden) or not len(person_box):
            return person_box
        on_foot: np.ndarray = person_box[sv.box_iou_batch(person_box, ridden).max(axis=1) == 0]
        return on_foot

    def _that_stand(self, scene: Scene) -> sv.Detections:
        """Vehicles seen in at least half of the last looks at what has not changed since."""
        chosen: list[sv.Detections] = []
        for found, _ in reversed(self._looks):
            for row in range(len(found)):
                one = found[[row]]
                assert isinstance(one, sv.Detections)
                known = any(len(_apart(one, other)) == 0 for other in chosen)
                if not known and self._stands(one, scene):
                    chosen.append(one)
        return sv.Detections.merge(chosen) if chosen else sv.Detections.empty()

    def _stands(self, one: sv.Detections, scene: Scene) -> bool:
        """Whether it was seen by half of the looks, and not by the last of several alone."""
        seen: list[bool] = []
        for found, moved in reversed(self._looks):
            overlap = sv.box_iou_batch(one.xyxy, found.xyxy) if len(found) else np.zeros((1, 1))
            seen.append(bool(overlap.max() >= _SAME_IOU))
            if scene.share(moved, one.xyxy)[0] >= _COVERED:
                break
        alone = seen[0] and sum(seen) == 1 < len(seen)
        return 2 * sum(seen) >= len(seen) and not alone


def _apart(vehicles: sv.Detections, others: sv.Detections) -> sv.Detections:
    """Those of the vehicles that are not among the others."""
    if not len(vehicles) or not len(others):
        return vehicles
    alone = sv.box_iou_batch(vehicles.xyxy, others.xyxy).max(axis=1) < _BESIDE_IOU
    found = vehicles[alone]
    assert isinstance(found, sv.Detections)
    return found
