"""Events: what was found, when, who took part, and why; one of them per occurrence."""

from collections import defaultdict
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float

from scene4d.searching.activities._compose import Aligned
from scene4d.searching.activities._evidence import Evidence, phase_value, played_by_several
from scene4d.searching.activities._terms import term_text
from scene4d.searching.activities.calibrated import ScoreCalibration
from scene4d.searching.activities.definition import Activity
from scene4d.searching.predicates.stage import Stage

WITHOUT_BREAK = "without a break"
"""Entry of :attr:`Event.why` for what stretching phases over what denies them cost."""


@dataclass(frozen=True)
class Event:
    """An activity that happened. ``score`` is the product of its phases' probabilities,
    ``mean_score`` the geometric mean over all their predicates, which compares activities of
    different length.

    Seconds count from the clip's start. ``roles`` maps each role to its track; ``why`` each
    predicate, as ``phase: predicate(role, ...)``, to what it contributed: the score is the product
    of these, a NaN (nothing could be judged: no keypoints, say) counting one half. ``phases_s`` is
    from when to when each phase lasted; ``calibration`` that of the activity's scores, where there
    is one. Of alternatives ``activity`` is the one that it was, and ``also`` others that the same
    doer seemed to do meanwhile, with lower scores.
    """

    activity: str
    score: float
    mean_score: float
    begin_s: float
    end_s: float
    roles: Mapping[str, int]
    why: Mapping[str, float]
    phases_s: tuple[tuple[float, float], ...] = ()
    calibration: ScoreCalibration | None = None
    also: tuple[str, ...] = ()

    @property
    def probability(self) -> float | None:
        """Probability that the event is right; None where its scores are not calibrated."""
        if self.calibration is None:
            return None
        return float(self.calibration.at(np.array(self.score)))


@dataclass(frozen=True, eq=False)
class Found:
    """An event, who took part (tracks by their position), and where its doer was in the end."""

    event: Event
    doer: int
    partners: tuple[int, ...]
    place_m: Float[np.ndarray, "2"]


def found_event(
    stage: Stage, activity: Activity, evidence: Evidence, cast: int, aligned: Aligned
) -> Found:
    """The event of an alignment; ``aligned`` counts the moments of ``evidence.casts``."""
    casts, counted = evidence.casts, played_by_several(activity)
    why = {}
    for number, (phase, (first, last)) in enumerate(
        zip(activity.phases, aligned.core, strict=True)
    ):
        for term, values in zip(phase.terms, evidence.terms[number], strict=True):
            why[f"{phase.name}: {term_text(term)}"] = phase_value(values[first : last + 1])
        if counted is not None and evidence.enough is not None:
            so_many = evidence.enough[number][first : last + 1]
            why[f"{phase.name}: {counted.how_many} ({counted.name})"] = phase_value(so_many)
    if aligned.stretched < -0.01:
        why[WITHOUT_BREAK] = float(np.exp(aligned.stretched))
    score = float(np.exp(min(aligned.log_score, 0.0)))
    who = casts.tracks[cast]
    numbers = stage.tracks.track[stage.first_row]
    base = next(rows for view, rows in casts.rows.items() if view[1] == 0)
    ends = np.array([*aligned.whole, (aligned.begin, aligned.end)])
    ends_s = stage.tracks.time_s[base[ends]]
    begin_s, end_s = _span_s(activity, aligned, ends_s[-1], stage.span_s)
    event = Event(
        activity.name,
        score,
        score ** (1 / len(activity.terms)),
        begin_s,
        end_s,
        {role.name: int(numbers[at]) for role, at in zip(activity.roles, who, strict=True)},
        why,
        tuple((float(first_s), float(last_s)) for first_s, last_s in ends_s[:-1]),
    )
    place = stage.tracks.xy_m[base[aligned.core[-1][1]]]
    return Found(event, int(who[0]), tuple(int(at) for at in who[1:]), place)


def _span_s(
    activity: Activity,
    aligned: Aligned,
    seen_s: Float[np.ndarray, "2"],
    within_s: tuple[float, float],
) -> tuple[float, float]:
    """Begin and end of an event that is seen from when to when, with what is not seen of its first
    and its last phase, as far as the footage goes.
    """
    before, after = 0.0, 0.0
    for phase, (first, last) in zip(activity.phases, aligned.whole, strict=True):
        before = max(before, phase.unseen_s[0] if first == aligned.begin else 0.0)
        after = max(after, phase.unseen_s[1] if last == aligned.end else 0.0)
    begin_s, end_s = seen_s[0] - before, seen_s[1] + after
    return float(max(begin_s, within_s[0])), float(min(end_s, within_s[1]))


def one_per_occurrence(
    found: Sequence[Found], *, symmetric: bool = False, crowd_m: float = 0.0
) -> list[Event]:
    """Of events that overlap in time and have one doer only the best, best first.

    The doer is the first role; where roles may be swapped (``symmetric``) each of them is. Doers
    within ``crowd_m`` of one another, with the same others, count as one. Equal scores are ordered
    by time, then tracks.
    """
    order = sorted(
        found,
        key=lambda f: (
            round(-f.event.score, 9),
            f.event.begin_s,
            f.event.end_s,
            tuple(f.event.roles.values()),
        ),
    )
    kept: list[Event] = []
    taken: dict[int, list[tuple[float, float]]] = defaultdict(list)
    crowds: list[Found] = []
    for one in order:
        begin, end = one.event.begin_s, one.event.end_s
        doers = (one.doer, *one.partners) if symmetric else (one.doer,)
        if any(b <= end and begin <= e for doer in doers for b, e in taken[doer]):
            continue
        if crowd_m and any(_together(one, other, crowd_m) for other in crowds):
            continue
        kept.append(one.event)
        crowds.append(one)
        for doer in doers:
            taken[doer].append((begin, end))
    return kept


def one_per_alternative(found: Sequence[Event]) -> list[Event]:
    """Events of several alternatives, best first: what one doer seemed to do in one interval is one
    event, of the best alternative.

    Its score stays that of this one: the same rows speak for all, so that scores do not add up.
    """
    kept: list[Event] = []
    for event in sorted(found, key=lambda one: (-one.score, one.begin_s, one.activity)):
        doer = next(iter(event.roles.values()), None)
        for at, other in enumerate(kept):
            same = doer is not None and doer == next(iter(other.roles.values()), None)
            meets = event.begin_s <= other.end_s and other.begin_s <= event.end_s
            if same and meets and event.activity != other.activity:
                also = dict.fromkeys((*other.also, event.activity))
                kept[at] = replace(other, also=tuple(also))
                break
        else:
            kept.append(event)
    return kept


def _together(one: Found, other: Found, crowd_m: float) -> bool:
    a, b = one.event, other.event
    meets = a.begin_s <= b.end_s and b.begin_s <= a.end_s
    same = one.partners == other.partners
    apart = float(np.linalg.norm(one.place_m - other.place_m))
    return meets and same and not apart > crowd_m
