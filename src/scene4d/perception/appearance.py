"""The colours of a person's clothes, a cheap sign of who it is."""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

_BINS = 8
_PARTS = ((0.15, 0.5), (0.55, 0.9))
"""Torso and legs, as shares of the box's height."""

_MIDDLE = (0.25, 0.75)  # share of the box's width where the body is, not the ground
_CLOTHES_AB = (98.0, 158.0)  # clothes use a small part of the range of a* and b* (neutral: 128)


def colour_histograms(
    image_bgr: UInt8[np.ndarray, "h w 3"], box_xyxy: Float[np.ndarray, "n 4"]
) -> Float[np.ndarray, "n 48"]:
    """Histograms of L*, a*, b* over torso and legs of every box; each row sums to 1.

    A part that lies outside the image has a flat histogram.
    """
    out = np.empty((len(box_xyxy), len(_PARTS) * 3 * _BINS))
    for row, box in zip(out, box_xyxy, strict=True):
        row[:] = np.concatenate([_histogram(_patch(image_bgr, box, part)) for part in _PARTS])
    return out / len(_PARTS)


def _patch(image_bgr: np.ndarray, box: np.ndarray, part: tuple[float, float]) -> np.ndarray:
    height, width = image_bgr.shape[:2]
    x = box[0] + np.array(_MIDDLE) * (box[2] - box[0])
    y = box[1] + np.array(part) * (box[3] - box[1])
    x1, x2 = np.clip(np.round(x), 0, width).astype(int)
    y1, y2 = np.clip(np.round(y), 0, height).astype(int)
    return image_bgr[y1:y2, x1:x2]


def _histogram(patch: np.ndarray) -> np.ndarray:
    if not patch.size:
        return np.full(3 * _BINS, 1 / (3 * _BINS))
    lab = cv2.cvtColor(patch, cv2.COLOR_BGR2LAB).reshape(-1, 3).astype(float)
    low, high = _CLOTHES_AB
    share = np.column_stack([lab[:, 0] / 256, (lab[:, 1:] - low) / (high - low)])
    # Every pixel is shared between the two nearest bins, so that a small change of light
    # changes the histogram a little.
    position = np.clip(share * _BINS - 0.5, 0, _BINS - 1)
    lower = np.minimum(position.astype(int), _BINS - 2)
    upper_weight = position - lower
    channel = np.broadcast_to(np.arange(3) * _BINS, lower.shape)
    counts = np.bincount((channel + lower).ravel(), (1 - upper_weight).ravel(), 3 * _BINS)
    counts += np.bincount((channel + lower + 1).ravel(), upper_weight.ravel(), 3 * _BINS)
    return counts / counts.sum()
