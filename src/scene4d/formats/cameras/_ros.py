"""ROS ``camera_info`` YAML (``camera_calibration_parsers``): intrinsics only.

``plumb_bob`` distortion is OpenCV's (k1, k2, p1, p2, k3), ``equidistant`` that of ``cv2.fisheye``
(k1, k2, k3, k4). ``projection_matrix`` is ``[K | 0]``:
it maps the rectified camera's own frame, not the world. The pose is not part of this format.
"""

from pathlib import Path

import numpy as np

from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.text import decimal, quoted, read_text
from scene4d.formats.cameras import _fields as fields
from scene4d.formats.cameras._contract import CameraFormat, ImageSize
from scene4d.formats.cameras._pinhole import lens_of, size_for

_FISHEYE = "equidistant"
_MODELS = ("plumb_bob", "rational_polynomial", _FISHEYE)


def _sniff(path: Path, head: str) -> bool:
    return "distortion_model:" in head


def _read(path: Path, image_size: ImageSize | None) -> Lens:
    values = fields.yaml_fields(read_text(path))
    model = values.get("distortion_model")
    if model not in _MODELS:
        raise InputError(
            f"field 'distortion_model': {quoted(model)} is not supported, only "
            f"{', '.join(_MODELS)}; calibrate the lens with one of these, or undistort the footage "
            "first"
        )
    # The second and third names are those of the message itself, as ROS 1 and 2 print it.
    K = fields.intrinsic_matrix(*fields.require(values, "camera_matrix", "K", "k"))
    found = fields.find(values, "distortion_coefficients", "D", "d")
    size = fields.image_size(values) or size_for(K, image_size)
    distortion = fields.numbers(*found) if found else np.zeros(4)
    return lens_of(size, K, distortion, fisheye=model == _FISHEYE)


def _matrix(name: str, values: np.ndarray) -> str:
    data = ", ".join(map(decimal, values.ravel()))
    return f"{name}:\n  rows: {values.shape[0]}\n  cols: {values.shape[1]}\n  data: [{data}]\n"


def _write(camera: Camera) -> str:
    return (
        "# Intrinsics only: this format has no place for the camera's pose in the world.\n"
        f"image_width: {camera.image_size[0]}\nimage_height: {camera.image_size[1]}\n"
        "camera_name: camera\n"
        + _matrix("camera_matrix", camera.K)
        + f"distortion_model: {_FISHEYE if camera.is_fisheye else 'plumb_bob'}\n"
        + _matrix("distortion_coefficients", camera.distortion[None])
        + _matrix("rectification_matrix", np.eye(3))
        + _matrix("projection_matrix", np.column_stack([camera.K, np.zeros(3)]))
    )


FORMAT = CameraFormat(
    "ros", "ROS camera_info YAML (intrinsics only)", _sniff, _read, _write, fisheye=True
)
