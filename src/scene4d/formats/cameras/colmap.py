"""COLMAP's text model: a folder with ``cameras.txt`` and ``images.txt``.

The centre of COLMAP's first pixel is (0.5, 0.5), ours is (0, 0): principal points shift by half
a pixel. Poses are cam_from_world, quaternions (w, x, y, z); COLMAP's world has no units of its
own, it must be metres with Z up. A folder without images is a lens.
"""

from pathlib import Path

import numpy as np

from scene4d.core import geometry
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.text import decimal, floats, read_text
from scene4d.formats.cameras.contract import CameraFormat, ImageSize
from scene4d.formats.cameras.pinhole import five_coefficients

# Of each model the positions of fx, fy, cx, cy among its parameters, and how many it has; what
# follows cy are distortion coefficients in OpenCV's order. After COLMAP's documentation of models.
_MODELS: dict[str, tuple[tuple[int, int, int, int], int]] = {
    "SIMPLE_PINHOLE": ((0, 0, 1, 2), 3),
    "PINHOLE": ((0, 1, 2, 3), 4),
    "SIMPLE_RADIAL": ((0, 0, 1, 2), 4),
    "RADIAL": ((0, 0, 1, 2), 5),
    "OPENCV": ((0, 1, 2, 3), 8),
    "FULL_OPENCV": ((0, 1, 2, 3), 12),
}
_HALF_PIXEL = 0.5


def _folder(path: Path) -> Path:
    return path if path.is_dir() else path.parent


def _sniff(path: Path, head: str) -> bool:
    if path.is_dir():
        return any((path / name).is_file() for name in ("cameras.txt", "cameras.bin"))
    return path.name in ("cameras.txt", "images.txt", "cameras.bin", "images.bin")


def _lens(number: int, tokens: list[str]) -> Lens:
    where = f"cameras.txt line {number}"
    if len(tokens) < 5:
        raise InputError(f"{where}: expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS...")
    model = tokens[1]
    if model not in _MODELS:
        raise InputError(
            f"{where}: camera model {model} is not supported; convert it to one of "
            f"{', '.join(_MODELS)} (undistort the images, or calibrate with one of these)"
        )
    width, height = floats(tokens[2:4], where)
    values = floats(tokens[4:], where)
    places, count = _MODELS[model]
    if len(values) != count:
        raise InputError(f"{where}: {model} has {count} parameters, found {len(values)}")
    fx, fy, cx, cy = values[list(places)]
    try:
        distortion = five_coefficients(values[places[-1] + 1 :])
    except InputError as error:
        raise InputError(f"{where}: {error}") from error
    K = np.array([[fx, 0, cx - _HALF_PIXEL], [0, fy, cy - _HALF_PIXEL], [0, 0, 1]])
    return Lens((int(width), int(height)), K, distortion)


def _lenses(folder: Path) -> dict[str, Lens]:
    path = folder / "cameras.txt"
    if not path.is_file():
        if (folder / "cameras.bin").is_file():
            raise InputError(
                "binary COLMAP models are not read; convert this one with "
                "`colmap model_converter --output_type TXT`"
            )
        raise InputError("no cameras.txt in the folder")
    lines = enumerate(read_text(path).splitlines(), start=1)
    rows = [(n, line.split()) for n, line in lines if line.strip() and line.strip()[0] != "#"]
    if not rows:
        raise InputError("cameras.txt: holds no camera")
    return {tokens[0]: _lens(number, tokens) for number, tokens in rows}


def _images(path: Path) -> list[tuple[int, list[str]]]:
    """Image lines alone; the line of 2-D points after each may be empty."""
    rows, points = [], False
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if points:
            points = False
        elif line.strip() and not line.lstrip().startswith("#"):
            rows.append((number, line.split(maxsplit=9)))
            points = True
    return rows


def _read(path: Path, image_size: ImageSize | None) -> Camera | Lens:
    folder = _folder(path)
    lenses = _lenses(folder)
    images = _images(folder / "images.txt") if (folder / "images.txt").is_file() else []
    if not images:
        return _read_lens(path, image_size)
    if len(images) > 1:
        raise InputError(
            f"images.txt holds {len(images)} images, a camera needs exactly one; keep the two "
            "lines of that image"
        )
    number, tokens = images[0]
    where = f"images.txt line {number}"
    if len(tokens) < 9:
        raise InputError(f"{where}: expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
    w, x, y, z, *t = floats(tokens[1:8], where)
    if tokens[8] not in lenses:
        raise InputError(f"{where}: camera {tokens[8]} is not in cameras.txt")
    if not np.any([w, x, y, z]):
        raise InputError(f"{where}: the quaternion is zero")
    R = geometry.rotation_from_quaternion(np.array([x, y, z, w]))
    lens = lenses[tokens[8]]
    return Camera(lens.image_size, lens.K, lens.distortion, R, np.array(t))


def _read_lens(path: Path, image_size: ImageSize | None) -> Camera | Lens:
    lenses = _lenses(_folder(path))
    if len(lenses) > 1:
        raise InputError(f"cameras.txt holds {len(lenses)} cameras; keep the line of one")
    return next(iter(lenses.values()))


def _write(camera: Camera) -> dict[str, str]:
    K, (k1, k2, p1, p2, k3) = camera.K, camera.distortion
    if K[0, 1]:
        raise InputError(f"COLMAP's camera models have no skew, the camera's K has {K[0, 1]}")
    values = [K[0, 0], K[1, 1], K[0, 2] + _HALF_PIXEL, K[1, 2] + _HALF_PIXEL]
    model = "PINHOLE"
    if k3:
        model, values = "FULL_OPENCV", [*values, k1, k2, p1, p2, k3, 0.0, 0.0, 0.0]
    elif np.any(camera.distortion):
        model, values = "OPENCV", [*values, k1, k2, p1, p2]
    x, y, z, w = geometry.quaternion_from_rotation(camera.R)
    pose = " ".join(map(decimal, [w, x, y, z, *camera.t]))
    width, height = camera.image_size
    return {
        "cameras.txt": "# CAMERA_ID MODEL WIDTH HEIGHT PARAMS[]\n"
        f"1 {model} {width} {height} {' '.join(map(decimal, values))}\n",
        "images.txt": "# IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME, then POINTS2D[]\n"
        f"1 {pose} 1 camera.png\n\n",
        "points3D.txt": "# POINT3D_ID X Y Z R G B ERROR TRACK[]\n",
    }


FORMAT = CameraFormat(
    name="colmap",
    description="COLMAP text model (a folder)",
    patterns=("cameras.txt",),
    sniff=_sniff,
    read=_read,
    read_lens=_read_lens,
    write=_write,
)
