"""Which of the known formats a file has: the one that is named, or the first that recognises it."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TypeVar

from scene4d.core.errors import InputError
from scene4d.core.text import head_text, quoted


@dataclass(frozen=True)
class Format:
    """What every format has: the name by which users choose it, and one line that describes it."""

    name: str
    description: str


@dataclass(frozen=True)
class ReadableFormat(Format):
    """``sniff(path, head)`` says whether a file looks like this format; ``head`` is its beginning,
    empty for a folder.
    """

    sniff: Callable[[Path, str], bool]


_F = TypeVar("_F", bound=Format)
_R = TypeVar("_R", bound=ReadableFormat)


def by_name(formats: Sequence[_F], name: str, kind: str) -> _F:
    """The format of this name. Raises :class:`InputError` that lists the known names."""
    for candidate in formats:
        if candidate.name == name:
            return candidate
    raise InputError(f"{kind} format {quoted(name)} is unknown; known: {names(formats)}")


def recognised(formats: Sequence[_R], path: Path, head: str) -> _R | None:
    """The first format that recognises the file, so the specific stand before the general."""
    return next((candidate for candidate in formats if candidate.sniff(path, head)), None)


def detected(formats: Sequence[_R], path: Path, kind: str) -> _R:
    """As :func:`recognised`; raises :class:`InputError` for an empty file, and where none does."""
    head = head_text(path)
    if not path.is_dir() and not head.strip():
        raise InputError("the file is empty")
    found = recognised(formats, path, head)
    if found is None:
        raise InputError(
            f"no {kind} format recognises this file; give its format, one of {names(formats)}"
        )
    return found


def names(formats: Sequence[Format]) -> str:
    """The names, for messages."""
    return ", ".join(candidate.name for candidate in formats)
