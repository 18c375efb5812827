"""How a command ends: every error is told once, in one line, with the right exit code."""

import functools
import os
from collections.abc import Callable
from typing import ParamSpec, TypeVar

import typer

from scene4d.cli.output import say
from scene4d.core.errors import Scene4DError

_DEBUG_VARIABLE = "SCENE4D_DEBUG"
COULD_NOT = 1
_INTERRUPTED = 130
"""128 + SIGINT, as shells count."""

P = ParamSpec("P")
T = TypeVar("T")


def guarded(command: Callable[P, T]) -> Callable[P, T]:
    """The command with its errors turned into a line on stderr and an exit code."""

    @functools.wraps(command)
    def run(*args: P.args, **kwargs: P.kwargs) -> T:
        try:
            return command(*args, **kwargs)
        except (typer.Exit, typer.BadParameter):
            raise
        except Scene4DError as error:
            say(f"scene4d: error: {' '.join(str(error).split())}")
            code = COULD_NOT
        except KeyboardInterrupt:
            say("scene4d: interrupted")
            code = _INTERRUPTED
        except Exception as error:
            _tell_defect(error)
            code = COULD_NOT
        raise typer.Exit(code)

    return run


def _tell_defect(error: Exception) -> None:
    what = f"{type(error).__name__}: {error}".rstrip(": ")
    say(f"scene4d: internal error: {' '.join(what.split())}")
    if not os.environ.get(_DEBUG_VARIABLE):
        say(
            "scene4d: this is a defect of scene4d: please report it, with the command and what it "
            f"prints with {_DEBUG_VARIABLE}=1"
        )
        return
    import platform
    import traceback
    from importlib.metadata import version

    say("".join(traceback.format_exception(error)).rstrip())
    say(f"scene4d {version('scene4d')}, Python {platform.python_version()}, {platform.platform()}")
