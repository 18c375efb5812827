"""All camera formats. A new one is a file beside this one and a line in :data:`_FORMATS`."""

import os
from dataclasses import replace
from pathlib import Path

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.files import read_json, replace_files
from scene4d.core.text import head_text, quoted
from scene4d.formats._choosing import by_name, detected, names
from scene4d.formats._numbers import sane_numbers
from scene4d.formats.cameras import (
    _camera_json,
    _colmap,
    _deepstream,
    _is_msgs,
    _kitti,
    _krtd,
    _matrix,
    _opencv,
    _openlabel,
    _ros,
    _towncentre,
    _tsai,
)
from scene4d.formats.cameras._contract import CameraFormat, ImageSize

# The first whose sniff agrees reads the file, so the specific stand before the general.
_FORMATS: tuple[CameraFormat, ...] = (
    _openlabel.FORMAT,
    _is_msgs.FORMAT,
    _camera_json.FORMAT,
    _opencv.YAML,
    _opencv.XML,
    _krtd.FORMAT,
    _colmap.FORMAT,
    _ros.FORMAT,
    _deepstream.FORMAT,
    _tsai.FORMAT,
    _towncentre.FORMAT,
    _kitti.FORMAT,
    _matrix.FORMAT,
)


def camera_formats() -> tuple[CameraFormat, ...]:
    """Every format, in the order in which a file is tried."""
    return _FORMATS


def read_camera(
    path: str | os.PathLike[str],
    *,
    image_size: ImageSize | None = None,
    format: str | None = None,  # noqa: A002 - the word that people look for
) -> Camera | Lens:
    """Read a camera file of any known format; a :class:`Lens` where it holds no pose.

    ``image_size`` (width, height) is that of the footage: a camera measured on images of another
    size is scaled to it, and formats that carry no size take it from here (without it, it is
    inferred from the principal point). ``format`` names the format instead of detecting it.
    Raises :class:`InputError` naming the file, the line or field, and the remedy.
    """
    return _read(Path(path), image_size, format, lens=False)


def read_lens(path: str | os.PathLike[str], *, image_size: ImageSize | None = None) -> Lens:
    """Intrinsics and distortion of a camera file of any known format, for this image size.

    Raises :class:`InputError` as :func:`read_camera`, and where the aspect ratio differs.
    """
    found = _read(Path(path), image_size, None, lens=True)
    return found.lens if isinstance(found, Camera) else found


def read_calibration(
    path: str | os.PathLike[str], *, image_size: ImageSize | None = None
) -> Calibration:
    """A whole camera of any known format: with its covariance where a calibration wrote it, taken
    as exact elsewhere.

    Raises :class:`InputError` as :func:`read_camera`, and for a lens without a pose.
    """
    camera = read_camera(path, image_size=image_size)
    if not isinstance(camera, Camera):
        raise InputError(f"{path}: holds a lens without a pose; a whole camera is needed")
    made = _camera_json.FORMAT.sniff(Path(path), head_text(Path(path)))
    if not made or "person_height_m" not in read_json(path):
        return Calibration.of_camera(camera)
    return replace(Calibration.load(path), camera=camera, image_size=camera.image_size)


def _read(path: Path, image_size: ImageSize | None, name: str | None, *, lens: bool) -> Lens:
    with sane_numbers(path, "camera"):
        chosen = by_name(_FORMATS, name, "camera") if name else detected(_FORMATS, path, "camera")
        read = chosen.read_lens if lens and chosen.read_lens else chosen.read
        found = read(path, image_size)
        return found if image_size is None else found.scaled_to(image_size)


def write_camera(camera: Camera, path: str | os.PathLike[str], format: str) -> None:  # noqa: A002
    """Write a camera in a format of :func:`camera_formats`: all of its files, or none.

    A format that is a folder (COLMAP) takes ``path`` as the folder. Missing folders are made.
    Formats without distortion (DeepStream, bare matrix) get the undistorted P; ROS gets the lens
    alone. Raises :class:`InputError` for a format that is unknown, read only, or cannot hold this
    camera (few hold a fisheye lens), and :class:`~scene4d.core.errors.OutputError` where a file
    cannot be written.
    """
    path = Path(path)
    chosen = by_name(_FORMATS, format, "camera")
    if chosen.write is None:
        writable = names([known for known in _FORMATS if known.write])
        raise InputError(f"camera format {quoted(format)} is read only; write one of {writable}")
    if camera.is_fisheye and not chosen.fisheye:
        able = names([known for known in _FORMATS if known.fisheye])
        raise InputError(
            f"camera format {quoted(format)} has no place for a fisheye lens; write one of {able}, "
            "or calibrate undistorted footage"
        )
    content = chosen.write(camera)
    if isinstance(content, str):
        content = {path.name: content}
        folder = path.parent
    else:
        folder = path.parent if path.name in content else path
    paths = {name: folder / name for name in content}
    replace_files(paths, ((name, text.encode()) for name, text in content.items()), parents=True)
