"""Calibrations of recordings with a known truth: PETS 2009, the paper's data sets, your own."""

from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scene4d.calibration import person_segments
from scene4d.calibration.options import CalibrateOptions
from scene4d.calibration.orienting import read_orientation
from scene4d.calibration.watching import Seen, annotated, watch
from scene4d.calibration.writing import BACKGROUND
from scene4d.core.errors import InputError
from scene4d.core.ground_map import GroundMap
from scene4d.core.orientation import Orientation
from scene4d.core.progress import Progress
from scene4d.evaluation._options import EvaluateOptions
from scene4d.evaluation.datasets._reference import PUBLISHED, Reference, pets, towncentre
from scene4d.evaluation.datasets._virat import spread_frames, virat
from scene4d.evaluation.measures._correspondence import POINTS
from scene4d.evaluation.trials._methods import HEIGHTS_M, Input, trials
from scene4d.evaluation.trials.outcomes import Evaluation, Outcome, Setting
from scene4d.formats.cameras import read_calibration
from scene4d.formats.homographies import read_reference
from scene4d.formats.points import read_points
from scene4d.video.background import calibrated_view
from scene4d.video.frames import VIDEO_SUFFIXES

_NO_VIDEO = "There is no video in this folder: the lines that need one were left out."
_NO_PICTURES = (
    "There are no pictures here for the orientation network to read: its lines are left out."
)
_LENT = (
    "Lines of boxes alone use what the pictures of the same camera show: its straight edges, and "
    "what the orientation network reads in them."
)
_GRID = (48, 32)
"""Columns and rows of pixels that serve as ground points where no file gives any: one every 16 to
40 pixels, chosen by hand."""
_COARSEST_M = 0.25
"""A pixel of the grid covers at most this much ground: farther out, nobody reads the map. Chosen by
hand, half a person's width."""
_FEWEST = 3
"""Points that a rigid alignment of two maps needs before distances mean anything."""


def evaluate_pets(data: str | Path, options: EvaluateOptions, progress: Progress) -> Evaluation:
    """PETS 2009 S2.L1, View 1: the video, Faster R-CNN boxes, hand-drawn boxes.

    Raises :class:`InputError` where the camera or the annotations are missing.
    """
    folder = Path(data)
    reference = pets(folder)
    inputs, notes = _video(folder, CalibrateOptions(), reference, progress)
    for name, footage in (
        ("frcnn_det.txt", "Faster R-CNN boxes"),
        ("PETS2009-S2L1.xml", "hand-drawn boxes"),
    ):
        if (folder / name).exists():
            inputs.append(Input(footage, _boxes(folder / name, reference)))
        else:
            notes.append(f"{name} is not in this folder: {footage} were left out.")
    return _evaluated("pets", reference, inputs, notes, progress)


def evaluate_towncentre(
    data: str | Path, options: EvaluateOptions, progress: Progress
) -> Evaluation:
    """TownCentre: tracker boxes, the two frames that are published, the video if it is there (1000
    frames of it, as in the paper), and the published boxes, which are circular.
    """
    folder = Path(data)
    reference = towncentre(folder)
    most = CalibrateOptions(frames=PUBLISHED["towncentre"].frames)
    inputs, notes = _video(folder, most, reference, progress)
    pictures = folder / "frames"
    if pictures.is_dir():
        count = len(list(pictures.iterdir()))
        name = f"{count} frames"
        inputs.append(_watched(name, pictures, CalibrateOptions(), reference, progress))
    if (folder / "tracker_boxes.txt").exists():
        inputs.append(Input("tracker boxes", _boxes(folder / "tracker_boxes.txt", reference)))
    published = _boxes(folder / "TownCentreGTHalfRes.csv", reference)
    inputs.append(Input("published boxes", published, circular=True))
    notes.append(
        "The published boxes are circular: the true calibration drew them as bodies of 1.90 m. "
        "They serve as ground positions here; what fits their heights proves nothing."
    )
    return _evaluated("towncentre", reference, inputs, notes, progress)


def evaluate_virat(data: str | Path, options: EvaluateOptions, progress: Progress) -> Evaluation:
    """One clip of VIRAT, whose truth is the ground homography of its scene; see :func:`.virat`."""
    scene = virat(data, clip=options.clip, image_size=options.image_size)
    inputs, notes = [], list(scene.notes)
    if scene.video is None:
        notes.append(_NO_VIDEO)
    else:
        frames = CalibrateOptions(frames=PUBLISHED["virat"].frames)
        inputs.append(_watched("video", scene.video, frames, scene.reference, progress))
    people = spread_frames(scene.people)
    inputs.append(Input("annotated boxes", Seen(people, len(np.unique(people.frame)))))
    return _evaluated("virat", scene.reference, inputs, notes, progress)


def evaluate_custom(
    camera: str | Path, reference: str | Path, options: EvaluateOptions
) -> Evaluation:
    """A calibration of any camera format against a camera or a ground homography.

    Without ``points`` among the options a grid of pixels serves, as far as one pixel covers at most
    :data:`_COARSEST_M` of true ground. Both files are for the same footage, as decoded. Raises
    :class:`InputError` for files that cannot be read, and where fewer than :data:`_FEWEST` points
    lie on the ground.
    """
    found = read_calibration(camera, image_size=options.image_size)
    truth = read_reference(reference, image_size=found.image_size)
    bare = Reference(Path(reference).name, truth, np.empty((0, 2)))
    if options.points is None:
        of = f"a grid of pixels that cover {_COARSEST_M:g} m of ground at most"
        uv = _grid(bare)
    else:
        of = Path(options.points).name
        uv = read_points(options.points, image_size=found.image_size)
    known = _over(bare, uv)
    outcome = Outcome.scored(Setting(Path(camera).name, found.method, given=""), found, known)
    image = calibrated_view(Path(camera).with_name(BACKGROUND), found.image_size)
    note = f"The points are {known.n_points} spread over {of}."
    return Evaluation("custom", known, (outcome,), image, (note,))


