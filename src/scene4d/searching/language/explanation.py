"""What was understood, in lines to read."""

import math
from collections.abc import Sequence

from scene4d.searching.activities.definition import Activity, Phase
from scene4d.searching.activities.terms import term_text
from scene4d.searching.language.clock import Window


def predicate_lines(activity: Activity) -> list[str]:
    """The terms in their order, one line each, as ``near(person, vehicle, tau_m=3)``."""
    return [term_text(term) for phase in activity.phases for term in phase.terms]


def explain(activity: Activity, window: Window | None, notes: Sequence[str]) -> list[str]:
    """The decomposition as text: who, the phases with their durations and terms, when, notes."""
    lines = [f"{role.name}: {' or '.join(role.classes)}" for role in activity.roles]
    for number, phase in enumerate(activity.phases, 1):
        lines.append(f"{number}. {phase.name}{_lasting(phase)}{_pause(phase, number)}")
        lines += [f"   {term_text(term)}" for term in phase.terms]
    lines += [f"{r.first} {r.relation} {r.second}" for r in activity.relations]
    if window is not None:
        lines.append(f"time of day: {window}")
    return [*lines, *(f"note: {note}" for note in notes)]


def _lasting(phase: Phase) -> str:
    if math.isinf(phase.max_s):
        return f", at least {phase.min_s:g} s" if phase.min_s else ""
    return f", {phase.min_s:g} to {phase.max_s:g} s"


def _pause(phase: Phase, number: int) -> str:
    return f", at most {phase.gap_s:g} s later" if number > 1 and phase.gap_s else ""
