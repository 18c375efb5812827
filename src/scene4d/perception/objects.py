"""From one frame to a table of people and vehicles: detectors and keypoints put together."""

import time
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass, field, replace

import numpy as np
import supervision as sv
from jaxtyping import Float32

from scene4d.core.people import Detections
from scene4d.core.tracks import CLASSES, VEHICLES
from scene4d.perception.appearance import colour_histograms
from scene4d.perception.detectors.base import Detector
from scene4d.perception.detectors.tiled import TiledDetector
from scene4d.perception.detectors.tiles import ExpectedPersonPx
from scene4d.perception.people import PoseEstimator, TimedImage, persons

_SAME_IOU = 0.5
"""Boxes of cars, trucks and buses (or of the two kinds of bicycle) that overlap more are one."""
_PART_SHARE = 0.8
"""A box that lies so far inside a better one of its class is a part of it."""

_WHEELS = {name: 2 if name in ("bicycle", "motorcycle") else 4 for name in VEHICLES}
_NAME = f"<U{max(map(len, CLASSES))}"


@dataclass
class ObjectDetector:
    """Finds what a scene holds, one row per person and vehicle, without tracks.

    ``vehicles`` None: the vehicles too are those that ``people`` names. Persons that ``vehicles``
    finds are left out. ``timings`` counts the seconds spent, by stage.
    """

    people: Detector
    keypoints: PoseEstimator | None = None
    vehicles: Detector | None = None
    timings: dict[str, float] = field(default_factory=dict)

    @classmethod
    def default(cls, *, threads: int | None = None, vehicles: bool = True) -> "ObjectDetector":
        """YOLOX-tiny, RTMPose-s and YOLOv4-tiny; gets the weights if they are missing."""
        from scene4d.perception.detectors.yolov4 import Yolov4TinyDetector
        from scene4d.perception.detectors.yolox import YoloxDetector
        from scene4d.perception.keypoints import KeypointEstimator
        from scene4d.perception.session import DEFAULT_THREADS

        n = DEFAULT_THREADS if threads is None else threads
        second = Yolov4TinyDetector(threads=n) if vehicles else None
        return cls(YoloxDetector(threads=n), KeypointEstimator(threads=n), second)

    def expecting(self, expected_person_px: ExpectedPersonPx | None) -> "ObjectDetector":
        """The same for a scene where the size of people is known; see TiledDetector."""

        def told(detector: Detector | None) -> Detector | None:
            if isinstance(detector, TiledDetector):
                return detector.expecting(expected_person_px)
            return detector

        people = told(self.people)
        assert people is not None
        return replace(self, people=people, vehicles=told(self.vehicles))

    def look(self, frame: TimedImage) -> tuple[Detections, Float32[np.ndarray, "n 48"]]:
        """What is seen in a frame, and the colours of every row (see ``colour_histograms``).

        People (best first), then vehicles (best first), under the names of ``CLASSES``. A rider
        is a person, beside the bicycle's own row. Keypoints of vehicles are NaN with score 0.
        """
        image = frame.image_bgr
        with self._timed("detect people"):
            first = self.people.detect(image)
        second = first
        if self.vehicles is not None:
            with self._timed("detect vehicles"):
                second = self.vehicles.detect(image)
        person_box, person_score = _boxes(persons(first))
        vehicle = one_per_vehicle(second)
        vehicle_box, vehicle_score = _boxes(vehicle)
        n, m = len(person_box), len(vehicle_box)
        names: tuple[str, ...] = ()
        uv, uv_score = np.empty((n, 0, 2)), np.empty((n, 0))
        if self.keypoints is not None:
            names = self.keypoints.names
            with self._timed("keypoints"):
                uv, uv_score = self.keypoints.estimate(image, person_box)
        box = np.concatenate([person_box, vehicle_box])
        with self._timed("appearance"):
            colours = colour_histograms(image, box).astype(np.float32)
        kinds = [*["person"] * n, *vehicle.data.get("class_name", [])]
        found = Detections.from_boxes(
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
        return found, colours

    @contextmanager
    def _timed(self, stage: str) -> Iterator[None]:
        start = time.perf_counter()
        yield
        self.timings[stage] = self.timings.get(stage, 0.0) + time.perf_counter() - start


def one_per_vehicle(found: sv.Detections) -> sv.Detections:
    """The vehicles among detections, one row each, best first.

    Of boxes of several classes that overlap by more than ``_SAME_IOU`` (a pick-up is a car and a
    truck) the best is kept, bicycles and motorcycles apart from cars, trucks and buses: those
    stand in front of one another. Then parts go: boxes inside a better one of their own class.
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
