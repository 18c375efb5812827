"""Open any footage: a video, an image, a folder of images, a glob, or a stream."""

import glob
import os
import re
from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.video._images import IMAGE_SUFFIXES, ImageSource, natural_key
from scene4d.video.frames import FRAGMENTS, Frame, Source, Timeline

__all__ = ["FRAGMENTS", "Frame", "Source", "Timeline", "open_source"]

_STREAM_SCHEMES = frozenset(
    {"rtsp", "rtsps", "rtmp", "rtmps", "http", "https", "udp", "srt", "rtp"}
)


def open_source(source: str | os.PathLike[str], *, live: bool = False) -> Source:
    """Open the footage at SOURCE.

    An existing path takes precedence over its interpretation as a glob. Images are ordered by the
    numbers in their names (``frame_2`` before ``frame_10``). A ``live`` stream is decoded with less
    delay. Raises :class:`InputError` if there
    is nothing readable, and ``UnavailableError`` for a stream that does not answer.
    """
    text = os.fspath(source)
    scheme = re.match(r"([a-z][a-z0-9+.]*)://", text, re.IGNORECASE)
    if scheme:
        return _open_stream(text, scheme[1].lower(), live=live)
    path = Path(text)
    try:
        is_folder, exists = path.is_dir(), path.exists()
    except (OSError, ValueError) as error:
        raise InputError(f"{text}: cannot be opened: {error}") from error
    if is_folder:
        return _open_folder(path)
    if not exists and glob.has_magic(text):
        return _open_glob(text)
    return _open_file(path)


def _open_stream(url: str, scheme: str, *, live: bool) -> Source:
    if scheme not in _STREAM_SCHEMES:
        raise InputError(
            f"{scheme}:// is not a kind of stream that can be read; expected one of "
            f"{', '.join(sorted(_STREAM_SCHEMES))}, or a file without a scheme"
        )
    from scene4d.video.stream import StreamSource

    return StreamSource(url, live=live)


def _open_folder(folder: Path) -> Source:
    try:
        paths = [p for p in folder.iterdir() if _is_image(p)]
    except OSError as error:
        raise InputError(f"{folder}: cannot be listed: {error.strerror}") from error
    if not paths:
        raise InputError(
            f"{folder}: the folder holds no images; expected files that end in "
            f"{' '.join(sorted(IMAGE_SUFFIXES))}, or give a video file"
        )
    return ImageSource(str(folder), sorted(paths, key=natural_key))


def _open_glob(pattern: str) -> Source:
    matches = glob.glob(pattern, recursive=True)  # noqa: PTH207 - Path.glob takes no full path
    paths = [p for p in map(Path, matches) if p.is_file()]
    if not paths:
        raise InputError(
            f"{pattern}: matches no file; check the pattern, and quote it so that the shell "
            "does not expand it"
        )
    if len(paths) == 1:
        return _open_file(paths[0])
    other = [p for p in paths if not _is_image(p)]
    if other:
        raise InputError(
            f"{pattern}: matches {len(paths)} files of which {other[0].name} is no image; "
            "a glob must match images only, or a single video"
        )
    by_folder = sorted(paths, key=lambda p: (str(p.parent), natural_key(p)))
    return ImageSource(pattern, by_folder)


def _open_file(path: Path) -> Source:
    try:
        size = path.stat().st_size
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}; check the path") from error
    if size == 0 and path.is_file():
        raise InputError(f"{path}: is empty (0 bytes); copy or record it again")
    if _is_image(path):
        return ImageSource(str(path), [path])
    from scene4d.video._videofile import VideoSource

    return VideoSource(path)


def _is_image(path: Path) -> bool:
    hidden = path.name.startswith(".")  # macOS leaves "._name.jpg" beside images
    return not hidden and path.suffix.lower() in IMAGE_SUFFIXES
