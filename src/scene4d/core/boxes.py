"""How boxes (x1, y1, x2, y2) lie over each other; leading axes broadcast."""

import numpy as np
from jaxtyping import Float

_LEAST_PX2 = 1e-9
"""Taken for no area at all, which nothing can be a share of."""


def area_px2(box_xyxy: Float[np.ndarray, "*n 4"]) -> Float[np.ndarray, "*n"]:
    """Width times height."""
    wide, tall = (box_xyxy[..., one + 2] - box_xyxy[..., one] for one in (0, 1))
    return np.asarray(wide * tall)


def covered(
    box_xyxy: Float[np.ndarray, "*n 4"], by_xyxy: Float[np.ndarray, "*m 4"]
) -> Float[np.ndarray, "*k"]:
    """Share of boxes that others cover; 0 for a box without an area, NaN where one is NaN."""
    shared = _shared_px2(box_xyxy, by_xyxy)
    return np.asarray(shared / np.maximum(area_px2(box_xyxy), _LEAST_PX2))


def iou(
    box_xyxy: Float[np.ndarray, "*n 4"], other_xyxy: Float[np.ndarray, "*m 4"]
) -> Float[np.ndarray, "*k"]:
    """Intersection over union; 0 for two boxes without an area, NaN where one is NaN."""
    shared = _shared_px2(box_xyxy, other_xyxy)
    union = area_px2(box_xyxy) + area_px2(other_xyxy) - shared
    return np.asarray(shared / np.maximum(union, _LEAST_PX2))


def _shared_px2(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    # One side after the other: NumPy is slow along an axis of two.
    wide, tall = (
        np.minimum(a[..., one + 2], b[..., one + 2]) - np.maximum(a[..., one], b[..., one])
        for one in (0, 1)
    )
    return np.asarray(np.maximum(wide, 0.0) * np.maximum(tall, 0.0))
