"""What all commands share: ``--json``, ``-q``, ``-v``, messages, errors and exit codes.

A command is a function decorated by :func:`command`. It takes a :class:`Job` and its own options,
and returns an :class:`Answer`. This module prints the answer and handles every failure.
"""

import functools
import inspect
import logging
import os
import warnings
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import AbstractContextManager, contextmanager, nullcontext, suppress
from dataclasses import dataclass
from importlib.metadata import version
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any, Concatenate, ParamSpec

import typer

from scene4d.cli.output import emit_json, say
from scene4d.core.envelope import envelope
from scene4d.core.errors import OutputError, Scene4DError
from scene4d.core.progress import Progress, Silent
from scene4d.core.staging import ensure_folder

if TYPE_CHECKING:
    from types import TracebackType

_DEBUG_VARIABLE = "SCENE4D_DEBUG"
_DONE, _COULD_NOT, _WRONG_USAGE, _INTERRUPTED = 0, 1, 2, 130
"""Exit codes. 130 is 128 + SIGINT, as shells count."""
_TERMINATED = 143
"""128 + SIGTERM."""

P = ParamSpec("P")

_Json = Annotated[
    bool, typer.Option("--json", help="Print one JSON object to standard output and nothing else.")
]
_Quiet = Annotated[
    bool, typer.Option("--quiet", "-q", help="Show only errors: no progress, no warnings.")
]
_Verbose = Annotated[
    bool, typer.Option("--verbose", "-v", help="Show each stage and the time it took.")
]


class Terminated(KeyboardInterrupt):
    """SIGTERM: the command ends as with Ctrl-C, so that no half-written file is left."""


@dataclass(frozen=True)
class Answer:
    """The result of a command: ``fields`` for ``--json``; ``show`` prints it for people."""

    fields: Mapping[str, Any]
    show: Callable[[], None]
    warnings: Sequence[str] = ()
    """``show`` prints these too."""
    undetermined: str | None = None
    """Why the command ran but has no result: exit code 1."""
    what: str = "camera"
    """What is undetermined then."""


@dataclass(frozen=True)
class Job:
    """The output options of a command."""

    as_json: bool = False
    quiet: bool = False
    verbose: bool = False

    def progress(self) -> AbstractContextManager[Progress]:
        """The progress display of the command."""
        from scene4d.cli.progress import shown

        return nullcontext(Silent()) if self.quiet else shown(verbose=self.verbose)


def command(
    name: str,
) -> Callable[[Callable[Concatenate[Job, P], Answer]], Callable[..., None]]:
    """Make the command ``scene4d NAME``, with the options that all commands have."""

    def decorated(work: Callable[Concatenate[Job, P], Answer]) -> Callable[..., None]:
        @functools.wraps(work)
        def run(
            *args: Any,
            as_json: bool = False,
            quiet: bool = False,
            verbose: bool = False,
            **own: Any,
        ) -> None:
            with _Messages(quiet=quiet, verbose=verbose) as messages:
                code = _run(
                    name,
                    lambda: work(Job(as_json, quiet, verbose), *args, **own),
                    messages,
                    as_json=as_json,
                )
            if code != _DONE:
                raise typer.Exit(code)

        _add_options(run, work)
        return run

    return decorated


def _add_options(run: Callable[..., None], work: Callable[..., Answer]) -> None:
    """Typer reads a command's options from its signature."""
    signature = inspect.signature(work)
    _, *own = signature.parameters.values()
    shared = [
        inspect.Parameter(name, inspect.Parameter.KEYWORD_ONLY, default=False, annotation=kind)
        for name, kind in (("as_json", _Json), ("quiet", _Quiet), ("verbose", _Verbose))
    ]
    run.__signature__ = signature.replace(  # type: ignore[attr-defined]
        parameters=[*own, *shared], return_annotation=None
    )
    run.__annotations__ = {p.name: p.annotation for p in (*own, *shared)} | {"return": None}
    del run.__wrapped__  # type: ignore[attr-defined]


