"""COLMAP's text model: a folder with ``cameras.txt`` and ``images.txt``, or ``frames.txt``.

The centre of COLMAP's first pixel is (0.5, 0.5), ours is (0, 0): principal points shift by half
a pixel. Poses are cam_from_world, quaternions (w, x, y, z); COLMAP's world has no units of its
own, it must be metres with Z up. A folder without images is a lens.

Since version 3.12 a pose is that of a rig: ``frames.txt`` has rig_from_world, ``rigs.txt``
sensor_from_rig, and they count where both files list any; the poses of ``images.txt`` repeat them.
"""

from collections.abc import Iterator
from pathlib import Path
from typing import NamedTuple

import numpy as np

from scene4d.core import geometry
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.text import decimal, floats, quoted, read_text
from scene4d.formats._numbers import lines_of
from scene4d.formats.cameras._contract import CameraFormat, ImageSize
from scene4d.formats.cameras._pinhole import lens_of, rotation_of_quaternion

# Of each model the positions of fx, fy, cx, cy among its parameters, and how many it has; what
# follows cy are distortion coefficients in OpenCV's order. After COLMAP's documentation of models.
_MODELS: dict[str, tuple[tuple[int, int, int, int], int]] = {
    "SIMPLE_PINHOLE": ((0, 0, 1, 2), 3),
    "PINHOLE": ((0, 1, 2, 3), 4),
    "SIMPLE_RADIAL": ((0, 0, 1, 2), 4),
    "RADIAL": ((0, 0, 1, 2), 5),
    "OPENCV": ((0, 1, 2, 3), 8),
    "FULL_OPENCV": ((0, 1, 2, 3), 12),
    "SIMPLE_RADIAL_FISHEYE": ((0, 0, 1, 2), 4),
    "RADIAL_FISHEYE": ((0, 0, 1, 2), 5),
    "OPENCV_FISHEYE": ((0, 1, 2, 3), 8),
}
_HALF_PIXEL = 0.5
_POSE = 7  # numbers: QW QX QY QZ TX TY TZ


class _Posed(NamedTuple):
    """An image's camera, and cam_from_world."""

    camera: str
    R: np.ndarray
    t: np.ndarray


def _folder(path: Path) -> Path:
    return path if path.is_dir() else path.parent


def _sniff(path: Path, head: str) -> bool:
    if path.is_dir():
        return any((path / name).is_file() for name in ("cameras.txt", "cameras.bin"))
    return path.name in ("cameras.txt", "images.txt", "cameras.bin", "images.bin")


def _lines(path: Path) -> Iterator[tuple[str, list[str]]]:
    """Where each line is, and its words, without comments and blank lines."""
    for where, line in lines_of(read_text(path), ("#",)):
        yield f"{path.name} {where}", line.split()


def _lens(where: str, tokens: list[str]) -> Lens:
    if len(tokens) < 5:
        raise InputError(f"{where}: expected CAMERA_ID MODEL WIDTH HEIGHT PARAMS...")
    model = tokens[1]
    if model not in _MODELS:
        raise InputError(
            f"{where}: camera model {quoted(model)} is not supported; convert it to one of "
            f"{', '.join(_MODELS)} (undistort the images, or calibrate with one of these)"
        )
    width, height = floats(tokens[2:4], where)
    values = floats(tokens[4:], where)
    places, count = _MODELS[model]
    if len(values) != count:
        raise InputError(f"{where}: {model} has {count} parameters, found {len(values)}")
    fx, fy, cx, cy = values[list(places)]
    K = np.array([[fx, 0, cx - _HALF_PIXEL], [0, fy, cy - _HALF_PIXEL], [0, 0, 1]])
    size, distortion = (int(width), int(height)), values[places[-1] + 1 :]
    try:
        return lens_of(size, K, distortion, fisheye=model.endswith("FISHEYE"))
    except InputError as error:
        raise InputError(f"{where}: {error}") from error


def _lenses(folder: Path) -> dict[str, Lens]:
    path = folder / "cameras.txt"
    if not path.is_file():
        if (folder / "cameras.bin").is_file():
            raise InputError(
                "binary COLMAP models are not read; convert this one with "
                "`colmap model_converter --output_type TXT`"
            )
        raise InputError("no cameras.txt in the folder")
    lenses = {tokens[0]: _lens(where, tokens) for where, tokens in _lines(path)}
    if not lenses:
        raise InputError("cameras.txt: holds no camera")
    return lenses


def _pose(tokens: list[str], where: str) -> tuple[np.ndarray, np.ndarray]:
    if len(tokens) < _POSE:
        raise InputError(
            f"{where}: expected a pose QW QX QY QZ TX TY TZ, found {len(tokens)} words"
        )
    w, x, y, z, *t = floats(tokens[:_POSE], where)
    return rotation_of_quaternion([x, y, z, w], where), np.array(t)


