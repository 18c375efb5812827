"""``scene4d demo``: a first calibration, on footage with a published reference camera."""

from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene4d.cli.arguments import command_line
from scene4d.cli.command import Answer, Job, command, output_folder
from scene4d.cli.output import emit, say, visible
from scene4d.core.errors import OutputError, UnavailableError

if TYPE_CHECKING:
    import numpy as np

    from scene4d.calibration.calibrating import Run
    from scene4d.core.progress import Progress
    from scene4d.searching import SearchResult

_TITLE = "PETS 2009 S2.L1, View 001"
PUBLISHED = "height 7.07 m, tilt 16.48°, roll -3.09°"
"""Tsai calibration of View_001 that the University of Reading published with the footage."""


_SEARCH = "a person walks faster than 1 m/s for more than 2 seconds"
_RATE_HZ = 5.0
"""Half of the default, so that the demo ends within a minute."""
_TRACKED_S = 20.0
"""Seconds of the sample that are tracked; they show some people and both parked cars."""


@command("demo")
def demo(
    job: Job,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for the camera, the scene and the pages.")
    ] = Path("scene4d-demo"),
) -> Answer:
    """Run the whole pipeline on a sample video: camera, tracks, one search, and their pages.

    The sample is 80 seconds of people on a campus (PETS 2009, University of Reading) with a
    published camera calibration. The video and the networks are downloaded once, about 100 and
    70 MB. If they are unavailable, the demo says so and calibrates from people that scene4d
    detected in this video beforehand.

    [bold]Examples[/bold]

      scene4d demo
      scene4d demo --out first --json
    """
    from scene4d.calibration.writing import write
    from scene4d.cli.calibrate import calibrated

    with output_folder(out), job.progress() as progress:
        result, video = _calibrated(progress)
        write(result, out, progress=progress)
        chain = None if video is None else _tracked_and_searched(video, out, progress)
    source = "embedded table" if video is None else "video"
    more = {} if chain is None else {"scene": str(out / "scene"), "search": chain.to_dict()}
    camera = calibrated(result.calibration, out, people_from=source, **more)
    return replace(camera, show=lambda: _show(camera, chain, out))


def _show(camera: Answer, chain: "SearchResult | None", out: Path) -> None:
    camera.show()
    lines = [f"\nThe published calibration of this camera: {PUBLISHED}."]
    if chain is not None:
        best = f", the best from {chain.events[0].event.begin_s:.0f} s" if chain.events else ""
        lines += [
            f'Searched the first {_TRACKED_S:.0f} s for "{_SEARCH}":',
            f"{len(chain.events)} events{best}.",
            "\nOpen these pages:",
            f"  {out / 'page.html'}",
            f"  {out / 'report.html'}",
            *(f"  {path}" for path in sorted((out / "scene" / "figures").glob("*"))),
            f"  {out / 'search' / 'search.html'}",
        ]
    emit(visible("\n".join(lines) + "\n"))


def _tracked_and_searched(video: Path, out: Path, progress: "Progress") -> "SearchResult":
    from scene4d.app import ViewOptions, view
    from scene4d.searching import SearchOptions, answer, understand
    from scene4d.store.query import Scene
    from scene4d.tracking import TrackOptions, track
    from scene4d.video.sample import first_seconds

    clip = first_seconds(video, out / "pets.avi", _TRACKED_S)
    options = TrackOptions(rate_hz=_RATE_HZ)
    track(clip, out / "camera.json", out / "scene", options, progress=progress)
    found = answer(understand(Scene.open(out / "scene"), _SEARCH, SearchOptions()), progress)
    found.save(out / "search", command=None, progress=progress)
    view([out / "scene"], out / "page.html", ViewOptions(searches=[_SEARCH]), progress=progress)
    return found


def _calibrated(progress: "Progress") -> "tuple[Run, Path | None]":
    """The camera, and the footage if it and the networks are available."""
    from scene4d.calibration.calibrating import run
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.calibration.watching import fetch_weights
    from scene4d.core.fetching import cache_dir
    from scene4d.video.sample import sample_video

    video = None
    try:
        with progress.stage("Getting the sample video", None):
            video = sample_video(cache_dir() / "samples")
        fetch_weights(progress, vehicles=True)
    except (UnavailableError, OutputError) as error:
        return _from_embedded_people(video, str(error), progress), None
    return run(video, CalibrateOptions(), progress, command=command_line()), video


def _from_embedded_people(video: Path | None, why: str, progress: "Progress") -> "Run":
    from scene4d.calibration.calibrating import run_detections
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.formats.demo import demo_detections

    missing = "sample video" if video is None else "networks"
    say(f"scene4d: {' '.join(why.split())}")
    say("scene4d: continuing with people that scene4d detected in the sample video beforehand")
    note = (
        f"The {missing} could not be downloaded: this calibration uses a table of people that "
        "scene4d detected in the sample video beforehand."
    )
    return run_detections(
        demo_detections(),
        CalibrateOptions(),
        progress,
        _TITLE,
        image_bgr=None if video is None else _first_picture(video),
        notes=(note,),
        command=command_line(),
    )


def _first_picture(video: Path) -> "np.ndarray":
    from scene4d.video.reader import open_source

    with open_source(video) as footage:
        return next(footage.frames([0])).image_bgr
