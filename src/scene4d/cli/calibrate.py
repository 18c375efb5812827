"""``scene4d calibrate``: footage in, camera and report out."""

from enum import StrEnum
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scene4d.cli.arguments import (
    annotation_format,
    command_line,
    device_option,
    parse_image_size,
    parse_person_height,
)
from scene4d.cli.command import Answer, Job, command, output_folder

if TYPE_CHECKING:
    from rich.table import Table

    from scene4d.core.calibration import Calibration
    from scene4d.drawing.words import ErrorText


class Method(StrEnum):
    """How the camera is solved for."""

    joint = "joint"
    paper = "paper"


class Vehicles(StrEnum):
    """When vehicles are looked for."""

    auto = "auto"
    always = "always"
    never = "never"


_PLAIN = str.maketrans({"\N{MINUS SIGN}": "-", "\N{NO-BREAK SPACE}": " ", "\u202f": " "})
"""Typographic characters become ASCII, so that copied numbers can be parsed."""
_FOOTAGE, _KNOWN, _SOLVER = "Input", "Known values", "Solver"


@command("calibrate")
def calibrate(
    job: Job,
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="SOURCE",
            help="Video, image, folder of images, quoted glob, or stream address (rtsp://...). "
            "Optional with --annotations and --image-size.",
        ),
    ] = None,
    *,
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Folder for camera.json, report.html, figures/ and people.parquet; created if it "
            "does not exist.",
        ),
    ],
    frames: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Use N frames spread over the footage. Default: one per second, 100 to 200.",
            rich_help_panel=_FOOTAGE,
        ),
    ] = None,
    annotations: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Use these boxes or keypoints instead of the built-in detector: MOTChallenge, "
            "COCO, KPF, PETS XML, TownCentre.",
            rich_help_panel=_FOOTAGE,
        ),
    ] = None,
    image_size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH",
            help="Size of the annotated images, if there is no SOURCE.",
            rich_help_panel=_FOOTAGE,
        ),
    ] = None,
    format_: Annotated[str | None, annotation_format(_FOOTAGE)] = None,
    drop_invalid: Annotated[
        bool,
        typer.Option(
            "--drop-invalid",
            help="Skip impossible boxes in --annotations, with a warning, instead of refusing the "
            "file.",
            rich_help_panel=_FOOTAGE,
        ),
    ] = False,
    device: Annotated[str, device_option(_FOOTAGE)] = "auto",
    person_height: Annotated[
        str,
        typer.Option(
            metavar="METRES",
            help="Mean height of the people, shoes included. It sets the scale.",
            rich_help_panel=_KNOWN,
        ),
    ] = "1.70",
    lens: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Camera file in any known format; its focal length and distortion are used.",
            rich_help_panel=_KNOWN,
        ),
    ] = None,
    estimate_focal: Annotated[
        bool,
        typer.Option(
            "--estimate-focal",
            help="Take only the distortion from --lens and estimate the focal length.",
            rich_help_panel=_KNOWN,
        ),
    ] = False,
    orientation: Annotated[
        str,
        typer.Option(
            metavar="auto|people|network|FILE",
            help="Prior for focal length, tilt and roll. auto: the orientation network's estimate, "
            "as a guess that the people can overrule. people: no prior. network: the network's "
            "estimate, used as is. FILE: JSON with focal_px, tilt_deg, roll_deg and, unless they "
            "are exact, sigma, as scene4d orientation writes it.",
            rich_help_panel=_KNOWN,
        ),
    ] = "auto",
    landmarks: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="JSON with what was measured in the scene: ground points, heights, distances.",
            rich_help_panel=_KNOWN,
        ),
    ] = None,
    method: Annotated[
        Method,
        typer.Option(
            help="joint: focal length, tilt, roll, height and distortion together. paper: only the "
            "height, as in Wagner et al. (2019); the rest comes from the orientation network or "
            "from --orientation FILE.",
            rich_help_panel=_SOLVER,
        ),
    ] = Method.joint,
    vehicles: Annotated[
        Vehicles,
        typer.Option(
            help="Moving vehicles as rulers, besides people. auto: where people alone do not "
            "determine the camera. Finding them costs three to four times as much.",
            rich_help_panel=_SOLVER,
        ),
    ] = Vehicles.auto,
    seed: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="Random seed; the same seed gives the same camera.",
            rich_help_panel=_SOLVER,
        ),
    ] = 0,
) -> Answer:
    """Calibrate a fixed camera from footage of people walking.

    Finds focal length, tilt, roll, lens distortion and height above the ground in metres, with
    their uncertainty. Nothing needs to be clicked or measured: the scale comes from the mean height
    of people.

    The camera must not move, the ground must be level where people walk, and at least three people
    must be visible from head to foot. More people, near and far, left and right, are better. Where
    people do not determine the camera, moving vehicles help: at least five.

    [bold]Examples[/bold]

      scene4d calibrate street.mp4 --out street
      scene4d calibrate "frames/*.jpg" --out yard --lens lens.yaml
      scene4d calibrate yard.mp4 --out yard --landmarks measured.json
      scene4d calibrate rtsp://10.0.0.7/main --out gate --person-height 1.75
      scene4d calibrate --annotations gt.txt --image-size 1920x1080 \\
          --lens lens.yaml --out mot

    Measurements in the scene (--landmarks FILE) make it more accurate, and with four or more
    ground points nobody need be in the picture. FILE holds pixels of the footage, and metres in
    any frame of your own (y to the left of x, seen from above). Each list may be missing:

      {"points": [{"uv": [412, 530], "xy_m": [8.4, 2.0]}],
       "uprights": [{"foot_uv": [90, 610], "head_uv": [88, 402],
                     "height_m": 2.1}],
       "distances": [{"uv": [[412, 530], [700, 900]],
                      "distance_m": 12.3}]}

    Ground points may also be a table (.csv) with the columns u, v, x_m, y_m and, where known, z_m,
    sigma_m, sigma_px and name. Optional everywhere: name, sigma_px (2) and sigma_m (uprights 0.02,
    others 0.05); of points also height_m above the ground.

    If the people do not determine the camera, the exit code is 1, and camera.json and the report
    say what is missing.
    """
    size = None if image_size is None else parse_image_size(image_size)
    height_m = parse_person_height(person_height)
    if source is None and (annotations is None or image_size is None):
        raise typer.BadParameter(
            "give footage, or both --annotations and --image-size", param_hint="SOURCE"
        )
    if method is Method.paper and orientation == "people":
        raise typer.BadParameter(
            "the paper's method needs the camera's orientation: use network, give a FILE, or use "
            "--method joint",
            param_hint="--orientation",
        )
    if method is Method.paper and landmarks is not None:
        raise typer.BadParameter(
            "the paper's method estimates the height from people alone: use --method joint",
            param_hint="--landmarks",
        )
    from scene4d.calibration.calibrating import run
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.calibration.writing import write

    options = CalibrateOptions(
        lens=lens,
        annotations=annotations,
        image_size=size,
        person_height_m=height_m,
        method=method.value,
        orientation=orientation,
        landmarks=landmarks,
        estimate_focal=estimate_focal,
        frames=frames,
        device=device,
        vehicles=vehicles.value,
        seed=seed,
        drop_invalid=drop_invalid,
        format=format_,
    )
    with output_folder(out), job.progress() as progress:
        result = run(source, options, progress, command=command_line())
        write(result, out, progress=progress)
    return calibrated(result.calibration, out)


