"""All predicates by name, with their parameters: what activities and words refer to."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType

import numpy as np

from scene4d.searching.predicates import (
    body,
    distance,
    motion,
    place,
    posture,
    relation,
    turning,
    visibility,
)

_Function = Callable[..., np.ndarray]


@dataclass(frozen=True)
class Parameter:
    """A number in ``unit`` ("m", "s", "m/s", "rad", "" for a share) from ``low`` to ``high``, or
    the name of a "zone", a "line", or a "side" of a vehicle. ``default`` is None where it must be
    given (zones, lines) or may be left out (sides).
    """

    name: str
    default: float | str | None
    unit: str
    low: float = 0.0
    high: float = float("inf")

    @property
    def required(self) -> bool:
        """Whether there is no predicate without it."""
        return self.unit in ("zone", "line")


@dataclass(frozen=True)
class Predicate:
    """``function(a, **parameters)`` or ``function(a, b, **parameters)`` of :class:`Rows`: a
    probability per row, NaN where it cannot be judged. ``summary`` is one line of prose.
    """

    name: str
    arity: int
    parameters: Mapping[str, Parameter]
    function: _Function
    summary: str


_RANGE: dict[str, tuple[str, float, float]] = {
    "tau_m": ("m", 0.0, 1e4),
    "sigma_m": ("m", 0.01, 1e3),
    "speed_mps": ("m/s", 0.0, 100.0),
    "sigma_mps": ("m/s", 0.01, 50.0),
    "angle_rad": ("rad", 0.0, np.pi),
    "sigma_rad": ("rad", 0.001, np.pi),
    "window_s": ("s", 0.05, 600.0),
    "sigma_s": ("s", 0.01, 600.0),
    "share": ("", 0.0, 1.0),
    "zone": ("zone", 0.0, np.inf),
    "line": ("line", 0.0, np.inf),
    "side": ("side", 0.0, np.inf),
}
"""Unit and range of a parameter follow from its name."""
_FUNCTIONS: tuple[_Function, ...] = (
    distance.near,
    distance.far,
    distance.same_place,
    motion.moving,
    motion.stationary,
    motion.speed_above,
    motion.speed_below,
    relation.moving_towards,
    relation.moving_away,
    relation.following,
    relation.facing,
    turning.turning_left,
    turning.turning_right,
    turning.u_turning,
    turning.reversing,
    visibility.appears,
    visibility.appears_from,
    visibility.disappears,
    visibility.disappears_into,
    place.inside,
    place.crosses,
    posture.stooping,
    body.arm_moving_up,
    body.arm_moving_down,
)
_SUMMARIES = {
    "near": "a and b are within tau_m of one another",
    "far": "a and b are further than tau_m from one another",
    "same_place": "a and b stand in one place, perhaps at different times",
    "moving": "a moves",
    "stationary": "a stands",
    "speed_above": "a is faster than speed_mps",
    "speed_below": "a is slower than speed_mps",
    "moving_towards": "a moves towards b",
    "moving_away": "a moves away from b",
    "following": "a moves behind b, the same way",
    "facing": "a faces b; with side, a stands at that side of the vehicle b",
    "turning_left": "a's direction of motion turns left",
    "turning_right": "a's direction of motion turns right",
    "u_turning": "a turns round",
    "reversing": "the vehicle a moves backwards",
    "appears": "a comes into view inside the picture, from behind nothing",
    "appears_from": "a comes into view within b's outline, from behind nothing else",
    "disappears": "a is gone from view inside the picture, behind nothing",
    "disappears_into": "a is gone from view within b's outline, behind nothing else",
    "inside": "a stands in the zone",
    "crosses": "a crosses the line",
    "stooping": "a is seen less tall than share of its standing height",
    "arm_moving_up": "a raises an arm",
    "arm_moving_down": "a lowers an arm",
}


def _predicate(function: _Function) -> Predicate:
    signature = inspect.signature(function).parameters.values()
    roles = [p for p in signature if p.kind is p.POSITIONAL_OR_KEYWORD]
    parameters = {}
    for p in signature:
        if p.kind is p.KEYWORD_ONLY:
            unit, low, high = _RANGE[p.name]
            default = None if p.default is p.empty else p.default
            parameters[p.name] = Parameter(p.name, default, unit, low, high)
    name = function.__name__
    return Predicate(name, len(roles), MappingProxyType(parameters), function, _SUMMARIES[name])


PREDICATES: Mapping[str, Predicate] = MappingProxyType(
    {function.__name__: _predicate(function) for function in _FUNCTIONS}
)
"""Every predicate that activities may use."""
