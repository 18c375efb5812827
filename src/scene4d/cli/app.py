"""The program ``scene4d``: its commands, and what they share."""

import sys
from collections.abc import Sequence
from typing import Annotated, Any

import typer
from typer.core import TyperGroup

from scene4d.cli.activities import activities
from scene4d.cli.align import align
from scene4d.cli.arguments import reflowed
from scene4d.cli.calibrate import calibrate
from scene4d.cli.command import usage_envelope
from scene4d.cli.demo import demo
from scene4d.cli.evaluate import evaluate
from scene4d.cli.export import export
from scene4d.cli.fleet import fleet
from scene4d.cli.models import models
from scene4d.cli.orientation import orientation
from scene4d.cli.output import emit, emit_json, say
from scene4d.cli.search import search
from scene4d.cli.serve import serve
from scene4d.cli.track import track
from scene4d.cli.view import view
from scene4d.cli.watch import watch
from scene4d.core.envelope import envelope

_EPILOG = """
Start with [bold]scene4d demo[/bold]. Every command has [bold]--help[/bold].

Results go to standard output, progress and messages to standard error.
With --json a command prints exactly one JSON object, even if it fails.
Exit codes: 0 done; 1 failed, with a reason; 2 wrong usage; 130 interrupted by Ctrl-C.

SCENE4D_CACHE names the folder for networks and samples. SCENE4D_DEBUG=1 shows tracebacks.
"""


class _Program(TyperGroup):
    """The commands; with ``--json``, wrong usage is reported in JSON too."""

    def main(self, args: Sequence[str] | None = None, *rest: Any, **options: Any) -> Any:
        """Run the command that ``args`` names, and end the process."""
        words = sys.argv[1:] if args is None else list(args)
        if "--json" not in words:
            return super().main(words, *rest, **options)
        if {*words} == {"--json", "--version"}:
            emit_json(envelope("version", {}))
            sys.exit(0)
        try:
            code = super().main(words, *rest, **options | {"standalone_mode": False})
        except Exception as error:
            if not hasattr(error, "format_message"):
                raise
            context = getattr(error, "ctx", None)
            name = "" if context is None else context.command_path.partition(" ")[2]
            message = error.format_message()
            say(f"scene4d: error: {message}")
            emit_json(usage_envelope(name, message))
            code = 2
        sys.exit(code or 0)


app = typer.Typer(
    name="scene4d",
    cls=_Program,
    epilog=_EPILOG,
    no_args_is_help=True,
    rich_markup_mode="rich",
    pretty_exceptions_enable=False,
    context_settings={"help_option_names": ["--help", "-h"]},
)


def _version(wanted: bool) -> bool:
    if wanted:
        from importlib.metadata import version

        emit(f"scene4d {version('scene4d')}\n")
        raise typer.Exit
    return wanted


@app.callback()
def scene4d(
    version: Annotated[
        bool, typer.Option("--version", callback=_version, is_eager=True, help="Show the version.")
    ] = False,
) -> None:
    """Turn a fixed camera into a metric sensor, from the people who walk through its footage."""


for _command in (
    *(calibrate, orientation, track, watch, align, fleet),
    *(search, activities, view, serve, export, models, demo),
):
    app.command(help=reflowed(_command.__doc__))(_command)
app.add_typer(evaluate)
