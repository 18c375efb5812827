"""``scene4d orientation``: a camera's orientation, estimated from its images alone."""

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
            help="Video, image, folder of images, quoted glob, or stream address (rtsp://...).",
        ),
    ],
    *,
    lens: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Camera file in any known format: its distortion is removed from the images and "
            "its focal length is used as is.",
        ),
    ] = None,
    frames: Annotated[
        int | None,
        typer.Option(
            min=1,
            max=1000,
            metavar="N",
            help="Use N frames spread over the footage. Default: until further frames no longer "
            "change the answer, up to 1000.",
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for orientation.json and figures/orientation.png. Without it, no file is "
            "written.",
        ),
    ] = None,
) -> Answer:
    """Estimate focal length, tilt and roll of a camera from its images alone.

    A small network that is part of scene4d looks at buildings, streets, trees and sky; no people
    are needed. The estimate is far less certain than a calibration from people: every value comes
    with its standard deviation. The camera's height cannot be estimated this way.

    The principal point is assumed to be the image centre. The output of --json is a file for
    calibrate --orientation.

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

    from scene4d.cli.output import print_warnings, screen

    table = Table(box=None, pad_edge=False, padding=(0, 2, 0, 0), header_style="bold")
    table.add_column("Read", style="bold", no_wrap=True)
    table.add_column("", no_wrap=True)
    table.add_column("95 % interval", no_wrap=True)
    for name, title, unit, places in _ROWS:
        table.add_row(title, *_cells(reading, name, unit, places))
    count = f"{reading.frames} picture{'' if reading.frames == 1 else 's'}"
    with screen() as console:
        console.print(table)
        console.print(f"\nFrom {count}. Field of view: vertical, of the whole image.", style="dim")
        print_warnings(console, (*_vague(reading), *reading.notes))
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
    """Warnings about values that the images do not determine."""
    titles = {"roll_deg": "roll", "tilt_deg": "tilt", "vfov_deg": "field of view"}
    names = [titles[name] for name in reading.vague]
    if not names:
        return []
    if len(names) == len(titles):
        return ["The images do not determine the orientation: the values mean nothing."]
    return [f"The images do not determine the {' or the '.join(names)}."]
