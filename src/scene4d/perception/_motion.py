"""How far known things moved since the last picture: the median of the optical flow within them.

Sources: Lucas and Kanade, "An iterative image registration technique" (1981), in pyramids; Kalal,
Mikolajczyk and Matas, "Forward-backward error" (2010), for the median and for when not to trust it.
"""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Bool, Float, UInt8

_LONGEST_PX = 960
"""Longer side of the grey picture in which motion is measured. This and the values below are chosen
by hand on PETS 2009."""
_POINTS = np.stack(
    np.meshgrid(np.linspace(0.3, 0.7, 4), np.linspace(0.1, 0.6, 6)), axis=-1
).reshape(-1, 2)
"""Points that are followed, as shares of the box: a person's trunk, a vehicle's body."""
_ROOM = 0.25
"""Surroundings of a box in which it is followed, in its longer sides: who runs comes less far
within a fifth of a second."""
_WINDOW, _LEVELS = (11, 11), 3  # follows up to 40 px
_ENOUGH = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)
_BACK_PX, _BACK_SHARE = 1.0, 0.01
"""A point counts if following it back ends this near to where it began (pixels of the grey picture,
or share of the box's height if that is more)."""
_HELD_SHARE = 1 / 3
"""A thing is held if so many of its points count."""


class Motion(NamedTuple):
    """The motion between two pictures of a still camera, grey and shrunk by ``scale``; ``before``
    is None for the first.
    """

    before: np.ndarray | None
    now: np.ndarray
    scale: float

    @classmethod
    def between(cls, last: "Motion | None", image_bgr: UInt8[np.ndarray, "h w 3"]) -> "Motion":
        """From the last picture to the next."""
        grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
        scale = min(1.0, _LONGEST_PX / max(grey.shape))
        if scale < 1:
            size = round(grey.shape[1] * scale), round(grey.shape[0] * scale)
            grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        return cls(None if last is None else last.now, grey, scale)

    def within(
        self, box_xyxy: Float[np.ndarray, "n 4"]
    ) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
        """How far what was in each box of the last picture has come, in pixels, and whether it
        could be followed (else zero).
        """
        shift, held = np.zeros((len(box_xyxy), 2)), np.zeros(len(box_xyxy), bool)
        if self.before is None:
            return shift, held
        for row, box in enumerate(box_xyxy * self.scale):
            steps = self._steps(self.before, box)
            held[row] = len(steps) >= _HELD_SHARE * len(_POINTS)
            if held[row]:
                shift[row] = np.median(steps, axis=0) / self.scale
        return shift, held

    def _steps(self, before: np.ndarray, box: np.ndarray) -> np.ndarray:
        """How far the points of a box that count have come; only its surroundings are read."""
        side = box[2:] - box[:2]
        room = _ROOM * side.max() + max(_WINDOW)
        last = np.ceil(box[2:] + room).astype(int)
        first = np.maximum(np.floor(box[:2] - room), 0).astype(int)
        part = slice(first[1], max(0, last[1])), slice(first[0], max(0, last[0]))
        if not before[part].size:
            return np.empty((0, 2))
        begin = (box[:2] - first + _POINTS * side).astype(np.float32)
        there, found = _followed(before[part], self.now[part], begin)
        back, again = _followed(self.now[part], before[part], there)
        away = np.linalg.norm(back - begin, axis=1)
        good = found & again & (away < max(_BACK_PX, _BACK_SHARE * side[1]))
        steps: np.ndarray = (there - begin)[good]
        return steps


def _followed(before: np.ndarray, now: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, ...]:
    """Where points (n, 2) went, and which were found."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, points, None, winSize=_WINDOW, maxLevel=_LEVELS, criteria=_ENOUGH
    )
    return there, found[:, 0] > 0
