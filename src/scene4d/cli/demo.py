"""``scene4d demo``: a first calibration, on footage whose true camera is published."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene4d.cli.command import Answer, Job, command, output_folder
from scene4d.cli.output import say
from scene4d.core.errors import OutputError, UnavailableError

if TYPE_CHECKING:
    import numpy as np

    from scene4d.calibration.calibrating import Run
    from scene4d.core.progress import Progress

_TITLE = "PETS 2009 S2.L1, View 001"
PUBLISHED = "height 7.07 m, tilt 16.48°, roll -3.09°"
"""Tsai calibration of View_001 that the University of Reading published with the footage."""


@command("demo")
def demo(
    job: Job,
    out: Annotated[
        Path, typer.Option(metavar="DIR", help="Folder for the camera and the report.")
    ] = Path("scene4d-demo"),
) -> Answer:
    """Calibrate the camera of a sample video, and say where the report lies.

    The sample is 80 seconds of people on a campus (PETS 2009, University of Reading), whose true
    camera is published. It and the networks are fetched once, about 100 and 45 MB. Where they
    cannot be had, the demo says so and goes on from people that scene4d detected in this video
    beforehand.

    [bold]Examples[/bold]

      scene4d demo
      scene4d demo --out first --json
    """
    from scene4d.calibration.writing import write
    from scene4d.cli.arguments import command_line
    from scene4d.cli.calibrate import calibrated

    with output_folder(out), job.progress() as progress:
        result, people = _calibrated(progress)
        write(result, out, command=command_line(), progress=progress)
    return calibrated(result.calibration, out, people_from=people)


def _calibrated(progress: "Progress") -> "tuple[Run, str]":
    from scene4d.calibration.calibrating import run
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.calibration.watching import fetch_weights
    from scene4d.core.fetching import cache_dir
    from scene4d.video.sample import sample_video

    video = None
    try:
        with progress.stage("Getting the sample video", None):
            video = sample_video(cache_dir() / "samples")
        fetch_weights(progress)
    except (UnavailableError, OutputError) as error:
        return _from_embedded_people(video, str(error), progress), "embedded table"
    return run(video, CalibrateOptions(), progress), "video"


def _from_embedded_people(video: Path | None, why: str, progress: "Progress") -> "Run":
    from scene4d.calibration.calibrating import run_detections
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.formats.demo import demo_detections

    missing = "sample video" if video is None else "networks"
    say(f"scene4d: {' '.join(why.split())}")
    say("scene4d: going on from people that scene4d detected in the sample video beforehand")
    note = (
        f"The {missing} could not be had: this is calibrated from a table of people that scene4d "
        "detected in the sample video beforehand."
    )
    return run_detections(
        demo_detections(),
        CalibrateOptions(),
        progress,
        _TITLE,
        image_bgr=None if video is None else _first_picture(video),
        notes=(note,),
    )


def _first_picture(video: Path) -> "np.ndarray":
    from scene4d.video.reader import open_source

    with open_source(video) as footage:
        return next(footage.frames([0])).image_bgr
