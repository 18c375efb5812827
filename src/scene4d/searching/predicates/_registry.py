"""All predicates by name, with their parameters: what activities and words refer to."""

import inspect
from collections.abc import Callable, Mapping
from dataclasses import dataclass
from types import MappingProxyType
from typing import Any, Literal

import numpy as np

from scene4d.searching.predicates._beside import beside
from scene4d.searching.predicates._body import arm_moving_down, arm_moving_up
from scene4d.searching.predicates._crowd import alone, crowded
from scene4d.searching.predicates._distance import between, far, near, same_place
from scene4d.searching.predicates._entrances import at_entrance
from scene4d.searching.predicates._looks import coloured, longer_than, taller_than
from scene4d.searching.predicates._motion import (
    arrived,
    departs,
    moving,
    present,
    speed_above,
    speed_below,
    stationary,
    staying,
)
from scene4d.searching.predicates._posture import stooping
from scene4d.searching.predicates._relation import (
    facing,
    following,
    moving_away,
    moving_towards,
    together,
)
from scene4d.searching.predicates._spots import near_spot
from scene4d.searching.predicates._turning import reversing, turning_left, turning_right, u_turning
from scene4d.searching.predicates._visibility import (
    appears,
    appears_from,
    disappears,
    disappears_into,
)
from scene4d.searching.predicates._zones import crosses, inside, near_zone

_Function = Callable[..., np.ndarray]


@dataclass(frozen=True)
class Parameter:
    """A number in ``unit`` ("m", "s", "m/s", "rad", "" for a share or a count) from ``low`` to
    ``high``, or the name of a "zone", a "line", a "spot", a "side" of a vehicle, a "colour" or a
    "part" of a body. ``default`` is
    None where it must be given (zones, lines, spots, colours) or may be left out (sides, parts).
    """

    name: str
    default: float | str | None
    unit: str
    low: float = 0.0
    high: float = float("inf")

    @property
    def required(self) -> bool:
        """Whether there is no predicate without it."""
        return self.unit in ("zone", "line", "spot", "colour")


@dataclass(frozen=True)
class Predicate:
    """``function(a, **parameters)``, or with b, or b and c, of :class:`StageRows`: a
    probability per row, NaN where it cannot be judged.

    ``reads`` are the groups of columns (:data:`.schema.GROUPS`) that it looks at beside times and
    positions: they are read from a scene only where a predicate needs them. ``holds`` says where a
    predicate of two roles may hold: "within" the distance ``tau_m`` (± ``sigma_m``), or "beyond"
    it, or None for any distance; ``tau_m`` may count from an outline, up to ``outline_m`` from the
    middle. In a ``symmetric`` one the roles may be swapped.
    """

    name: str
    arity: int
    parameters: Mapping[str, Parameter]
    function: _Function
    reads: frozenset[str] = frozenset()
    holds: Literal["within", "beyond"] | None = None
    symmetric: bool = False
    outline_m: float = 0.0


_RANGES: dict[str, tuple[str, float, float]] = {
    "tau_m": ("m", 0.0, 1e4),
    "sigma_m": ("m", 0.01, 1e3),
    "radius_m": ("m", 0.1, 1e3),
    "length_m": ("m", 0.1, 100.0),
    "height_m": ("m", 0.1, 20.0),
    "speed_mps": ("m/s", 0.0, 100.0),
    "sigma_mps": ("m/s", 0.01, 50.0),
    "angle_rad": ("rad", 0.0, np.pi),
    "sigma_rad": ("rad", 0.001, np.pi),
    "window_s": ("s", 0.05, 600.0),
    "sigma_s": ("s", 0.01, 600.0),
    "share": ("", 0.0, 1.0),
    "count": ("", 2.0, 1e3),
}
"""Unit and range of a number follow from its name. Ranges only keep out what cannot be meant."""
NAMED = ("zone", "line", "spot", "side", "colour", "part")
"""Parameters that are names, and no numbers."""


def _predicate(function: _Function, *reads: str, **facts: Any) -> Predicate:
    """A predicate with the parameters of its function's signature, and what it reads."""
    signature = inspect.signature(function).parameters.values()
    arity = sum(p.kind is p.POSITIONAL_OR_KEYWORD for p in signature)
    parameters = {}
    for p in signature:
        if p.kind is p.KEYWORD_ONLY:
            unit, low, high = (p.name, 0.0, np.inf) if p.name in NAMED else _RANGES[p.name]
            default = None if p.default is p.empty else p.default
            parameters[p.name] = Parameter(p.name, default, unit, low, high)
    return Predicate(
        function.__name__, arity, MappingProxyType(parameters), function, frozenset(reads), **facts
    )


_ALL = (
    _predicate(near, holds="within", symmetric=True),
    _predicate(far, holds="beyond", symmetric=True),
    _predicate(same_place, holds="within", symmetric=True),
    _predicate(beside, "heading", "size", holds="within", outline_m=8.0),
    _predicate(between),
    _predicate(near_spot),
    _predicate(alone),
    _predicate(present),
    _predicate(moving, "velocity"),
    _predicate(stationary, "velocity"),
    _predicate(staying),
    _predicate(arrived),
    _predicate(departs),
    _predicate(speed_above, "velocity"),
    _predicate(speed_below, "velocity"),
    _predicate(moving_towards, "velocity"),
    _predicate(moving_away, "velocity"),
    _predicate(following, "velocity", holds="within"),
    _predicate(together, "velocity", holds="within", symmetric=True),
    _predicate(facing, "heading", "size"),
    _predicate(turning_left, "velocity"),
    _predicate(turning_right, "velocity"),
    _predicate(u_turning, "velocity"),
    _predicate(reversing, "velocity", "heading"),
    _predicate(appears, "box"),
    _predicate(appears_from, "box", "size"),
    _predicate(disappears, "box"),
    _predicate(disappears_into, "box", "size"),
    _predicate(at_entrance, "box"),
    _predicate(inside),
    _predicate(near_zone),
    _predicate(crosses, "velocity"),
    _predicate(stooping, "box"),
    _predicate(longer_than, "size"),
    _predicate(taller_than, "size"),
    _predicate(coloured, "colours"),
    _predicate(crowded),
    _predicate(arm_moving_up, "keypoint"),
    _predicate(arm_moving_down, "keypoint"),
)
PREDICATES: Mapping[str, Predicate] = {one.name: one for one in _ALL}
"""Every predicate that activities may use."""
