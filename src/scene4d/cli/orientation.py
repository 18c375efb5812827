"""``scene4d orientation``: how a camera is turned, read from its pictures alone."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene4d.cli.command import Answer, Job, command, output_folder

if TYPE_CHECKING:
    from scene4d.calibration.orienting import OrientationReading

_ROWS = (
    ("focal_px", "Focal length", "px", 0),
    ("tilt_deg", "Tilt", "°", 1),
    ("roll_deg", "Roll", "°", 1),
    ("vfov_deg", "Field of view", "°", 1),
)


@command("orientation")
def orientation(
    job: Job,
    source: Annotated[
        str,
        typer.Argument(
            metavar="SOURCE",
            help="Picture, video, folder of images, quoted glob, or stream address (rtsp://...).",
            show_default=False,
        ),
    ],
    *,
    lens: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Camera file of any known format: its distortion is taken out of the pictures "
            "and its focal length is believed.",
            show_default=False,
        ),
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=1000,
            metavar="N",
            help="Look at N frames spread over the footage. Default: as many as change the "
            "answer, up to 1000.",
            show_default=False,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for orientation.json and figures/orientation.png; nothing is written "
            "without it.",
            show_default=False,
        ),
    ] = None,
) -> Answer:
    """Read focal length, tilt and roll of a camera from its pictures alone.

    A small network that is part of scene4d looks at buildings, streets, trees and sky; nobody
    needs to be in the picture. It is far less sure than a calibration from people, and says so:
    every number comes with its spread. The height of a camera it cannot tell.

    The optical axis is assumed to meet the middle of the picture. What is printed with --json is a
    file for calibrate --orientation.

    [bold]Examples[/bold]

      scene4d orientation street.jpg
      scene4d orientation gate.mp4 --lens lens.yaml --out gate
      scene4d orientation "frames/*.jpg" --json > orientation.json
    """
    from scene4d.calibration.orienting import read_orientation
    from scene4d.calibration.writing import write_orientation

    figure = None
    with output_folder(out), job.progress() as progress:
        reading = read_orientation(source, lens=lens, frames=frames, progress=progress)
        if out is not None:
            figure = write_orientation(reading, out, progress=progress)
    return Answer(reading.to_dict(), lambda: _show(reading, figure), reading.notes)


def _show(reading: "OrientationReading", figure: Path | None) -> None:
    from rich.table import Table

    from scene4d.cli.output import screen

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("Read", style="bold", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("95 % interval", no_wrap=True)
    for name, title, unit, places in _ROWS:
        table.add_row(title, *_cells(reading, name, unit, places))
    count = f"{reading.frames} picture{'' if reading.frames == 1 else 's'}"
    with screen() as console:
        console.print(table)
        console.print(f"\nFrom {count}. Field of view: that of the picture's height.", style="dim")
        for text in (*_vague(reading), *reading.notes):
            console.print(f"Warning  {text}", style="yellow")
        if figure is not None:
            folder = figure.parent.parent
            console.print(f"\nFigure   {figure}", soft_wrap=True)
            console.print(f"File     {folder / 'orientation.json'}", soft_wrap=True)


def _cells(reading: "OrientationReading", name: str, unit: str, places: int) -> tuple[str, str]:
    values = reading.to_dict()
    value, sigma, (low, high) = values[name], values["sigma"][name], reading.intervals[name]
    gap = "" if unit == "°" else " "
    if sigma == 0:
        return f"{value:.{places}f}{gap}{unit} (given)", ""
    text = f"{value:.{places}f} ± {sigma:.{places}f}{gap}{unit}"
    return text, f"{low:.{places}f} to {high:.{places}f}{gap}{unit}"


def _vague(reading: "OrientationReading") -> list[str]:
    """What the picture does not tell, in words."""
    titles = {"roll_deg": "roll", "tilt_deg": "tilt", "vfov_deg": "field of view"}
    names = [titles[name] for name in reading.vague]
    if not names:
        return []
    if len(names) == len(titles):
        return ["The picture does not tell how the camera is turned: the numbers mean nothing."]
    return [f"The picture does not tell the {' or the '.join(names)}."]
