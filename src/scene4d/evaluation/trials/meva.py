"""Search for activities on MEVA: annotated tracks, true cameras, labelled activities."""

import re
import tarfile
import tempfile
from collections.abc import Callable, Iterator, Mapping, Sequence
from contextlib import contextmanager
from dataclasses import dataclass
from datetime import datetime, timedelta
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scene4d.calibration.watching import noted_annotations
from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.progress import Progress, timed
from scene4d.evaluation.activity_baselines import in_pixels, near_alone
from scene4d.evaluation.activity_evaluation import ActivityEvaluation, ActivityOutcome, Method
from scene4d.evaluation.activity_scores import ClipEvents, Ranked, average_precision
from scene4d.evaluation.trials.meva_ground import Ground, local_ground
from scene4d.evaluation.trials.meva_tracks import followed
from scene4d.formats.activities import LabelledActivity, read_activities
from scene4d.formats.cameras import read_calibration
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Activity
from scene4d.searching.activities.identity import unite_tracks
from scene4d.searching.activities.search import LEAST_SCORE, find
from scene4d.searching.predicates.rows import Stage
from scene4d.searching.stages import stage_of
from scene4d.tracking import TrackOptions

TUNED = ("G341", "G424")
"""Cameras whose clips every constant was chosen on."""
REPORTED = ("G328", "G506")
"""Cameras that are reported unless others are asked for, and that nothing was chosen on."""
_FPS = 30.0
METRES_PER_PX = (0.005, 0.01, 0.02, 0.04)
"""What a pixel may be taken for where distances are counted in pixels."""

OURS = Method("metres", "the catalogue's activities, on the ground in metres")
PIXELS = Method(
    "pixels",
    "the same activities on the picture, from the feet of the boxes, with one pixel taken for "
    f"{', '.join(f'{m:g}' for m in METRES_PER_PX)} m: for each activity what finds it best on the "
    "cameras tuned on",
)
_NEAR = Method(
    "near", "the same activities with P(near) as their only predicate, on the ground in metres"
)
METHODS = (OURS, PIXELS, _NEAR)

_GEOM, _ACTIVITIES = ".geom.yml", ".activities.yml"
_NAME = re.compile(
    r"(?P<day>\d{4}-\d\d-\d\d)\.(?P<begin>\d\d-\d\d-\d\d)\.(?P<end>\d\d-\d\d-\d\d)\.\w+\.(?P<camera>\w+)"
)
_ARCHIVE = "annotations.tar.xz"


@dataclass(frozen=True, eq=False)
class Clip:
    """One annotated clip: its camera, how long it is, who was where, on which ground, and what is
    labelled.
    """

    name: str
    camera: str
    minutes: float
    stage: Stage
    ground: Ground
    labelled: tuple[LabelledActivity, ...]

    def label_s(self, names: Sequence[str]) -> Float[np.ndarray, "r 2"]:
        """When anything of these names happens, in seconds."""
        spans = [(one.begin_frame, one.end_frame) for one in self.labelled if one.name in names]
        return np.array(spans, float).reshape(-1, 2) / _FPS


def evaluate_meva(
    data: str | Path, progress: Progress, *, cameras: Sequence[str] = REPORTED
) -> ActivityEvaluation:
    """Every activity of the catalogue that MEVA labels, searched for on some cameras.

    ``data`` holds ``cameras/*.krtd`` and the annotations, as ``annotations.tar.xz`` or unpacked in
    ``annotations/``. Raises :class:`InputError` for what is missing, for files that cannot be read,
    and for a camera that constants were chosen on.
    """
    seen_before = sorted(set(cameras) & set(TUNED))
    if seen_before:
        raise InputError(
            f"camera {', '.join(seen_before)}: constants were chosen on it, so that it proves "
            f"nothing; report others, such as {' and '.join(REPORTED)}"
        )
    timings: dict[str, float] = {}
    with timed(timings, "tracks"):
        clips = meva_clips(data, tuple(dict.fromkeys((*TUNED, *cameras))), progress)
    tuned = [clip for clip in clips if clip.camera in TUNED]
    reported = [clip for clip in clips if clip.camera in cameras]
    return _evaluated(reported, tuned, labelled_activities(), progress, timings)


