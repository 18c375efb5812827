"""What a detector is, and the classes that most detectors know."""

from typing import Protocol, runtime_checkable

import numpy as np
import supervision as sv
from jaxtyping import UInt8

from scene4d.core.errors import InputError

COCO80: tuple[str, ...] = (
    "person", "bicycle", "car", "motorcycle", "airplane", "bus", "train", "truck", "boat",
    "traffic light", "fire hydrant", "stop sign", "parking meter", "bench", "bird", "cat", "dog",
    "horse", "sheep", "cow", "elephant", "bear", "zebra", "giraffe", "backpack", "umbrella",
    "handbag", "tie", "suitcase", "frisbee", "skis", "snowboard", "sports ball", "kite",
    "baseball bat", "baseball glove", "skateboard", "surfboard", "tennis racket", "bottle",
    "wine glass", "cup", "fork", "knife", "spoon", "bowl", "banana", "apple", "sandwich", "orange",
    "broccoli", "carrot", "hot dog", "pizza", "donut", "cake", "chair", "couch", "potted plant",
    "bed", "dining table", "toilet", "tv", "laptop", "mouse", "remote", "keyboard", "cell phone",
    "microwave", "oven", "toaster", "sink", "refrigerator", "book", "clock", "vase", "scissors",
    "teddy bear", "hair drier", "toothbrush",
)  # fmt: skip
"""The classes of COCO, in the order that networks trained on it number them."""


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

    A network would accept grey or float images too, and find other things in them.
    """
    shape = tuple(image_bgr.shape)
    if len(shape) != 3 or shape[2] != 3 or 0 in shape or image_bgr.dtype != np.uint8:
        raise InputError(
            f"image: found shape {shape} of {image_bgr.dtype}, expected (height, width, 3) of "
            "uint8, blue first"
        )
