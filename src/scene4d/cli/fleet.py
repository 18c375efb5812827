"""``scene4d fleet``: a plan of many cameras and clips."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scene4d.cli.command import Answer, Job, command

if TYPE_CHECKING:
    from rich.console import Console

    from scene4d.fleet import FleetRun

_MOST_LINES = 20
"""Clips in quarantine that are listed; ``--json`` has all."""


@command("fleet")
def fleet(
    job: Job,
    plan: Annotated[
        Path,
        typer.Argument(
            metavar="PLAN",
            help="YAML file of cameras and what to do with them, or a folder of clips.",
        ),
    ],
    *,
    out: Annotated[
        str,
        typer.Option(
            metavar="STORE", help="Folder for the results, or an address such as s3://bucket/fleet."
        ),
    ],
    ray: Annotated[
        str | None,
        typer.Option(
            metavar="ADDRESS",
            help="Ray cluster that does the work, as 10.0.0.1:6379; local makes one of this "
            "machine. Default: one task after the other, in this process.",
        ),
    ] = None,
) -> Answer:
    """Calibrate, track, align and search many cameras, on one machine or on many.

    PLAN says what is to be done; docs/fleet.md shows one. What STORE holds already is not done
    again, so that a fleet that was killed, or whose plan has grown, goes on where it was. Clips
    that fail by their own fault go into a quarantine with the reason; the others go on. A plan with
    every_s is done again so often, with the clips that came, until Ctrl-C. One fleet works on STORE
    at a time.

    [bold]Examples[/bold]

      scene4d fleet plan.yaml --out store
      scene4d fleet clips --out store --ray local
      scene4d fleet plan.yaml --out s3://city/october --ray 10.0.0.1:6379 --json
    """
    if not plan.exists():
        raise typer.BadParameter(f"{plan} does not exist", param_hint="PLAN")
    from scene4d.fleet import run_fleet

    with job.progress() as progress:
        found = run_fleet(plan, out, ray=ray, progress=progress)
    aside = len(found.quarantine)
    word = "task is" if aside == 1 else "tasks are"
    warnings = [f"{aside} {word} in quarantine; {found.store}/quarantine says why"] if aside else []
    return Answer(found.to_dict(), lambda: _show(found, warnings), warnings)


def _show(found: "FleetRun", warnings: list[str]) -> None:
    from scene4d.cli.output import print_warnings, screen, titled

    said = found.to_dict()
    numbers = ("Tasks", "Done", "Earlier", "Aside", "Footage", "CPU")
    table = titled("Camera", "State", right=numbers)
    for name, one in said["cameras"].items():
        counts = (one[key] for key in ("tasks", "done", "earlier"))
        aside = one["quarantined"] + one["skipped"]
        hours = (f"{one[key]:.2f} h" for key in ("footage_h", "cpu_h"))
        table.add_row(name, one["state"], *map(str, counts), str(aside), *hours)
    with screen() as console:
        console.print(table)
        if warnings:
            console.print()
        print_warnings(console, warnings)
        for one in found.quarantine[:_MOST_LINES]:
            clip = f" {one['clip']}" if one["clip"] else ""
            text = f"  {one['stage']} {one['camera']}{clip}: {one['reason']}"
            console.print(text, style="yellow", soft_wrap=True)
        for words, events in found.events.items():
            _show_events(console, words, events)
        console.print(f"\nTime taken  {said['took_s']:.1f} s{_rates(said)}", soft_wrap=True)
        console.print(f"Store       {found.store}", soft_wrap=True)


def _show_events(console: "Console", words: str, events: dict[str, Any]) -> None:
    console.print(f"\n{words}: {events['events']} events", style="bold", soft_wrap=True)
    for number, one in enumerate(events["best"], 1):
        sure = "" if one["probability"] is None else f"  probability {one['probability']:.2f}"
        when = one["begin_time"] or f"{one['begin_s']:.1f} s"
        console.print(
            f"{number:3d}  {one['score']:.2f}{sure}  {when}  camera {one['camera']}  {one['clip']}",
            soft_wrap=True,
        )


def _rates(said: dict[str, Any]) -> str:
    if said["camera_hours_per_hour"] is None:
        return ""
    return (
        f"; {said['camera_hours_per_hour']:.1f} hours of footage an hour, "
        f"{said['cpu_h_per_camera_hour']:.2f} hours of a core for each"
    )
