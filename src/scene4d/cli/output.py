"""Printing: results to stdout, everything else to stderr."""

import json
import sys
from collections.abc import Iterable, Iterator
from contextlib import contextmanager, suppress
from typing import TYPE_CHECKING, Any

from scene4d.core.errors import OutputError

if TYPE_CHECKING:
    from rich.console import Console, ConsoleOptions, ConsoleRenderable
    from rich.segment import Segment
    from rich.table import Table

_PIPE_COLUMNS = 100
"""Width of printed tables if stdout is no terminal."""


def say(text: str) -> None:
    """Write one line to stderr. If stderr is closed, the work goes on."""
    if sys.stderr is not None:
        with suppress(OSError):
            sys.stderr.write(_encodable(visible(text), sys.stderr.encoding) + "\n")
            sys.stderr.flush()


def visible(text: str) -> str:
    """Text whose control characters, but for newline and tab, are written as ``\\x1b``.

    Names and messages may come from files: they must not control the terminal.
    """
    return "".join(c if c in "\n\t" or not _controls(c) else f"\\x{ord(c):02x}" for c in text)


def _controls(character: str) -> bool:
    return character < " " or "\x7f" <= character <= "\x9f"


def emit(text: str) -> None:
    """Write text to stdout and flush; a closed pipe (``| head``) is no error.

    Characters that the terminal cannot show become ``?``. Raises :class:`OutputError` if the text
    cannot be written, as on a full disk.
    """
    if sys.stdout is None:
        return
    try:
        sys.stdout.write(_encodable(text, sys.stdout.encoding))
        sys.stdout.flush()
    except BrokenPipeError:
        sys.stdout = None
    except OSError as error:
        sys.stdout = None  # Python would try again at the end, and change the exit code to 120
        raise OutputError(f"standard output cannot be written: {error.strerror}") from error


def emit_json(values: dict[str, Any]) -> None:
    """One JSON object to stdout."""
    emit(json.dumps(values, indent=1, allow_nan=False) + "\n")


class _Visible:
    """A rich renderable without control characters in its text; styles are unaffected."""

    def __init__(self, inner: "ConsoleRenderable") -> None:
        self._inner = inner

    def __rich_console__(
        self, console: "Console", options: "ConsoleOptions"
    ) -> Iterator["Segment"]:
        for segment in console.render(self._inner, options):
            yield segment._replace(text=visible(segment.text))


class _Hook:
    """Makes a console draw only visible text."""

    def process_renderables(self, renderables: list[Any]) -> list[Any]:
        """Wrap the renderables before they are drawn."""
        return [_Visible(one) for one in renderables]


@contextmanager
def screen() -> Iterator["Console"]:
    """A console with the width and colours of stdout; its content is emitted at the end."""
    from rich.console import Console

    width = None if sys.stdout is not None and sys.stdout.isatty() else _PIPE_COLUMNS
    console = Console(width=width, highlight=False, markup=False)
    console.push_render_hook(_Hook())  # type: ignore[arg-type]
    with console.capture() as captured:
        yield console
    emit("".join(f"{line.rstrip()}\n" for line in captured.get().splitlines()))


def print_warnings(console: "Console", warnings: Iterable[str]) -> None:
    """A line for each."""
    for warning in warnings:
        console.print(f"Warning  {warning}", style="yellow", soft_wrap=True)


def facts() -> "Table":
    """A table without titles: names in bold, and what is so, which wraps."""
    from rich.table import Table

    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column()
    return table


def titled(*left: str, right: Iterable[str] = ()) -> "Table":
    """A table whose columns have titles: names first, then numbers, aligned to the right."""
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for title in left:
        table.add_column(title)
    for title in right:
        table.add_column(title, justify="right")
    return table


def _encodable(text: str, encoding: str | None) -> str:
    known = encoding or "utf-8"
    return text.encode(known, "replace").decode(known)
