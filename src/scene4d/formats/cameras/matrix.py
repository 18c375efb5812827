"""A bare 3x4 projection matrix: 12 numbers as text (spaces or commas), or as a JSON list.

World metres, Z up, to undistorted pixels with centres at integers, up to a factor. Distortion
has no place in it and is left out on writing. Text after ``#`` is not read.
"""

import json
import re
from pathlib import Path

import numpy as np

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.text import decimal, floats, read_text
from scene4d.formats.cameras.contract import CameraFormat, ImageSize
from scene4d.formats.cameras.pinhole import camera_from_projection

_SEPARATORS = re.compile(r"[\s,;]+")


def _tokens(text: str) -> list[tuple[int, str]]:
    return [
        (number, token)
        for number, line in enumerate(text.splitlines(), start=1)
        for token in _SEPARATORS.split(line.partition("#")[0])
        if token
    ]


def _sniff(path: Path, head: str) -> bool:
    if head.lstrip().startswith("["):
        return True
    tokens = [token for _, token in _tokens(head)]
    try:
        return len([float(token) for token in tokens]) == 12
    except ValueError:
        return False


def _json_values(text: str) -> np.ndarray:
    try:
        rows = json.loads(text)
    except (ValueError, RecursionError) as error:
        raise InputError(f"is not JSON: {error}") from error
    flat: list[object] = []
    for row in rows if isinstance(rows, list) else []:
        flat.extend(row if isinstance(row, list) else [row])
    return floats(flat, "matrix")


def _read(path: Path, image_size: ImageSize | None) -> Camera:
    text = read_text(path)
    if text.lstrip().startswith("["):
        values = _json_values(text)
    else:
        values = np.array([floats([token], f"line {n}")[0] for n, token in _tokens(text)])
    if len(values) != 12:
        raise InputError(f"expected the 12 numbers of a 3x4 matrix, found {len(values)}")
    return camera_from_projection(values.reshape(3, 4), image_size)


def _write(camera: Camera) -> str:
    return "\n".join(" ".join(map(decimal, row)) for row in camera.P) + "\n"


FORMAT = CameraFormat(
    name="matrix",
    description="bare 3x4 projection matrix (without distortion)",
    patterns=("*.txt", "*.csv", "*.json"),
    sniff=_sniff,
    read=_read,
    write=_write,
)
