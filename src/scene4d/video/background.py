"""The background without people: the median of a few frames."""

from pathlib import Path

import cv2
import numpy as np
from jaxtyping import UInt8

from scene4d.video.frames import Frame

_MAX_FRAMES = 21
_MIN_FRAMES = 5
"""More frames add little to a median; with fewer, standing people remain. Chosen by hand."""
MAX_BYTES = 200e6
"""Memory limit for the kept frames; of larger frames fewer are kept."""


class Background:
    """Keeps a few of the sampled frames, spread over the clip, and computes their median."""

    def __init__(self, image_size: tuple[int, int], expected_frames: int | None) -> None:
        width, height = image_size
        room = max(3, min(_MAX_FRAMES, int(MAX_BYTES / (width * height * 3))))
        self._step = max(1, -(-(expected_frames or room) // room))
        self._room = room
        self._seen = 0
        self._kept: list[np.ndarray] = []

    def add(self, frame: Frame) -> None:
        """Offer one frame; it is copied only if it is kept."""
        if self._seen % self._step == 0 and len(self._kept) < self._room:
            self._kept.append(frame.image_bgr.copy())
        self._seen += 1

    @property
    def kept_bgr(self) -> list[UInt8[np.ndarray, "h w 3"]]:
        """The frames that were kept."""
        return self._kept

    @property
    def is_median(self) -> bool:
        """Whether enough frames were kept to remove moving objects."""
        return len(self._kept) >= _MIN_FRAMES

    def image(self) -> UInt8[np.ndarray, "h w 3"] | None:
        """The median image; the first frame if there are too few; None if there are none."""
        if not self._kept:
            return None
        if not self.is_median:
            return self._kept[0]
        rows = []
        for top in range(0, self._kept[0].shape[0], 64):  # in strips, to save memory
            strip = np.stack([image[top : top + 64] for image in self._kept])
            middle = strip.shape[0] // 2
            rows.append(np.partition(strip, middle, axis=0)[middle])
        return np.concatenate(rows)


def calibrated_view(path: Path | None, image_size: tuple[int, int]) -> np.ndarray | None:
    """The view as calibrated; None if it was not kept or its size differs."""
    if path is None or not path.is_file():
        return None
    image = cv2.imread(str(path))
    if image is None or image.shape[1::-1] != image_size:
        return None
    return np.asarray(image)
