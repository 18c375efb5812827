"""``scene4d track``: people and vehicles on the ground, written as a scene."""

import re
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene4d.cli.arguments import (
    CAMERA,
    SCENE,
    annotation_format,
    detector_option,
    device_option,
    parse_person_height,
    person_height_option,
)
from scene4d.cli.command import Answer, Job, command, output_folder

if TYPE_CHECKING:
    from scene4d.tracking import TrackRun

_WATCHING = "Input"
_MEANING = "Scene"


@command("track")
def track(
    job: Job,
    source: Annotated[
        str | None,
        typer.Argument(
            metavar="SOURCE",
            help="Video or stream URL of the calibrated camera. Not needed with --annotations.",
        ),
    ] = None,
    *,
    camera: Annotated[Path, CAMERA],
    out: Annotated[Path, SCENE],
    annotations: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="Use these boxes instead of the built-in detectors: KPF, MOTChallenge, PETS XML, "
            "TownCentre, COCO, VIRAT. Track numbers in the file are kept.",
            rich_help_panel=_WATCHING,
        ),
    ] = None,
    rate: Annotated[
        float,
        typer.Option(
            metavar="HZ",
            min=0.01,
            max=1000,
            help="Frames used per second of footage.",
            rich_help_panel=_WATCHING,
        ),
    ] = 10.0,
    detector: Annotated[str | None, detector_option(_WATCHING)] = None,
    device: Annotated[str, device_option(_WATCHING)] = "auto",
    fps: Annotated[
        float | None,
        typer.Option(
            metavar="HZ",
            min=0.01,
            max=1000,
            help="Frame rate of --annotations, if there is no SOURCE.",
            rich_help_panel=_WATCHING,
        ),
    ] = None,
    format_: Annotated[str | None, annotation_format(_WATCHING)] = None,
    drop_invalid: Annotated[
        bool,
        typer.Option(
            "--drop-invalid",
            help="Skip impossible boxes in --annotations, with a warning.",
            rich_help_panel=_WATCHING,
        ),
    ] = False,
    name: Annotated[
        str | None,
        typer.Option(
            "--name",
            metavar="NAME",
            help="Name of the camera in the scene. Default: the name of the footage.",
            rich_help_panel=_MEANING,
        ),
    ] = None,
    start: Annotated[
        str | None,
        typer.Option(
            metavar="TIME",
            help="Start time of the footage, as 2026-11-20T08:00:00Z. Default: unknown; times then "
            "count from 1970.",
            rich_help_panel=_MEANING,
        ),
    ] = None,
    person_height: Annotated[str | None, person_height_option(_MEANING)] = None,
) -> Answer:
    """Track people and vehicles on the ground, in metres and seconds, and write the scene.

    The scene is a folder of Parquet files with one row per object and time: position with its
    covariance, velocity, heading, box and keypoints. A run that was interrupted resumes when it is
    started again; another run adds to the scene.

    [bold]Examples[/bold]

      scene4d track gate.mp4 --camera gate/camera.json --out scene
      scene4d track gate.mp4 --camera gate/camera.json --out scene \\
          --name gate --start 2026-11-20T08:00:00Z
      scene4d track --annotations clip.geom.yml --fps 30 \\
          --camera G328.krtd --out scene
    """
    if source is None and annotations is None:
        raise typer.BadParameter("give footage, or --annotations", param_hint="SOURCE")
    if fps is not None and annotations is None:
        raise typer.BadParameter(
            "is for --annotations; --rate sets how many frames of the footage are used",
            param_hint="--fps",
        )
    height_m = None if person_height is None else parse_person_height(person_height)
    from scene4d.tracking import TrackOptions
    from scene4d.tracking import track as follow_footage

    options = TrackOptions(
        annotations=annotations,
        name=name,
        start=None if start is None else _parse_start(start),
        rate_hz=rate,
        fps=fps,
        person_height_m=height_m,
        drop_invalid=drop_invalid,
        format=format_,
        detector=detector,
        device=device,
    )
    with output_folder(out), job.progress() as progress:
        run = follow_footage(source, camera, out, options, progress=progress)
    return Answer(run.to_dict(), lambda: _show(run), run.warnings)


def _parse_start(text: str) -> datetime:
    """An ISO 8601 time; without a zone it is UTC."""
    try:
        time = datetime.fromisoformat(re.sub(r"[zZ]$", "+00:00", text.strip()))
    except ValueError:
        raise typer.BadParameter(
            f"{text!r} is no time; write it as 2026-11-20T08:00:00Z", param_hint="--start"
        ) from None
    return (time if time.tzinfo else time.replace(tzinfo=UTC)).astimezone(UTC)


def _times(timings: dict[str, float]) -> str:
    return ", ".join(f"{k} {v:.1f} s" for k, v in timings.items() if v >= 0.05)


def _show(run: "TrackRun") -> None:
    from scene4d.cli.output import facts, print_warnings, screen

    table = facts()
    found = ", ".join(f"{count} x {name}" for name, count in run.tracks.items()) or "nobody"
    table.add_row("Tracks", found)
    table.add_row("Rows", f"{run.rows:,}")
    if run.without_position:
        table.add_row("No position", f"{run.without_position:,} sightings without a ground point")
    if run.resumed:
        table.add_row("Resumed", "where an earlier run stopped, or was complete")
    table.add_row("Time taken", _times(run.timings))
    with screen() as console:
        console.print(table)
        print_warnings(console, run.warnings)
        console.print(f"\nScene    {run.scene}", soft_wrap=True)
        if run.picture is not None:
            console.print(f"Picture  {run.picture}", soft_wrap=True)
        if run.objects_picture is not None:
            console.print(f"Objects  {run.objects_picture}", soft_wrap=True)
