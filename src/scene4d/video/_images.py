"""Images as footage: a single image, or images in natural order of their names."""

import re
import warnings
from collections.abc import Iterable, Iterator
from pathlib import Path

import cv2
import numpy as np
import PIL.Image
from jaxtyping import UInt8

from scene4d.core.errors import InputError
from scene4d.video.frames import MOST_PIXELS, Frame, Source, Timeline, check_picture_size

IMAGE_SUFFIXES = frozenset(
    {".bmp", ".dib", ".jpe", ".jpeg", ".jpg", ".jp2", ".pbm", ".pgm", ".png", ".pnm", ".ppm"}
    | {".tif", ".tiff", ".webp"}
)


def natural_key(path: Path) -> tuple[list[tuple[int, int, str]], str]:
    """Sort key that puts ``frame_2`` before ``frame_10``."""
    parts = re.findall(r"\d+|\D+", path.name.casefold())
    return [(0, int(p), "") if p.isdecimal() else (1, 0, p) for p in parts], path.name


def _read_image(path: Path) -> UInt8[np.ndarray, "h w 3"]:
    """An image as 8-bit BGR: grey is repeated, alpha dropped, 16 bits divided by 256.

    EXIF orientation is applied. Raises :class:`InputError` if the file is not a complete image.
    """
    try:
        data = np.fromfile(path, np.uint8)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if not len(data):
        raise InputError(f"{path}: is empty (0 bytes); copy or export the image again")
    _check_header(path)
    try:
        image = cv2.imdecode(data, cv2.IMREAD_COLOR)
    except cv2.error:
        image = None
    if image is None:
        raise InputError(
            f"{path}: is not an image that can be decoded, or it is cut short; "
            "expected a whole JPEG, PNG, TIFF, BMP, WebP or PNM file of 8 or 16 bits"
        )
    check_picture_size(image.shape[1], image.shape[0], str(path))
    return image


def _check_header(path: Path) -> None:
    """Reject an image that is too large before its pixels are decoded.

    A header that Pillow cannot read passes; the decoder reports the error.
    """
    with warnings.catch_warnings():
        warnings.simplefilter("ignore")
        try:
            with PIL.Image.open(path) as header:
                width, height = header.size
        except PIL.Image.DecompressionBombError as error:
            raise InputError(
                f"{path}: found a picture of more than {MOST_PIXELS:,} pixels: scale it"
            ) from error
        except (OSError, ValueError, SyntaxError):
            return
    check_picture_size(width, height, str(path))


class ImageSource(Source):
    """Images in the order given. They have no clock: ``time_s`` is NaN (0 for a single image)."""

    def __init__(self, name: str, paths: list[Path]) -> None:
        self.name = name
        self.fps = None
        self._paths = paths
        self._unreadable: dict[int, str] = {}
        count = len(paths)
        times = np.zeros(1) if count == 1 else np.full(count, np.nan)
        self.timeline = Timeline(times, np.ones(count, bool))
        height, width = self._first_readable().shape[:2]
        self.image_size = (width, height)

    def _first_readable(self) -> np.ndarray:
        for i in range(len(self._paths)):
            image = self._read(i)
            if image is not None:
                return image
        if len(self._paths) == 1:
            raise InputError(self._unreadable[0])
        raise InputError(
            f"{self.name}: none of its {len(self._paths)} images can be read; "
            f"the first: {self._unreadable[0]}"
        )

    def _read(self, index: int) -> np.ndarray | None:
        try:
            return _read_image(self._paths[index])
        except InputError as error:
            self._unreadable[index] = str(error)
            return None

    @property
    def warnings(self) -> tuple[str, ...]:
        """One sentence with the number of unreadable images."""
        if not self._unreadable:
            return ()
        first = self._unreadable[min(self._unreadable)]
        count = len(self._unreadable)
        return (f"{self.name}: {count} of {len(self._paths)} images were left out; first: {first}",)

    def frames(self, indices: Iterable[int] | None = None) -> Iterator[Frame]:
        """See :meth:`Source.frames`."""
        assert self.timeline is not None
        for i in self._wanted(indices):
            image = self._read(i)
            if image is not None:
                self._check_size(image, f"image {self._paths[i].name}")
                yield Frame(i, float(self.timeline.time_s[i]), image)
