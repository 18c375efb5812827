"""Detects people and vehicles in one frame: detectors and keypoints combined into a table."""

from dataclasses import dataclass, field, replace
from typing import Protocol, runtime_checkable

import cv2
import numpy as np
import supervision as sv
from jaxtyping import Float, Float32, UInt8

from scene4d.core.people import Detections
from scene4d.core.progress import timed
from scene4d.core.tracks import CLASSES, VEHICLES
from scene4d.perception.detectors._base import Detector
from scene4d.perception.detectors.tiles import ExpectedPersonPx, TiledDetector

_SAME_IOU = 0.5
"""Boxes of cars, trucks and buses (or of bicycles and motorcycles) that overlap more are merged;
the usual threshold."""
_PART_SHARE = 0.8
"""A box with this share inside a better one of its class is a part of it; chosen by hand."""

_BINS = 8
_PARTS = ((0.15, 0.5), (0.55, 0.9))
"""Torso and legs, as shares of the box's height."""
_MIDDLE = (0.25, 0.75)
"""Part of the box's width that shows the body and not the ground."""
_CLOTHES_AB = (98.0, 158.0)
"""Range of a* and b* (neutral: 128) that clothes use. These four values are chosen by hand."""

_WHEELS = {name: 2 if name in ("bicycle", "motorcycle") else 4 for name in VEHICLES}
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
    ignored. ``timings`` holds the seconds spent by stage.
    """

    people: Detector
    keypoints: PoseEstimator | None = None
    vehicles: Detector | None = None
    timings: dict[str, float] = field(default_factory=dict)

    @classmethod
    def default(cls) -> "ObjectDetector":
        """YOLOX-tiny, RTMPose-s and YOLOv4-tiny; downloads missing weights."""
        from scene4d.perception.detectors._yolov4 import Yolov4TinyDetector
        from scene4d.perception.detectors.yolox import YoloxDetector
        from scene4d.perception.keypoints import KeypointEstimator

        return cls(YoloxDetector(), KeypointEstimator(), Yolov4TinyDetector())

    def expecting(self, expected_person_px: ExpectedPersonPx | None) -> "ObjectDetector":
        """The same detector for a scene with known sizes of people; see TiledDetector."""

        def told(detector: Detector | None) -> Detector | None:
            if isinstance(detector, TiledDetector):
                return detector.expecting(expected_person_px)
            return detector

        people = told(self.people)
        assert people is not None
        return replace(self, people=people, vehicles=told(self.vehicles))

    def look(self, frame: TimedImage) -> tuple[Detections, Float32[np.ndarray, "n 48"]]:
        """Detections in a frame, and the colours of every row (see ``colour_histograms``).

        People (best first), then vehicles (best first), with the names in ``CLASSES``. A rider and
        the bicycle are two rows. Keypoints of vehicles are NaN with score 0.
        """
        image = frame.image_bgr
        with timed(self.timings, "detect people"):
            found = self.people.detect(image)
        person_box, person_score = _boxes(_persons(found))
        if self.vehicles is not None:
            with timed(self.timings, "detect vehicles"):
                found = self.vehicles.detect(image)
        vehicles = one_per_vehicle(found)
        vehicle_box, vehicle_score = _boxes(vehicles)
        n, m = len(person_box), len(vehicle_box)
        names: tuple[str, ...] = ()
        uv, uv_score = np.empty((n, 0, 2)), np.empty((n, 0))
        if self.keypoints is not None:
            names = self.keypoints.names
            with timed(self.timings, "keypoints"):
                uv, uv_score = self.keypoints.estimate(image, person_box)
        box = np.concatenate([person_box, vehicle_box])
        with timed(self.timings, "appearance"):
            colours = colour_histograms(image, box).astype(np.float32)
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
        return table, colours


def _persons(found: sv.Detections) -> sv.Detections:
    """The people among detections; all of them if the detector names no classes."""
    names = found.data.get("class_name")
    if names is None or not len(found):
        return found
    chosen = found[np.asarray(names) == "person"]
    assert isinstance(chosen, sv.Detections)  # a mask never gives a single field
    return chosen


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
    box, score = _boxes(found)
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


def _boxes(found: sv.Detections) -> tuple[np.ndarray, np.ndarray]:
    box = np.asarray(found.xyxy, float).reshape(-1, 4)
    score = np.ones(len(box)) if found.confidence is None else np.asarray(found.confidence, float)
    return box, score


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
