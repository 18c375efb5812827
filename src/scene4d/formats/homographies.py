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
import re
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.ground_map import GroundMap
from scene4d.core.text import floats, head_text, prefixed, read_text
from scene4d.formats.cameras import camera_formats, read_camera

_SEPARATORS = re.compile(r"[\s,;]+")
_NUMBERS = 9
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
    try:
        return GroundMap(image_size, _matrix(read_text(path)))
    except InputError as error:
        raise prefixed(error, path) from error


def looks_like_homography(path: str | os.PathLike[str]) -> bool:
    """Whether a file holds nine numbers and nothing else, or JSON with one 3x3 list.

    Raises :class:`InputError` where the file cannot be read.
    """
    path = Path(path)
    try:
        text = head_text(path, _LARGEST)
    except InputError as error:
        raise prefixed(error, path) from error
    if _is_json(text):
        try:
            values = json.loads(text)
        except (ValueError, RecursionError):
            return False
        if isinstance(values, dict):
            return not _OF_A_CAMERA.intersection(map(str.casefold, values)) and (
                len(_square_fields(values)) == 1
                or any("homography" in name.casefold() for name in values)
            )
        return len(_flat(values)) == _NUMBERS
    tokens = [token for _, token in _tokens(text)]
    try:
        return len([float(token) for token in tokens]) == _NUMBERS
    except ValueError:
        return False


def read_reference(
    path: str | os.PathLike[str], *, image_size: tuple[int, int] | None = None
) -> Camera | GroundMap:
    """What a calibration is held against: a camera of any known format, or a ground homography.

    ``image_size`` is that of the footage; a homography needs it. Raises :class:`InputError` for
    files that are neither, for a lens without a pose, and as :func:`read_ground_map` and
    :func:`~scene4d.formats.cameras.read_camera`.
    """
    path = Path(path)
    if looks_like_homography(path):
        if image_size is None:
            raise InputError(
                f"{path}: a homography carries no image size; give that of its images "
                "(--image-size WxH)"
            )
        return read_ground_map(path, image_size=image_size)
    head = head_text(path)
    if head.strip() and not any(known.sniff(path, head) for known in camera_formats()):
        names = ", ".join(known.name for known in camera_formats())
        raise InputError(
            f"{path}: is neither a camera file (known: {names}) nor a homography (the nine numbers "
            "of a 3x3 matrix, pixels to metres, as text or JSON)"
        )
    camera = read_camera(path, image_size=image_size)
    if not isinstance(camera, Camera):
        raise InputError(f"{path}: holds a lens without a pose, and cannot be a reference")
    return camera


def _matrix(text: str) -> Float[np.ndarray, "3 3"]:
    if _is_json(text):
        return _json_matrix(text)
    tokens = _tokens(text)
    values = np.array([floats([token], f"line {n}")[0] for n, token in tokens])
    if len(values) != _NUMBERS:
        line = tokens[min(_NUMBERS, len(tokens) - 1)][0] if tokens else 1
        raise InputError(
            f"line {line}: expected the 9 numbers of a 3x3 homography, found {len(values)}"
        )
    return values.reshape(3, 3)


def _json_matrix(text: str) -> Float[np.ndarray, "3 3"]:
    try:
        values = json.loads(text)
    except ValueError as error:
        line = getattr(error, "lineno", 1)
        raise InputError(f"line {line}: is not JSON: {error}") from error
    except RecursionError as error:
        raise InputError(f"is not JSON: {error}") from error
    where = "homography"
    if isinstance(values, dict):
        fields = _square_fields(values)
        if len(fields) != 1:
            found = ", ".join(map(repr, fields)) or "none"
            raise InputError(f"expected one field that is a 3x3 list of numbers, found {found}")
        where, values = f"field {fields[0]!r}", values[fields[0]]
    found_values = floats(_flat(values), where)
    if len(found_values) != _NUMBERS:
        raise InputError(f"{where}: expected a 3x3 list of numbers, found {len(found_values)}")
    return found_values.reshape(3, 3)


def _is_json(text: str) -> bool:
    return text.lstrip()[:1] in ("[", "{")


def _tokens(text: str) -> list[tuple[int, str]]:
    """Every word with its line."""
    return [
        (number, token)
        for number, line in enumerate(text.splitlines(), start=1)
        for token in _SEPARATORS.split(line.partition("#")[0])
        if token
    ]


def _flat(value: Any) -> list[object]:
    """The entries of a list of lists (or of a plain list), row by row."""
    out: list[object] = []
    for row in value if isinstance(value, list) else []:
        out.extend(row if isinstance(row, list) else [row])
    return out


def _square_fields(values: Mapping[str, Any]) -> list[str]:
    return [
        name
        for name, value in values.items()
        if isinstance(value, list)
        and [len(row) if isinstance(row, list) else 0 for row in value] == [3, 3, 3]
    ]
