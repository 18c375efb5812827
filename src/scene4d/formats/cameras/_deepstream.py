"""NVIDIA DeepStream's ``camInfo`` YAML for single- and multi-view 3D tracking (Gst-nvtracker).

``projectionMatrix_3x4_w2p``: 12 numbers, row-major, world to pixels counted from the top left
pixel; ``projectionMatrix_3x4``: the same, counted from the image centre, which is
``((w - 1) / 2, (h - 1) / 2)`` here, so that a principal point at the centre becomes 0 exactly.
The tracker takes either; NVIDIA's multi-view tools read ``_w2p`` alone, so both are written.
``modelInfo`` is the cylinder that stands for a person; NVIDIA's sample gives it and the world in
centimetres, which is told from the cylinder's height. The matrices map to undistorted pixels:
distortion has no place in the file and is left out on writing.
"""

from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.body import BODY_RADIUS_M, PERSON_HEIGHT_M
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.text import decimal, floats, read_text
from scene4d.formats.cameras import _fields as fields
from scene4d.formats.cameras._contract import CameraFormat, ImageSize
from scene4d.formats.cameras._pinhole import decompose, size_for

_CENTRED, _CORNER = "projectionMatrix_3x4", "projectionMatrix_3x4_w2p"
_UNITS = ((0.5, 3.0, 1.0), (50.0, 300.0, 0.01), (500.0, 3000.0, 0.001))
"""A person's height tells the unit of the file: (least, most, metres per unit)."""


def _sniff(path: Path, head: str) -> bool:
    return _CENTRED in head


def _metres_per_unit(values: Mapping[str, Any]) -> float:
    info = values.get("modelInfo")
    if isinstance(info, list):  # one entry per class
        info = info[0] if info else None
    if not isinstance(info, Mapping) or "height" not in info:
        return 1.0
    height = float(floats([info["height"]], "field 'modelInfo.height'")[0])
    for least, most, metres in _UNITS:
        if least <= height <= most:
            return metres
    raise InputError(
        f"field 'modelInfo.height': {height:g} is no person's height in metres, centimetres or "
        "millimetres, so the unit of the file is unknown"
    )


def _matrix(name: str, value: Any) -> np.ndarray:
    if isinstance(value, list) and any(isinstance(row, list) for row in value):
        raise InputError(
            f"field {name!r}: expected 12 numbers in one list, found nested rows, as other tools "
            f"write them for pixels counted from the corner; if so, flatten them as {_CORNER!r}"
        )
    return fields.matrix(name, value, 3, 4)


def _read(path: Path, image_size: ImageSize | None) -> Camera:
    values = fields.yaml_fields(read_text(path))
    name, value = fields.require(values, _CORNER, _CENTRED)
    K, R, t = decompose(_matrix(name, value))
    if name == _CENTRED:
        if image_size is None:
            raise InputError(
                f"field {name!r} counts pixels from the image centre and the file carries no "
                "image size; give image_size"
            )
        K[:2, 2] += (np.array(image_size) - 1) / 2
    return Camera(image_size=size_for(K, image_size), K=K, R=R, t=t * _metres_per_unit(values))


def _write(camera: Camera) -> str:
    """Text of the file; a distorted camera keeps its undistorted P."""
    centred = np.eye(3)
    centred[:2, 2] = -(np.array(camera.image_size) - 1) / 2
    width, height = camera.image_size
    return "\n".join(
        [
            f"# World metres, Z up, to pixels of {width}x{height} images without lens distortion;",
            "# row-major. Pixels count from the centre of the top left pixel:",
            *_numbers(_CORNER, camera.P),
            "# and from the image centre:",
            *_numbers(_CENTRED, centred @ camera.P),
            "# The cylinder that stands for a person, in metres.",
            "modelInfo:",
            f"  height: {PERSON_HEIGHT_M}",
            f"  radius: {BODY_RADIUS_M}",
            "",
        ]
    )


def _numbers(name: str, values: np.ndarray) -> list[str]:
    return [f"{name}:", *(f"  - {decimal(x)}" for x in values.ravel())]


FORMAT = CameraFormat(
    "deepstream", "NVIDIA DeepStream camInfo YAML (without distortion)", _sniff, _read, _write
)