def evaluate_footage(
    source: str | Path, reference: str | Path, options: EvaluateOptions, progress: Progress
) -> Evaluation:
    """Everything that can be tried on footage of your own whose camera is known.

    The feet of the people who are seen serve as ground points, unless ``points`` are among the
    options. A reference measured on images of another size is scaled to the footage. Raises
    :class:`InputError` as :func:`evaluate_custom`, and for footage that cannot be read.
    """
    from scene4d.video.reader import open_source

    with open_source(source) as footage:
        size = footage.image_size
    truth = read_reference(reference, image_size=size)
    bare = Reference(Path(reference).name, truth, np.empty((0, 2)))
    seen = _watched("footage", Path(source), CalibrateOptions(), bare, progress)
    if options.points is None:
        of, uv = "the feet of the people seen", person_segments(seen.seen.detections).foot_uv
    else:
        of, uv = Path(options.points).name, read_points(options.points, image_size=size)
    known = _over(bare, uv)
    notes = [f"The points are {known.n_points} spread over {of}."]
    return _evaluated("custom", known, [seen], notes, progress)


def _over(bare: Reference, uv: Float[np.ndarray, "n 2"]) -> Reference:
    """The reference with these pixels as its ground points; raises :class:`InputError` where too
    few of them lie on its ground.
    """
    known = replace(bare, feet_uv=uv)
    count = len(known.walked_uv)
    if count < _FEWEST:
        raise InputError(
            f"{bare.name}: only {count} of {len(uv)} points lie on its ground and in the picture, "
            f"and {_FEWEST} are needed: give points, a file of pixels on the ground"
        )
    return replace(known, n_points=min(POINTS, count))


def _grid(reference: Reference) -> Float[np.ndarray, "n 2"]:
    """Pixels of a regular grid at which the reference's ground is seen in useful detail."""
    width, height = reference.image_size
    columns, rows = _GRID
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    here, ok = reference.locate(uv)
    below, ok_below = reference.locate(uv + np.array([0.0, 1.0]))
    fine = np.hypot(*(below - here).T) <= _COARSEST_M
    return uv[ok & ok_below & fine]


def _video(
    folder: Path, options: CalibrateOptions, reference: Reference, progress: Progress
) -> tuple[list[Input], list[str]]:
    videos = sorted(p for p in folder.iterdir() if p.suffix.lower() in VIDEO_SUFFIXES)
    if not videos:
        return [], [_NO_VIDEO]
    if len(videos) > 1:
        names = ", ".join(p.name for p in videos)
        raise InputError(f"{folder}: holds several videos ({names}); leave the one to evaluate")
    return [_watched("video", videos[0], options, reference, progress)], []


def _watched(
    name: str, source: Path, options: CalibrateOptions, reference: Reference, progress: Progress
) -> Input:
    """What the footage shows; the orientation network looks at every frame that is sampled, and
    once more through the true lens where that bends the pictures.
    """
    from scene4d.video.reader import open_source

    options = replace(options, orientation="network")
    with open_source(source) as footage:
        seen = watch(footage, options, progress, {})
    truth = reference.truth
    if isinstance(truth, GroundMap) or not truth.distortion.any():
        return Input(name, seen)
    straightened = read_orientation(
        source, lens=truth.lens, focal_known=False, frames=seen.frames, progress=progress
    )
    return Input(name, seen, straightened=straightened)


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
    """Everything that can be tried on these inputs, scored; ``notes`` are added to."""
    truth = None
    try:
        camera = reference.camera
        truth = Orientation(camera.focal_px, camera.tilt_rad, camera.roll_rad)
    except InputError as error:
        notes.append(f"Lines that need the true orientation were left out: {error}")
    tried = [trial for given in _lent(inputs, notes) for trial in trials(given, truth)]
    outcomes = []
    with progress.stage("Calibrating and scoring", len(tried) * len(HEIGHTS_M)) as step:
        for trial in tried:
            for height in HEIGHTS_M:
                outcomes.append(trial.outcome(reference, height))
                step(1)
    pictures = (given.seen.image_bgr for given in inputs)
    image = next((picture for picture in pictures if picture is not None), None)
    return Evaluation(name, reference, tuple(outcomes), image, tuple(notes))


def _lent(inputs: Sequence[Input], notes: list[str]) -> list[Input]:
    """The inputs; those without pictures borrow from one that has some what the network reads in
    them and the scene's edges.
    """
    lenders = [given for given in inputs if given.seen.reading is not None]
    if not lenders:
        notes.append(_NO_PICTURES)
        return list(inputs)
    if len(lenders) < len(inputs):
        notes.append(_LENT)
    lent, straightened = lenders[0].seen, lenders[0].straightened
    return [
        given
        if given.seen.reading is not None
        else replace(
            given,
            seen=replace(
                given.seen,
                reading=lent.reading,
                edges_xyxy=lent.edges_xyxy,
                image_bgr=lent.image_bgr,
            ),
            straightened=straightened,
        )
        for given in inputs
    ]
