"""What each predicate contributed, in words."""

import math
from collections.abc import Mapping


def why_groups(why: Mapping[str, float]) -> list[tuple[str, list[tuple[str, str, float]]]]:
    """Predicates by phase, as (name, value in words, value for the bar)."""
    groups: dict[str, list[tuple[str, str, float]]] = {}
    for key, value in why.items():
        phase, colon, term = key.partition(": ")
        name = term if colon else phase
        unknown = math.isnan(value)
        text = "cannot be judged, counts ½" if unknown else f"{value:.2f}"
        groups.setdefault(phase if colon else "", []).append(
            (name, text, 0.5 if unknown else value)
        )
    return list(groups.items())
