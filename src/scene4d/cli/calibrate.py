"""``scene4d calibrate``: footage in, camera and report out."""

import shlex
import sys
from enum import StrEnum
from pathlib import Path
from typing import Annotated

import typer

from scene4d.cli.arguments import Json, parse_image_size, parse_person_height
from scene4d.cli.guard import guarded


class Method(StrEnum):
    """How the camera is solved for."""

    joint = "joint"
    paper = "paper"


_FOOTAGE, _KNOWN, _SOLVER = "What is looked at", "What is known beforehand", "How it is solved"


@guarded
def calibrate(
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="SOURCE",
            help="Video, image, folder of images, quoted glob, or stream address (rtsp://...). "
            "May be left out with --annotations and --image-size.",
            show_default=False,
        ),
    ] = None,
    *,
    out: Annotated[
        Path,
        typer.Option(
            metavar="DIR",
            help="Folder for camera.json, report.html, figures/ and people.parquet; made if it "
            "is not there.",
            show_default=False,
        ),
    ],
    frames: Annotated[
        int | None,
        typer.Option(
            min=1,
            metavar="N",
            help="Look at N frames spread over the footage. Default: one a second, 100 to 200.",
            rich_help_panel=_FOOTAGE,
            show_default=False,
        ),
    ] = None,
    annotations: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Boxes or keypoints of people instead of the built-in detector: MOTChallenge, "
            "COCO, KPF, PETS XML, TownCentre.",
            rich_help_panel=_FOOTAGE,
            show_default=False,
        ),
    ] = None,
    image_size: Annotated[
        str | None,
        typer.Option(
            metavar="WxH",
            help="Size of the images that the annotations were made on, if there is no SOURCE.",
            rich_help_panel=_FOOTAGE,
            show_default=False,
        ),
    ] = None,
    drop_invalid: Annotated[
        bool,
        typer.Option(
            "--drop-invalid",
            help="Leave out impossible boxes of --annotations, with a warning, instead of "
            "refusing the file.",
            rich_help_panel=_FOOTAGE,
        ),
    ] = False,
    person_height: Annotated[
        str,
        typer.Option(
            metavar="METRES",
            help="Mean height of the people, shoes included: the scale of everything.",
            rich_help_panel=_KNOWN,
        ),
    ] = "1.70",
    lens: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Camera file of any known format whose focal length and distortion are taken.",
            rich_help_panel=_KNOWN,
            show_default=False,
        ),
    ] = None,
    estimate_focal: Annotated[
        bool,
        typer.Option(
            "--estimate-focal",
            help="Take the distortion alone from --lens and estimate the focal length.",
            rich_help_panel=_KNOWN,
        ),
    ] = False,
    orientation: Annotated[
        str,
        typer.Option(
            metavar="auto|people|network|FILE",
            help="What is known of focal length, tilt and roll. auto: what the orientation "
            "network reads in the pictures, as a guess that the people may overrule. people: "
            "nothing. network: its reading is believed. FILE: JSON with focal_px, tilt_deg, "
            "roll_deg and, if it is not exact, sigma, as scene4d orientation writes it.",
            rich_help_panel=_KNOWN,
        ),
    ] = "auto",
    method: Annotated[
        Method,
        typer.Option(
            help="joint: focal length, tilt, roll, height and distortion together. paper: the "
            "height alone, as Wagner et al. (2019), the rest read by the orientation network or "
            "told by --orientation FILE.",
            rich_help_panel=_SOLVER,
        ),
    ] = Method.joint,
    seed: Annotated[
        int,
        typer.Option(
            min=0,
            metavar="N",
            help="Seed of random draws; the same seed gives the same camera.",
            rich_help_panel=_SOLVER,
        ),
    ] = 0,
    as_json: Json = False,
) -> None:
    """Calibrate a fixed camera from footage of people walking.

    Finds focal length, tilt, roll, lens distortion and height above the ground in metres, with
    their uncertainty. Nothing is clicked or measured; the scale comes from how tall people are.

    The camera must stand still, the ground must be level where people walk, and at least three
    people must be seen from head to foot; more people, near and far, left and right, are better.

    [bold]Examples[/bold]

      scene4d calibrate street.mp4 --out street
      scene4d calibrate "frames/*.jpg" --out yard --lens lens.yaml
      scene4d calibrate rtsp://10.0.0.7/main --out gate --person-height 1.75
      scene4d calibrate --annotations gt.txt --image-size 1920x1080 \\
          --lens lens.yaml --out mot

    A camera that the people do not determine ends with exit code 1; camera.json and the report
    then say what is missing.
    """
    size = None if image_size is None else parse_image_size(image_size)
    height_m = parse_person_height(person_height)
    if source is None and (annotations is None or image_size is None):
        raise typer.BadParameter(
            "give footage, or both --annotations and --image-size", param_hint="SOURCE"
        )
    if method is Method.paper and orientation == "people":
        raise typer.BadParameter(
            "the paper's method needs the camera's orientation: say network, give a FILE, or use "
            "--method joint",
            param_hint="--orientation",
        )
    from scene4d.calibration.calibrating import run
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.calibration.writing import write
    from scene4d.cli.folder import output_folder
    from scene4d.cli.progress import shown
    from scene4d.cli.summary import finish

    options = CalibrateOptions(
        lens=lens,
        annotations=annotations,
        image_size=size,
        person_height_m=height_m,
        method=method.value,
        orientation=orientation,
        estimate_focal=estimate_focal,
        frames=frames,
        seed=seed,
        drop_invalid=drop_invalid,
    )
    with output_folder(out), shown() as progress:
        result = run(source, options, progress)
        write(result, out, command=command_line(), progress=progress)
    finish(result.calibration, out, as_json=as_json)


def command_line() -> str:
    """The command as it was typed, for the report; passwords in addresses are left out."""
    from scene4d.video.stream import without_password

    return shlex.join(["scene4d", *map(without_password, sys.argv[1:])])
