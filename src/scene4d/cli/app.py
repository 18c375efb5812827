"""The program ``scene4d``: its commands, and what concerns all of them."""

from typing import Annotated

import typer

from scene4d.cli.arguments import reflowed
from scene4d.cli.calibrate import calibrate
from scene4d.cli.demo import demo
from scene4d.cli.evaluate import evaluate
from scene4d.cli.export import export
from scene4d.cli.models import models
from scene4d.cli.orientation import orientation
from scene4d.cli.output import emit
from scene4d.cli.search import search
from scene4d.cli.track import track

_EPILOG = """
Begin with [bold]scene4d demo[/bold]. Every command explains itself with [bold]--help[/bold].

Results go to standard output, progress and messages to standard error.
Exit codes: 0 done; 1 could not, and says why; 2 wrong usage; 130 interrupted by Ctrl-C.

SCENE4D_CACHE names the folder for networks and samples. SCENE4D_DEBUG=1 shows tracebacks.
"""

app = typer.Typer(
    name="scene4d",
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
        bool,
        typer.Option("--version", callback=_version, is_eager=True, help="Show the version."),
    ] = False,
) -> None:
    """Turn a fixed camera into a metric sensor, from the people who walk through its footage."""


for _command in (calibrate, orientation, track, search, export, models, demo):
    app.command(help=reflowed(_command.__doc__))(_command)
app.add_typer(evaluate)
