"""What a detector is."""

from typing import Protocol, runtime_checkable

import numpy as np
import supervision as sv
from jaxtyping import UInt8

from scene4d.core.errors import InputError


@runtime_checkable
class Detector(Protocol):
    """Anything that finds persons (and perhaps other objects) in one picture."""

    def detect(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> sv.Detections:
        """Boxes in pixels of the picture with a confidence each.

        Pixel centres lie at integers: the image reaches from -0.5 to its width - 0.5. Where
        ``data["class_name"]`` is given, only rows named ``person`` are people; where it is not,
        all rows are. Names are those of COCO.
        """
        ...


def require_bgr(image_bgr: np.ndarray) -> None:
    """Raise :class:`InputError` for anything but an image (h, w, 3) of bytes with a pixel in it.

    A network would take grey or float images too, and find other things in them.
    """
    shape = tuple(image_bgr.shape)
    if len(shape) != 3 or shape[2] != 3 or 0 in shape or image_bgr.dtype != np.uint8:
        raise InputError(
            f"image: found shape {shape} of {image_bgr.dtype}, expected (height, width, 3) of "
            "uint8, blue first"
        )
