"""``track``: from the footage of a calibrated camera to a scene on disk."""

from scene4d.tracking._options import TrackOptions, TrackRun
from scene4d.tracking._running import track
from scene4d.tracking.live import WatchOptions, WatchRun, watch
from scene4d.tracking.several import watch_several

__all__ = [
    "TrackOptions",
    "TrackRun",
    "WatchOptions",
    "WatchRun",
    "track",
    "watch",
    "watch_several",
]
