"""Search for activities on MEVA: annotated tracks, true cameras, labelled activities."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.progress import Progress, timed
from scene4d.evaluation._options import TUNED, EvaluateOptions
from scene4d.evaluation.datasets._meva import Clip, meva_clips
from scene4d.evaluation.measures._events import OVERLAP_S, OVERLAP_SHARE, ClipEvents, Ranked
from scene4d.evaluation.trials._baselines import in_pixels, near_alone
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Activity
from scene4d.searching.activities.search import LEAST_SCORE, find
from scene4d.searching.predicates.stage import Stage

METRES_PER_PX = (0.005, 0.01, 0.02, 0.04)
"""Lengths that a pixel may stand for in the baseline in pixels; a person of 1.7 m is 340 to 43
pixels tall, as on MEVA."""
FALSE_PER_MINUTE = (0.15, 0.02)
"""Rates of false alarms at which misses are reported: NIST's for ActEV."""


@dataclass(frozen=True)
class Method:
    """A way to search: a short ``name`` for tables, and what it does in a sentence."""

    name: str
    description: str


OURS = Method("metres", "the catalogue's activities, on the ground in metres")
PIXELS = Method(
    "pixels",
    "the same activities in the image, from the feet of the boxes, with one pixel taken as "
    f"{', '.join(f'{m:g}' for m in METRES_PER_PX)} m: for each activity what finds it best on the "
    "tuning cameras",
)
_NEAR = Method(
    "near", "the same activities with P(near) as their only predicate, on the ground in metres"
)
METHODS = (OURS, PIXELS, _NEAR)


@dataclass(frozen=True, eq=False)
class ActivityOutcome:
    """How one method did on one activity; ``ranked`` is None where it cannot search for it.

    ``settings`` are those that the method has for this activity alone.
    """

    method: str
    activity: str
    ranked: Ranked | None
    settings: dict[str, float] = field(default_factory=dict)

    @property
    def average_precision(self) -> float | None:
        """Average precision; None where nothing is labelled or the method cannot search."""
        return None if self.ranked is None else self.ranked.average_precision

    def missed_at(self, false_per_minute: float) -> float | None:
        """Pmiss@RFA; None as above."""
        det = None if self.ranked is None else self.ranked.det
        return None if det is None else det.missed_at(false_per_minute)

    def to_dict(self) -> dict[str, Any]:
        """One cell of ``evaluation.json``."""
        return {
            "average_precision": self.average_precision,
            "p_miss": {f"{rate:g}": self.missed_at(rate) for rate in FALSE_PER_MINUTE},
            "found": None if self.ranked is None else len(self.ranked.score),
            "correct": None if self.ranked is None else int(self.ranked.correct.sum()),
        } | self.settings


@dataclass(frozen=True, eq=False)
class ActivityEvaluation:
    """Every method on every activity. The first of ``methods`` is ours, the others are baselines.

    ``activities`` maps each activity to its names in the data set, ``labels`` to how often it is
    labelled. ``tuned`` are the cameras that constants were chosen on, ``reported`` the others,
    which everything here is about.
    """

    name: str
    methods: tuple[Method, ...]
    activities: dict[str, tuple[str, ...]]
    labels: dict[str, int]
    outcomes: tuple[ActivityOutcome, ...]
    tuned: tuple[str, ...]
    reported: tuple[str, ...]
    clips: int
    minutes: float
    notes: tuple[str, ...] = ()
    timings: dict[str, float] = field(default_factory=dict)

    def of(self, method: str, activity: str) -> ActivityOutcome:
        """One cell of the table."""
        return next(o for o in self.outcomes if (o.method, o.activity) == (method, activity))

    def searched(self, method: str) -> list[float]:
        """Average precision of the activities that are labelled and that the method can search."""
        values = [self.of(method, activity).average_precision for activity in self.activities]
        return [value for value in values if value is not None]

    def mean_average_precision(self, method: str) -> float | None:
        """Mean of :meth:`searched`."""
        known = self.searched(method)
        return sum(known) / len(known) if known else None

    def to_dict(self) -> dict[str, Any]:
        """Content of ``evaluation.json``."""
        return {
            "dataset": self.name,
            "cameras": {"tuned": list(self.tuned), "reported": list(self.reported)},
            "clips": self.clips,
            "minutes": self.minutes,
            "matching": {"overlap_s": OVERLAP_S, "share_of_shorter_labels": OVERLAP_SHARE},
            "methods": {method.name: method.description for method in self.methods},
            "mean_average_precision": {
                method.name: self.mean_average_precision(method.name) for method in self.methods
            },
            "activities": [
                {
                    "activity": activity,
                    "labels": list(names),
                    "labelled": self.labels[activity],
                    "methods": {
                        method.name: self.of(method.name, activity).to_dict()
                        for method in self.methods
                    },
                }
                for activity, names in self.activities.items()
            ],
            "notes": list(self.notes),
            "timings_s": self.timings,
        }