def labelled_activities() -> dict[str, Activity]:
    """The activities of the catalogue that have names in MEVA."""
    return {name: one for name, one in load_catalogue().items() if one.labels}


def meva_clips(data: str | Path, cameras: Sequence[str], progress: Progress) -> list[Clip]:
    """The clips of some cameras, in the order of their names; see :func:`evaluate_meva`."""
    folder = Path(data)
    calibrations = {}
    for camera in cameras:
        calibrations[camera] = read_calibration(folder / "cameras" / f"{camera}.krtd")
    with _annotations(folder) as unpacked:
        every = [(path, _NAME.match(path.name)) for path in sorted(unpacked.rglob(f"*{_GEOM}"))]
        chosen = [(path, name) for path, name in every if name and name["camera"] in cameras]
        missing = sorted(set(cameras) - {name["camera"] for _, name in chosen})
        if missing:
            raise InputError(f"{folder}: holds no annotated clip of camera {', '.join(missing)}")
        clips: list[Clip] = []
        with progress.stage("Following annotated people and vehicles", 2 * len(chosen)) as step:
            for camera, published in calibrations.items():
                clips += _clips(
                    camera, published, [c for c in chosen if c[1]["camera"] == camera], step
                )
    return sorted(clips, key=lambda clip: clip.name)


@contextmanager
def _annotations(folder: Path) -> Iterator[Path]:
    if (folder / "annotations").is_dir():
        yield folder / "annotations"
        return
    archive = folder / _ARCHIVE
    with tempfile.TemporaryDirectory(prefix="scene4d-") as scratch:
        try:
            with tarfile.open(archive) as packed:
                packed.extractall(scratch, filter="data")
        except (OSError, tarfile.TarError, EOFError) as error:
            raise InputError(
                f"{archive}: cannot be unpacked: {error}; expected the annotations of MEVA there, "
                f"or unpacked in {folder / 'annotations'}"
            ) from error
        yield Path(scratch)


def _clips(
    camera: str,
    published: Calibration,
    files: Sequence[tuple[Path, re.Match[str]]],
    step: Callable[[int], None],
) -> list[Clip]:
    """The clips of one camera; ``step`` is told of each file read, and of each clip made."""
    annotated = []
    for path, _ in files:
        found, _ = noted_annotations(path, published.image_size, _FPS, drop_invalid=True)
        annotated.append(found)
        step(1)
    ground = local_ground(camera, published, annotated)
    clips = []
    for (path, name), found in zip(files, annotated, strict=True):
        clips.append(_clip(path, name, found, ground))
        step(1)
    return clips


def _clip(path: Path, name: re.Match[str], annotated: Detections, ground: Ground) -> Clip:
    stem = path.name.removesuffix(_GEOM)
    labelled = read_activities(path.with_name(stem + _ACTIVITIES))
    options = TrackOptions(f"{ground.camera}.krtd", annotations=path, name=ground.camera, fps=_FPS)
    tracks = followed(annotated, ground.calibration, options, _FPS)
    stage = unite_tracks(stage_of(tracks, ground.calibration))
    return Clip(stem, ground.camera, _minutes(name), stage, ground, labelled)


def _minutes(name: re.Match[str]) -> float:
    begin, end = (datetime.strptime(name[key], "%H-%M-%S") for key in ("begin", "end"))
    return (end - begin) % timedelta(days=1) / timedelta(minutes=1)


