"""Looks only where something can have changed: what stands still was seen already.

A region (the whole picture, or a tile) is looked at again when its picture differs from the one
that was looked at last, or after some time. Everything follows from the pictures since the last
:meth:`Attention.begin`, so a run that resumes there sees the same as one that never stopped.
"""

from collections import deque
from collections.abc import Callable

import numpy as np
import supervision as sv
from jaxtyping import Bool, Float

from scene4d.perception._changes import GreyCopy, areas, changed
from scene4d.perception._duplicates import one_per_vehicle
from scene4d.perception._postures import Postures
from scene4d.perception.detectors._base import Detector
from scene4d.perception.detectors.tiles import Boxes, TiledDetector

_PEOPLE_S = 1.0
"""Seconds after which a region without change is looked at again for people."""
_VEHICLES_S = 2.0
"""The same for vehicles. Both are chosen by hand: nothing that comes goes unseen by the cells."""
_LOOKS = 3
"""Looks that decide whether a vehicle stands where nothing changes: what is seen in fewer than half
of them is no vehicle but a doubtful score."""
_AFTER_CHANGE = 2
"""Looks at what has changed: with one, whatever the detector takes it for would stay."""
_VEHICLE_WIDTH, _VEHICLE_HEIGHT = 0.7, 0.5
"""Smallest change that can be a vehicle, in heights of a person there: a bicycle is 1.0 by 0.6, a
car 1.0 by 0.9 when seen from the front. Changes are coarse; chosen by hand on PETS 2009, where
changes beside the boxes of people are mostly smaller."""
_TOUCHED, _COVERED = 0.05, 0.15
"""Shares of a vehicle's box that must change for it to be looked at, and for earlier looks to be
forgotten: it may have moved, or gone. Chosen by hand; one that drives is where it was seen last to
a twentieth of its length."""
_SAME_IOU = 0.5
_BESIDE_IOU = 0.3
"""Boxes of a vehicle that stands overlap by more; those of two things by less than the second."""
_MARGIN = 0.15
"""A person's box is enlarged by this share of its height: shadow, bags, and a detector's errors."""
_TWO_WHEELS = ("bicycle", "motorcycle")

_Matters = Callable[[Bool[np.ndarray, "h w"], tuple[slice, slice]], bool]
"""Whether a change within the given rows and columns of the grey copy calls for a look."""


class _Region:
    """A part of the picture, and what was seen when it was last looked at."""

    def __init__(self, box: np.ndarray, cells: tuple[slice, slice], looks: int) -> None:
        self.box, self.cells = box, cells
        self.looks = looks
        """Looks that are still to come, whatever happens."""
        self.grey: np.ndarray | None = None
        self.ignored: np.ndarray | None = None
        self.time_s = -np.inf
        self.found: Boxes | None = None


class _Gaze:
    """Looks with one detector: at first and after a change several times, else now and then."""

    def __init__(self, detector: Detector, every_s: float, first: int, after_change: int) -> None:
        self._detector = detector
        self._every_s = every_s
        self._first, self._after_change = first, after_change
        self._regions: list[_Region] = []
        self.found = sv.Detections.empty()
        """What was seen in all regions, in each when it was last looked at."""

    def look(
        self,
        image: np.ndarray,
        copy: GreyCopy,
        time_s: float,
        ignored: Bool[np.ndarray, "h w"],
        matters: _Matters,
    ) -> bool:
        """Look where needed; whether anything was looked at. Changes in ``ignored`` cells, now or
        at the last look, do not count.
        """
        if not self._regions:
            size = (image.shape[1], image.shape[0])
            boxes = np.array([[0, 0, *size]])
            if isinstance(self._detector, TiledDetector):
                boxes = self._detector.regions(size)
            self._regions = [_Region(box, copy.cells(box), self._first) for box in boxes]
        stale = [r for r in self._regions if self._is_stale(r, copy, time_s, ignored, matters)]
        for region in stale:
            region.grey, region.ignored = copy.grey[region.cells], ignored[region.cells]
            region.time_s, region.looks = time_s, max(0, region.looks - 1)
            if isinstance(self._detector, TiledDetector):
                region.found = self._detector.look_at(image, region.box)
            else:
                self.found = self._detector.detect(image)
        if stale and isinstance(self._detector, TiledDetector):
            self.found = self._detector.joined([r.found for r in self._regions if r.found])
        return bool(stale)

    def _is_stale(
        self,
        region: _Region,
        copy: GreyCopy,
        time_s: float,
        ignored: np.ndarray,
        matters: _Matters,
    ) -> bool:
        if region.grey is None:
            return True
        mask = changed(copy.grey[region.cells], region.grey)
        mask &= ~(ignored[region.cells] | region.ignored)
        if mask.any() and matters(mask, region.cells):
            region.looks = max(region.looks, self._after_change)
        late = not time_s - region.time_s < self._every_s
        return late or region.looks > 0


class Attention:
    """Where to look in successive frames of a still camera; one object per footage.

    ``vehicles`` None: the detector of people finds vehicles too.
    """

    def __init__(self, people: Detector, vehicles: Detector | None) -> None:
        self._people_detector, self._vehicle_detector = people, vehicles
        self.begin()

    def begin(self) -> None:
        """Forget what was seen."""
        self.looked = False
        self.postures = Postures()
        self._people = _Gaze(self._people_detector, _PEOPLE_S, 1, 1)
        also = self._vehicle_detector
        self._vehicles = None if also is None else _Vehicles(also)

    def people(self, image: np.ndarray, time_s: float) -> sv.Detections:
        """What the detector of people finds; ``looked`` says whether it looked at anything."""
        self._copy, self._time_s = GreyCopy(image), time_s
        nothing = np.zeros(self._copy.grey.shape, bool)
        self.looked = self._people.look(
            image, self._copy, time_s, nothing, lambda mask, cells: True
        )
        return self._people.found

    def vehicles(
        self, image: np.ndarray, person_box_xyxy: Float[np.ndarray, "n 4"]
    ) -> sv.Detections:
        """The vehicles in the image last given to :meth:`people`, one row each."""
        assert self._vehicles is not None
        return self._vehicles.look(image, self._copy, self._time_s, person_box_xyxy)


