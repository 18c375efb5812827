"""An evaluation of activity search: methods by activities, and what must be said beside it."""

from dataclasses import dataclass, field
from functools import cached_property
from typing import Any

from scene4d.evaluation.activity_matching import OVERLAP_S, OVERLAP_SHARE
from scene4d.evaluation.activity_scores import DetCurve, Ranked, average_precision, det_curve

FALSE_PER_MINUTE = (0.15, 0.02)
"""Rates of false alarms at which misses are reported: NIST's for ActEV."""


@dataclass(frozen=True)
class Method:
    """A way to search: a short ``name`` for tables, and what it does in a sentence."""

    name: str
    description: str


@dataclass(frozen=True, eq=False)
class ActivityOutcome:
    """How one method did on one activity; ``ranked`` is None where it cannot look for it.

    ``settings`` are those that the method has for this activity alone.
    """

    method: str
    activity: str
    ranked: Ranked | None
    settings: dict[str, float] = field(default_factory=dict)

    @cached_property
    def average_precision(self) -> float | None:
        """Average precision; None where there is nothing to find or no way to look for it."""
        return None if self.ranked is None else average_precision(self.ranked)

    @cached_property
    def det(self) -> DetCurve | None:
        """The DET curve; None as above."""
        return None if self.ranked is None else det_curve(self.ranked)

    def missed_at(self, false_per_minute: float) -> float | None:
        """Pmiss@RFA; None as above."""
        return None if self.det is None else self.det.missed_at(false_per_minute)

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` says of it."""
        return {
            "average_precision": self.average_precision,
            "p_miss": {f"{rate:g}": self.missed_at(rate) for rate in FALSE_PER_MINUTE},
            "found": None if self.ranked is None else len(self.ranked.score),
            "correct": None if self.ranked is None else int(self.ranked.correct.sum()),
        } | self.settings


@dataclass(frozen=True, eq=False)
class ActivityEvaluation:
    """Every method on every activity. The first of ``methods`` is ours, the others are baselines.

    ``activities`` maps each activity to the names it has in the data set, ``labels`` to how often
    it is labelled. ``tuned`` are the cameras that constants were chosen on, ``reported`` the
    others, which everything here is about.
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

    def mean_average_precision(self, method: str) -> float | None:
        """Mean over the activities that the method can look for."""
        values = [self.of(method, activity).average_precision for activity in self.activities]
        known = [value for value in values if value is not None]
        return sum(known) / len(known) if known else None

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints."""
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