def evaluate_meva(
    data: str | Path, options: EvaluateOptions, progress: Progress
) -> ActivityEvaluation:
    """Every activity of the catalogue that MEVA labels, searched for on some cameras.

    ``data`` is as for :func:`.meva_clips`. Raises :class:`InputError` for what is missing and what
    cannot be read.
    """
    timings: dict[str, float] = {}
    with timed(timings, "tracks"):
        clips = meva_clips(data, tuple(dict.fromkeys((*TUNED, *options.cameras))), progress)
    tuned = [clip for clip in clips if clip.camera in TUNED]
    reported = [clip for clip in clips if clip.camera in options.cameras]
    activities = labelled_activities()
    with timed(timings, "choose the scale of pixels"):
        scales = _best_scales(tuned, activities, progress)
    outcomes = []
    with progress.stage("Searching", len(METHODS) * len(activities)) as step:
        for method in METHODS:
            with timed(timings, f"search, {method.name}"):
                wanted = scales if method is PIXELS else dict.fromkeys(activities, 1.0)
                seen = {scale: seen_by(method, reported, scale) for scale in {*wanted.values()}}
                for name, activity in activities.items():
                    ranked = ranked_by(method, reported, seen[wanted[name]], activity)
                    settings = {"metres_per_px": scales[name]} if method is PIXELS else {}
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


def labelled_activities() -> dict[str, Activity]:
    """The activities of the catalogue that have names in MEVA."""
    return {name: one for name, one in load_catalogue().items() if one.labels}


def _best_scales(
    clips: Sequence[Clip], activities: Mapping[str, Activity], progress: Progress
) -> dict[str, float]:
    """For each activity the scale of :data:`METRES_PER_PX` with the best average precision; the
    first of equal ones.
    """
    best = dict.fromkeys(activities, (-1.0, 0.0))
    with progress.stage("Choosing the scale of pixels", len(METRES_PER_PX)) as step:
        for scale in METRES_PER_PX:
            seen = seen_by(PIXELS, clips, scale)
            for name, activity in activities.items():
                ranked = ranked_by(PIXELS, clips, seen, activity)
                found = (None if ranked is None else ranked.average_precision) or 0.0
                if found > best[name][0]:
                    best[name] = found, scale
            step(1)
    return {name: scale for name, (_, scale) in best.items()}


def seen_by(method: Method, clips: Sequence[Clip], metres_per_px: float) -> list[Stage]:
    """The clips' stages as a method sees them."""
    if method is not PIXELS:
        return [clip.stage for clip in clips]
    return [in_pixels(clip.stage, metres_per_px) for clip in clips]


def ranked_by(
    method: Method, clips: Sequence[Clip], seen: Sequence[Stage], activity: Activity
) -> Ranked | None:
    """What a method finds of an activity in the clips; None where it cannot search for it."""
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
    said = dict.fromkeys(str(clip.ground) for clip in clips)
    return (
        "The published cameras stand in the frame of a site whose terrain is not level. Focal "
        "length and lens are as published; height over the local ground, tilt and roll (with the "
        "published ones as a prior of 1°) come from the boxes of the people. "
        + "; ".join(said)
        + "."
    )


_NOTES = (
    "Tracks are annotated, not detected: this measures predicates and composition on known tracks, "
    "not detectors and trackers.",
    "Only actors of labelled activities are boxed, and only while they act. People and vehicles "
    "that do nothing labelled are missing, so they cannot raise a false alarm, and tracks begin "
    "and end in the open where nobody appeared or disappeared.",
    "MEVA boxes an object anew for each of its activities: tracks with the same boxes were united. "
    "Even so a track begins and ends where a label does, which helps.",
    "The annotations hold boxes but no keypoints: what needs the body's pose cannot be judged.",
    f"Every constant was chosen on cameras {' and '.join(TUNED)}; other cameras are reported. No "
    "camera has constants of its own.",
    "An event is correct where it overlaps a label of its activity by 1 s, or by half of a label "
    "that is shorter than 1 s; each is used once (NIST, ActEV SDL V2). The participants are not "
    "compared.",
)
