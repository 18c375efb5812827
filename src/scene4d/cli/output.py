"""What is printed: results to stdout, everything else to stderr."""

import json
import os
import sys
from contextlib import suppress
from typing import TYPE_CHECKING, Any

from scene4d.errors import OutputError

if TYPE_CHECKING:
    from rich.console import Console


def say(text: str) -> None:
    """One line to stderr. Where nobody reads it any more, the work goes on."""
    if sys.stderr is not None:
        with suppress(OSError):
            sys.stderr.write(_encodable(text, sys.stderr.encoding) + "\n")
            sys.stderr.flush()


def emit(text: str) -> None:
    """Text to stdout at once; a reader who has gone away (``| head``) is no error.

    Characters that the terminal cannot show become ``?``. Raises :class:`OutputError` where the
    text cannot be written, as on a full disk.
    """
    if sys.stdout is None:
        return
    try:
        sys.stdout.write(_encodable(text, sys.stdout.encoding))
        sys.stdout.flush()
    except OSError as error:
        # Python writes once more when it ends: that must not fail again.
        os.dup2(os.open(os.devnull, os.O_WRONLY), sys.stdout.fileno())
        if not isinstance(error, BrokenPipeError):
            reason = error.strerror or error
            raise OutputError(f"standard output cannot be written: {reason}") from error


def emit_json(values: dict[str, Any]) -> None:
    """One JSON object to stdout."""
    emit(json.dumps(values, indent=1, allow_nan=False) + "\n")


def console() -> "Console":
    """A console as wide and colourful as stdout is; print into its ``capture`` and emit that."""
    from rich.console import Console

    width = None if sys.stdout is not None and sys.stdout.isatty() else 100
    return Console(width=width, highlight=False, markup=False)


def _encodable(text: str, encoding: str | None) -> str:
    known = encoding or "utf-8"
    return text.encode(known, "replace").decode(known)
