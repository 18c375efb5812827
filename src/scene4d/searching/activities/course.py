"""Every predicate of an event over time: what its score was made of, and what came before."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from scene4d.searching.activities._absence import absence_values
from scene4d.searching.activities._casting import cast
from scene4d.searching.activities._events import Event
from scene4d.searching.activities._evidence import gather
from scene4d.searching.activities._terms import term_text
from scene4d.searching.activities.definition import Activity
from scene4d.searching.predicates.stage import Stage

_AROUND_S = 3.0
"""A course begins this long before its event, and ends as long after it; chosen by hand."""
_SIGNS = "▁▂▃▄▅▆▇█"


@dataclass(frozen=True, eq=False)
class Course:
    """Moments (s from the clip's start) of an event's cast, and the value of each predicate at
    them, as in :attr:`.Event.why`; NaN where it cannot be judged.
    """

    time_s: Float[np.ndarray, "n"]
    values: Mapping[str, Float[np.ndarray, "n"]]

    def signs(self, name: str, width: int) -> str:
        """One predicate as a line of ``width`` signs of rising height; a space where unknown."""
        edges = np.linspace(self.time_s[0], self.time_s[-1], width)
        nearest = np.abs(self.time_s[:, None] - edges).argmin(axis=0)
        values = self.values[name][nearest]
        index = np.minimum(np.nan_to_num(values) * len(_SIGNS), len(_SIGNS) - 1).astype(int)
        known = np.isfinite(values)
        return "".join(_SIGNS[i] if k else " " for i, k in zip(index, known, strict=True))


def course_of(stage: Stage, activity: Activity, event: Event) -> Course | None:
    """The course of an event of this stage; None where its cast has no moment together."""
    activity = activity.option(event.activity)
    if activity.is_of_nobody:
        return Course(*absence_values(stage, activity, event))
    rows = {role: _rows(stage, number, event) for role, number in event.roles.items()}
    casts = cast(stage, activity, rows)
    if len(casts) == 0:
        return None
    evidence = gather(stage, activity, casts, 0.0)
    base = next(rows for view, rows in casts.rows.items() if view[1] == 0)
    values = {
        f"{phase.name}: {term_text(term)}": own_values
        for phase, terms in zip(activity.phases, evidence.terms, strict=True)
        for term, own_values in zip(phase.terms, terms, strict=True)
    }
    return Course(stage.tracks.time_s[base], values)


def _rows(stage: Stage, number: int, event: Event) -> Int[np.ndarray, "n"]:
    """Rows of a track at about the time of an event."""
    (at,) = np.flatnonzero(stage.tracks.track[stage.first_row] == number)
    rows = np.arange(stage.first_row[at], stage.last_row[at] + 1)
    time_s = stage.tracks.time_s[rows]
    about = (time_s >= event.begin_s - _AROUND_S) & (time_s <= event.end_s + _AROUND_S)
    return rows[about & stage.used[rows]]
