"""``.ci`` camera file of the Oxford TownCentre data set; read only.

Lines ``Name = value``: ``x_cam = R(q) X + t`` with q = (x, y, z, w), metres, Z up; OpenCV's
distortion K1 K2 P1 P2; pixel centres at integers (the centre of 1920 pixels is 959.5).
"""

from pathlib import Path

import numpy as np

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.text import floats, quoted, read_text
from scene4d.formats._numbers import lines_of
from scene4d.formats.cameras._contract import CameraFormat, ImageSize
from scene4d.formats.cameras._pinhole import five_coefficients, rotation_of_quaternion, size_for

_K = ("FocalLengthX", "Skew", "PrincipalPointX", "FocalLengthY", "PrincipalPointY")
_QUATERNION = ("RotationX", "RotationY", "RotationZ", "RotationW")
_TRANSLATION = ("TranslationX", "TranslationY", "TranslationZ")
_DISTORTION = ("DistortionK1", "DistortionK2", "DistortionP1", "DistortionP2")


def _sniff(path: Path, head: str) -> bool:
    return "FocalLengthX" in head and "RotationW" in head


def _values(text: str) -> dict[str, float]:
    values = {}
    for where, line in lines_of(text):
        name, equals, value = line.partition("=")
        if not equals:
            raise InputError(f"{where}: expected `Name = value`, found {quoted(line.strip())}")
        values[name.strip()] = float(floats([value.strip()], where)[0])
    missing = [n for n in (*_K, *_QUATERNION, *_TRANSLATION, *_DISTORTION) if n not in values]
    if missing:
        raise InputError(f"field {missing[0]!r} is missing")
    return values


def _read(path: Path, image_size: ImageSize | None) -> Camera:
    values = _values(read_text(path))
    fx, skew, cx, fy, cy = (values[name] for name in _K)
    K = np.array([[fx, skew, cx], [0, fy, cy], [0, 0, 1.0]])
    return Camera(
        image_size=size_for(K, image_size),
        K=K,
        distortion=five_coefficients(np.array([values[name] for name in _DISTORTION])),
        R=rotation_of_quaternion([values[name] for name in _QUATERNION], "the rotation"),
        t=np.array([values[name] for name in _TRANSLATION]),
    )


FORMAT = CameraFormat("towncentre", "TownCentre .ci (read only)", _sniff, _read)
