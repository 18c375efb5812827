"""``scene4d watch``: a camera tracked while it runs."""

import json
import signal
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import replace
from functools import partial
from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scene4d.cli.arguments import (
    SCENE,
    catalogue_option,
    detector_option,
    device_option,
    parse_person_height,
    person_height_option,
    zones_option,
)
from scene4d.cli.command import Answer, Job, command, output_folder
from scene4d.cli.output import emit, facts, visible

if TYPE_CHECKING:
    from rich.table import Table

    from scene4d.tracking import WatchRun

_WATCHING = "Input"
_MEANING = "Scene"
_ASKED = "Events"


@command("watch")
def watch(
    job: Job,
    sources: Annotated[
        list[str],
        typer.Argument(
            metavar="SOURCE...",
            help="Stream URL, capture device such as /dev/video0, or a video, which is played at "
            "real time. Several are watched at once.",
        ),
    ],
    *,
    camera: Annotated[
        list[Path],
        typer.Option(
            metavar="FILE",
            help="The camera's calibration: camera.json, or another format. One for each SOURCE.",
        ),
    ],
    out: Annotated[Path, SCENE],
    rate: Annotated[
        float,
        typer.Option(
            metavar="HZ",
            min=0.01,
            max=1000,
            help="Frames analysed per second, if the machine keeps up; others are dropped.",
            rich_help_panel=_WATCHING,
        ),
    ] = 10.0,
    give_up: Annotated[
        float | None,
        typer.Option(
            metavar="SECONDS",
            min=0,
            help="End if a lost stream does not come back for this long. Default: try for ever.",
            rich_help_panel=_WATCHING,
        ),
    ] = None,
    recalibrate: Annotated[
        bool,
        typer.Option(
            "--recalibrate",
            help="When the view has moved and stands still again, watch people for 100 s, "
            "calibrate on them, and go on as another camera.",
            rich_help_panel=_WATCHING,
        ),
    ] = False,
    search: Annotated[
        list[str] | None,
        typer.Option(
            metavar="WORDS",
            help='What to search for meanwhile, as "person enters vehicle". Repeatable. Searches '
            "kept in the scene (SCENE/standing.json, which the page writes) are looked for too.",
            rich_help_panel=_ASKED,
        ),
    ] = None,
    alert: Annotated[
        list[str] | None,
        typer.Option(
            metavar="URL|COMMAND",
            help="Where to send each event: https://... (a webhook), mqtt://host/topic, or "
            "exec:COMMAND, which reads it. Repeatable.",
            rich_help_panel=_ASKED,
        ),
    ] = None,
    min_score: Annotated[
        float,
        typer.Option(
            metavar="P",
            min=0.0,
            max=1.0,
            help="Lowest score of an event, which ranks events and is no probability.",
            rich_help_panel=_ASKED,
        ),
    ] = 0.3,
    catalogue: Annotated[list[Path] | None, catalogue_option(_ASKED)] = None,
    zones: Annotated[Path | None, zones_option(_ASKED)] = None,
    detector: Annotated[str | None, detector_option(_WATCHING)] = None,
    device: Annotated[str, device_option(_WATCHING)] = "auto",
    name: Annotated[
        list[str] | None,
        typer.Option(
            "--name",
            metavar="NAME",
            help="Name of the camera in the scene, one for each SOURCE. Default: the name of the "
            "source.",
            rich_help_panel=_MEANING,
        ),
    ] = None,
    person_height: Annotated[str | None, person_height_option(_MEANING)] = None,
) -> Answer:
    """Track a running camera: what it sees is in the scene within two seconds.

    Others can read the scene meanwhile. Frames that cannot be analysed in time are dropped and
    counted. A lost stream is opened again. While the view has moved nobody is tracked. Ctrl-C
    ends it.

    Each event of --search is one line, soon after its end, and another when it is final. With
    --json each is a line of JSON, and the summary follows.

    [bold]Examples[/bold]

      scene4d watch rtsp://gate/live --camera gate/camera.json --out scene
      scene4d watch gate.mp4 --camera gate/camera.json --out scene --rate 5
      scene4d watch rtsp://gate/live rtsp://yard/live --rate 2 --out scene \\
          --camera gate/camera.json --camera yard/camera.json
      scene4d watch /dev/video0 --camera gate/camera.json --out scene \\
          --search "person enters vehicle" --alert mqtt://broker/gate
    """
    height_m = None if person_height is None else parse_person_height(person_height)
    from scene4d.tracking import TrackOptions, WatchOptions, watch_several
    from scene4d.tracking import watch as watch_camera

    tracking = TrackOptions(
        rate_hz=rate, person_height_m=height_m, detector=detector, device=device
    )
    options = WatchOptions(
        give_up_s=give_up,
        recalibrate=recalibrate,
        searches=search or (),
        min_score=min_score,
        catalogues=catalogue or (),
        zones=zones,
        alerts=alert or (),
    )
    tell = _tell_json if job.as_json else partial(_tell, several=len(sources) > 1)
    with output_folder(out), job.progress() as progress, _stopping() as stop:
        if len(sources) > 1:
            runs = watch_several(
                sources, camera, out, options, tracking, names=name or (), stop=stop, tell=tell
            )
            fields = {"out": str(out), "cameras": [run.to_dict() for run in runs]}
        else:
            if len(camera) > 1 or len(name or ()) > 1:
                raise typer.BadParameter("is more than the one of SOURCE", param_hint="--camera")
            tracking = replace(tracking, name=name[0] if name else None)
            run = watch_camera(
                sources[0], camera[0], out, options, tracking,
                stop=stop, tell=tell, progress=progress,
            )  # fmt: skip
            runs, fields = [run], run.to_dict()
    warnings = [text for run in runs for text in run.warnings]
    return Answer(fields, lambda: _show(runs), warnings)


