"""``scene4d export``: a camera or a scene in the format of another program."""

from collections.abc import Iterable, Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene4d.cli.arguments import parse_image_size
from scene4d.cli.command import Answer, Job, command
from scene4d.cli.output import emit, visible
from scene4d.core.errors import InputError
from scene4d.core.staging import ensure_folder

if TYPE_CHECKING:
    from scene4d.cli.exporting import GroundPoint
    from scene4d.formats.cameras import CameraFormat
    from scene4d.formats.scenes import SceneFormat


def _writable() -> list[str]:
    """Names of the camera formats that can be written."""
    from scene4d.formats.cameras import camera_formats

    return [known.name for known in camera_formats() if known.write is not None]


@command("export")
def export(
    job: Job,
    what: Annotated[
        Path,
        typer.Argument(
            metavar="CAMERA|SCENE|SITE",
            help="camera.json, a camera file in another known format, or the folder of a scene or "
            "a site.",
        ),
    ],
    *,
    to: Annotated[
        str,
        typer.Option(
            metavar="FORMAT",
            help="For a camera: json, opencv-yaml, opencv-xml, krtd, colmap, ros, deepstream or "
            "matrix. For a scene: csv, mot, kpf, geojson, moving-features, openlabel or rerun.",
            autocompletion=_writable,
        ),
    ],
    out: Annotated[Path, typer.Option(metavar="FILE", help="File to write; for COLMAP, a folder.")],
    from_format: Annotated[
        str | None,
        typer.Option(
            "--from", metavar="FORMAT", help="Format of CAMERA, if the file does not show it."
        ),
    ] = None,
    image_size: Annotated[
        str | None,
        typer.Option(metavar="WxH", help="Image size, for formats that do not store it."),
    ] = None,
    run: Annotated[
        str | None, typer.Option(metavar="NAME", help="Run to export, if the scene holds several.")
    ] = None,
    anchor: Annotated[
        list[str] | None,
        typer.Option(
            metavar="U,V,LAT,LON",
            help="A pixel on the ground with its latitude and longitude in degrees, to "
            "georeference a scene; give two or more.",
        ),
    ] = None,
) -> Answer:
    """Write a camera, a scene or a site in the format of another program.

    [bold]Examples[/bold]

      scene4d export street/camera.json --to opencv-yaml --out street.yml
      scene4d export street/camera.json --to colmap --out street/sparse
      scene4d export street.krtd --to json --out camera.json
      scene4d export scene --to csv --out tracks.csv
      scene4d export scene --to geojson --out tracks.geojson \\
          --anchor 420,510,53.4401,-0.9432 --anchor 130,390,53.4405,-0.9429
      scene4d export site --to geojson --out people.geojson

    ROS camera_info holds only the lens. DeepStream and the bare 3x4 matrix hold no distortion: use
    them with undistorted images. Fisheye cameras can be written as json, opencv-yaml, opencv-xml,
    colmap and ros.
    """
    from scene4d.cli.exporting import is_scene
    from scene4d.store.site_file import is_site

    if not what.exists():
        raise InputError(f"{what}: is not there; give a camera file or the folder of a scene")
    if is_site(what):
        return _export_site(what, to, out)
    if is_scene(what):
        return _export_scene(what, to, out, run, anchor or [])
    return _export_camera(what, to, out, from_format, image_size)


def _parse_anchor(text: str) -> "GroundPoint":
    """``u,v,lat,lon`` as a point."""
    from scene4d.cli.exporting import GroundPoint

    try:
        u, v, lat, lon = (float(word) for word in text.split(","))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is no anchor; write it as 420,510,53.4401,-0.9432 (u,v,lat,lon)",
            param_hint="--anchor",
        ) from None
    return GroundPoint(u, v, lat, lon)


def _export_scene(scene: Path, to: str, out: Path, run: str | None, anchor: list[str]) -> Answer:
    from scene4d.cli.exporting import export_scene
    from scene4d.formats.scenes import scene_formats

    description = _description(to, scene_formats(), "of scenes")
    points = [_parse_anchor(text) for text in anchor]
    return _written(to, description, export_scene(scene, out, to, run=run, anchor=points))


def _export_site(site: Path, to: str, out: Path) -> Answer:
    from scene4d.cli.exporting import export_site
    from scene4d.formats.scenes import scene_formats

    description = _description(to, scene_formats(), "of sites")
    return _written(to, description, export_site(site, out, to))


def _export_camera(
    camera: Path,
    to: str,
    out: Path,
    from_format: str | None,
    image_size: str | None,
) -> Answer:
    from scene4d.core.calibration import GIVEN
    from scene4d.core.camera import Camera
    from scene4d.formats.cameras import (
        camera_formats,
        read_calibration,
        read_camera,
        write_camera,
    )

    writable = [known for known in camera_formats() if known.write is not None]
    description = _description(to, writable, "that is written")
    if out.exists() and camera.exists() and out.samefile(camera):
        raise InputError(f"{out}: is the camera that is read; give another --out")
    size = None if image_size is None else parse_image_size(image_size)
    found = read_camera(camera, image_size=size, format=from_format)
    if not isinstance(found, Camera):
        raise InputError(
            f"{camera}: holds a lens and no pose, and a camera needs both; give the camera.json "
            "that `scene4d calibrate` wrote"
        )
    calibration = None if from_format else read_calibration(camera, image_size=size)
    if to == "json" and calibration is not None and calibration.method != GIVEN:
        ensure_folder(out.parent)
        calibration.save(out)  # with its covariance, which a bare camera lacks
    else:
        write_camera(found, out, to)
    return _written(to, description, (out,))


def _description(to: str, formats: "Iterable[CameraFormat | SceneFormat]", which: str) -> str:
    """What a format says of itself. Raises :class:`typer.BadParameter` for one that is unknown."""
    known = {one.name: one.description for one in formats}
    if to not in known:
        raise typer.BadParameter(
            f"{to!r} is no format {which}; known: {', '.join(known)}", param_hint="--to"
        )
    return known[to]


def _written(to: str, description: str, files: Sequence[Path]) -> Answer:
    lines = "".join(f"Wrote {path}: {description}\n" for path in files)
    return Answer(
        {"format": to, "out": [str(path) for path in files]}, lambda: emit(visible(lines))
    )
