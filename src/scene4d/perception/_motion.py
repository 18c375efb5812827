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
_ACROSS, _DOWN = np.linspace(0.3, 0.7, 4), np.linspace(0.1, 0.6, 6)
"""Points that are followed, as shares of the box: a person's trunk, a vehicle's body."""
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
        n = len(box_xyxy)
        if not n or self.before is None:
            return np.zeros((n, 2)), np.zeros(n, bool)
        box = box_xyxy * self.scale
        side = box[:, 2:] - box[:, :2]
        share = np.stack(np.meshgrid(_ACROSS, _DOWN), axis=-1).reshape(-1, 2)
        begin = (box[:, None, :2] + share * side[:, None]).astype(np.float32)
        flat = begin.reshape(-1, 1, 2)
        there, found = _followed(self.before, self.now, flat)
        back, again = _followed(self.now, self.before, there)
        away = np.linalg.norm((back - flat).reshape(begin.shape), axis=2)
        good = away < np.maximum(_BACK_PX, _BACK_SHARE * side[:, 1])[:, None]
        good &= (found.reshape(good.shape) > 0) & (again.reshape(good.shape) > 0)
        held = good.mean(axis=1) >= _HELD_SHARE
        step = np.where(good[..., None], there.reshape(begin.shape) - begin, np.nan)
        shift = np.zeros((n, 2))
        shift[held] = np.nanmedian(step[held], axis=1) / self.scale
        return shift, held


def _followed(before: np.ndarray, now: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, ...]:
    """Where points (n, 1, 2) went, and whether they were found."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, points, None, winSize=_WINDOW, maxLevel=_LEVELS, criteria=_ENOUGH
    )
    return there, found
