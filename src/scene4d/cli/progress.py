"""Progress on stderr: bars on a terminal, otherwise one line for every slow stage."""

import sys
import threading
import time
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager

from rich.console import Console
from rich.progress import (
    BarColumn,
    SpinnerColumn,
    TaskProgressColumn,
    TextColumn,
    TimeRemainingColumn,
)
from rich.progress import Progress as RichProgress

from scene4d.cli.output import say
from scene4d.core.progress import Advance, Progress

_SLOW_S = 2.0
"""A stage that takes longer gets a line."""
_REMIND_S = 30.0
"""Interval of the further lines of a slow stage."""


@contextmanager
def shown(*, verbose: bool = False) -> Iterator[Progress]:
    """The progress display of a command; its bars disappear when the command ends.

    ``verbose`` prints a permanent line for every stage, with the time it took.
    """
    console = Console(stderr=True)
    if verbose:
        yield EveryStage()
        return
    if not _draws(console):
        yield Lines()
        return
    columns = (
        SpinnerColumn(),
        TextColumn("{task.description}"),
        BarColumn(),
        TaskProgressColumn(),
        TimeRemainingColumn(elapsed_when_finished=True),
    )
    with RichProgress(*columns, console=console, transient=True) as bars:
        yield Bars(bars)


def _draws(console: Console) -> bool:
    # With FORCE_COLOR set, as in many CI systems, rich takes a log file for a terminal.
    return sys.stderr is not None and sys.stderr.isatty() and not console.is_dumb_terminal


class Bars:
    """A bar for the current stage."""

    def __init__(self, bars: RichProgress) -> None:
        self._bars = bars

    @contextmanager
    def stage(self, title: str, total: int | None) -> Iterator[Advance]:
        """See :class:`scene4d.core.progress.Progress`."""
        task = self._bars.add_task(title, total=total)
        try:
            yield lambda steps: self._bars.advance(task, steps)
        finally:
            self._bars.remove_task(task)


class Lines:
    """A line after two seconds of a stage, then every half minute, for pipes and log files."""

    def stage(self, title: str, total: int | None) -> AbstractContextManager[Advance]:
        """See :class:`scene4d.core.progress.Progress`."""
        return _told_if_slow(title, total)


class EveryStage:
    """A line at the end of every stage."""

    @contextmanager
    def stage(self, title: str, total: int | None) -> Iterator[Advance]:
        """See :class:`scene4d.core.progress.Progress`."""
        begun_s = time.monotonic()
        with _told_if_slow(title, total) as advance:
            yield advance
        say(f"scene4d: {title}: {time.monotonic() - begun_s:.1f} s")


@contextmanager
def _told_if_slow(title: str, total: int | None) -> Iterator[Advance]:
    timer = threading.Timer(_SLOW_S, say, [f"scene4d: {title} ..."])
    timer.daemon = True
    timer.start()
    done, told_s = 0, time.monotonic()

    def advance(steps: int) -> None:
        nonlocal done, told_s
        done += steps
        if time.monotonic() - told_s >= _REMIND_S:
            told_s = time.monotonic()
            say(f"scene4d: {title}: {done}{'' if total is None else f' of {total}'}")

    try:
        yield advance
    finally:
        timer.cancel()
