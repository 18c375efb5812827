"""Straight edges of the scene, for its vanishing points (LSD, von Gioi et al. 2010)."""

import cv2
import numpy as np
from jaxtyping import Float, UInt8

_MIN_LENGTH = 0.02
"""Shortest edge, as a share of the image diagonal; directions of shorter ones are unreliable."""
_MARGIN = 0.01
"""Image border that is ignored, as a share of the diagonal."""
_BLACK_LEVEL = 8


def straight_edges(
    background_bgr: UInt8[np.ndarray, "h w 3"],
    hidden_xyxy: Float[np.ndarray, "n 4"] | None = None,
) -> Float[np.ndarray, "m 4"]:
    """End points ``(u1, v1, u2, v2)`` of straight edges, pixel centres at integers.

    ``hidden_xyxy`` are boxes whose edges do not belong to the scene (people in a single image).
    Edges along the image border, and along black areas left by undistortion, are dropped.
    """
    grey = cv2.cvtColor(background_bgr, cv2.COLOR_BGR2GRAY)
    found = cv2.createLineSegmentDetector(cv2.LSD_REFINE_STD).detect(grey)[0]
    if found is None:
        return np.empty((0, 4))
    xyxy = found[:, 0].astype(float)
    height, width = grey.shape
    diagonal = np.hypot(width, height)
    xyxy = xyxy[np.hypot(*(xyxy[:, 2:] - xyxy[:, :2]).T) > _MIN_LENGTH * diagonal]
    blocked = _outside(background_bgr, max(2, round(_MARGIN * diagonal)))
    for x1, y1, x2, y2 in np.empty((0, 4)) if hidden_xyxy is None else hidden_xyxy:
        blocked[max(0, int(y1)) : int(y2) + 2, max(0, int(x1)) : int(x2) + 2] = True
    along = np.linspace(0, 1, 7)[:, None, None]
    uv = np.rint(xyxy[:, :2] * (1 - along) + xyxy[:, 2:] * along).astype(int)
    u, v = uv[..., 0].clip(0, width - 1), uv[..., 1].clip(0, height - 1)
    return xyxy[~blocked[v, u].any(axis=0)]


def _outside(image_bgr: np.ndarray, margin: int) -> np.ndarray:
    """Invalid image areas: black areas that touch the border, and a margin around them."""
    dark = (image_bgr.max(axis=2) < _BLACK_LEVEL).astype(np.uint8)
    padded = np.pad(dark, 1, constant_values=1)
    # Everything black that is connected to the frame around the image.
    labels = cv2.connectedComponents(padded, connectivity=4)[1]
    frame = (labels == labels[0, 0]).astype(np.uint8)
    size = 2 * margin + 1
    grown = cv2.dilate(frame, np.ones((size, size), np.uint8))
    return grown[1:-1, 1:-1].astype(bool)
