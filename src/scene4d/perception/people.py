"""Detects people in frames: detector, keypoints and tracker combined into a table."""

from collections.abc import Callable, Iterable
from dataclasses import dataclass, field, replace

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.perception._tracking import Tracker
from scene4d.perception.detectors._base import Detector
from scene4d.perception.objects import ObjectDetector, PoseEstimator, TimedImage

_PeopleProgress = Callable[[int, int], None]
"""Called after every frame with the frames done and the people found so far."""


@dataclass
class PeopleDetector:
    """A detector with optional keypoints and tracks. The tracker has state: use one per clip."""

    detector: Detector
    keypoints: PoseEstimator | None = None
    tracker: Tracker | None = field(default_factory=Tracker)

    @classmethod
    def default(cls, device: str = "auto") -> "PeopleDetector":
        """YOLOX-tiny, RTMPose-s and the tracker; downloads missing weights."""
        from scene4d.perception.detectors.yolox import YoloxDetector
        from scene4d.perception.keypoints import KeypointEstimator

        return cls(YoloxDetector(device), KeypointEstimator(device))

    def look(self, frame: TimedImage) -> Detections:
        """The people in one frame; give frames in order of time.

        A frame without a time has no tracks (-1).
        """
        found, colours, _ = ObjectDetector(self.detector, self.keypoints).look(frame)
        people = found.class_name == "person"
        found, colours = found.select(people), colours[people]
        if self.tracker is None or not np.isfinite(frame.time_s):
            return found
        return replace(found, track=self.tracker.update(found.box_xyxy, frame.time_s, colours))


def detect_people(
    frames: Iterable[TimedImage],
    people: PeopleDetector | None = None,
    *,
    progress: _PeopleProgress | None = None,
) -> Detections:
    """The people in a stream of frames, which is read once and not kept in memory.

    ``people`` None means :meth:`PeopleDetector.default`. Raises :class:`InputError` if there is no
    frame, or if the frame size changes.
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
