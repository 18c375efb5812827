"""``scene4d models``: the networks in use, and whether they are installed."""

from enum import StrEnum
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scene4d.cli.command import Answer, Job, command
from scene4d.cli.output import screen

if TYPE_CHECKING:
    from scene4d.perception.weights import WeightStatus

_PACKAGED = "orientation"
"""The network that is part of the package and is never fetched."""


class Action(StrEnum):
    """What to do with the networks."""

    fetch = "fetch"


@command("models")
def models(
    job: Job,
    action: Annotated[
        Action | None,
        typer.Argument(
            metavar="fetch", help="Download missing networks, about 70 MB, and check the others."
        ),
    ] = None,
) -> Answer:
    """List the networks and whether they are installed; [bold]models fetch[/bold] downloads them.

    A network is downloaded when a command first needs it: with pip from the package index that this
    machine is set up for, or from the project that made it. Every file is checked against its
    SHA-256. The files are in the user's cache folder, or in the folder that SCENE4D_CACHE names.
    The orientation network is packaged: it comes with scene4d.

    [bold]Examples[/bold]

      scene4d models
      scene4d models fetch
      SCENE4D_CACHE=/srv/scene4d scene4d models fetch --json
    """
    if action is Action.fetch:
        from scene4d.calibration.watching import fetch_weights

        with job.progress() as progress:
            fetch_weights(progress, vehicles=True)
    from scene4d.core.fetching import cache_dir
    from scene4d.perception.weights import list_weights

    rows = [*list_weights(), _packaged()]
    folder = cache_dir() / "weights"
    fields = {"folder": str(folder), "weights": [_fields(row) for row in rows]}
    return Answer(fields, lambda: _show(rows))


def _show(rows: list["WeightStatus"]) -> None:
    from rich.table import Table

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    for heading in ("Name", "Size", "Present", "Verified", "Licence"):
        table.add_column(heading, no_wrap=heading != "Licence")
    for row in rows:
        size = f"{row.bytes / 1e6:.1f} MB"
        table.add_row(row.name, size, *_state(row), row.licence)
    width = max(len(row.name) for row in rows)
    with screen() as console:
        console.print(table)
        console.print()
        for row in rows:
            console.print(f"{row.name:{width}}  {row.file}", soft_wrap=True)
        if not all(row.present for row in rows):
            console.print("\nWhat is missing is fetched when it is first used, or now by")
            console.print("scene4d models fetch", style="bold")


def _packaged() -> "WeightStatus":
    """The network inside the package; it is not verified apart from the package."""
    from importlib.resources import files
    from pathlib import Path

    from scene4d.perception.weights import WeightStatus

    file = Path(str(files("scene4d.perception").joinpath("orientation", "network.onnx")))
    present = file.is_file()
    size = file.stat().st_size if present else 0
    licence = "as scene4d (made for it; docs/orientation.md)"
    return WeightStatus(_PACKAGED, file, size, present, present, licence)


def _state(row: "WeightStatus") -> tuple[str, str]:
    """Whether a network is present and intact, in words."""
    if row.name == _PACKAGED and row.present:
        return "packaged", "-"
    if not row.present:
        return "no", "-"
    return "yes", "yes" if row.verified else "NO: damaged"


def _fields(row: "WeightStatus") -> dict[str, Any]:
    return {
        "name": row.name,
        "file": str(row.file),
        "bytes": row.bytes,
        "present": row.present,
        "packaged": row.name == _PACKAGED,
        "verified": row.verified,
        "licence": row.licence,
    }
