"""``scene4d export``: a camera in the format of another program."""

from pathlib import Path
from typing import Annotated

import typer

from scene4d.cli.arguments import Json, parse_image_size
from scene4d.cli.guard import guarded
from scene4d.cli.output import emit, emit_json
from scene4d.errors import InputError


def _writable() -> dict[str, str]:
    """Names and descriptions of the formats that are written."""
    from scene4d.formats.cameras import camera_formats

    return {f.name: f.description for f in camera_formats() if f.write is not None}


def _completions() -> list[str]:
    return list(_writable())


@guarded
def export(
    camera: Annotated[
        Path,
        typer.Argument(
            metavar="CAMERA", help="camera.json, or a camera file of another known format."
        ),
    ],
    *,
    to: Annotated[
        str,
        typer.Option(
            metavar="FORMAT",
            help="json, opencv-yaml, opencv-xml, krtd, colmap, ros, deepstream or matrix.",
            autocompletion=_completions,
            show_default=False,
        ),
    ],
    out: Annotated[
        Path,
        typer.Option(
            metavar="FILE", help="File to write; for COLMAP, the folder.", show_default=False
        ),
    ],
    from_format: Annotated[
        str | None,
        typer.Option("--from", metavar="FORMAT", help="Format of CAMERA, where it is not clear."),
    ] = None,
    image_size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Image size, for formats that do not hold it."),
    ] = None,
    as_json: Json = False,
) -> None:
    """Write a camera in the format of another program.

    [bold]Examples[/bold]

      scene4d export street/camera.json --to opencv-yaml --out street.yml
      scene4d export street/camera.json --to colmap --out street/sparse
      scene4d export street.krtd --to json --out camera.json

    ROS camera_info holds the lens alone. DeepStream and the bare 3x4 matrix hold no distortion:
    they are for undistorted images.
    """
    known = _writable()
    if to not in known:
        raise typer.BadParameter(
            f"{to!r} is no format that is written; known: {', '.join(known)}", param_hint="--to"
        )
    from scene4d.formats.cameras import read_camera, write_camera
    from scene4d.model import Camera

    if out.exists() and camera.exists() and out.samefile(camera):
        raise InputError(f"{out}: is the camera that is read; give another --out")
    size = None if image_size is None else parse_image_size(image_size)
    found = read_camera(camera, image_size=size, format=from_format)
    if not isinstance(found, Camera):
        raise InputError(
            f"{camera}: holds a lens and no pose, and a camera needs both; give the camera.json "
            "that `scene4d calibrate` wrote"
        )
    write_camera(found, out, to)
    if as_json:
        emit_json({"format": to, "out": str(out)})
    else:
        emit(f"Wrote {out}: {known[to]}\n")
