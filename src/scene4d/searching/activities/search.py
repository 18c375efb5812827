"""Finding an activity in what a camera tracked."""

from dataclasses import dataclass, replace

import numpy as np

from scene4d.core.errors import InputError
from scene4d.searching.activities._absence import absences
from scene4d.searching.activities._casting import cast, is_symmetric, rows_of_roles, unbound_roles
from scene4d.searching.activities._checking import check_activity, check_places
from scene4d.searching.activities._compose import Aligned, Span, Timeline, align
from scene4d.searching.activities._events import (
    Event,
    found_event,
    one_per_alternative,
    one_per_occurrence,
)
from scene4d.searching.activities._evidence import Evidence, gather, played_by_several, promising
from scene4d.searching.activities._related import align_related
from scene4d.searching.activities._terms import value_of
from scene4d.searching.activities.calibrated import ANNOTATED, DETECTED, calibration_of
from scene4d.searching.activities.definition import Activity
from scene4d.searching.predicates._registry import PREDICATES
from scene4d.searching.predicates.stage import Stage

MIN_SCORE = 0.05
"""Least score of an event, unless another is asked for; chosen by hand."""
LEAST_SCORE = 0.001
"""No event scores less; chosen by hand: below it hardly a predicate speaks for an event, and every
moment is one."""


@dataclass(frozen=True)
class Judged:
    """``events`` of an activity, best first, and how many ``casts`` came close enough for one."""

    events: list[Event]
    casts: int


def find(stage: Stage, activity: Activity, *, min_score: float = MIN_SCORE) -> list[Event]:
    """The events of :func:`judge`, best first."""
    return judge(stage, activity, min_score=min_score).events


def judge(stage: Stage, activity: Activity, *, min_score: float = MIN_SCORE) -> Judged:
    """Every event of the activity with at least ``min_score`` and :data:`LEAST_SCORE`.

    An event is the best alignment of the activity's phases for a cast of tracks (:mod:`compose`);
    of those of one doer that overlap in time only the best is an event. Where the stage has nobody
    for a role there is none. Raises :class:`InputError` for an activity that is impossible or names
    what does not exist, for a zone that crosses itself, for a stage whose rows are not in order,
    and where so many casts are possible that judging them would take too long.
    """
    if not 0 <= min_score <= 1:
        raise InputError(f"min_score must lie between 0 and 1, found {min_score}")
    least = max(min_score, LEAST_SCORE)
    check_activity(activity)
    check_places(stage, activity)
    if activity.alternatives:
        several = [judge(stage, one, min_score=min_score) for one in activity.alternatives]
        events = one_per_alternative([event for one in several for event in one.events])
        return Judged(events, sum(one.casts for one in several))
    if activity.is_of_nobody:
        return Judged(absences(stage, activity, least), 0)
    rows = rows_of_roles(stage, activity)
    counted = played_by_several(activity)
    if len(rows) > 1 and not counted:
        for role in unbound_roles(activity):
            rows[role] = promising(stage, activity, role, rows[role], least)
    casts = cast(stage, activity, rows)
    found = []
    for batch in [casts] if counted else casts.batches():
        evidence = gather(stage, activity, batch, least)
        for number, aligned in _align(evidence, activity, stage.step_s, least):
            found.append(found_event(stage, activity, evidence, number, aligned))
    events = one_per_occurrence(
        found,
        symmetric=is_symmetric(activity),
        crowd_m=_crowd_reach_m(activity),
    )
    calibration = calibration_of(activity, DETECTED if stage.everybody else ANNOTATED)
    events = [replace(event, calibration=calibration) for event in events]
    return Judged(events, len(casts.first))


def _align(
    evidence: Evidence, activity: Activity, step_s: float, least_score: float
) -> list[tuple[int, Aligned]]:
    if len(evidence.casts) == 0:
        return []
    moments = Timeline(evidence.casts.tick, evidence.casts.first)
    spans = [Span.of(phase, step_s) for phase in activity.phases]
    least = float(np.log(least_score))
    logs = evidence.log_p, evidence.log_judged
    if activity.relations:
        return align_related(moments, *logs, activity, spans, step_s, least)
    return align(moments, *logs, spans, step_s, least)


def _crowd_reach_m(activity: Activity) -> float:
    """Distance within which two doers of an activity do it together: across a crowd, or 0."""
    radii = [
        2 * value_of(term, "radius_m")
        for term in activity.terms
        if "radius_m" in PREDICATES[term.predicate].parameters and not term.negated
    ]
    # Those who are counted do it together, wherever they are.
    return float("inf") if played_by_several(activity) else float(np.max(radii, initial=0.0))
