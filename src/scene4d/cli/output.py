"""What is printed: results to stdout, everything else to stderr."""

import json
import sys
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from scene4d.core.errors import OutputError

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, ConsoleRenderable
    from rich.segment import Segment

_PIPE_COLUMNS = 100
"""Width of what is drawn where there is no terminal."""


def say(text: str) -> None:
    """One line to stderr. Where nobody reads it any more, the work goes on."""
    if sys.stderr is not None:
        with suppress(OSError):
            sys.stderr.write(_encodable(visible(text), sys.stderr.encoding) + "\n")
            sys.stderr.flush()


def visible(text: str) -> str:
    """Text whose control characters, but for newline and tab, are written as ``\\x1b``.

    Names and messages come from files: they must not move the cursor or recolour the terminal.
    """
    return "".join(c if c in "\n\t" or not _controls(c) else f"\\x{ord(c):02x}" for c in text)


def _controls(character: str) -> bool:
    return character < " " or "\x7f" <= character <= "\x9f"


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


class _Visible:
    """A rendering whose text holds no control characters; styles are kept apart from the text."""

    def __init__(self, inner: "ConsoleRenderable") -> None:
        self._inner = inner

    def __rich_console__(
        self, console: "Console", options: "ConsoleOptions"
    ) -> Iterator["Segment"]:
        for segment in console.render(self._inner, options):
            yield segment._replace(text=visible(segment.text))


class _Hook:
    """Lets a console draw visible text alone."""

    def process_renderables(self, renderables: list[Any]) -> list[Any]:
        """Wrap what is about to be drawn."""
        return [_Visible(one) for one in renderables]


@contextmanager
def screen() -> Iterator["Console"]:
    """A console as wide and colourful as stdout is; what was drawn on it is emitted at the end."""
    from rich.console import Console

    width = None if sys.stdout is not None and sys.stdout.isatty() else _PIPE_COLUMNS
    console = Console(width=width, highlight=False, markup=False)
    console.push_render_hook(_Hook())  # type: ignore[arg-type]
    with console.capture() as captured:
        yield console
    emit("".join(f"{line.rstrip()}\n" for line in captured.get().splitlines()))


def _encodable(text: str, encoding: str | None) -> str:
    known = encoding or "utf-8"
    return text.encode(known, "replace").decode(known)
