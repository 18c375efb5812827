"""Small pictures as files."""

import numpy as np
from jaxtyping import UInt8


def jpeg(image_bgr: UInt8[np.ndarray, "h w 3"], quality: int, scale: float = 1.0) -> bytes:
    """A picture as JPEG, shrunk where ``scale`` is below one; it is never enlarged."""
    import cv2

    if scale < 1:
        image_bgr = cv2.resize(image_bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    coded = cv2.imencode(".jpg", image_bgr, [cv2.IMWRITE_JPEG_QUALITY, quality])[1]
    return bytes(coded.tobytes())
