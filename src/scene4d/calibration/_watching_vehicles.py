"""Looking for vehicles, where people alone do not determine the camera.

Finding vehicles costs three to four times what finding people does, so it is done where it helps,
on short bursts of frames: a vehicle's way within two seconds shows where it heads, and vehicles of
other moments are other vehicles.
"""

from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Int

from scene4d.core.people import Detections
from scene4d.core.progress import Progress, timed
from scene4d.core.tracks import VEHICLES

if TYPE_CHECKING:
    from scene4d.video.frames import Source, Timeline

_RATE_HZ = 8.0
"""A car at 100 km/h moves by less than its length from frame to frame."""
_BURST_S, _BURSTS = 2.0, 10
"""Length and number of bursts: 160 frames. In 2 s a car at 20 km/h moves by more than itself."""


def watch_vehicles(
    footage: "Source", progress: Progress, timings: dict[str, float], device: str
) -> Detections | None:
    """Tracked vehicles in bursts of frames; None of a source that has no clock or cannot be read
    again (images, streams). Raises as :func:`perception.weights.fetch_all`.
    """
    from scene4d.perception.vehicles import VehicleDetector

    timeline = footage.timeline
    if timeline is None or not timeline.has_clock:
        return None
    detector = VehicleDetector.default(device)
    chosen = burst_frames(timeline)
    parts: list[Detections] = []
    with timed(timings, "vehicles"), progress.stage("Watching vehicles", len(chosen)) as step:
        for frame in footage.frames(chosen.tolist()):
            parts.append(detector.look(frame))
            step(1)
    return Detections.concatenate(parts) if parts else None


def burst_frames(timeline: "Timeline") -> Int[np.ndarray, "n"]:
    """Indices of the frames to look at: bursts spread evenly over the footage, or all of it where
    it is short.
    """
    time_s = timeline.time_s
    begin, end = float(time_s[0]), float(time_s[-1])
    bursts = max(1, min(_BURSTS, int((end - begin) / _BURST_S)))
    length_s = min((end - begin) / bursts, _BURST_S)
    apart = (end - begin - length_s) / max(bursts - 1, 1)
    slots = np.arange(0.0, length_s, 1 / _RATE_HZ)
    wanted = (begin + apart * np.arange(bursts)[:, None] + slots).ravel()
    return np.unique(np.minimum(np.searchsorted(time_s, wanted - 1e-6), len(time_s) - 1))


def annotated_vehicles(detections: Detections) -> Detections | None:
    """The tracked vehicles among annotations, sorted by time; None where there are none."""
    rows = np.isin(detections.class_name, VEHICLES) & (detections.track >= 0)
    if not rows.any():
        return None
    found = detections.select(rows)
    return found.select(np.argsort(found.frame, kind="stable"))
