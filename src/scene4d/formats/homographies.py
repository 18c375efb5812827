"""A homography of the ground: nine numbers that map pixels to ground metres.

Text: nine numbers, row by row, separated by blanks, commas, semicolons or ends of lines; what
follows ``#`` is not read. JSON: a 3x3 list, or an object with one 3x3 list among its fields.
``[X, Y, W] = H [u, v, 1]`` with the pixel (0, 0) in the top left corner, ground at (X/W, Y/W).

VIRAT's scene homographies (``*_homography_img2world.txt``) are such text, with commas. Their
README calls them roughly estimated, and the world scene-dependent; it names no unit. Read as
metres, that of scene 0102 is the ground under a camera 5.4 m high (1920x1080, focal length 944 px,
tilt 21°); that of scene 0100 fits no camera, so it serves as a map alone.
"""

import json
import os
from pathlib import Path

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.ground_map import GroundMap
from scene4d.core.text import head_text, in_file
from scene4d.formats._choosing import names, recognised
from scene4d.formats._numbers import (
    all_numbers,
    flat,
    is_json,
    matrix_fields,
    read_matrix,
    sane_numbers,
    words,
)
from scene4d.formats.cameras import camera_formats, read_camera

_LARGEST = 1 << 16
"""Bytes; nine numbers and their comments take far less."""
_OF_A_CAMERA = frozenset(
    {"k", "r", "camera_matrix", "cameramatrix", "intrinsic_matrix", "intrinsics"}
    | {"rotation", "rotation_matrix", "schema"}
)
"""Fields of camera files, so that a K or an R alone is not taken for a map of the ground."""


def read_ground_map(path: str | os.PathLike[str], *, image_size: tuple[int, int]) -> GroundMap:
    """The ground map of a homography file; ``image_size`` is that of the images it is for.

    Raises :class:`InputError` naming the file and the line or field: for what is no number, for
    another count of numbers, and for a matrix that :class:`GroundMap` refuses.
    """
    path = Path(path)
    with sane_numbers(path, "map"):
        return GroundMap(image_size, read_matrix(path, 3, 3, "homography"))


def read_reference(
    path: str | os.PathLike[str], *, image_size: tuple[int, int] | None = None
) -> Camera | GroundMap:
    """What a calibration is held against: a camera of any known format, or a ground homography.

    ``image_size`` is that of the footage; a homography needs it. Raises :class:`InputError` for
    files that are neither, for a lens without a pose, and as :func:`read_ground_map` and
    :func:`~scene4d.formats.cameras.read_camera`.
    """
    path = Path(path)
    with in_file(path):
        head = head_text(path, _LARGEST)
    if _looks_like_homography(head):
        if image_size is None:
            raise InputError(
                f"{path}: a homography carries no image size; give image_size, that of its images"
            )
        return read_ground_map(path, image_size=image_size)
    if head.strip() and recognised(camera_formats(), path, head) is None:
        raise InputError(
            f"{path}: is neither a camera file (known: {names(camera_formats())}) nor a homography "
            "(the nine numbers of a 3x3 matrix, pixels to metres, as text or JSON)"
        )
    camera = read_camera(path, image_size=image_size)
    if not isinstance(camera, Camera):
        raise InputError(f"{path}: holds a lens without a pose, and cannot be a reference")
    return camera


def _looks_like_homography(text: str) -> bool:
    """Whether it holds nine numbers and nothing else, or JSON with one 3x3 list."""
    if not is_json(text):
        tokens = [word for _, word in words(text)]
        return len(tokens) == 9 and all_numbers(tokens)
    try:
        values = json.loads(text)
    except (ValueError, RecursionError):
        return False
    if not isinstance(values, dict):
        return len(flat(values)) == 9
    return not _OF_A_CAMERA.intersection(map(str.casefold, values)) and (
        len(matrix_fields(values, 3, 3)) == 1
        or any("homography" in name.casefold() for name in values)
    )
