"""Where the picture of a still camera has changed, on a small grey copy of it."""

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Int16, Int32, UInt8

_LONGEST_PX = 480
"""Longer side of the grey copy: the smallest people that a tile shows (16 px at full HD) are four
cells high in it."""
_LEAST_GREY = 10
"""Grey levels by which a cell must differ: clothes that differ by less from what is behind them are
not found by the detectors either (chosen by hand)."""
_NOISES = 6.0
"""The same, in standard deviations of the noise between two pictures."""
_LEAST_CELLS = 4
"""Connected cells that must differ: noise comes alone."""
_EVERY = 6
"""Every sixth cell each way is enough to know the light and the noise."""
_SIGMA_OF_MEDIAN = 1.4826


class GreyCopy:
    """A small grey copy (h, w) of a picture, and the scale from the picture's pixels to its."""

    def __init__(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> None:
        height, width = image_bgr.shape[:2]
        scale = min(1.0, _LONGEST_PX / max(width, height))
        size = max(1, round(width * scale)), max(1, round(height * scale))
        grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
        small = cv2.resize(grey, size, interpolation=cv2.INTER_AREA)
        self.grey = cv2.blur(small, (3, 3)).astype(np.int16)
        self.scale = np.array([size[0] / width, size[1] / height] * 2)

    def cells(self, box_xyxy: Float[np.ndarray, "4"] | Int[np.ndarray, "4"]) -> tuple[slice, slice]:
        """Rows and columns of the cells that a box covers, one at least."""
        x1, y1, x2, y2 = np.asarray(box_xyxy) * self.scale
        height, width = self.grey.shape
        left, top = min(max(int(x1), 0), width - 1), min(max(int(y1), 0), height - 1)
        bottom, right = max(top + 1, int(np.ceil(y2))), max(left + 1, int(np.ceil(x2)))
        return slice(top, bottom), slice(left, right)


def changed(
    now: Int16[np.ndarray, "h w"], then: Int16[np.ndarray, "h w"]
) -> Bool[np.ndarray, "h w"]:
    """Cells that differ by more than noise and light do, in connected areas of a few."""
    step = now - then
    few = step[::_EVERY, ::_EVERY]
    light = np.int16(np.median(few))
    noise = _SIGMA_OF_MEDIAN * float(np.median(np.abs(few - light)))
    mask = np.abs(step - light) > max(_LEAST_GREY, _NOISES * noise)
    if not mask.any():
        return mask
    _, label, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    return mask & (stats[:, cv2.CC_STAT_AREA] >= _LEAST_CELLS)[label]


def areas(mask: Bool[np.ndarray, "h w"]) -> Int32[np.ndarray, "n 4"]:
    """Left, top, right and bottom of the connected areas of a mask, in cells."""
    if not mask.any():
        return np.empty((0, 4), np.int32)
    _, _, stats, _ = cv2.connectedComponentsWithStats(mask.astype(np.uint8))
    found: np.ndarray = np.hstack([stats[1:, :2], stats[1:, :2] + stats[1:, 2:4]])
    return found
