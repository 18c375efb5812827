"""What a camera format is: a name, a way to recognise its files, a reader and perhaps a writer."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scene4d.core.camera import Camera, Lens

ImageSize = tuple[int, int]


@dataclass(frozen=True)
class CameraFormat:
    """One camera file format; an instance of it in the registry is all that a format needs.

    ``sniff(path, head)`` says whether the file looks like this format (``head`` is its beginning,
    empty for a folder). ``read(path, image_size)`` returns the camera as the file has it;
    ``image_size`` only serves formats that carry none. ``read_lens`` replaces ``read`` where
    intrinsics alone can be had from files that ``read`` must refuse. ``write`` returns the text
    of the file, or name → text for formats that are a folder. Readers raise
    :class:`~scene4d.core.errors.InputError` naming line or field; the registry adds the file.
    """

    name: str
    description: str
    patterns: tuple[str, ...]
    sniff: Callable[[Path, str], bool]
    read: Callable[[Path, ImageSize | None], Camera | Lens]
    read_lens: Callable[[Path, ImageSize | None], Camera | Lens] | None = None
    write: Callable[[Camera], str | dict[str, str]] | None = None
