"""Parsing of options that several commands share, and the layout of help texts."""

import inspect
import math
import re
import shlex
import sys
from typing import Any

import typer


def annotation_format(panel: str) -> Any:
    """The option ``--format`` of commands that read annotations."""
    return typer.Option(
        "--format",
        metavar="NAME",
        help="Format of --annotations, if the file does not show it: mot, coco, kpf, pets, "
        "towncentre-csv, towncentre-top, virat.",
        rich_help_panel=panel,
    )


CAMERA: Any = typer.Option(
    metavar="FILE", help="camera.json from calibrate, or a camera file in another known format."
)
"""The option ``--camera`` of commands that track."""
SCENE: Any = typer.Option(
    metavar="SCENE", help="Folder of the scene; created if it does not exist, extended if it does."
)
"""The option ``--out`` of commands that track."""


def detector_option(panel: str) -> Any:
    """The option ``--detector`` of commands that track."""
    return typer.Option(
        metavar="NAME|FILE",
        help="Another detector for people and vehicles: a registered name, or an ONNX file "
        "in the YOLOX layout with the COCO classes.",
        rich_help_panel=panel,
    )


def device_option(panel: str) -> Any:
    """The option ``--device`` of commands that look at footage."""
    return typer.Option(
        metavar="NAME",
        help="Where the networks of people and vehicles run: auto, cpu, cuda and other providers "
        "of ONNX Runtime, or openvino:cpu, openvino:gpu and other devices of OpenVINO.",
        rich_help_panel=panel,
    )


def person_height_option(panel: str) -> Any:
    """The option ``--person-height`` of commands that track."""
    return typer.Option(
        metavar="METRES",
        help="Mean height of the people. Default: the height used by the calibration.",
        rich_help_panel=panel,
    )


def catalogue_option(panel: str | None = None) -> Any:
    """The option ``--catalogue`` of commands that search."""
    return typer.Option(
        metavar="FILE",
        help="YAML file with your own activities, added to the built-in ones. Repeatable.",
        rich_help_panel=panel,
    )


def zones_option(panel: str) -> Any:
    """The option ``--zones`` of commands that search."""
    return typer.Option(
        metavar="FILE",
        help="Named zones and lines on the ground, in metres: GeoJSON, or names with points.",
        rich_help_panel=panel,
    )


def parse_image_size(text: str) -> tuple[int, int]:
    """``1920x1080`` as (width, height)."""
    match = re.fullmatch(r"\s*(\d{1,6})\s*[xX×]\s*(\d{1,6})\s*", text)
    if match is None or not (int(match[1]) and int(match[2])):
        raise typer.BadParameter(
            f"{text!r} is no image size; write it as 1920x1080", param_hint="--image-size"
        )
    return int(match[1]), int(match[2])


def parse_person_height(text: str) -> float:
    """A mean height of people in metres."""
    try:
        height_m = float(text)
    except ValueError:
        height_m = math.nan
    if not 0.5 <= height_m <= 2.5:
        raise typer.BadParameter(
            f"{text!r} is no mean height of people in metres, from 0.5 to 2.5; write it as 1.75",
            param_hint="--person-height",
        )
    return height_m


def reflowed(doc: str | None) -> str:
    """A docstring whose paragraphs are one line each, so that they wrap at the terminal's width.

    Indented lines (the examples) stay as they are.
    """
    paragraphs = inspect.cleandoc(doc or "").split("\n\n")
    return "\n\n".join(p if p.startswith(" ") else " ".join(p.split()) for p in paragraphs)


def command_line() -> str:
    """The command as it was typed, for a report; passwords in addresses are left out."""
    from scene4d.video.stream import without_password

    return shlex.join(["scene4d", *map(without_password, sys.argv[1:])])
