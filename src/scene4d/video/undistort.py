"""Frames without lens distortion."""

import cv2
import numpy as np
from jaxtyping import UInt8

from scene4d.core.camera import Lens
from scene4d.core.errors import InputError


class Undistorter:
    """Removes the distortion of a lens from frames; the result is a pinhole image of the same K.

    Works only on frames of ``lens.image_size`` (see :meth:`Lens.scaled_to`). Pixels outside the
    original image become black.
    """

    def __init__(self, lens: Lens) -> None:
        self.lens = lens
        self._maps: tuple[np.ndarray, np.ndarray] | None = None
        if lens.bends:
            maps = cv2.fisheye if lens.is_fisheye else cv2
            u, v = maps.initUndistortRectifyMap(
                lens.K, lens.distortion, np.eye(3), lens.K, lens.image_size, cv2.CV_32FC1
            )
            u += np.float32(lens.K[0, 1] / lens.K[1, 1]) * (v - np.float32(lens.K[1, 2]))
            self._maps = cv2.convertMaps(u, v, cv2.CV_16SC2)  # fixed point: twice as fast

    def __call__(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> UInt8[np.ndarray, "h w 3"]:
        """The undistorted frame. Raises :class:`InputError` for a frame of another size."""
        height, width = image_bgr.shape[:2]
        if (width, height) != self.lens.image_size:
            raise InputError(
                f"the frame is {width}x{height} but the lens is for "
                f"{self.lens.image_size[0]}x{self.lens.image_size[1]} images; scale the lens first"
            )
        if self._maps is None:
            return image_bgr
        return cv2.remap(image_bgr, *self._maps, interpolation=cv2.INTER_LINEAR)
