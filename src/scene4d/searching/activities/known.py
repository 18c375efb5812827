"""Every predicate that an activity may speak of."""

from collections.abc import Mapping
from types import MappingProxyType

from scene4d.searching.activities.crowd import crowded
from scene4d.searching.predicates.registry import PREDICATES as OF_ONE_OR_TWO
from scene4d.searching.predicates.registry import Parameter, Predicate

_CROWDED = Predicate(
    name="crowded",
    arity=1,
    parameters={
        "count": Parameter("count", 5.0, "", 2.0, 1000.0),
        "radius_m": Parameter("radius_m", 3.0, "m", 0.1, 1000.0),
    },
    function=crowded,
    summary="at least count of its kind, itself among them, are within radius_m",
)

PREDICATES: Mapping[str, Predicate] = MappingProxyType({**OF_ONE_OR_TWO, "crowded": _CROWDED})
"""Those of :mod:`scene4d.searching.predicates`, and those that look at everybody."""
