"""MEVA's annotated boxes as tracks on the ground, followed in memory as ``scene4d track`` does."""

from pathlib import Path

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.people import Detections
from scene4d.core.tracks import Tracks
from scene4d.tracking.following import Follower, Look
from scene4d.tracking.options import TrackOptions, TrackRun
from scene4d.tracking.placing import known_classes

_FRAMES_PER_LOOK = 300


def followed(
    annotated: Detections, calibration: Calibration, options: TrackOptions, fps: float
) -> Tracks:
    """What ``scene4d track --annotations`` writes into a scene.

    Rows are ordered by (track, time). Frames are looked at as often as ``options`` says, from 0 on.
    """
    found, _ = known_classes(annotated)
    every = max(1, round(fps / options.rate_hz))
    found = found.select(found.frame % every == 0)
    found = found.select(np.lexsort([found.track, found.frame]))
    run = TrackRun(Path(), str(options.name), str(options.annotations))
    follower = Follower(calibration, options.height_m(calibration), run)
    frames = np.arange(0, int(found.frame.max(initial=-1)) + 1, every)
    parts = []
    for begin in range(0, len(frames), _FRAMES_PER_LOOK):
        some = frames[begin : begin + _FRAMES_PER_LOOK]
        rows = np.arange(*np.searchsorted(found.frame, [some[0], some[-1] + 1]))
        parts += list(follower.follow(Look(some, some / fps, found.select(rows))))
    tracks = Tracks.concatenate([*parts, follower.finish()])
    return tracks.select(np.lexsort([tracks.time_s, tracks.track]))
