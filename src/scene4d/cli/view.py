"""``scene4d view``: a scene as one page to look at, measure in and draw on."""

from pathlib import Path
from typing import Annotated

import typer

from scene4d.cli.arguments import zones_option
from scene4d.cli.command import Answer, Job, command
from scene4d.cli.output import emit, visible

_PAGE = "Page"


@command("view")
def view(
    job: Job,
    scenes: Annotated[
        list[Path], typer.Argument(metavar="SCENE...", help="Scene folders, as track writes them.")
    ],
    *,
    out: Annotated[Path, typer.Option(metavar="FILE", help="The page, such as page.html.")],
    search: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WORDS",
            help="Show the events of this search. Repeatable.",
            rich_help_panel=_PAGE,
        ),
    ] = None,
    zones: Annotated[Path | None, zones_option(_PAGE)] = None,
    footage: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|DIR",
            help="Where the footage is, if it has moved since it was tracked.",
            rich_help_panel=_PAGE,
        ),
    ] = None,
    no_video: Annotated[
        bool,
        typer.Option(
            "--no-video",
            help="Leave the footage out: show a picture of the empty view.",
            rich_help_panel=_PAGE,
        ),
    ] = False,
) -> Answer:
    """Make one page of a scene: footage and plan in step, a ruler, zones, and the camera's errors.

    The page is one file without links: it opens from disk, on any machine, and asks for no address.
    Footage is made small enough to live inside it. docs/view.md shows what the page can do.

    [bold]Examples[/bold]

      scene4d view scene --out page.html
      scene4d view scene --search "two people meet" --out page.html
      scene4d view north south --zones zones.json --no-video --out both.html
    """
    from scene4d.app import ViewOptions
    from scene4d.app import view as write_view

    options = ViewOptions(footage, tuple(search or ()), zones, video=not no_video)
    with job.progress() as progress:
        page = write_view(scenes, out, options, progress=progress)
    size = page.stat().st_size
    text = f"{page}: {size / 1e6:.1f} MB. Open it in a browser.\n"
    return Answer({"page": str(page), "bytes": size}, lambda: emit(visible(text)))
