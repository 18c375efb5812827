"""What a detector is."""

from typing import Protocol, runtime_checkable

import numpy as np
import supervision as sv
from jaxtyping import UInt8


@runtime_checkable
class Detector(Protocol):
    """Anything that finds persons (and perhaps other objects) in one picture."""

    def detect(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> sv.Detections:
        """Boxes in pixels of the picture with a confidence each.

        Pixel centres lie at integers. Where ``data["class_name"]`` is given, only rows named
        ``person`` are people; where it is not, all rows are.
        """
        ...
