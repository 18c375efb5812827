"""What is printed: results to stdout, everything else to stderr."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from scene4d.core.errors import OutputError

if TYPE_CHECKING:
    from rich.console import Console

_PIPE_COLUMNS = 100
"""Width of what is drawn where there is no terminal."""


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
    except BrokenPipeError:
        return
    except OSError as error:
        raise OutputError(f"standard output cannot be written: {error.strerror}") from error


def emit_json(values: dict[str, Any]) -> None:
    """One JSON object to stdout."""
    emit(json.dumps(values, indent=1, allow_nan=False) + "\n")


@contextmanager
def screen() -> Iterator["Console"]:
    """A console as wide and colourful as stdout is; what was drawn on it is emitted at the end."""
    from rich.console import Console

    width = None if sys.stdout is not None and sys.stdout.isatty() else _PIPE_COLUMNS
    console = Console(width=width, highlight=False, markup=False)
    with console.capture() as captured:
        yield console
    emit("".join(f"{line.rstrip()}\n" for line in captured.get().splitlines()))


def _encodable(text: str, encoding: str | None) -> str:
    known = encoding or "utf-8"
    return text.encode(known, "replace").decode(known)