@contextmanager
def _stopping() -> Iterator[threading.Event]:
    """Set by Ctrl-C and SIGTERM: watching then ends normally. A second one ends it at once."""
    stop = threading.Event()
    if threading.current_thread() is not threading.main_thread():
        yield stop
        return
    before = {kind: signal.getsignal(kind) for kind in (signal.SIGINT, signal.SIGTERM)}

    def ask(kind: int, _: object) -> None:
        stop.set()
        signal.signal(kind, before[signal.Signals(kind)])

    try:
        for kind in before:
            signal.signal(kind, ask)
        yield stop
    finally:
        for kind, handler in before.items():
            signal.signal(kind, handler)


def _tell_json(event: dict[str, Any]) -> None:
    emit(json.dumps(event, allow_nan=False) + "\n")


def _tell(event: dict[str, Any], *, several: bool) -> None:
    """When it ended, its score, what it is, who took part, and of several cameras which."""
    who = ", ".join(f"{role} {track}" for role, track in event["roles"].items())
    state = event["state"]
    where = f"{event['camera']}  " if several else ""
    late = f"{event['latency_s']:.1f} s ago" if state == "provisional" else state
    emit(
        visible(
            f"{event['end_time']}  {where}{event['score']:.2f}  {event['search']}  {who}  ({late})"
        )
        + "\n"
    )


def _show(runs: "list[WatchRun]") -> None:
    from scene4d.cli.output import print_warnings, screen

    with screen() as console:
        for run in runs:
            console.print(_summary(run, several=len(runs) > 1))
        print_warnings(console, (text for run in runs for text in run.warnings))
        console.print(f"\nScene    {runs[0].scene}", soft_wrap=True)
        for run in runs:
            if run.picture is not None:
                console.print(f"Picture  {run.picture}", soft_wrap=True)


def _summary(run: "WatchRun", *, several: bool) -> "Table":
    table = facts()
    found = ", ".join(f"{count} x {name}" for name, count in run.tracks.items()) or "nobody"
    if several:
        table.add_row("Camera", run.camera)
    table.add_row("Tracks", found)
    table.add_row("Rows", f"{run.rows:,}")
    table.add_row("Frames", f"{run.offered:,}, of which {run.dropped:,} dropped")
    if run.events:
        table.add_row("Events", f"{run.events}, {run.alerts_sent} alerts delivered")
    if run.reconnected:
        table.add_row("Reconnected", f"{run.reconnected} x")
    if run.not_in_view_s:
        table.add_row("View moved", f"for {run.not_in_view_s:.0f} s")
    if len(run.cameras) > 1:
        table.add_row("Calibrated again", ", ".join(run.cameras[1:]))
    return table
