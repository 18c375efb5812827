"""Detects people and vehicles in one frame: detectors and keypoints combined into a table."""

from collections.abc import Iterable, Iterator
from concurrent.futures import Future, ThreadPoolExecutor
from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
import supervision as sv
from jaxtyping import Float, Float32, UInt8

from scene4d.core.people import Detections
from scene4d.core.progress import timed
from scene4d.core.tracks import CLASSES
from scene4d.perception._duplicates import boxes_of, one_per_vehicle
from scene4d.perception._scene import Scene
from scene4d.perception.attention import Attention
from scene4d.perception.colours import COLUMNS
from scene4d.perception.detectors._base import Detector
from scene4d.perception.detectors.tiles import ExpectedPersonPx, TiledDetector

_BINS = 8
_PARTS = ((0.15, 0.5), (0.55, 0.9))
"""Torso and legs, as shares of the box's height."""
_MIDDLE = (0.25, 0.75)
"""Part of the box's width that shows the body and not the ground."""
_CLOTHES_AB = (98.0, 158.0)
"""Range of a* and b* (neutral: 128) that clothes use. These four values are chosen by hand."""

_NAME = f"<U{max(map(len, CLASSES))}"


@runtime_checkable
class TimedImage(Protocol):
    """One decoded frame; ``time_s`` counts from the clip's start and is NaN where unknown."""

    @property
    def index(self) -> int:
        """Number of the frame in the footage, from 0."""
        ...

    @property
    def time_s(self) -> float:
        """Seconds from the clip's start, NaN where unknown."""
        ...

    @property
    def image_bgr(self) -> UInt8[np.ndarray, "h w 3"]:
        """The image in BGR order."""
        ...


Moment = tuple[int, float, Detections, Float32[np.ndarray, "n 48"], Float32[np.ndarray, "n 8"]]
"""Index and time of a frame, its detections, and of every row the histograms of colours, by which
it is known again, and the readings, by which the colours are named."""


@runtime_checkable
class PoseEstimator(Protocol):
    """Estimates body keypoints of people with known boxes."""

    names: tuple[str, ...]

    def estimate(
        self, image_bgr: UInt8[np.ndarray, "h w 3"], box_xyxy: Float[np.ndarray, "n 4"]
    ) -> tuple[Float[np.ndarray, "n k 2"], Float[np.ndarray, "n k"]]:
        """Points (n, k, 2) in pixels and scores (n, k) in [0, 1]."""
        ...


