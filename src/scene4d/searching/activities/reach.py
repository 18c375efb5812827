"""What a term says of where its two roles are, before any probability is computed."""

from collections.abc import Mapping

import numpy as np

from scene4d.searching.activities.definition import Activity, Term
from scene4d.searching.activities.meeting import BOUND_SIGMA
from scene4d.searching.activities.terms import value_of
from scene4d.searching.predicates.registry import Predicate

# Predicates that are improbable beyond a distance: the parameters that say which, and how softly.
_BOUNDED = dict.fromkeys(("near", "same_place", "following"), ("tau_m", "sigma_m"))
_SYMMETRIC = ("near", "far", "same_place")


def reach_of(term: Term, predicates: Mapping[str, Predicate]) -> float:
    """Distance beyond which a term of two roles is below 0.01 whoever they are; or infinite.

    The positions' own errors are left to the search, which widens its boxes by them.
    """
    opposite = "near" if term.predicate == "far" and term.negated else term.predicate
    if opposite not in _BOUNDED or (term.negated and term.predicate != "far"):
        return float("inf")
    names = [name for name in _BOUNDED[opposite] if name in predicates[term.predicate].parameters]
    tau, *sigma = (value_of(term, name, predicates) for name in names)
    return max(tau + BOUND_SIGMA * sum(sigma), 0.1)


def is_symmetric(activity: Activity) -> bool:
    """Whether two roles may be swapped without a change of what is asked."""
    if len(activity.roles) != 2 or set(activity.roles[0].classes) != set(activity.roles[1].classes):
        return False
    one, two = (role.name for role in activity.roles)
    swap = {one: two, two: one}
    for phase in activity.phases:
        if {_signature(term, {}) for term in phase.terms} != {
            _signature(term, swap) for term in phase.terms
        }:
            return False
    return True


def _signature(term: Term, names: Mapping[str, str]) -> tuple:
    roles = tuple(names.get(role, role) for role in term.roles)
    lagged = bool(term.parameters.get("lag_s", 0.0))
    if term.predicate in _SYMMETRIC and not lagged:
        roles = tuple(sorted(roles))
    return (term.predicate, roles, tuple(sorted(term.parameters.items())), term.negated)


def crowd_reach_m(activity: Activity, predicates: Mapping[str, Predicate]) -> float:
    """Distance within which two doers of an activity do it together: across a crowd, or 0."""
    radii = [
        2 * value_of(term, "radius_m", predicates)
        for phase in activity.phases
        for term in phase.terms
        if "radius_m" in predicates[term.predicate].parameters and not term.negated
    ]
    return float(np.max(radii, initial=0.0))
