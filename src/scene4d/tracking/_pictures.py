"""The last seconds of a camera as small pictures, for alerts."""

import base64
from collections import deque
from collections.abc import Mapping

import cv2
import numpy as np

from scene4d.core.pictures import jpeg
from scene4d.core.tracks import Tracks
from scene4d.video.frames import Frame

_EVERY_S, _KEPT = 0.5, 60
"""A picture each half second, of half a minute: an event is told a few seconds after its end."""
_WIDTH_PX, _QUALITY = 640, 80
"""Some 40 kB each."""
_COLOURS = ((0, 160, 255), (255, 140, 0), (60, 200, 60), (200, 60, 200))
_NEAR_S = 1.0


class Pictures:
    """Keeps small pictures in memory: half a minute of them."""

    def __init__(self) -> None:
        self._kept: deque[tuple[float, float, bytes]] = deque(maxlen=_KEPT)

    def add(self, frame: Frame) -> None:
        """Keep a frame, if the last one is old enough."""
        if self._kept and frame.time_s < self._kept[-1][0] + _EVERY_S:
            return
        scale = min(1.0, _WIDTH_PX / frame.image_bgr.shape[1])
        self._kept.append((frame.time_s, scale, jpeg(frame.image_bgr, _QUALITY, scale)))

    def of(self, time_s: float, tracks: Tracks, roles: Mapping[str, int]) -> str | None:
        """The picture nearest to a time, with the boxes of who took part: JPEG in base64."""
        if not self._kept:
            return None
        at_s, scale, content = min(self._kept, key=lambda kept: abs(kept[0] - time_s))
        image = cv2.imdecode(np.frombuffer(content, np.uint8), cv2.IMREAD_COLOR)
        for colour, (role, track) in zip(_COLOURS, roles.items(), strict=False):
            box = _box(tracks, track, at_s)
            if box is not None:
                left, top, right, bottom = (np.rint(box * scale)).astype(int).tolist()
                cv2.rectangle(image, (left, top), (right, bottom), colour, 2)
                font, place = cv2.FONT_HERSHEY_SIMPLEX, (left, max(12, top - 4))
                cv2.putText(image, role, place, font, 0.45, colour, 1, cv2.LINE_AA)
        return base64.b64encode(jpeg(image, _QUALITY)).decode()


def _box(tracks: Tracks, track: int, at_s: float) -> np.ndarray | None:
    rows = np.flatnonzero((tracks.track == track) & np.isfinite(tracks.box_xyxy).all(axis=1))
    if not len(rows):
        return None
    away_s = np.abs(tracks.time_s[rows] - at_s)
    nearest = int(away_s.argmin())
    return tracks.box_xyxy[rows[nearest]] if away_s[nearest] < _NEAR_S else None
