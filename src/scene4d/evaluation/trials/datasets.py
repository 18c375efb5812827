"""The data sets of the paper, and PETS 2009."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np

from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.watching import Seen, annotated, watch
from scene4d.core.errors import InputError
from scene4d.core.orientation import Orientation
from scene4d.core.progress import Progress
from scene4d.evaluation import (
    PUBLISHED,
    Evaluation,
    FewPeople,
    Reference,
    pets,
    spread_frames,
    towncentre,
    virat,
)
from scene4d.evaluation.trials.few import DRAWS, PEOPLE, WAYS, few_people
from scene4d.evaluation.trials.methods import HEIGHTS_M, Input, trials

_VIDEO_SUFFIXES = (".avi", ".mp4", ".mkv", ".mov", ".mpg")
_NO_VIDEO = "There is no video in this folder: what needs one was left out."
_NO_PICTURES = (
    "There are no pictures here to show to the orientation network: its rows are left out."
)
_LENT = (
    "What the orientation network reads in the pictures is told to lines of mere boxes as well: "
    "it is the same camera."
)


def evaluate_pets(data: str | Path, progress: Progress) -> Evaluation:
    """PETS 2009 S2.L1, View 1: the video, Faster R-CNN boxes, hand-drawn boxes.

    Raises :class:`InputError` where the camera or the annotations are missing.
    """
    folder = Path(data)
    reference = pets(folder)
    inputs, notes = _video(folder, CalibrateOptions(), progress)
    for name, footage in (
        ("frcnn_det.txt", "Faster R-CNN boxes"),
        ("PETS2009-S2L1.xml", "hand-drawn boxes"),
    ):
        if (folder / name).exists():
            inputs.append(Input(footage, _boxes(folder / name, reference)))
        else:
            notes.append(f"{name} is not in this folder: {footage} were left out.")
    return _evaluated("pets", reference, inputs, notes, progress)


def evaluate_towncentre(data: str | Path, progress: Progress) -> Evaluation:
    """TownCentre: tracker boxes, the two frames that are left, the video where somebody has it
    (1000 frames, as the paper), and the published boxes, which are circular.
    """
    folder = Path(data)
    reference = towncentre(folder)
    inputs, notes = _video(
        folder, CalibrateOptions(frames=PUBLISHED["towncentre"].frames), progress
    )
    pictures = folder / "frames"
    if pictures.is_dir():
        count = len(list(pictures.iterdir()))
        inputs.append(Input(f"{count} frames", _watched(pictures, CalibrateOptions(), progress)))
    if (folder / "tracker_boxes.txt").exists():
        inputs.append(Input("tracker boxes", _boxes(folder / "tracker_boxes.txt", reference)))
    published = _boxes(folder / "TownCentreGTHalfRes.csv", reference)
    inputs.append(Input("published boxes", published, circular=True))
    notes.append(
        "The published boxes are circular: they were drawn by the true calibration as bodies of "
        "1.90 m. They serve as ground positions here; what fits their heights proves nothing."
    )
    return _evaluated("towncentre", reference, inputs, notes, progress)


def evaluate_virat(
    data: str | Path,
    progress: Progress,
    *,
    clip: str | None = None,
    image_size: tuple[int, int] | None = None,
) -> Evaluation:
    """One clip of VIRAT, whose truth is the ground homography of its scene; see :func:`.virat`."""
    scene = virat(data, clip=clip, image_size=image_size)
    inputs, notes = [], list(scene.notes)
    if scene.video is None:
        notes.append(_NO_VIDEO)
    else:
        options = CalibrateOptions(frames=PUBLISHED["virat"].frames)
        inputs.append(Input("video", _watched(scene.video, options, progress)))
    people = spread_frames(scene.people)
    inputs.append(Input("annotated boxes", Seen(people, len(np.unique(people.frame)))))
    return _evaluated("virat", scene.reference, inputs, notes, progress)


def _video(
    folder: Path, options: CalibrateOptions, progress: Progress
) -> tuple[list[Input], list[str]]:
    videos = sorted(p for p in folder.iterdir() if p.suffix.lower() in _VIDEO_SUFFIXES)
    if not videos:
        return [], [_NO_VIDEO]
    if len(videos) > 1:
        names = ", ".join(p.name for p in videos)
        raise InputError(f"{folder}: holds several videos ({names}); leave the one to evaluate")
    return [Input("video", _watched(videos[0], options, progress))], []


def _watched(source: Path, options: CalibrateOptions, progress: Progress) -> Seen:
    """What the footage shows; the orientation network looks at every frame that is sampled."""
    from scene4d.video.reader import open_source

    options = replace(options, orientation="network")
    with open_source(source) as footage:
        return watch(footage, options, progress, {})


def _boxes(path: Path, reference: Reference) -> Seen:
    return annotated(
        CalibrateOptions(annotations=path, drop_invalid=True), reference.image_size, None
    )


def _evaluated(
    name: str,
    reference: Reference,
    inputs: Sequence[Input],
    notes: list[str],
    progress: Progress,
) -> Evaluation:
    truth = None
    try:
        camera = reference.camera
        truth = Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad)
    except InputError as error:
        notes.append(f"What needs the true orientation was left out: {error}")
    tried = [trial for given in _lent(inputs, notes) for trial in trials(given, truth)]
    outcomes = []
    with progress.stage("Calibrating and scoring", len(tried) * len(HEIGHTS_M)) as step:
        for trial in tried:
            for height in HEIGHTS_M:
                outcomes.append(trial.outcome(reference, height))
                step(1)
    few: list[FewPeople] = []
    seeing = [given for given in inputs if given.seen.reading is not None]
    with progress.stage(
        "Drawing a few people", len(seeing) * len(WAYS) * len(PEOPLE) * DRAWS
    ) as step:
        for given in seeing:
            few.extend(few_people(given, reference, notes, step))
    pictures = (given.seen.image_bgr for given in inputs)
    return Evaluation(
        name=name,
        reference=reference,
        outcomes=tuple(outcomes),
        published=PUBLISHED.get(name),
        image_bgr=next((image for image in pictures if image is not None), None),
        notes=tuple(notes),
        few=tuple(few),
    )


def _lent(inputs: Sequence[Input], notes: list[str]) -> list[Input]:
    """The inputs, of which those without pictures borrow the reading of one that has some."""
    readings = [given.seen.reading for given in inputs if given.seen.reading is not None]
    if not readings:
        notes.append(_NO_PICTURES)
        return list(inputs)
    if len(readings) < len(inputs):
        notes.append(_LENT)
    return [
        given
        if given.seen.reading is not None
        else replace(given, seen=replace(given.seen, reading=readings[0]))
        for given in inputs
    ]
