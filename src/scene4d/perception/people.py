"""From frames to a table of people: detector, keypoints and tracker put together."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field
from typing import Protocol, runtime_checkable

import numpy as np
import supervision as sv
from jaxtyping import Float, UInt8

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.perception.appearance import colour_histograms
from scene4d.perception.detectors.base import Detector
from scene4d.perception.tracking import Tracker

_PeopleProgress = Callable[[int, int], None]
"""Called after every frame with the frames done and the people found so far."""


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
        """The picture, blue first."""
        ...


@runtime_checkable
class PoseEstimator(Protocol):
    """Finds body points of people whose boxes are known."""

    names: tuple[str, ...]

    def estimate(
        self, image_bgr: UInt8[np.ndarray, "h w 3"], box_xyxy: Float[np.ndarray, "n 4"]
    ) -> tuple[Float[np.ndarray, "n k 2"], Float[np.ndarray, "n k"]]:
        """Points (n, k, 2) in pixels and scores (n, k) in [0, 1]."""
        ...


@dataclass
class PeopleDetector:
    """A detector, with keypoints and tracks where wanted. The tracker remembers: one per clip."""

    detector: Detector
    keypoints: PoseEstimator | None = None
    tracker: Tracker | None = field(default_factory=Tracker)

    @classmethod
    def default(cls, *, threads: int | None = None) -> "PeopleDetector":
        """YOLOX-tiny, RTMPose-s and the tracker; gets the weights if they are missing."""
        from scene4d.perception.detectors.yolox import YoloxDetector
        from scene4d.perception.keypoints import KeypointEstimator
        from scene4d.perception.session import DEFAULT_THREADS

        n = DEFAULT_THREADS if threads is None else threads
        return cls(YoloxDetector(threads=n), KeypointEstimator(threads=n))

    def look(self, frame: TimedImage) -> Detections:
        """The people of one frame; frames come in order of time.

        Without a time a frame has no tracks (-1).
        """
        image = frame.image_bgr
        found = persons(self.detector.detect(image))
        box = np.asarray(found.xyxy, float).reshape(-1, 4)
        score = np.ones(len(box)) if found.confidence is None else found.confidence
        track = np.full(len(box), -1)
        if self.tracker is not None and np.isfinite(frame.time_s):
            track = self.tracker.update(box, frame.time_s, colour_histograms(image, box))
        names: tuple[str, ...] = ()
        uv, uv_score = np.empty((len(box), 0, 2)), np.empty((len(box), 0))
        if self.keypoints is not None:
            names = self.keypoints.names
            uv, uv_score = self.keypoints.estimate(image, box)
        return Detections.from_boxes(
            (image.shape[1], image.shape[0]),
            np.full(len(box), frame.index),
            box,
            time_s=np.full(len(box), frame.time_s),
            score=np.asarray(score, float),
            track=track,
            keypoint_uv=uv,
            keypoint_score=uv_score,
            keypoint_names=names,
        )


def persons(found: sv.Detections) -> sv.Detections:
    """The persons among detections; all of them where the detector names no classes."""
    names = found.data.get("class_name")
    if names is None or not len(found):
        return found
    chosen = found[np.asarray(names) == "person"]
    assert isinstance(chosen, sv.Detections)  # a mask never gives a single field
    return chosen


def detect_people(
    frames: Iterable[TimedImage],
    people: PeopleDetector | None = None,
    *,
    progress: _PeopleProgress | None = None,
) -> Detections:
    """The people of a stream of frames, which is read once and never kept.

    ``people`` None means :meth:`PeopleDetector.default`. Raises :class:`InputError` where there
    is no frame at all, or where the frames change their size.
    """
    people = PeopleDetector.default() if people is None else people
    parts: list[Detections] = []
    count = 0
    for done, frame in enumerate(frames, start=1):
        part = people.look(frame)
        if parts and part.image_size != parts[0].image_size:
            (w, h), (w0, h0) = part.image_size, parts[0].image_size
            raise InputError(
                f"frame {frame.index}: found {w}x{h} pixels, expected {w0}x{h0} as before; "
                "split the footage where its size changes"
            )
        parts.append(part)
        count += len(part)
        if progress is not None:
            progress(done, count)
    if not parts:
        raise InputError("found no frame to look for people in, expected at least one")
    return Detections.concatenate(parts)
