"""How boxes (x1, y1, x2, y2) lie over each other; leading axes broadcast."""

import numpy as np
from jaxtyping import Float


def area_px2(box_xyxy: Float[np.ndarray, "*n 4"]) -> Float[np.ndarray, "*n"]:
    """Width times height."""
    return np.asarray((box_xyxy[..., 2:] - box_xyxy[..., :2]).prod(axis=-1))


def covered(
    box_xyxy: Float[np.ndarray, "*n 4"], by_xyxy: Float[np.ndarray, "*m 4"]
) -> Float[np.ndarray, "*k"]:
    """Share of boxes that others cover; 0 for a box without an area, NaN where one is NaN."""
    return _share(_shared_px2(box_xyxy, by_xyxy), area_px2(box_xyxy))


def iou(
    box_xyxy: Float[np.ndarray, "*n 4"], other_xyxy: Float[np.ndarray, "*m 4"]
) -> Float[np.ndarray, "*k"]:
    """Intersection over union; 0 for two boxes without an area, NaN where one is NaN."""
    shared = _shared_px2(box_xyxy, other_xyxy)
    return _share(shared, area_px2(box_xyxy) + area_px2(other_xyxy) - shared)


def _shared_px2(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    low, high = np.maximum(a[..., :2], b[..., :2]), np.minimum(a[..., 2:], b[..., 2:])
    return np.asarray(np.clip(high - low, 0.0, None).prod(axis=-1))


def _share(part: np.ndarray, whole: np.ndarray) -> np.ndarray:
    return np.asarray(part / np.maximum(whole, 1e-9))