class _Vehicles:
    """Vehicles in successive frames; those that stand are taken from the last few looks."""

    def __init__(self, detector: Detector) -> None:
        self._detector = detector
        self._gaze = _Gaze(detector, _VEHICLES_S, _LOOKS, _AFTER_CHANGE)
        self._looks: deque[tuple[sv.Detections, np.ndarray]] = deque(maxlen=_LOOKS)
        self._standing = sv.Detections.empty()
        self._person_px: np.ndarray | None = None

    def look(
        self, image: np.ndarray, copy: GreyCopy, time_s: float, person_box: np.ndarray
    ) -> sv.Detections:
        """The vehicles in one frame."""
        moved = np.zeros(copy.grey.shape, bool)

        def matters(mask: np.ndarray, cells: tuple[slice, slice]) -> bool:
            whole = np.zeros(copy.grey.shape, bool)
            whole[cells] = mask
            moved[cells] |= mask
            return self._is_vehicle(whole, copy, image.shape) or any(
                _share(whole, copy, box) >= _TOUCHED for box in self._standing.xyxy
            )

        ignored = _ignored(copy, person_box, self._standing)
        if not self._gaze.look(image, copy, time_s, ignored, matters):
            return self._standing
        found = one_per_vehicle(self._gaze.found)
        self._looks.append((found, moved))
        self._standing = self._that_stand(copy)
        if not len(found) or not len(self._standing):
            return found if len(found) else self._standing
        alone = sv.box_iou_batch(self._standing.xyxy, found.xyxy).max(axis=1) < _BESIDE_IOU
        return sv.Detections.merge([found, self._standing[alone]]) if alone.any() else found

    def _is_vehicle(self, mask: np.ndarray, copy: GreyCopy, shape: tuple[int, ...]) -> bool:
        """Whether an area of change is as large as a vehicle there."""
        if self._person_px is None:
            self._person_px = _person_heights(self._detector, shape)
        for top, width, height in areas(mask):
            foot = min(round((top + height) / copy.scale[1]), shape[0] - 1)
            person = self._person_px[foot] * copy.scale[1]
            if width >= _VEHICLE_WIDTH * person and height >= _VEHICLE_HEIGHT * person:
                return True
        return False

    def _that_stand(self, copy: GreyCopy) -> sv.Detections:
        """Vehicles seen in at least half of the last looks at what has not changed since."""
        chosen: list[sv.Detections] = []
        for found, _ in reversed(self._looks):
            for row in range(len(found)):
                one = found[[row]]
                assert isinstance(one, sv.Detections)
                known = any(_iou(one, other) >= _BESIDE_IOU for other in chosen)
                if not known and self._stands(one, copy):
                    chosen.append(one)
        return sv.Detections.merge(chosen) if chosen else sv.Detections.empty()

    def _stands(self, one: sv.Detections, copy: GreyCopy) -> bool:
        looks = seen = 0
        for found, moved in reversed(self._looks):
            looks += 1
            overlap = sv.box_iou_batch(one.xyxy, found.xyxy) if len(found) else np.zeros((1, 1))
            seen += bool(overlap.max() >= _SAME_IOU)
            if _share(moved, copy, one.xyxy[0]) >= _COVERED:
                break
        return 2 * seen >= looks


def _person_heights(detector: Detector, shape: tuple[int, ...]) -> Float[np.ndarray, "h"]:
    """Height of a person with feet at each image row; the least that can be seen where unknown."""
    rows = np.arange(shape[0], dtype=float)
    if not isinstance(detector, TiledDetector):
        return np.zeros(shape[0])
    sight, expected = detector.sight, detector.expected_person_px
    least = np.full(shape[0], sight.hopeless_px * max(shape[:2]) / sight.input_px)
    if expected is None:
        return least
    given = np.asarray(expected(rows) if callable(expected) else expected, float)
    return np.fmax(least, given)


def _iou(one: sv.Detections, other: sv.Detections) -> float:
    return float(sv.box_iou_batch(one.xyxy, other.xyxy)[0, 0])


def _share(mask: np.ndarray, copy: GreyCopy, box_xyxy: np.ndarray) -> float:
    """Share of a box that a mask covers."""
    return float(mask[copy.cells(box_xyxy)].mean())


def _ignored(
    copy: GreyCopy, person_box: np.ndarray, vehicles: sv.Detections
) -> Bool[np.ndarray, "h w"]:
    """Cells in which people are the change, but for those who ride something."""
    mask = np.zeros(copy.grey.shape, bool)
    kinds = vehicles.data.get("class_name", [])
    ridden = vehicles.xyxy[np.isin(kinds, _TWO_WHEELS)] if len(vehicles) else np.empty((0, 4))
    for box in person_box:
        if len(ridden) and sv.box_iou_batch(box[None], ridden).max() > 0:
            continue
        margin = _MARGIN * (box[3] - box[1])
        mask[copy.cells(box + margin * np.array([-1, -1, 1, 1]))] = True
    return mask
