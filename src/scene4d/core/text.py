"""Reading text and XML safely, and writing numbers so that nothing is lost.

Readers raise :class:`InputError` with the line or field; the registries put the file in front.
"""

import difflib
import os
import reprlib
from collections.abc import Iterable, Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError

if TYPE_CHECKING:
    from xml.etree.ElementTree import Element

_LONGEST_QUOTE = 80
"""Characters: one line of a terminal."""
_BRIEF = reprlib.Repr()
_BRIEF.maxstring = _BRIEF.maxlong = _BRIEF.maxother = _LONGEST_QUOTE


def quoted(value: object) -> str:
    """A value from a file for a message: as ``repr``, which escapes what a terminal would obey,
    and at most 80 characters.
    """
    try:
        text = _BRIEF.repr(value)
    except ValueError:  # Python refuses to print integers of more than 4300 digits
        text = "a number of thousands of digits"
    return text if len(text) <= _LONGEST_QUOTE else f"{text[: _LONGEST_QUOTE - 3]}..."


def read_text(path: Path) -> str:
    """The whole file as UTF-8. Raises :class:`InputError` (unreadable, not text, empty)."""
    try:
        text = path.read_bytes().decode("utf-8-sig")
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}") from error
    except UnicodeDecodeError as error:
        raise InputError(f"is not UTF-8 text: byte {error.start} cannot be decoded") from error
    if not text.strip():
        raise InputError("the file is empty")
    return text


def head_text(path: Path, size: int = 4096) -> str:
    """The beginning of a file for format detection; empty for a folder.

    Raises :class:`InputError` where there is nothing to read.
    """
    if path.is_dir():
        return ""
    try:
        with path.open("rb") as file:
            return file.read(size).decode("utf-8-sig", errors="replace")
    except OSError as error:
        raise InputError(f"cannot be read: {error.strerror}") from error


def parse_xml(text: str) -> "Element":
    """The root element; entities and external references are refused.

    Raises :class:`InputError` naming the line.
    """
    from xml.etree.ElementTree import ParseError  # every command reads text, and few read XML

    from defusedxml.common import DefusedXmlException
    from defusedxml.ElementTree import fromstring

    try:
        return fromstring(text)  # as text, so that the encoding it declares is of no account
    except ParseError as error:
        raise InputError(f"line {error.position[0]}: is not well-formed XML: {error}") from error
    except DefusedXmlException as error:
        raise InputError(f"XML with entities or external references is refused: {error}") from error


def floats(tokens: Iterable[object], where: str) -> Float[np.ndarray, "n"]:
    """Finite numbers. Raises :class:`InputError` naming ``where`` and the offending token."""
    values = []
    for token in tokens:
        if isinstance(token, bool) or not isinstance(token, (int, float, str)):
            raise InputError(f"{where}: expected a number, found {quoted(token)}")
        try:
            value = float(token)
        except (ValueError, OverflowError) as error:
            raise InputError(f"{where}: expected a number, found {quoted(token)}") from error
        if not np.isfinite(value):
            raise InputError(f"{where}: expected a finite number, found {quoted(token)}")
        values.append(value)
    return np.array(values, dtype=float)


def decimal(value: float) -> str:
    """The shortest text that reads back as the same float.

    It always has a point: YAML 1.1 readers take ``1e-05`` for a string.
    """
    text = repr(float(value) + 0.0)
    return text.replace("e", ".0e") if "e" in text and "." not in text else text


@contextmanager
def in_file(path: str | os.PathLike[str]) -> Iterator[None]:
    """An :class:`InputError` in the block gets the file in front, once."""
    try:
        yield
    except InputError as error:
        if str(error).startswith(f"{os.fspath(path)}:"):
            raise
        raise InputError(f"{os.fspath(path)}: {error}") from error


def nearest(word: str, known: Iterable[str]) -> str:
    """``; did you mean X?``, or what there is where nothing is like it: the end of a message."""
    known = sorted(known)
    like = difflib.get_close_matches(word, known, n=1, cutoff=0.6)
    if like:
        return f"; did you mean {like[0]!r}?"
    return f"; there is {', '.join(known)}" if known else "; there is none"
