"""``scene4d align``: several scenes become one site."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated, Any

import typer

from scene4d.cli.command import Answer, Job, command, output_folder

if TYPE_CHECKING:
    from scene4d.alignment import Alignment


@command("align")
def align(
    job: Job,
    scenes: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCENE...", help="Folders written by track: of two cameras or more."
        ),
    ],
    *,
    out: Annotated[
        Path,
        typer.Option(metavar="SITE", help="Folder for site.json, identities, plan.png and pairs/."),
    ],
    anchor: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="JSON or CSV with ground points whose longitude and latitude or metres on a floor "
            "plan are known, GeoJSON with lines that tracks keep to (roads, pavements), or known "
            "cameras: the site's frame becomes that.",
        ),
    ] = None,
    max_offset: Annotated[
        float,
        typer.Option(
            metavar="SECONDS",
            min=0.1,
            max=86_400,
            help="How far apart clocks may be; without known starts, how much later one clip may "
            "begin than another.",
        ),
    ] = 600.0,
    pictures: Annotated[
        bool, typer.Option("--pictures/--no-pictures", help="Draw plan.png and pairs/.")
    ] = True,
) -> Answer:
    """Put several cameras on one ground and one clock, from the people whom they share.

    Needs no clicks and no targets: who walks through two views tells where one lies to the other,
    how its clock is off, and by how much its metre differs. A camera that shares nobody is
    undetermined, with the reason. People and vehicles get one number in all cameras. Search and
    export take the site as they take a scene; docs/sites.md shows how.

    [bold]Examples[/bold]

      scene4d align hall-scene yard-scene gate-scene --out site
      scene4d align north south --out site --anchor points.csv
      scene4d align north south --out site --anchor roads.geojson
      scene4d align scenes/* --out site --max-offset 30 --json
    """
    from scene4d.alignment import AlignOptions
    from scene4d.alignment import align as align_scenes

    options = AlignOptions(anchor, max_offset, pictures)
    with output_folder(out), job.progress() as progress:
        found = align_scenes(scenes, out, options, progress=progress)
    return Answer(
        found.to_dict(),
        lambda: _show(found),
        found.warnings,
        undetermined=None if found.reason is None else _with_remedy(found.reason),
        what="site",
    )


def _with_remedy(reason: str) -> str:
    said = reason.replace("; ", ", ")
    return f"{said}; track longer footage in which people walk through both views, or give --anchor"


def _show(found: "Alignment") -> None:
    from scene4d.cli.output import print_warnings, screen, titled

    numbers = ("East or right", "North or ahead", "Heading", "Clock", "Scale")
    table = titled("Camera", right=numbers)
    undetermined = []
    said = found.to_dict()
    for name, one in said["cameras"].items():
        if one["status"] != "ok":
            undetermined.append(f"{name}: undetermined: {one['reason']}")
            continue
        table.add_row(name, *_row(one))
    with screen() as console:
        if table.row_count:
            console.print(table)
        for line in undetermined:
            console.print(line, style="yellow", soft_wrap=True)
        print_warnings(console, found.warnings)
        console.print(
            f"\nPeople and vehicles  {said['identities']} in {said['tracks']} tracks, "
            f"{said['seen_by_several']} seen by more than one camera"
        )
        taken = ", ".join(f"{name} {s:.1f} s" for name, s in found.timings.items() if s >= 0.05)
        console.print(f"Time taken           {taken}")
        console.print(f"Site                 {found.site.folder}", soft_wrap=True)


def _row(one: dict[str, Any]) -> list[str]:
    sigma = one["sigma"]
    return [
        f"{one['x_m']:.2f} ± {sigma['x_m']:.2f} m",
        f"{one['y_m']:.2f} ± {sigma['y_m']:.2f} m",
        f"{one['heading_deg']:.1f} ± {sigma['heading_deg']:.1f}°",
        f"{one['time_offset_s']:+.2f} ± {sigma['time_offset_s']:.2f} s",
        f"{one['scale']:.3f} ± {sigma['scale']:.3f}",
    ]