@dataclass
class ObjectDetector:
    """Detects people and vehicles, one row each, without tracks.

    If ``vehicles`` is None, ``people`` detects the vehicles too. People that ``vehicles`` finds are
    ignored. With an ``attention`` (see :meth:`attentive`) frames must be given in order of time.
    ``timings`` holds the seconds spent by stage.
    """

    people: Detector
    keypoints: PoseEstimator | None = None
    vehicles: Detector | None = None
    attention: Attention | None = None
    timings: dict[str, float] = field(default_factory=dict)

    @classmethod
    def default(cls, device: str = "auto") -> "ObjectDetector":
        """YOLOX-tiny, RTMPose-s and YOLOv4-tiny; downloads missing weights."""
        from scene4d.perception.detectors._yolov4 import Yolov4TinyDetector
        from scene4d.perception.detectors.yolox import YoloxDetector
        from scene4d.perception.keypoints import KeypointEstimator

        return cls(YoloxDetector(device), KeypointEstimator(device), Yolov4TinyDetector(device))

    def expecting(self, expected_person_px: ExpectedPersonPx | None) -> "ObjectDetector":
        """The same detector for a scene with known sizes of people; see TiledDetector."""

        def told(detector: Detector | None) -> Detector | None:
            if isinstance(detector, TiledDetector):
                return detector.expecting(expected_person_px)
            return detector

        people = told(self.people)
        assert people is not None
        return replace(self, people=people, vehicles=told(self.vehicles))

    def attentive(self) -> "ObjectDetector":
        """The same detector for successive frames of a still camera: looks where they change."""
        return replace(self, attention=Attention(self.people, self.vehicles))

    def begin(self) -> None:
        """Forget earlier frames: what follows depends on what follows only."""
        if self.attention is not None:
            self.attention.begin()

    def look(
        self, frame: TimedImage
    ) -> tuple[Detections, Float32[np.ndarray, "n 48"], Float32[np.ndarray, "n 8"]]:
        """Detections in a frame, and the colours of every row: see ``colour_histograms``, and
        :class:`.ColourReader`, of which there is one with an attention only (else NaN).

        People (best first), then vehicles (best first), with the names in ``CLASSES``. A rider and
        the bicycle are two rows. Keypoints of vehicles are NaN with score 0.
        """
        return self._completed(frame, *self._found(frame))

    def looks(self, frames: Iterable[TimedImage]) -> Iterator[Moment]:
        """:meth:`look` at each of some frames; while one is looked at for vehicles and keypoints,
        people are looked for in the next.
        """

        def moment(frame: TimedImage, found: sv.Detections, scene: Scene | None) -> Moment:
            return frame.index, frame.time_s, *self._completed(frame, found, scene)

        with ThreadPoolExecutor(1) as beside:
            last: Future[Moment] | None = None
            for frame in frames:
                found = self._found(frame)
                if last is not None:
                    yield last.result()
                last = beside.submit(moment, frame, *found)
            if last is not None:
                yield last.result()

    def _completed(
        self, frame: TimedImage, found: sv.Detections, scene: Scene | None
    ) -> tuple[Detections, Float32[np.ndarray, "n 48"], Float32[np.ndarray, "n 8"]]:
        """All of a frame in which people were found."""
        image = frame.image_bgr
        vehicles, people = self._vehicles(image, found, scene), _persons(found)
        person_box, person_score = boxes_of(people)
        vehicle_box, vehicle_score = boxes_of(vehicles)
        n, m = len(person_box), len(vehicle_box)
        names: tuple[str, ...] = () if self.keypoints is None else self.keypoints.names
        with timed(self.timings, "keypoints"):
            uv, uv_score = self._keypoints(frame, people)
        box = np.concatenate([person_box, vehicle_box])
        with timed(self.timings, "appearance"):
            colours = self._colours(frame, people, vehicle_box)
        kinds = [*["person"] * n, *vehicles.data.get("class_name", [])]
        table = Detections.from_boxes(
            (image.shape[1], image.shape[0]),
            np.full(n + m, frame.index),
            box,
            time_s=np.full(n + m, frame.time_s),
            score=np.concatenate([person_score, vehicle_score]),
            class_name=np.array(kinds, dtype=_NAME),
            keypoint_uv=np.concatenate([uv, np.full((m, len(names), 2), np.nan)]),
            keypoint_score=np.concatenate([uv_score, np.zeros((m, len(names)))]),
            keypoint_names=names,
        )
        with timed(self.timings, "appearance"):
            return table, colours, self._readings(frame, table)

    def _readings(self, frame: TimedImage, table: Detections) -> Float32[np.ndarray, "n 8"]:
        if self.attention is None:
            return np.full((len(table), COLUMNS), np.nan, np.float32)
        return self.attention.reader.read(frame.image_bgr, frame.time_s, table)

    def _keypoints(self, frame: TimedImage, people: sv.Detections) -> tuple[np.ndarray, np.ndarray]:
        """Keypoints (n, k, 2) of the people in a frame, and their scores (n, k)."""
        box, image = boxes_of(people)[0], frame.image_bgr
        if self.keypoints is None:
            return np.empty((len(box), 0, 2)), np.empty((len(box), 0))
        if self.attention is None:
            return self.keypoints.estimate(image, box)
        postures, columns = self.attention.postures, len(self.keypoints.names)
        uv, score, rows = postures.carried(people, frame.time_s, columns)
        if len(rows):
            uv[rows], score[rows] = self.keypoints.estimate(image, box[rows])
        postures.keep(people, uv, score)
        return uv, score

    def _colours(
        self, frame: TimedImage, people: sv.Detections, vehicle_box: np.ndarray
    ) -> Float32[np.ndarray, "n 48"]:
        """Colours of people and then of vehicles; of people as they were last looked at."""
        box, image = boxes_of(people)[0], frame.image_bgr
        seen = np.ones(len(box), bool)
        number = np.asarray(people.data.get("number", ()), np.int64)
        before = {} if self.attention is None else self.attention.colours
        if len(number):
            known = np.isin(number, list(before))
            seen = ~known | (people.data["looked_s"] == frame.time_s)
        fresh = colour_histograms(image, np.concatenate([box[seen], vehicle_box]))
        out = np.empty((len(box) + len(vehicle_box), fresh.shape[1]), np.float32)
        out[np.append(seen, np.ones(len(vehicle_box), bool))] = fresh
        for row in np.flatnonzero(~seen):
            out[row] = before[int(number[row])]
        if self.attention is not None:
            self.attention.colours = dict(zip(number.tolist(), out, strict=False))
        return out

    def _found(self, frame: TimedImage) -> tuple[sv.Detections, Scene | None]:
        """What the detector of people finds in a frame, and the scene that attention made of it."""
        with timed(self.timings, "detect people"):
            if self.attention is None:
                return self.people.detect(frame.image_bgr), None
            return self.attention.people(frame.image_bgr, frame.time_s)

    def _vehicles(
        self, image: np.ndarray, found: sv.Detections, scene: Scene | None
    ) -> sv.Detections:
        """The vehicles in a frame."""
        if self.vehicles is None:
            return one_per_vehicle(found)
        with timed(self.timings, "detect vehicles"):
            if self.attention is None or scene is None:
                return one_per_vehicle(self.vehicles.detect(image))
            return self.attention.vehicles(scene, boxes_of(_persons(found))[0])


