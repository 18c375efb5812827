"""A bare 3x4 projection matrix: 12 numbers as text (spaces or commas), or as JSON lists.

World metres, Z up, to undistorted pixels with centres at integers, up to a factor. Distortion
has no place in it and is left out on writing. Text after ``#`` is not read.
"""

from pathlib import Path

from scene4d.core.camera import Camera
from scene4d.core.text import decimal
from scene4d.formats._numbers import all_numbers, read_matrix, words
from scene4d.formats.cameras._contract import CameraFormat, ImageSize
from scene4d.formats.cameras._pinhole import camera_from_projection


def _sniff(path: Path, head: str) -> bool:
    tokens = [word for _, word in words(head)]
    return head.lstrip().startswith("[") or (len(tokens) == 12 and all_numbers(tokens))


def _read(path: Path, image_size: ImageSize | None) -> Camera:
    return camera_from_projection(read_matrix(path, 3, 4, "matrix"), image_size)


def _write(camera: Camera) -> str:
    return "\n".join(" ".join(map(decimal, row)) for row in camera.P) + "\n"


FORMAT = CameraFormat(
    "matrix", "bare 3x4 projection matrix (without distortion)", _sniff, _read, _write
)
