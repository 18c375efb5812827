"""KRTD, the camera files of Kitware's KWIVER and of the MEVA data set.

K (3 rows), R (3 rows), T (1 row) and distortion (1 row, OpenCV's order, may be missing), text.
``x_cam = R X + T`` in metres; pixel centres at integers; no image size.
"""

from pathlib import Path

import numpy as np

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.text import decimal, floats, read_text
from scene4d.formats._numbers import all_numbers
from scene4d.formats.cameras._contract import CameraFormat, ImageSize
from scene4d.formats.cameras._fields import intrinsic_matrix
from scene4d.formats.cameras._pinhole import five_coefficients, size_for


def _rows(text: str) -> list[tuple[int, list[str]]]:
    lines = enumerate(text.splitlines(), start=1)
    return [(number, line.split()) for number, line in lines if line.strip()]


def _sniff(path: Path, head: str) -> bool:
    rows = [tokens for _, tokens in _rows(head)][:7]
    looks = len(rows) == 7 and all(len(row) == 3 and all_numbers(row) for row in rows)
    return path.suffix.lower() == ".krtd" or looks


def _read(path: Path, image_size: ImageSize | None) -> Camera:
    rows = _rows(read_text(path))
    for number, tokens in rows[:7]:
        if len(tokens) != 3:
            raise InputError(f"line {number}: expected 3 numbers, found {len(tokens)}")
    if not 7 <= len(rows) <= 8:
        raise InputError(
            f"expected 7 or 8 rows of numbers (K, R, T, distortion), found {len(rows)}"
        )
    values = [floats(tokens, f"line {number}") for number, tokens in rows]
    K = intrinsic_matrix("K", [row.tolist() for row in values[:3]])
    distortion = five_coefficients(values[7]) if len(values) == 8 else np.zeros(5)
    return Camera(size_for(K, image_size), K, distortion, np.array(values[3:6]), values[6])


def _write(camera: Camera) -> str:
    blocks = [camera.K, camera.R, camera.t[None], camera.distortion[None]]
    return "\n\n".join(
        "\n".join(" ".join(map(decimal, row)) for row in block) for block in blocks
    ) + "\n"  # fmt: skip


FORMAT = CameraFormat("krtd", "Kitware KRTD (MEVA)", _sniff, _read, _write)
