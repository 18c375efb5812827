"""``scene4d serve``: the page of scenes with search, footage and what is new."""

from pathlib import Path
from typing import Annotated

import typer

from scene4d.cli.command import Answer, Job, command
from scene4d.cli.output import emit, say, visible

_WHERE = "Address"


@command("serve")
def serve(
    job: Job,
    scenes: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCENE...", help="Scene folders, as track writes them; watch may still write."
        ),
    ],
    *,
    port: Annotated[
        int,
        typer.Option(
            metavar="N", min=0, max=65535, help="Port; 0 takes any.", rich_help_panel=_WHERE
        ),
    ] = 8080,
    host: Annotated[
        str,
        typer.Option(
            metavar="ADDRESS",
            help="Address to answer at. One that others can reach needs --token.",
            rich_help_panel=_WHERE,
        ),
    ] = "127.0.0.1",
    token: Annotated[
        str | None,
        typer.Option(
            metavar="TEXT",
            help="What every request must bring: open http://ADDRESS/?token=TEXT once.",
            envvar="SCENE4D_TOKEN",
            rich_help_panel=_WHERE,
        ),
    ] = None,
    public_name: Annotated[
        list[str] | None,
        typer.Option(
            metavar="NAME",
            help="Name under which others reach it, such as that of a proxy. Repeatable.",
            rich_help_panel=_WHERE,
        ),
    ] = None,
    zones: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="File to which zones and lines are saved. Default: zones.json in the first SCENE.",
        ),
    ] = None,
    footage: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|DIR", help="Where the footage is, if it has moved since it was tracked."
        ),
    ] = None,
) -> Answer:
    """Serve scenes as a page: as view makes it, with search, zones that are kept, and live updates.

    The page and /openapi.json describe an HTTP interface for programs. The server answers to this
    machine only, unless --host and --token say otherwise. docs/view.md has more.

    [bold]Examples[/bold]

      scene4d serve scene
      scene4d serve north south --port 9000
      scene4d serve scene --host 0.0.0.0 --token "$SECRET"
    """
    from scene4d.app import ServeOptions
    from scene4d.app import serve as answer_requests

    options = ServeOptions(host, port, token, footage, zones, tuple(public_name or ()))
    address = ""

    def ready(url: str) -> None:
        nonlocal address
        address = url
        say(f"scene4d: serving at {url} until Ctrl-C")

    answer_requests(scenes, options, ready=ready)
    return Answer({"address": address}, lambda: emit(visible(f"{address} was served\n")))
