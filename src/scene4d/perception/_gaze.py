"""Looks with one detector: at regions now and then, closer at what moves, got lost or is new."""

import itertools
from collections.abc import Callable
from dataclasses import replace

import numpy as np
import supervision as sv
from jaxtyping import Bool, Float, Int

from scene4d.perception._canvas import Canvas, merged
from scene4d.perception._changes import areas
from scene4d.perception._duplicates import boxes_of
from scene4d.perception._known import TWICE_IOU, Known
from scene4d.perception._scene import EARLY_S, MOVED_S, Region, Scene
from scene4d.perception.detectors._base import Detector
from scene4d.perception.detectors.tiles import Boxes, TiledDetector, cut_by_tile

_TOUCHED = 0.05
"""Share of a box that must have changed for what is in it to have moved: one that drives is where
it was seen last to a twentieth of its length."""
_TRAVELLED = 0.02
"""The same of the way that a rigid thing came, in longer sides: the error of the optical flow is
less. Both are chosen by hand."""
_CROSSING_IOU = 0.1
"""What overlaps something else by more is looked at in every picture: following takes one for the
other. On the first half of PETS 2009 at 10 Hz that is a tenth more looks, and IDF1 rises from 89.7
to 92.1 (with every network on every frame: 92.0); with 0.0 it takes half as many looks again."""
_TRUST = 0.5
"""Weight of the box that a look expected, against the one that it found: a detector's boxes jitter
by 0.02 of their height, and what was followed here is a mean of earlier ones. On PETS 2009, HOTA is
67.7 with 0.5, 67.3 with 0.3 and 66.4 without."""
_ACROSS, _ALONG = 0.3, 0.2
"""Margins of a closer look, in heights of the box: with more of the ground around people YOLOX-tiny
found no more of them (98 % of 235 on PETS 2009)."""
_CLOSE_PX = 48.0
"""Height at which a closer look shows somebody in the network's input: more than twice that from
which recall is whole; chosen by hand."""
_KNOWN_SHARE = 0.75
"""Share of a detector's threshold from which it is believed where somebody is known to be: scores
in parts of a picture were lower by 0.06 in the median, by 0.16 for one in ten."""
_STAYS_IOU = 0.4
"""A look finds what is known if a box overlaps it by more; chosen by hand."""

Matters = Callable[[Bool[np.ndarray, "h w"]], Float[np.ndarray, "n 4"]]
"""Boxes, in pixels of the picture, of the changes that call for a look, among changed cells."""


