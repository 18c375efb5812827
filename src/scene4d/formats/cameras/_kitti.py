"""KITTI calibration text: intrinsics of the left colour camera; read only.

Lines ``NAME: numbers``. ``P2`` of the object and tracking benchmarks, or ``P_rect_02`` of the raw
recordings (``calib_cam_to_cam.txt``), is the 3x4 projection of the rectified image 02, whose left
3x3 part is K (Geiger et al. 2013, section IV); rectified images have no distortion. ``S_rect_02``
is the image size; the benchmarks' files carry none. Poses are given to the vehicle's other
sensors, not to the ground, so this is a lens.
"""

from pathlib import Path

import numpy as np

from scene4d.core.camera import Lens
from scene4d.core.errors import InputError
from scene4d.core.text import floats, read_text
from scene4d.formats._numbers import lines_of
from scene4d.formats.cameras._contract import CameraFormat, ImageSize

_PROJECTIONS = ("P2:", "P_rect_02:")
_SIZE = "S_rect_02:"


def _sniff(path: Path, head: str) -> bool:
    return any(line.startswith(_PROJECTIONS) for line in head.splitlines())


def _read(path: Path, image_size: ImageSize | None) -> Lens:
    K = None
    for where, line in lines_of(read_text(path)):
        if line.startswith(_PROJECTIONS):
            K = _exactly(12, line, "the 12 numbers of a 3x4 matrix", where).reshape(3, 4)[:, :3]
        elif line.startswith(_SIZE):
            width, height = _exactly(2, line, "width and height", where)
            image_size = int(width), int(height)
    if K is None:
        raise InputError(f"no line begins with {' or '.join(_PROJECTIONS)}")
    if image_size is None:
        raise InputError("the file carries no image size; give image_size")
    return Lens(image_size, K)


def _exactly(count: int, line: str, what: str, where: str) -> np.ndarray:
    values = floats(line.split()[1:], where)
    if len(values) != count:
        raise InputError(f"{where}: expected {what}, found {len(values)} numbers")
    return values


FORMAT = CameraFormat("kitti", "KITTI calibration text (intrinsics only; read only)", _sniff, _read)