def _posed_images(path: Path) -> list[_Posed]:
    """Of ``images.txt``; the line of 2-D points after each image may be empty."""
    found, points = [], False
    for number, line in enumerate(read_text(path).splitlines(), start=1):
        if points:
            points = False
        elif line.strip() and not line.lstrip().startswith("#"):
            where, tokens = f"images.txt line {number}", line.split(maxsplit=9)
            if len(tokens) < 9:
                raise InputError(f"{where}: expected IMAGE_ID QW QX QY QZ TX TY TZ CAMERA_ID NAME")
            found.append(_Posed(tokens[8], *_pose(tokens[1:8], where)))
            points = True
    return found


def _posed_frames(folder: Path) -> list[_Posed]:
    """Of ``frames.txt``: FRAME_ID RIG_ID RIG_FROM_WORLD NUM_DATA_IDS (TYPE SENSOR_ID DATA_ID)..."""
    rigs = dict(_rig(*line) for line in _lines(folder / "rigs.txt"))
    found = []
    for where, tokens in _lines(folder / "frames.txt"):
        data = tokens[10:]
        if len(tokens) < 10 or len(data) % 3:
            raise InputError(
                f"{where}: expected FRAME_ID RIG_ID QW QX QY QZ TX TY TZ NUM_DATA_IDS and "
                "TYPE SENSOR_ID DATA_ID for each"
            )
        R, t = _pose(tokens[2:9], where)
        for kind, sensor in zip(data[::3], data[1::3], strict=True):
            if kind != "CAMERA":
                continue
            pose = rigs.get(tokens[1], {}).get(sensor)
            if pose is None:
                raise InputError(
                    f"{where}: rigs.txt has no pose of camera {quoted(sensor)} in rig "
                    f"{quoted(tokens[1])}"
                )
            found.append(_Posed(sensor, pose[0] @ R, pose[0] @ t + pose[1]))
    return found


def _rig(where: str, tokens: list[str]) -> tuple[str, dict[str, tuple[np.ndarray, np.ndarray]]]:
    """A rig's name and sensor_from_rig of its cameras: RIG_ID NUM_SENSORS REF_TYPE REF_ID, then
    TYPE ID HAS_POSE and, where it is 1, the pose, of each other sensor.
    """
    poses = {}
    if tokens[2:3] == ["CAMERA"] and len(tokens) > 3:
        poses[tokens[3]] = np.eye(3), np.zeros(3)
    rest = tokens[4:]
    while rest:
        kind, sensor, posed, *rest = [*rest, "", ""] if len(rest) < 3 else rest
        if posed == "1":
            if kind == "CAMERA":
                poses[sensor] = _pose(rest, where)
            rest = rest[_POSE:]
        elif posed != "0":
            raise InputError(f"{where}: HAS_POSE must be 0 or 1, found {quoted(posed)}")
    return tokens[0], poses


def _posed(folder: Path) -> list[_Posed]:
    if (folder / "rigs.txt").is_file() and (folder / "frames.txt").is_file():
        frames = _posed_frames(folder)
        if frames:
            return frames
    images = folder / "images.txt"
    return _posed_images(images) if images.is_file() else []


def _read(path: Path, image_size: ImageSize | None) -> Camera | Lens:
    folder = _folder(path)
    lenses = _lenses(folder)
    images = _posed(folder)
    if not images:
        return _read_lens(path, image_size)
    if len(images) > 1:
        raise InputError(
            f"the model holds {len(images)} images, a camera needs exactly one; keep that image"
        )
    (image,) = images
    if image.camera not in lenses:
        raise InputError(f"camera {quoted(image.camera)} is not in cameras.txt")
    lens = lenses[image.camera]
    return lens.posed(image.R, image.t)


def _read_lens(path: Path, image_size: ImageSize | None) -> Lens:
    lenses = _lenses(_folder(path))
    if len(lenses) > 1:
        raise InputError(f"cameras.txt holds {len(lenses)} cameras; keep the line of one")
    return next(iter(lenses.values()))


def _write(camera: Camera) -> dict[str, str]:
    K, d = camera.K, camera.distortion
    if K[0, 1]:
        raise InputError(f"COLMAP's camera models have no skew, the camera's K has {K[0, 1]}")
    values = [K[0, 0], K[1, 1], K[0, 2] + _HALF_PIXEL, K[1, 2] + _HALF_PIXEL]
    model = "PINHOLE"
    if camera.is_fisheye:
        model, values = "OPENCV_FISHEYE", [*values, *d]
    elif d[4]:
        model, values = "FULL_OPENCV", [*values, *d, 0.0, 0.0, 0.0]
    elif np.any(d):
        model, values = "OPENCV", [*values, *d[:4]]
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
    "colmap", "COLMAP text model (a folder)", _sniff, _read, _write, _read_lens, fisheye=True
)
