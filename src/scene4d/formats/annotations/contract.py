"""What an annotation format is: a name, a way to recognise its files, and a reader."""

from collections.abc import Callable
from dataclasses import dataclass
from pathlib import Path

from scene4d.formats.annotations.boxes import Rows


@dataclass(frozen=True)
class AnnotationFormat:
    """One annotation file format; an instance of it in the registry is all that a format needs.

    ``sniff(path, head)`` says whether the file looks like this format (``head`` is its
    beginning). ``read(path, image_size)`` returns every box of the file in pixels of the footage,
    checked by :func:`~scene4d.formats.annotations.boxes.first_fault`, with unknown times. Readers
    raise :class:`~scene4d.core.errors.InputError` naming the line; the registry adds the file.
    """

    name: str
    description: str
    patterns: tuple[str, ...]
    sniff: Callable[[Path, str], bool]
    read: Callable[[Path, tuple[int, int]], Rows]