def calibrated(found: "Calibration", out: Path, **more: Any) -> Answer:
    """A calibration as the answer of a command; ``more`` are further fields."""
    return Answer(
        found.to_dict() | {"out": str(out)} | more,
        lambda: _show(found, out),
        found.warnings,
        None if found else found.reason,
    )


def _show(found: "Calibration", out: Path) -> None:
    """Print the camera with its uncertainty, the warnings, and the paths of the files."""
    from rich.table import Table

    from scene4d.cli.output import screen

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


def _warnings(found: "Calibration") -> "Table":
    from rich.table import Table

    table = Table.grid(padding=(0, 2, 0, 0))
    table.add_column(no_wrap=True)
    table.add_column()
    for warning in found.warnings:
        table.add_row("Warning", warning)
    return table


def _rows(found: "Calibration") -> list[tuple[str, str, str]]:
    from scene4d.drawing.words import ground_error_texts, parameter_rows

    rows = [(row.name, row.value, row.meaning) for row in parameter_rows(found)] if found else []
    errors = ground_error_texts(found) if found else []
    rows += [(f"Error {error.name}", error.median, _meaning(error)) for error in errors]
    where = f"{found.frames} frame{'' if found.frames == 1 else 's'}"
    if found:
        of = f"of {found.people} sightings in {where} agree with the camera"
        rows.append(("People", str(found.inliers), of))
    else:
        rows.append(("People", str(found.people), f"sightings in {where}"))
    if found.vehicles is not None:
        of = f"sightings of {found.vehicle_count} vehicles agree with the camera"
        rows.append(("Vehicles", str(len(found.vehicles)), of))
    return rows


def _meaning(error: "ErrorText") -> str:
    walked = f"; where people walked {error.walked}" if error.walked else ""
    return f"predicted median over {error.over}; one in ten is over {error.p90}{walked}"
