"""The short account of a calibration."""

from pathlib import Path

import typer
from rich.table import Table

from scene4d.cli.guard import COULD_NOT
from scene4d.cli.output import emit_json, say, screen
from scene4d.core.calibration import Calibration
from scene4d.drawing.words import parameter_rows, rounded_m

_PLAIN = str.maketrans({"\N{MINUS SIGN}": "-", "\N{NO-BREAK SPACE}": " ", "\u202f": " "})
"""What people copy from a terminal must be what programs read."""


def finish(found: Calibration, out: Path, *, as_json: bool, **more: str) -> None:
    """Print the result, and end with exit code 1 and the reason where there is no camera.

    ``more`` are further fields of the JSON object.
    """
    if as_json:
        emit_json(found.to_dict() | {"out": str(out)} | more)
    else:
        show(found, out)
    if not found:
        say(f"scene4d: error: the camera is undetermined: {found.reason}")
        raise typer.Exit(COULD_NOT)


def show(found: Calibration, out: Path) -> None:
    """The camera with its uncertainty, the warnings, and where everything lies."""
    table = Table(box=None, show_header=False, pad_edge=False, padding=(0, 2, 0, 0))
    table.add_column(style="bold", no_wrap=True)
    table.add_column(no_wrap=True)
    table.add_column(style="dim")
    for row in _rows(found):
        table.add_row(*(" ".join(text.translate(_PLAIN).split()) for text in row))
    with screen() as console:
        console.print(table)
        if found.warnings:
            console.print()
            console.print(_warnings(found), style="yellow")
        # Paths are never wrapped: people click on them and copy them.
        console.print(f"\nReport   {out / 'report.html'}", soft_wrap=True)
        console.print(f"Camera   {out / 'camera.json'}", soft_wrap=True)


def _warnings(found: Calibration) -> Table:
    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column()
    for warning in found.warnings:
        table.add_row("Warning", warning)
    return table


def _rows(found: Calibration) -> list[tuple[str, str, str]]:
    rows = [(row.name, row.value, row.meaning) for row in parameter_rows(found)] if found else []
    if found and found.ground_error_m is not None:
        median, p90 = (rounded_m(found.ground_error_m[name]) for name in ("median", "p90"))
        rows.append(("Ground error", median, f"predicted median; one in ten is over {p90}"))
    where = f"{found.frames} frame{'' if found.frames == 1 else 's'}"
    if found:
        of = f"of {found.people} sightings in {where} agree with the camera"
        rows.append(("People", str(found.inliers), of))
    else:
        rows.append(("People", str(found.people), f"sightings in {where}"))
    return rows
