"""Periods in which nobody does what is asked for, within the time in which a camera watched."""

from collections.abc import Iterator, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.errors import InputError
from scene4d.searching.activities._events import Event
from scene4d.searching.activities._evidence import phase_value
from scene4d.searching.activities._terms import arguments, places_of, term_text
from scene4d.searching.activities.definition import Activity, Term
from scene4d.searching.predicates._registry import PREDICATES
from scene4d.searching.predicates._zones import in_view, place_of
from scene4d.searching.predicates.stage import Stage

LOST, IN_VIEW = "nobody lost there", "in the picture"
"""Entries of :attr:`Event.why` beside the statement itself."""
_LIKELIER = 0.5
"""A period lasts while it is likelier that nobody is there than that somebody is."""
_UNJUDGED = 0.5
"""What cannot be judged counts one half: whether somebody is still there whose track ended."""
_LOST_S = 2.0
"""Whose track ends so shortly before a period may be there in it; as long as tracking bridges."""
_MOST_SHOWN = 2000
"""Moments of a course."""


@dataclass(frozen=True, eq=False)
class _Nobody:
    """P(nobody does it) at each moment of the watched time, and where tracks end that do it."""

    spans: tuple[tuple[np.ndarray, np.ndarray], ...]
    lost_s: Float[np.ndarray, "k"]
    found_s: Float[np.ndarray, "m"]


def absences(stage: Stage, activity: Activity, least: float) -> list[Event]:
    """Every longest period in which nobody plays the activity's role, best first.

    At a moment nobody does it with the product over all who are tracked of 1 - P(he does); a
    period's score is the geometric mean of that, times one half for everybody whose track ends, or
    begins, in the midst of it, times the share of the zone that the camera sees. Whoever was never
    tracked is not counted: it is no probability. Gaps in the footage end a period.
    """
    (phase,) = activity.phases
    nobody = _nobody(stage, activity)
    zones = [place_of(stage.zones, "zone", name) for name in places_of(phase.terms, "zone")]
    share = float(min((in_view(stage, zone) for zone in zones), default=1.0))
    found = []
    for time_s, p in nobody.spans:
        for first, last in _stretches(p >= _LIKELIER):
            begin_s, end_s = float(time_s[first]), float(time_s[last])
            if not phase.min_s <= end_s - begin_s <= phase.max_s:
                continue
            early, late = max(begin_s - _LOST_S, time_s[0]), min(end_s + _LOST_S, time_s[-1])
            unsure = np.sum((nobody.lost_s >= early) & (nobody.lost_s < end_s))
            unsure += np.sum((nobody.found_s > begin_s) & (nobody.found_s <= late))
            why = {
                f"{phase.name}: {_said(phase.terms)}": phase_value(p[first : last + 1]),
                LOST: _UNJUDGED ** float(unsure),
                IN_VIEW: share,
            }
            score = float(np.prod(list(why.values())))
            if score >= least:
                spans = ((begin_s, end_s),)
                found.append(
                    Event(activity.name, score, score, begin_s, end_s, {}, why, phases_s=spans)
                )
    return sorted(found, key=lambda one: (-round(one.score, 9), one.begin_s))


def absence_values(
    stage: Stage, activity: Activity, event: Event
) -> tuple[Float[np.ndarray, "n"], dict[str, Float[np.ndarray, "n"]]]:
    """Moments of a period and of a little before and after, and P(nobody does it) at each."""
    (phase,) = activity.phases
    spans = _nobody(stage, activity).spans
    time_s, p = next((t, p) for t, p in spans if t[0] <= event.begin_s <= t[-1])
    rows = np.flatnonzero((time_s >= event.begin_s - _LOST_S) & (time_s <= event.end_s + _LOST_S))
    rows = rows[:: max(1, len(rows) // _MOST_SHOWN)]
    return time_s[rows], {f"{phase.name}: {_said(phase.terms)}": p[rows]}


def _said(terms: Sequence[Term]) -> str:
    return " and ".join(map(term_text, terms))


def _nobody(stage: Stage, activity: Activity) -> _Nobody:
    if stage.watched is None:
        raise InputError(f"{activity.name!r}: when the camera was watched is not known")
    (phase,), (role,) = activity.phases, activity.roles
    tracks = stage.tracks
    rows = np.flatnonzero(np.isin(tracks.class_name, role.classes) & stage.used)
    does = _does(stage, rows, phase.terms)
    tick = stage.tick[rows]
    origin = tracks.time_s.min() if len(tracks) else float(stage.watched[0, 0])
    spans = []
    for begin_s, end_s in stage.watched[:, :2]:
        first = int(np.ceil((begin_s - origin) / stage.step_s - 1e-6))
        last = int(np.floor((end_s - origin) / stage.step_s + 1e-6))
        if last <= first:
            continue
        p = np.ones(last - first + 1)
        here = (tick >= first) & (tick <= last)
        np.multiply.at(p, tick[here] - first, 1 - does[here])
        spans.append((origin + stage.step_s * np.arange(first, last + 1), p))
    at_end = does > _LIKELIER
    ends, begins = (np.isin(rows, one) & at_end for one in (stage.last_row, stage.first_row))
    return _Nobody(tuple(spans), tracks.time_s[rows[ends]], tracks.time_s[rows[begins]])


def _does(
    stage: Stage,
    rows: Int[np.ndarray, "m"],
    terms: Sequence[Term],
) -> Float[np.ndarray, "m"]:
    """P(the terms hold) of each row; who has no place on the ground is in no zone, and what else
    cannot be judged counts one half.
    """
    seen = stage.rows(rows)
    p = np.ones(len(rows))
    for term in terms:
        value = PREDICATES[term.predicate].function(seen, **arguments(term))
        unknown = 0.0 if "zone" in term.parameters else _UNJUDGED
        p *= np.nan_to_num(1 - value if term.negated else value, nan=unknown)
    return np.clip(p, 0.0, 1.0)


def _stretches(holds: np.ndarray) -> Iterator[tuple[int, int]]:
    """First and last of each run of moments at which it holds."""
    edges = np.flatnonzero(np.diff(np.concatenate([[False], holds, [False]]).astype(int)))
    yield from ((int(a), int(b) - 1) for a, b in edges.reshape(-1, 2))
