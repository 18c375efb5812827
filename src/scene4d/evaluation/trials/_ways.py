"""Ways to search for an activity in clips: ours, and what it is compared with."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np

from scene4d.evaluation.datasets._meva import Clip
from scene4d.evaluation.measures._events import NIST, RULES, ClipEvents, Ranked, ranked_clips
from scene4d.evaluation.trials._baselines import in_box_sizes, in_pixels, near_alone, track_ends
from scene4d.searching.activities.definition import Activity
from scene4d.searching.activities.search import LEAST_SCORE, find
from scene4d.searching.predicates.stage import Stage


@dataclass(frozen=True)
class Method:
    """A way to search: a short ``name`` for tables, and what it does in a sentence.

    ``tried`` are values of its own setting, of which the one counts for each activity that finds it
    best on the tuning cameras. ``view`` is how it sees a stage with one of them, ``searched`` what
    it searches for instead of an activity, None where it cannot.
    """

    name: str
    description: str
    setting: str = ""
    tried: tuple[float, ...] = (1.0,)
    view: Callable[[Stage, float], Stage] = lambda stage, _: stage
    searched: Callable[[Activity], Activity | None] = lambda activity: activity


METRES_PER_PX = (0.005, 0.01, 0.02, 0.04)
"""Lengths that a pixel may stand for in the baseline in pixels; a person of 1.7 m is 340 to 43
pixels tall, as on MEVA."""
BOX_M = (1.5, 2.5, 4.0)
"""Lengths that a box may stand for: a car of 4.6 x 1.5 m is 2.6 m by the root of its area from the
side, and smaller from ahead."""
_CHOSEN = "for each activity what finds it best on the tuning cameras"

OURS = Method("metres", "the catalogue's activities, on the ground in metres")
PIXELS = Method(
    "pixels",
    "the same activities in the image, from the feet of the boxes, with one pixel taken as "
    f"{', '.join(f'{m:g}' for m in METRES_PER_PX)} m: {_CHOSEN}",
    "metres_per_px",
    METRES_PER_PX,
    view=in_pixels,
)
BOXES = Method(
    "box sizes",
    "those of one role in the image, where each thing moves by the size of its own box, taken as "
    f"{', '.join(f'{m:g}' for m in BOX_M)} m: {_CHOSEN}",
    "box_m",
    BOX_M,
    view=in_box_sizes,
    searched=lambda activity: activity if len(activity.roles) == 1 else None,
)
NEAR = Method(
    "near",
    "the same activities with P(near) as their only predicate, on the ground in metres",
    searched=near_alone,
)
ENDS = Method(
    "track ends",
    "no search at all: one event where each track begins, or where it ends, as long as labels are "
    f"on the tuning cameras, short tracks first: {_CHOSEN}. What it finds, the annotation gives "
    "away",
    "at_end",
    (0.0, 1.0),
)
METHODS = (OURS, PIXELS, BOXES, NEAR, ENDS)

_Found = tuple[np.ndarray, np.ndarray, list[set[int]]]
"""Begin and end (d, 2), scores (d,), and who takes part."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Clips, and their stages as a method sees them with one of its settings."""

    method: Method
    value: float
    clips: Sequence[Clip]
    stages: Sequence[Stage] = field(init=False)

    def __post_init__(self) -> None:
        stages = [self.method.view(clip.stage, self.value) for clip in self.clips]
        object.__setattr__(self, "stages", stages)

    def events(self, activity: Activity, length_s: float = np.nan) -> list[ClipEvents] | None:
        """What is found of an activity in each clip; None where the method cannot search for it.
        ``length_s`` is how long labels of it are, for :data:`ENDS`.
        """
        searched = self.method.searched(activity)
        if searched is None or (self.method == ENDS and np.isnan(length_s)):
            return None
        out = []
        for clip, stage in zip(self.clips, self.stages, strict=True):
            if self.method == ENDS:
                classes = activity.roles[0].classes
                spans, score, track = track_ends(stage, classes, length_s, self.value > 0)
                found: _Found = spans, score, [{number} for number in track.tolist()]
            else:
                found = _found(stage, searched)
            out.append(_beside_labels(clip, activity, found))
        return out


def _found(stage: Stage, activity: Activity) -> _Found:
    events = find(stage, activity, min_score=LEAST_SCORE)
    spans = np.array([(event.begin_s, event.end_s) for event in events], float).reshape(-1, 2)
    score = np.array([event.score for event in events], float)
    return spans, score, [set(event.roles.values()) for event in events]


def _beside_labels(clip: Clip, activity: Activity, found: _Found) -> ClipEvents:
    spans, score, who = found
    labels = [set(label.actors) for label in clip.labels(activity.labels)]
    involved = np.array([[one <= label for one in who] for label in labels], bool)
    involved = involved.reshape(len(labels), len(who))
    return ClipEvents(
        clip.camera, clip.minutes, clip.label_s(activity.labels), spans, score, involved
    )


def label_length_s(clips: Sequence[Clip], activity: Activity) -> float:
    """Median length of an activity's labels; NaN without any."""
    spans = np.concatenate([clip.label_s(activity.labels) for clip in clips])
    return float(np.median(np.diff(spans))) if len(spans) else float("nan")


def best_settings(
    method: Method, clips: Sequence[Clip], activities: Mapping[str, Activity]
) -> dict[str, float]:
    """For each activity the setting with the best average precision; the first of equal ones."""
    if len(method.tried) == 1:
        return dict.fromkeys(activities, method.tried[0])
    best = dict.fromkeys(activities, (-1.0, method.tried[0]))
    for value in method.tried:
        seen = Seen(method, value, clips)
        for name, activity in activities.items():
            events = seen.events(activity, label_length_s(clips, activity))
            found = (events and ranked(events).average_precision) or 0.0
            if found > best[name][0]:
                best[name] = found, value
    return {name: value for name, (_, value) in best.items()}


def ranked(events: Sequence[ClipEvents], rule: str = NIST) -> Ranked:
    """The events of all clips, matched by a rule of :data:`RULES`."""
    return Ranked.pooled(ranked_clips(events, RULES[rule]))
