"""All camera formats. A new one is a file beside this one and a line in :data:`_FORMATS`."""

import os
from dataclasses import replace
from pathlib import Path

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError, OutputError
from scene4d.core.files import read_json, write_bytes
from scene4d.core.text import head_text, prefixed
from scene4d.formats.cameras import (
    camera_json,
    colmap,
    deepstream,
    krtd,
    matrix,
    opencv,
    ros,
    towncentre,
    tsai,
)
from scene4d.formats.cameras.contract import CameraFormat

# The first whose sniff agrees reads the file, so the specific stand before the general.
_FORMATS: tuple[CameraFormat, ...] = (
    camera_json.FORMAT,
    opencv.YAML,
    opencv.XML,
    krtd.FORMAT,
    colmap.FORMAT,
    ros.FORMAT,
    deepstream.FORMAT,
    tsai.FORMAT,
    towncentre.FORMAT,
    matrix.FORMAT,
)


def camera_formats() -> tuple[CameraFormat, ...]:
    """Every format, in the order in which a file is tried."""
    return _FORMATS


def _by_name(name: str) -> CameraFormat:
    for candidate in _FORMATS:
        if candidate.name == name:
            return candidate
    raise InputError(
        f"camera format {name!r} is unknown; known: {', '.join(f.name for f in _FORMATS)}"
    )


def _detect(path: Path) -> CameraFormat:
    head = head_text(path)
    if not path.is_dir() and not head.strip():
        raise InputError("the file is empty")
    for candidate in _FORMATS:
        if candidate.sniff(path, head):
            return candidate
    raise InputError(
        "no camera format recognises this file; name the format, one of "
        + ", ".join(f.name for f in _FORMATS)
    )


def read_camera(
    path: str | os.PathLike[str],
    *,
    image_size: tuple[int, int] | None = None,
    format: str | None = None,  # noqa: A002 - the word that people look for
) -> Camera | Lens:
    """Read a camera file of any known format; a :class:`Lens` where it holds no pose.

    ``image_size`` (width, height) is that of the footage: a camera measured on images of another
    size is scaled to it, and formats that carry no size take it from here (without it, it is
    inferred from the principal point). ``format`` names the format instead of detecting it.
    Raises :class:`InputError` naming the file, the line or field, and the remedy.
    """
    return _read(Path(path), image_size, format, lens=False)


def read_lens(path: str | os.PathLike[str], *, image_size: tuple[int, int] | None = None) -> Lens:
    """Intrinsics and distortion of a camera file of any known format, for this image size.

    Raises :class:`InputError` as :func:`read_camera`, and where the aspect ratio differs.
    """
    found = _read(Path(path), image_size, None, lens=True)
    return found.lens if isinstance(found, Camera) else found


def read_calibration(
    path: str | os.PathLike[str], *, image_size: tuple[int, int] | None = None
) -> Calibration:
    """A whole camera of any known format: with its covariance where a calibration wrote it, taken
    as exact elsewhere.

    Raises :class:`InputError` as :func:`read_camera`, and for a lens without a pose.
    """
    camera = read_camera(path, image_size=image_size)
    if not isinstance(camera, Camera):
        raise InputError(f"{path}: holds a lens without a pose; a whole camera is needed")
    made = camera_json.FORMAT.sniff(Path(path), head_text(Path(path)))
    if not made or "person_height_m" not in read_json(path):
        return Calibration.of_camera(camera)
    return replace(Calibration.load(path), camera=camera, image_size=camera.image_size)


def _read(
    path: Path, image_size: tuple[int, int] | None, name: str | None, *, lens: bool
) -> Camera | Lens:
    chosen = _by_name(name) if name else None
    try:
        chosen = chosen or _detect(path)
        read = chosen.read_lens if lens and chosen.read_lens else chosen.read
        found = read(path, image_size)
        return found if image_size is None else found.scaled_to(image_size)
    except InputError as error:
        raise prefixed(error, path) from error


def write_camera(camera: Camera, path: str | os.PathLike[str], format: str) -> None:  # noqa: A002
    """Write a camera in a format of :func:`camera_formats`, atomically.

    A format that is a folder (COLMAP) takes ``path`` as the folder and makes it. Formats without
    distortion (DeepStream, bare matrix) get the undistorted P; ROS gets the lens alone. Raises
    :class:`InputError` for a format that is unknown, read only, or cannot hold this camera, and
    :class:`OutputError` where the file cannot be written.
    """
    path = Path(path)
    chosen = _by_name(format)
    if chosen.write is None:
        raise InputError(
            f"camera format {format!r} is read only; write one of "
            + ", ".join(f.name for f in _FORMATS if f.write)
        )
    content = chosen.write(camera)
    if isinstance(content, str):
        write_bytes(path, content.encode())
        return
    folder = path.parent if path.name in content else path
    try:
        folder.mkdir(exist_ok=True)
    except OSError as error:
        raise OutputError(f"{folder}: cannot be made: {error.strerror}") from error
    for name, text in content.items():
        write_bytes(folder / name, text.encode())