class Gaze:
    """What one detector knows of the picture.

    Regions are looked at ``first`` times at first, ``after_change`` times after a change, and every
    ``every_s`` seconds. ``rigid`` things stand if their motion is followed to be none. ``kinds``
    names what matters (None: all).
    """

    def __init__(
        self,
        detector: Detector,
        every_s: float,
        *,
        first: int = 1,
        after_change: int = 1,
        rigid: bool = False,
        kinds: tuple[str, ...] | None = None,
    ) -> None:
        self._detector, self._every_s, self._rigid = detector, every_s, rigid
        self._kinds = kinds
        self._first, self._after_change = first, after_change
        self._regions: list[Region] = []
        self._names: list[str] = []
        if isinstance(detector, TiledDetector):
            self._names = list(detector.class_names)
        self._canvases: tuple[tuple[int, int], ...] = ()
        self._person_px = np.empty(0)
        self._count = itertools.count()
        self._all = Known.nothing()  # of all regions: several may show one thing
        self._held = np.empty(0, bool)
        self._now_s = np.nan
        self.known = Known.nothing()
        """What was seen, each thing once."""
        self.moved = np.empty((0, 0), bool)
        """Cells that had changed before the last looks, but for those that others explain."""

    @property
    def found(self) -> sv.Detections:
        """What is known, best first."""
        return self.known.detections(tuple(self._names))

    def look(self, scene: Scene, others: Bool[np.ndarray, "h w"], matters: Matters) -> bool:
        """Look where needed; whether a region was looked at. Changes in cells that ``others``, or
        what is known here, explain now or explained at the last look are not new.
        """
        if not self._regions:
            self._begin(scene)
        regions, self._now_s = self._regions, scene.time_s
        masks = [region.changed(scene) for region in regions]
        self.moved = np.any(masks, axis=0) & ~others
        due = self._follow(scene, self.moved)
        new, shows = self._new_changes(scene, masks, others, matters)
        stale = np.array([r.is_stale(scene.time_s, self._every_s) for r in regions])
        due &= ~stale[self.known.origin]
        shows &= ~stale
        if due.any() or shows.any():
            stale[self._look_closer(scene, due, new, shows, others)] = True
        for number in np.flatnonzero(stale):
            self._look_at(scene, int(number))
        self.known, _ = self._all.once()
        explained = others | scene.cells_of(self.known.xyxy)
        for number in np.flatnonzero(stale):
            regions[number].remember(scene, explained)
        return bool(stale.any())

    def _follow(self, scene: Scene, moved: np.ndarray) -> Bool[np.ndarray, "n"]:
        """Move what is known along with the picture where it moved; which of it calls for a look:
        what was not looked at for long, got lost, or was seen but once.
        """
        touched = scene.share(moved, self._all.xyxy) >= _TOUCHED
        shift, held = np.zeros((len(touched), 2)), ~touched
        shift[touched], held[touched] = scene.motion.within(self._all.xyxy[touched])
        self._all = replace(self._all, xyxy=self._all.xyxy + np.tile(shift, 2))
        self.known, rows = self._all.once()
        self._held = held[rows]
        late = scene.time_s - self.known.looked_s >= MOVED_S - EARLY_S
        if not self._rigid:
            late |= self.known.crossing(_CROSSING_IOU)
        else:
            late &= self.known.travelled >= _TRAVELLED
        due: np.ndarray = (touched[rows] & (late | ~self._held)) | ~self.known.sure
        return due

    def large(self, scene: Scene, width: float, height: float) -> Matters:
        """Changes as large as given, in heights of a person whose feet are there."""
        if not len(self._person_px):
            self._person_px = self._person_heights(scene.size)

        def boxes(mask: np.ndarray) -> np.ndarray:
            box = areas(mask) / scene.copy.scale
            foot = np.clip(np.round(box[:, 3]), 0, scene.size[1] - 1).astype(int)
            side = (box[:, 2:] - box[:, :2]) / self._person_px[foot, None]
            return box[(side[:, 0] >= width) & (side[:, 1] >= height)]

        return boxes

    def _person_heights(self, size: tuple[int, int]) -> np.ndarray:
        """Height of a person with feet at each image row; the least to be seen where unknown."""
        if not isinstance(self._detector, TiledDetector):
            return np.zeros(size[1])
        sight = self._detector.sight
        least = sight.hopeless_px * max(size) / sight.input_px
        return np.fmax(least, self._detector.person_px(size[1]))

    def _begin(self, scene: Scene) -> None:
        boxes = np.array([[0, 0, *scene.size]])
        if isinstance(self._detector, TiledDetector):
            boxes = self._detector.regions(scene.size)
            room = (len(boxes) - 1) * self._detector.sight.input_px**2
            self._canvases = tuple(c for c in self._detector.canvases if 2 * c[0] * c[1] < room)
        self._regions = [Region(b, scene.copy.cells(b), self._first) for b in boxes]

    def _new_changes(
        self, scene: Scene, masks: list[np.ndarray], others: np.ndarray, matters: Matters
    ) -> tuple[Float[np.ndarray, "n 4"], Bool[np.ndarray, "n regions"]]:
        """Boxes of what nothing known explains, and which regions show it."""
        explained = others | scene.cells_of(self.known.xyxy)
        for mask, region in zip(masks, self._regions, strict=True):
            mask &= ~explained
            if region.explained is not None:
                mask[region.cells] &= ~region.explained
        new = matters(np.asarray(np.any(masks, axis=0)))
        shows = np.array([scene.share(mask, new) > 0 for mask in masks]).reshape(len(masks), -1).T
        if not self._canvases:
            for number in np.flatnonzero(shows.any(axis=0)):
                region = self._regions[number]
                region.looks = max(region.looks, self._after_change)
        return new, shows

    def _look_at(self, scene: Scene, number: int) -> None:
        """Look at a region: what it showed before is replaced by what it shows now."""
        region = self._regions[number]
        region.looks, region.time_s = max(0, region.looks - 1), scene.time_s
        found = self._seen(scene, region)
        if self._kinds is not None:
            found = found.select(np.isin([self._names[k] for k in found.label], self._kinds))
        new = self._new(found, np.full(len(found.label), number))
        if region.grey is None:
            new.sure[:] = True  # there is nothing to compare it with
        self._all = Known.joined([self._all.select(self._all.origin != number), new])

    def _seen(self, scene: Scene, region: Region) -> Boxes:
        if isinstance(self._detector, TiledDetector):
            return self._detector.look_at(scene.image, region.box)
        found = self._detector.detect(scene.image)
        names = found.data.get("class_name", ["person"] * len(found))
        self._names += sorted(set(map(str, names)) - set(self._names))
        label = np.array([self._names.index(str(name)) for name in names], np.int64)
        return Boxes(*boxes_of(found), label)

    def _new(self, found: Boxes, origin: np.ndarray) -> Known:
        """What was found now; known things keep their numbers, and the box of one
        that is not rigid is the mean of where it was followed to and of where it is seen.
        """
        n = len(found.label)
        number = np.array([next(self._count) for _ in range(n)], np.int64)
        rows, at = self.known.same(found.xyxy, found.label)
        number[at] = self.known.number[rows]
        box, held = found.xyxy.copy(), self._held[rows] & (not self._rigid)
        expected = self.known.xyxy[rows[held]]
        box[at[held]] += _TRUST * (expected - box[at[held]])
        sure = np.zeros(n, bool)
        if n and len(self.known):
            sure = sv.box_iou_batch(found.xyxy, self.known.xyxy).max(axis=1) >= _STAYS_IOU
        looked = np.full(n, self._now_s)
        return Known(box, found.score, found.label, origin, looked, box, number, sure)

    def _look_closer(
        self, scene: Scene, due: np.ndarray, new: np.ndarray, shows: np.ndarray, others: np.ndarray
    ) -> Int[np.ndarray, "k"]:
        """Look at known things and at what is new; regions that must be looked at instead."""
        origin = np.concatenate([self.known.origin[due], np.flatnonzero(shows.any(axis=0))])
        new, canvas = new[shows.any(axis=1)], None
        if self._canvases:
            canvas = self._canvas(scene, self.known.xyxy[due], new)
        if canvas is None:
            urgent = self.known.origin[due if not self._canvases else due & ~self._held]
            return np.union1d(urgent, self._rested(origin, scene.time_s))
        assert isinstance(self._detector, TiledDetector)
        least = _KNOWN_SHARE * self._detector.whole_threshold
        found, part = canvas.read(self._detector.infer_canvas(canvas.drawn(scene.image), least))
        cut = np.array(
            [cut_by_tile(b[None], canvas.part_xyxy[p], scene.size)[0]
             for b, p in zip(found.xyxy, part, strict=True)], bool
        )  # fmt: skip
        return self._take(scene, np.flatnonzero(due), found.select(~cut), canvas, others)

    def _take(
        self, scene: Scene, due: np.ndarray, found: Boxes, canvas: Canvas, others: np.ndarray
    ) -> Int[np.ndarray, "k"]:
        """What closer looks found takes the place of what was known there; the regions of what they
        did not find.
        """
        known = self.known
        overlap = np.zeros((len(due), len(found.label)))
        if overlap.size:
            overlap = sv.box_iou_batch(known.xyxy[due], found.xyxy)
            overlap *= known.label[due][:, None] == found.label
        again = overlap.max(axis=0, initial=0.0) >= _STAYS_IOU
        assert isinstance(self._detector, TiledDetector)
        kept = again | (found.score >= self._detector.tile_threshold)
        missed = due[overlap.max(axis=1, initial=0.0) < _STAYS_IOU]
        origin = self._home(found.xyxy, scene.size)
        if overlap.size:
            origin = np.where(again, known.origin[due][overlap.argmax(axis=0)], origin)
        fresh = self._new(found.select(kept), origin[kept])
        gone = np.zeros(len(self._all), bool)
        for boxes in (fresh.xyxy, known.xyxy[due]):
            if len(boxes) and len(gone):
                gone |= (sv.box_iou_batch(self._all.xyxy, boxes) > TWICE_IOU).any(axis=1)
        self._all = Known.joined([self._all.select(~gone), fresh])
        seen = np.zeros(others.shape, bool)
        for box in canvas.part_xyxy:
            seen[scene.copy.cells(box)] = True
        explained = others | scene.cells_of(self._all.xyxy)
        for region in self._regions:
            region.remember(scene, explained, seen)
        return self._rested(known.origin[missed], scene.time_s)

    def _rested(self, numbers: np.ndarray, time_s: float) -> Int[np.ndarray, "k"]:
        """Those of some regions that were not looked at just now."""
        rested: np.ndarray = np.array([r.rested(time_s) for r in self._regions])
        return np.unique(numbers[rested[numbers]])

    def _home(self, box_xyxy: np.ndarray, size: tuple[int, int]) -> Int[np.ndarray, "n"]:
        """Regions that show these boxes: the whole picture, or the last tile that holds one too
        small for it.
        """
        assert isinstance(self._detector, TiledDetector)
        sight = self._detector.sight
        home = np.zeros(len(box_xyxy), np.int64)
        small = (box_xyxy[:, 3] - box_xyxy[:, 1]) * sight.input_px < sight.small_px * max(size)
        for number, region in enumerate(self._regions):
            inside = (box_xyxy[:, :2] >= region.box[:2] - 1) & (box_xyxy[:, 2:] <= region.box[2:])
            home[small & inside.all(axis=1)] = number
        return home

    def _canvas(self, scene: Scene, known: np.ndarray, new: np.ndarray) -> Canvas | None:
        """Room for closer looks at known things (n, 4) and at changes (m, 4), if there is any."""
        assert isinstance(self._detector, TiledDetector)
        person = self._person_px[np.clip(new[:, 3].astype(int), 0, scene.size[1] - 1)]
        half = np.column_stack([0.2 * person, 0.5 * person])
        middle = (new[:, :2] + new[:, 2:]) / 2
        new = np.hstack(
            [np.minimum(new[:, :2], middle - half), np.maximum(new[:, 2:], middle + half)]
        )
        box = np.concatenate([known, new])
        height = box[:, 3] - box[:, 1]
        side = np.array([(r.box[2:] - r.box[:2]).max() for r in self._regions])
        least, most = self._detector.sight.input_px / np.array([side.max(), side.min()])
        scale = np.clip(_CLOSE_PX / np.maximum(height, 1.0), least, most)
        part = box + height[:, None] * np.array([-_ACROSS, -_ALONG, _ACROSS, _ALONG])
        part[:, :2], part[:, 2:] = np.floor(part[:, :2]), np.ceil(part[:, 2:])
        part = np.clip(part, 0, np.tile(scene.size, 2)).astype(np.int64)
        inside = (part[:, 2:] > part[:, :2]).all(axis=1)
        return Canvas.smallest(self._canvases, *merged(part[inside], scale[inside]))