def _run(name: str, work: Callable[[], Answer], messages: "_Messages", *, as_json: bool) -> int:
    """Run the command and print the result or the error; return the exit code."""
    try:
        answer = work()
        if answer.undetermined is not None:
            return _tell_undetermined(name, answer, messages, as_json=as_json)
        if as_json:
            emit_json(envelope(name, answer.fields, warnings=(*messages.heard, *answer.warnings)))
        else:
            answer.show()
        return _DONE
    except (typer.Exit, typer.BadParameter):
        raise
    except Scene4DError as error:
        text = " ".join(str(error).split())
        say(f"scene4d: error: {text}")
        code, failure = _COULD_NOT, _failure(error.kind, text)
    except KeyboardInterrupt as error:
        ended = isinstance(error, Terminated)
        kind, code = ("terminated", _TERMINATED) if ended else ("interrupted", _INTERRUPTED)
        say(f"scene4d: {kind}")
        failure = {"kind": kind, "message": f"the command was {kind}", "remedy": "run it again"}
    except Exception as error:
        code, failure = _COULD_NOT, _tell_defect(error)
    if as_json:
        with suppress(OutputError):
            emit_json(envelope(name, {}, warnings=messages.heard, error=failure))
    return code


def _tell_undetermined(name: str, answer: Answer, messages: "_Messages", *, as_json: bool) -> int:
    text = f"the {answer.what} is undetermined: {answer.undetermined}"
    if as_json:
        heard = (*messages.heard, *answer.warnings)
        failure = _failure("undetermined", text)
        emit_json(envelope(name, answer.fields, warnings=heard, error=failure))
    else:
        answer.show()
    say(f"scene4d: error: {text}")
    return _COULD_NOT


def usage_envelope(name: str, message: str) -> dict[str, Any]:
    """What ``--json`` prints when the options are wrong."""
    remedy = f"scene4d {name} --help".replace("  ", " ")
    return envelope(name, {}, error={"kind": "usage", "message": message, "remedy": remedy})


def _failure(kind: str, text: str) -> dict[str, Any]:
    """An error for ``--json``. By convention the text after the last semicolon is the remedy."""
    _, semicolon, remedy = text.rpartition("; ")
    return {"kind": kind, "message": text, "remedy": remedy if semicolon else None}


def _tell_defect(error: Exception) -> dict[str, Any]:
    what = " ".join(f"{type(error).__name__}: {error}".rstrip(": ").split())
    say(f"scene4d: internal error: {what}")
    remedy = (
        "this is a defect of scene4d: please report it, with the command and what it prints with "
        f"{_DEBUG_VARIABLE}=1"
    )
    if not os.environ.get(_DEBUG_VARIABLE):
        say(f"scene4d: {remedy}")
    else:
        import platform
        import traceback

        say("".join(traceback.format_exception(error)).rstrip())
        say(
            f"scene4d {version('scene4d')}, Python {platform.python_version()}, "
            f"{platform.platform()}"
        )
    return {"kind": "defect", "message": what, "remedy": remedy}


class _Messages(logging.Handler):
    """The library's log records and warnings: written to stderr at once, and kept."""

    def __init__(self, *, quiet: bool, verbose: bool) -> None:
        super().__init__(logging.DEBUG if verbose else logging.WARNING)
        self._quiet = quiet
        self.heard: list[str] = []

    def emit(self, record: logging.LogRecord) -> None:
        """Write one message to stderr; keep it if it is a warning."""
        text = record.getMessage()
        if record.levelno < logging.WARNING:
            say(f"scene4d: {text}")
            return
        self.heard.append(text)
        if not self._quiet:
            say(f"scene4d: warning: {text}")

    def __enter__(self) -> "_Messages":
        self._caught = warnings.catch_warnings()
        self._caught.__enter__()
        warnings.simplefilter("default", UserWarning)
        warnings.showwarning = self._show
        self._logger = logging.getLogger("scene4d")
        self._before = self._logger.level, self._logger.propagate
        self._logger.addHandler(self)
        self._logger.setLevel(self.level)
        self._logger.propagate = False
        return self

    def __exit__(
        self,
        kind: type[BaseException] | None,
        error: BaseException | None,
        traceback: "TracebackType | None",
    ) -> None:
        self._logger.removeHandler(self)
        level, self._logger.propagate = self._before
        self._logger.setLevel(level)
        self._caught.__exit__(kind, error, traceback)

    def _show(self, message: Warning | str, *_: Any, **__: Any) -> None:
        logging.getLogger("scene4d").warning("%s", message)


@contextmanager
def output_folder(out: Path | None) -> Iterator[None]:
    """Make the folder before the work starts; if the work fails, remove what was made here.

    Without a folder nothing is made. Raises :class:`OutputError` if it cannot be written.
    """
    if out is None:
        yield
        return
    try:
        made = [folder for folder in (out, *out.parents) if not folder.exists()]
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {error.strerror}") from error
    try:
        ensure_folder(out)
        yield
    except BaseException:
        with suppress(OSError):  # not empty: something else uses it
            for folder in made:
                folder.rmdir()
        raise
