"""What makes an activity impossible, said before anything is searched."""

import math
from collections.abc import Collection

from scene4d.core.errors import InputError
from scene4d.core.text import nearest
from scene4d.core.tracks import CLASSES
from scene4d.searching.activities._terms import check_term, places_of
from scene4d.searching.activities.definition import ALLEN, Activity, Phase, Relation, Role
from scene4d.searching.predicates._zones import place_of
from scene4d.searching.predicates.stage import Stage


def check_activity(activity: Activity) -> None:
    """Raise :class:`InputError` for an activity that can never be found or is not understood."""
    for one in activity.alternatives:
        check_activity(one)
    if activity.alternatives:
        return
    try:
        if not activity.roles:
            raise InputError("no role, expected at least one")
        if not activity.phases:
            raise InputError("no phase, expected at least one")
        check_names("role", [role.name for role in activity.roles])
        check_names("phase", [phase.name for phase in activity.phases])
        for role in activity.roles:
            check_role(role)
        if activity.is_of_nobody and (len(activity.roles) > 1 or len(activity.phases) > 1):
            raise InputError("a role that nobody plays stands alone, in one phase")
        if sum(role.is_counted for role in activity.roles) > 1:
            raise InputError("two roles that several play, expected one at most")
        names = [role.name for role in activity.roles]
        for phase in activity.phases:
            check_durations(phase)
            if not phase.terms:
                raise InputError(f"phase {phase.name!r}: no terms, expected at least one")
            for term in phase.terms:
                check_term(term, names)
        names = [phase.name for phase in activity.phases]
        if activity.state and activity.state not in names:
            raise InputError(f"state: no phase {activity.state!r}{nearest(activity.state, names)}")
        for relation in activity.relations:
            check_relation(relation, [phase.name for phase in activity.phases])
        used = {role for term in activity.terms for role in term.roles}
        for role in activity.roles:
            if role.name not in used:
                raise InputError(f"role {role.name!r}: is used in no phase")
    except InputError as error:
        raise InputError(f"activity {activity.name!r}: {error}") from None


def check_role(role: Role) -> None:
    """Raise :class:`InputError` for a class that scenes do not have."""
    if role.count < 1:
        raise InputError(f"role {role.name!r}: count must be at least 1, found {role.count}")
    if not role.classes:
        raise InputError(f"role {role.name!r}: no class; there is {', '.join(CLASSES)}")
    for name in role.classes:
        if name not in CLASSES:
            raise InputError(f"role {role.name!r}: no class {name!r}{nearest(name, CLASSES)}")


def check_durations(phase: Phase) -> None:
    """Raise :class:`InputError` where no interval can last so."""
    if not 0 <= phase.min_s <= phase.max_s or math.isinf(phase.min_s):
        raise InputError(
            f"phase {phase.name!r}: impossible duration, from {phase.min_s:g} to {phase.max_s:g} s"
        )
    if phase.max_s == 0:
        raise InputError(f"phase {phase.name!r}: impossible duration, it lasts 0 s at most")
    if not phase.gap_s >= 0:
        raise InputError(f"phase {phase.name!r}: gap must not be negative, found {phase.gap_s:g}")
    if not all(0 <= unseen_s < math.inf for unseen_s in phase.unseen_s):
        found = ", ".join(f"{unseen_s:g}" for unseen_s in phase.unseen_s)
        raise InputError(
            f"phase {phase.name!r}: unseen must be finite and not negative, found {found}"
        )


def check_relation(relation: Relation, phases: Collection[str]) -> None:
    """Raise :class:`InputError` for unknown phases and relations."""
    for name in (relation.first, relation.second):
        if name not in phases:
            raise InputError(f"relation: no phase {name!r}{nearest(name, phases)}")
    if relation.relation not in ALLEN:
        raise InputError(f"no relation {relation.relation!r}{nearest(relation.relation, ALLEN)}")
    if relation.first == relation.second:
        raise InputError(f"relation: {relation.first!r} is related to itself")


def check_places(stage: Stage, activity: Activity) -> None:
    """Raise :class:`InputError` for places that the activity names and the stage lacks, or that
    are no zone or no line.
    """
    for kind, places in (("zone", stage.zones), ("line", stage.lines)):
        for name in places_of(activity.terms, kind):
            try:
                place_of(places, kind, name)
            except InputError as error:
                raise InputError(f"activity {activity.name!r}: {error}") from None


def check_names(what: str, names: list[str]) -> None:
    """Raise :class:`InputError` for a name that two have."""
    for name in names:
        if names.count(name) > 1:
            raise InputError(f"{what} {name!r} occurs twice")
