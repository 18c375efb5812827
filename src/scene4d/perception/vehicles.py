"""Vehicles tracked in the image through frames a fraction of a second apart, for calibration.

Boxes are associated by where a vehicle's box is expected, from its last two, and by its size, in
one assignment per frame. As for people, a track that mixes two vehicles does more harm than a
vehicle split in two: where two matches are about equally good, the tracks concerned end.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.people import Detections
from scene4d.core.tracks import VEHICLES
from scene4d.perception._tracking import clear_matches
from scene4d.perception.detectors._base import Detector
from scene4d.perception.objects import ObjectDetector, TimedImage

# Lengths are in sizes of the box (the root of its area). Chosen by hand for frames 1/8 s apart.
_FIRST_SIGMA = 0.35
"""How far a vehicle comes between its first two frames: a car at 100 km/h, its own length."""
_PLACE_SIGMA = 0.08
"""Error of a box expected from its last two: jitter, and braking."""
_SIZE_SIGMA = 0.08
"""Error of the logarithm of its width and height."""
_GATE2 = 16.0
"""Largest cost of a match: four standard deviations."""
_MEMORY_S = 0.6
"""A track ends when it is unseen for longer."""


@dataclass
class _Track:
    label: int
    state: np.ndarray  # (4,) middle, log width and height
    speed: np.ndarray | None  # (4,) per second
    time_s: float


class VehicleTracker:
    """Assigns track numbers, from 0, to the boxes of successive frames; streaming."""

    def __init__(self) -> None:
        self._tracks: list[_Track] = []
        self._next = 0

    def update(self, box_xyxy: Float[np.ndarray, "n 4"], time_s: float) -> Int[np.ndarray, "n"]:
        """Track numbers (n,) of the boxes of one frame."""
        self._tracks = [t for t in self._tracks if time_s - t.time_s <= _MEMORY_S]
        side = np.maximum(box_xyxy[:, 2:] - box_xyxy[:, :2], 1.0)
        seen = np.hstack([(box_xyxy[:, :2] + box_xyxy[:, 2:]) / 2, np.log(side)])
        cost = np.array([_costs(t, seen, time_s) for t in self._tracks])
        pairs, doubtful = clear_matches(cost.reshape(len(self._tracks), len(seen)))
        label = np.full(len(seen), -1)
        for i, j in pairs:
            track = self._tracks[i]
            speed = (seen[j] - track.state) / max(time_s - track.time_s, 1e-3)
            track.speed = speed if track.speed is None else (track.speed + speed) / 2
            track.state, track.time_s = seen[j], time_s
            label[j] = track.label
        self._tracks = [t for t, ends in zip(self._tracks, doubtful, strict=True) if not ends]
        for new in np.flatnonzero(label < 0):
            label[new] = self._next
            self._tracks.append(_Track(self._next, seen[new], None, time_s))
            self._next += 1
        return label


def _costs(track: _Track, seen: np.ndarray, time_s: float) -> np.ndarray:
    """Cost (n,) of every box as the track's next; infinite where impossible."""
    expected = track.state.copy()
    if track.speed is not None:
        expected += track.speed * (time_s - track.time_s)
    size = np.exp(track.state[2:].mean())
    away = np.hypot(*(seen[:, :2] - expected[:2]).T) / size
    grown = np.abs(seen[:, 2:] - expected[2:]).max(axis=1, initial=0.0)
    place = _FIRST_SIGMA if track.speed is None else _PLACE_SIGMA
    cost: np.ndarray = (away / place) ** 2 + (grown / (2 * _SIZE_SIGMA)) ** 2
    return np.where(cost < _GATE2, cost, np.inf)


class VehicleDetector:
    """A detector of vehicles with tracks. The tracker has state: use one per clip."""

    def __init__(self, detector: Detector) -> None:
        self._objects = ObjectDetector(detector)
        self._tracker = VehicleTracker()

    @classmethod
    def default(cls, device: str = "auto") -> "VehicleDetector":
        """YOLOv4-tiny and the tracker; downloads missing weights."""
        from scene4d.perception.detectors._yolov4 import Yolov4TinyDetector

        return cls(Yolov4TinyDetector(device))

    def look(self, frame: TimedImage) -> Detections:
        """The vehicles in one frame, with tracks; give frames in order of time."""
        found, *_ = self._objects.look(frame)
        found = found.select(np.isin(found.class_name, VEHICLES))
        return replace(found, track=self._tracker.update(found.box_xyxy, frame.time_s))