def _persons(found: sv.Detections) -> sv.Detections:
    """The people among detections; all of them if the detector names no classes."""
    names = found.data.get("class_name")
    if names is None or not len(found):
        return found
    chosen = found[np.asarray(names) == "person"]
    assert isinstance(chosen, sv.Detections)  # a mask never gives a single field
    return chosen


def colour_histograms(
    image_bgr: UInt8[np.ndarray, "h w 3"], box_xyxy: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, "n 48"]:
    """Histograms of L*, a*, b* over torso and legs of every box; each row sums to 1.

    A part outside the image has a uniform histogram.
    """
    out = np.empty((len(box_xyxy), len(_PARTS) * 3 * _BINS))
    for row, box in zip(out, box_xyxy, strict=True):
        row[:] = np.concatenate([_histogram(_patch(image_bgr, box, part)) for part in _PARTS])
    return out / len(_PARTS)


def _patch(image_bgr: np.ndarray, box: np.ndarray, part: tuple[float, float]) -> np.ndarray:
    height, width = image_bgr.shape[:2]
    x = box[0] + np.array(_MIDDLE) * (box[2] - box[0])
    y = box[1] + np.array(part) * (box[3] - box[1])
    x1, x2 = np.clip(np.round(x), 0, width).astype(int)
    y1, y2 = np.clip(np.round(y), 0, height).astype(int)
    return image_bgr[y1:y2, x1:x2]


def _histogram(patch: np.ndarray) -> np.ndarray:
    if not patch.size:
        return np.full(3 * _BINS, 1 / (3 * _BINS))
    lab = cv2.cvtColor(patch, cv2.COLOR_BGR2LAB).reshape(-1, 3).astype(float)
    low, high = _CLOTHES_AB
    share = np.column_stack([lab[:, 0] / 256, (lab[:, 1:] - low) / (high - low)])
    # Every pixel is shared between the two nearest bins, so that a small change of light
    # changes the histogram a little.
    position = np.clip(share * _BINS - 0.5, 0, _BINS - 1)
    lower = np.minimum(position.astype(int), _BINS - 2)
    upper_weight = position - lower
    channel = np.broadcast_to(np.arange(3) * _BINS, lower.shape)
    counts = np.bincount((channel + lower).ravel(), (1 - upper_weight).ravel(), 3 * _BINS)
    counts += np.bincount((channel + lower + 1).ravel(), upper_weight.ravel(), 3 * _BINS)
    return counts / counts.sum()
