"""Search for activities on MEVA: annotated tracks, true cameras, labelled activities."""

from collections.abc import Mapping, Sequence
from dataclasses import asdict, dataclass, field
from functools import cached_property
from pathlib import Path
from typing import Any

from scene4d.core.progress import Progress, timed
from scene4d.evaluation._options import TUNED, EvaluateOptions
from scene4d.evaluation.datasets._meva import Clip, meva_clips
from scene4d.evaluation.measures._events import (
    NIST,
    OVERLAP_S,
    OVERLAP_SHARE,
    RULES,
    ClipEvents,
    Ranked,
    precision_interval,
    ranked_clips,
)
from scene4d.evaluation.measures._probability import TrueError, reliability, true_error
from scene4d.evaluation.trials._ways import (
    METHODS,
    OURS,
    Method,
    Seen,
    best_settings,
    label_length_s,
    ranked,
)
from scene4d.searching.activities.calibrated import ANNOTATED, ScoreCalibration, calibration_of
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.definition import Activity
from scene4d.searching.activities.search import MIN_SCORE

FALSE_PER_MINUTE = (0.15, 0.02)
"""Rates of false alarms at which misses are reported: NIST's for ActEV."""


@dataclass(frozen=True, eq=False)
class Trust:
    """How the probabilities of the events that a search shows by default came true: events, the
    share of right ones, the mean of what was stated, the expected calibration error as counted, and
    what chance does to it.
    """

    events: int
    right: float
    stated: float
    expected_error: float
    without_chance: TrueError


@dataclass(frozen=True, eq=False)
class ActivityOutcome:
    """How one method did on one activity; ``events`` are None where it cannot search for it.

    ``settings`` are those that the method has for this activity alone, ``calibration`` is that of
    its scores.
    """

    method: str
    activity: str
    events: tuple[ClipEvents, ...] | None
    settings: dict[str, float] = field(default_factory=dict)
    calibration: ScoreCalibration | None = None

    @cached_property
    def ranked(self) -> Ranked | None:
        """The events of all clips by NIST's rule."""
        return None if not self.events else ranked(self.events)

    def precision_by(self, rule: str, camera: str | None = None) -> float | None:
        """Average precision by a rule of :data:`.RULES`, on all cameras or on one."""
        clips = [clip for clip in self.events or () if camera in (None, clip.camera)]
        return ranked(clips, rule).average_precision if clips else None

    def interval(self, rule: str) -> tuple[float, float] | None:
        """95 % of the average precision by the rule, over clips drawn with replacement."""
        if not self.events:
            return None
        return precision_interval(ranked_clips(self.events, RULES[rule]))

    @property
    def average_precision(self) -> float | None:
        """Average precision; None where nothing is labelled or the method cannot search."""
        return None if self.ranked is None else self.ranked.average_precision

    def missed_at(self, false_per_minute: float) -> float | None:
        """Pmiss@RFA; None as above."""
        det = None if self.ranked is None else self.ranked.det
        return None if det is None else det.missed_at(false_per_minute)

    @cached_property
    def trust(self) -> Trust | None:
        """None where the scores are not calibrated, and where nothing was found."""
        if self.calibration is None or self.ranked is None:
            return None
        shown = self.ranked.score >= MIN_SCORE
        right = self.ranked.correct[shown]
        if not len(right):
            return None
        stated = self.calibration.at(self.ranked.score[shown])
        found = reliability(stated, right)
        counts = len(right), float(right.mean()), float(stated.mean())
        return Trust(*counts, found.expected_error, true_error(found))

    def to_dict(self) -> dict[str, Any]:
        """One cell of ``evaluation.json``."""
        found = {
            "average_precision": self.average_precision,
            "interval": self.interval(NIST),
            "p_miss": {f"{rate:g}": self.missed_at(rate) for rate in FALSE_PER_MINUTE},
            "found": None if self.ranked is None else len(self.ranked.score),
            "correct": None if self.ranked is None else int(self.ranked.correct.sum()),
        }
        return found | self.settings

    def by_rule(self) -> dict[str, Any]:
        """Average precision by every rule: with its interval, and camera by camera."""
        cameras = sorted({clip.camera for clip in self.events or ()})
        return {
            rule: {
                "average_precision": self.precision_by(rule),
                "interval": self.interval(rule),
                "cameras": {one: self.precision_by(rule, one) for one in cameras},
            }
            for rule in RULES
        }


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

    def ours(self, activity: str) -> ActivityOutcome:
        """The cell of our own method."""
        return self.of(self.methods[0].name, activity)

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
                    "rules": self.ours(activity).by_rule(),
                    "probability": (trust := self.ours(activity).trust) and asdict(trust),
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
    outcomes = []
    with progress.stage("Searching", len(METHODS)) as step:
        for method in METHODS:
            with timed(timings, f"search, {method.name}"):
                outcomes += _tried(method, tuned, reported, activities)
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


def _tried(
    method: Method,
    tuned: Sequence[Clip],
    reported: Sequence[Clip],
    activities: Mapping[str, Activity],
) -> list[ActivityOutcome]:
    """A method on the reported clips, with the settings that are best on the tuning ones."""
    settings = best_settings(method, tuned, activities)
    seen = {value: Seen(method, value, reported) for value in {*settings.values()}}
    out = []
    for name, activity in activities.items():
        events = seen[settings[name]].events(activity, label_length_s(tuned, activity))
        own = {method.setting: settings[name]} if method.setting else {}
        known = calibration_of(activity, ANNOTATED) if method == OURS else None
        found = None if events is None else tuple(events)
        out.append(ActivityOutcome(method.name, name, found, own, known))
    return out


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
    "Even so a track begins and ends where a label does, which helps: the method “track ends” "
    "shows what can be had by that alone.",
    "The annotations hold boxes but no keypoints: what needs the body's pose cannot be judged.",
    f"Every constant was chosen on cameras {' and '.join(TUNED)}; other cameras are reported. No "
    "camera has constants of its own.",
    "An event is correct where it overlaps a label of its activity by 1 s, or by half of a label "
    "that is shorter than 1 s; each is used once (NIST, ActEV SDL V2). Beside it stand temporal "
    "intersection over union of 0.2 and 0.5, and NIST's rule where all who take part in the event "
    "must be actors of the label.",
    "Ranges hold 95 % of the figures over clips drawn with replacement.",
)
