"""Footage that no calibration should trust, made from footage of one upright, fixed camera."""

from collections.abc import Callable, Iterator, Sequence
from pathlib import Path

import av
import cv2
import numpy as np

Images = Sequence[np.ndarray]


def turned(images: Images, quarters: int) -> Iterator[np.ndarray]:
    """As from a camera that was mounted turned, by quarters anticlockwise."""
    return (np.ascontiguousarray(np.rot90(image, quarters)) for image in images)


def spliced(
    first: Images, second: Images, is_second: Callable[[int], bool]
) -> Iterator[np.ndarray]:
    """Two cameras in one file: frame i comes from the second where ``is_second(i)``."""
    height, width = first[0].shape[:2]
    for i, image in enumerate(first):
        other = second[i % len(second)]
        yield cv2.resize(other, (width, height)) if is_second(i) else image


def write_video(path: Path, images, rate: int = 10) -> Path:
    """A video file of these images."""
    images = list(images)
    with av.open(str(path), "w") as out:
        stream = out.add_stream("libx264", rate=rate, options={"crf": "18", "preset": "ultrafast"})
        stream.height, stream.width = (side // 2 * 2 for side in images[0].shape[:2])
        stream.pix_fmt = "yuv420p"
        for image in images:
            cut = np.ascontiguousarray(image[: stream.height, : stream.width])
            out.mux(stream.encode(av.VideoFrame.from_ndarray(cut, format="bgr24")))
        out.mux(stream.encode())
    return path