def _evaluated(
    reported: Sequence[Clip],
    tuned: Sequence[Clip],
    activities: Mapping[str, Activity],
    progress: Progress,
    timings: dict[str, float] | None = None,
) -> ActivityEvaluation:
    """Every method on the ``reported`` clips; ``tuned`` are those that pixels are scaled on."""
    timings = {} if timings is None else timings
    with timed(timings, "choose the scale of pixels"):
        factors = _chosen_factors(tuned, activities, progress)
    outcomes = []
    with progress.stage("Searching", len(METHODS) * len(activities)) as step:
        for method in METHODS:
            with timed(timings, f"search, {method.name}"):
                scales = {1.0} if method is not PIXELS else set(factors.values())
                seen = {scale: seen_by(method, reported, scale) for scale in scales}
                for name, activity in activities.items():
                    scale = factors[name] if method is PIXELS else 1.0
                    settings = {"metres_per_px": scale} if method is PIXELS else {}
                    ranked = ranked_by(method, reported, seen[scale], activity)
                    outcomes.append(ActivityOutcome(method.name, name, ranked, settings))
                    step(1)
    return ActivityEvaluation(
        name="meva",
        methods=METHODS,
        activities={name: one.labels for name, one in activities.items()},
        labels={
            name: sum(len(clip.label_s(one.labels)) for clip in reported)
            for name, one in activities.items()
        },
        outcomes=tuple(outcomes),
        tuned=TUNED,
        reported=tuple(sorted({clip.camera for clip in reported})),
        clips=len(reported),
        minutes=sum(clip.minutes for clip in reported),
        notes=(*_NOTES, _grounds(reported)),
        timings=timings,
    )


def _chosen_factors(
    clips: Sequence[Clip], activities: Mapping[str, Activity], progress: Progress
) -> dict[str, float]:
    """For each activity the factor of :data:`METRES_PER_PX` with the best average precision; the
    first of equal ones.
    """
    best = dict.fromkeys(activities, (-1.0, 0.0))
    with progress.stage("Choosing the scale of pixels", len(METRES_PER_PX)) as step:
        for factor in METRES_PER_PX:
            seen = seen_by(PIXELS, clips, factor)
            for name, activity in activities.items():
                ranked = ranked_by(PIXELS, clips, seen, activity)
                found = (None if ranked is None else average_precision(ranked)) or 0.0
                if found > best[name][0]:
                    best[name] = found, factor
            step(1)
    return {name: factor for name, (_, factor) in best.items()}


def seen_by(method: Method, clips: Sequence[Clip], metres_per_px: float) -> list[Stage]:
    """The clips' stages as a method sees them."""
    if method is not PIXELS:
        return [clip.stage for clip in clips]
    return [in_pixels(clip.stage, metres_per_px) for clip in clips]


def ranked_by(
    method: Method, clips: Sequence[Clip], seen: Sequence[Stage], activity: Activity
) -> Ranked | None:
    """What a method finds of an activity in the clips; None where it cannot look for it."""
    searched = near_alone(activity) if method is _NEAR else activity
    if searched is None:
        return None
    events = []
    for clip, stage in zip(clips, seen, strict=True):
        found = find(stage, searched, min_score=LEAST_SCORE)
        spans = np.array([(event.begin_s, event.end_s) for event in found], float).reshape(-1, 2)
        score = np.array([event.score for event in found], float)
        events.append(ClipEvents(clip.label_s(activity.labels), spans, score))
    return Ranked.of_clips(events, sum(clip.minutes for clip in clips))


def _grounds(clips: Sequence[Clip]) -> str:
    said = dict.fromkeys(clip.ground.said() for clip in clips)
    return (
        "The published cameras stand in the frame of a site whose terrain is not level. Focal "
        "length and lens are theirs; height over the local ground, tilt and roll (believed to 1°) "
        "are those that the boxes of the people give. " + "; ".join(said) + "."
    )


_NOTES = (
    "Tracks are annotated, not detected: this measures predicates and composition on known tracks, "
    "not detectors and trackers.",
    "Only actors of labelled activities are boxed, and only while they act. Who does nothing that "
    "is labelled is not there to raise a false alarm, and tracks begin and end in the open where "
    "nobody appeared or disappeared.",
    "MEVA boxes an object anew for each of its activities: tracks with the same boxes were made "
    "one. Even so the ends of a track lie where a label begins or ends, which helps.",
    "The annotations hold boxes alone, no keypoints: what needs the body's pose cannot be judged.",
    f"Every constant was chosen on cameras {' and '.join(TUNED)}; others are reported. No camera "
    "has constants of its own.",
    "An event is correct where it overlaps a label of its activity by 1 s, or by half of a label "
    "that is shorter than 1 s; each is used once (NIST, ActEV SDL V2). Who took part is not "
    "compared.",
)
