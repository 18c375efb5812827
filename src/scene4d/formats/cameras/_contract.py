"""What a camera format is: a name, a way to recognise its files, a reader and perhaps a writer."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scene4d.core.camera import Camera, Lens
from scene4d.formats._choosing import ReadableFormat

ImageSize = tuple[int, int]
_Reader = Callable[[Path, ImageSize | None], Camera | Lens]


@dataclass(frozen=True)
class CameraFormat(ReadableFormat):
    """One camera file format; an instance of it in the registry is all that a format needs.

    ``read(path, image_size)`` returns the camera as the file has it; ``image_size`` only serves
    formats that carry none. ``write`` returns the text of the file, or name → text for formats
    that are a folder. ``read_lens`` replaces ``read`` where intrinsics alone can be had from files
    that ``read`` must refuse. Fisheye cameras are written only where ``fisheye`` is true. Readers
    raise :class:`~scene4d.core.errors.InputError` naming line or field; the registry adds the file.
    """

    read: _Reader
    write: Callable[[Camera], str | dict[str, str]] | None = None
    read_lens: _Reader | None = None
    fisheye: bool = False
