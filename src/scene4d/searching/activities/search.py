"""Finding an activity in what a camera tracked."""

from collections.abc import Iterator, Mapping
from dataclasses import dataclass

import numpy as np

from scene4d.core.errors import InputError
from scene4d.searching.activities.casting import Frames, cast
from scene4d.searching.activities.checking import check_activity
from scene4d.searching.activities.compose import Aligned, Moments, Span, align
from scene4d.searching.activities.crowd import clock_of
from scene4d.searching.activities.definition import Activity
from scene4d.searching.activities.events import Event, found_event, one_per_occurrence
from scene4d.searching.activities.evidence import Evidence, gather, steps
from scene4d.searching.activities.known import PREDICATES
from scene4d.searching.activities.places import check_places
from scene4d.searching.activities.reach import crowd_reach_m, is_symmetric
from scene4d.searching.activities.related import align_related
from scene4d.searching.predicates.registry import Predicate
from scene4d.searching.predicates.rows import Stage

MIN_SCORE = 0.05
"""Least score of an event, unless another is asked for."""
LEAST_SCORE = 0.001
"""No event scores less: below it hardly a predicate speaks for it, and every moment is one."""
_MOMENTS = 400_000


@dataclass(frozen=True)
class Judged:
    """``events`` of an activity, best first, and how many ``casts`` came close enough for one."""

    events: list[Event]
    casts: int


def find(
    stage: Stage,
    activity: Activity,
    *,
    min_score: float = MIN_SCORE,
    predicates: Mapping[str, Predicate] = PREDICATES,
) -> list[Event]:
    """The events of :func:`judge`, best first."""
    return judge(stage, activity, min_score=min_score, predicates=predicates).events


def judge(
    stage: Stage,
    activity: Activity,
    *,
    min_score: float = MIN_SCORE,
    predicates: Mapping[str, Predicate] = PREDICATES,
) -> Judged:
    """Every event of the activity with at least ``min_score`` and :data:`LEAST_SCORE`.

    An event is the best alignment of the activity's phases for a cast of tracks
    (:mod:`compose`); of those of one doer that overlap in time only the best is an event. Where the
    stage has nobody for a role there is none. Raises
    :class:`InputError` for an activity that is impossible or names what does not exist, for a zone
    that crosses itself, and for a stage whose rows are not in order.
    """
    if not 0 <= min_score <= 1:
        raise InputError(f"min_score must lie between 0 and 1, found {min_score}")
    least = max(min_score, LEAST_SCORE)
    check_activity(activity, predicates)
    check_places(stage, activity, predicates)
    frames = cast(clock_of(stage), activity, predicates)
    found = []
    for batch in _batches(frames):
        evidence = gather(stage, activity, batch, predicates, least)
        for number, aligned in _align(evidence, activity, stage.step_s, least):
            found.append(found_event(stage, activity, evidence, number, aligned))
    events = one_per_occurrence(
        found,
        symmetric=is_symmetric(activity),
        crowd_m=crowd_reach_m(activity, predicates),
    )
    return Judged(events, len(frames.first))


def _align(
    evidence: Evidence, activity: Activity, step_s: float, least_score: float
) -> list[tuple[int, Aligned]]:
    frames = evidence.frames
    if len(frames) == 0:
        return []
    moments = Moments(frames.tick, frames.first)
    spans = [Span(*steps(phase, step_s)) for phase in activity.phases]
    least = float(np.log(least_score))
    logs = evidence.log_p, evidence.log_judged
    if activity.relations:
        return align_related(moments, *logs, activity, spans, step_s, least)
    return align(moments, *logs, spans, step_s, least)


def _batches(frames: Frames) -> Iterator[Frames]:
    """Whole casts, as many as are worked on at a time."""
    if len(frames) == 0:
        return
    group = frames.first // _MOMENTS
    for number in np.unique(group):
        yield frames.only(group == number) if group[-1] > 0 else frames
