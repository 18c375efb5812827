"""How far known things moved since the last picture: the median of the optical flow within them.

Sources: Lucas and Kanade, "An iterative image registration technique" (1981), in pyramids; Kalal,
Mikolajczyk and Matas, "Forward-backward error" (2010), for the median and for when not to trust it.
"""

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


class Motion:
    """The motion between the last two pictures of a still camera."""

    def __init__(self) -> None:
        self._before: np.ndarray | None = None
        self._now: np.ndarray | None = None
        self._scale = 1.0

    def add(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> None:
        """The next picture."""
        grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
        self._scale = min(1.0, _LONGEST_PX / max(grey.shape))
        if self._scale < 1:
            size = round(grey.shape[1] * self._scale), round(grey.shape[0] * self._scale)
            grey = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        self._before, self._now = self._now, grey

    def within(
        self, box_xyxy: Float[np.ndarray, "n 4"]
    ) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
        """How far what was in each box of the last picture has come, in pixels, and whether it
        could be followed (else zero).
        """
        n = len(box_xyxy)
        if not n or self._before is None or self._now is None:
            return np.zeros((n, 2)), np.zeros(n, bool)
        box = box_xyxy * self._scale
        side = box[:, 2:] - box[:, :2]
        share = np.stack(np.meshgrid(_ACROSS, _DOWN), axis=-1).reshape(-1, 2)
        begin = (box[:, None, :2] + share * side[:, None]).astype(np.float32)
        flat = begin.reshape(-1, 1, 2)
        there, found = _followed(self._before, self._now, flat)
        back, again = _followed(self._now, self._before, there)
        away = np.linalg.norm((back - flat).reshape(begin.shape), axis=2)
        good = away < np.maximum(_BACK_PX, _BACK_SHARE * side[:, 1])[:, None]
        good &= (found.reshape(good.shape) > 0) & (again.reshape(good.shape) > 0)
        held = good.mean(axis=1) >= _HELD_SHARE
        step = np.where(good[..., None], there.reshape(begin.shape) - begin, np.nan)
        shift = np.zeros((n, 2))
        shift[held] = np.nanmedian(step[held], axis=1) / self._scale
        return shift, held


def _followed(before: np.ndarray, now: np.ndarray, points: np.ndarray) -> tuple[np.ndarray, ...]:
    """Where points (n, 1, 2) went, and whether they were found."""
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        before, now, points, None, winSize=_WINDOW, maxLevel=_LEVELS, criteria=_ENOUGH
    )
    return there, found
