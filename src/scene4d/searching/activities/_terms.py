"""Terms: predicates with roles and parameters, read from text, written as text, and checked."""

import math
import re
from collections.abc import Iterable

from scene4d.core.colours import NAMES, PALETTE, PARTS, SHADES, is_colour
from scene4d.core.errors import InputError
from scene4d.core.text import nearest
from scene4d.searching.activities.definition import Term
from scene4d.searching.predicates._registry import NAMED, PREDICATES, Parameter, Predicate
from scene4d.searching.predicates._relation import SIDES

_LAG = "lag_s"
"""Parameter of any term: its last role is looked at so much earlier; infinite: any time before."""

_NAME = r"[A-Za-z_][\w-]*"
_TERM = re.compile(rf"\s*(not\s+)?({_NAME})\s*\(([^()]*)\)\s*$")
_NUMBER = re.compile(r"([+-]?(?:\d+\.?\d*|\.\d+)(?:[eE][+-]?\d+)?|\.?inf)\s*([a-z/°]*)$")
# What a number may be followed by, and its size in metres, seconds and radians.
_UNITS = {
    "": (None, 1.0),
    "m": ("m", 1.0),
    "s": ("s", 1.0),
    "min": ("s", 60.0),
    "m/s": ("m/s", 1.0),
    "km/h": ("m/s", 1 / 3.6),
    "rad": ("rad", 1.0),
    "deg": ("rad", math.pi / 180),
    "°": ("rad", math.pi / 180),
    "m/s²": ("m/s²", 1.0),
    "rad/s": ("rad/s", 1.0),
    "deg/s": ("rad/s", math.pi / 180),
}

_NAMES = {"side": SIDES, "part": PARTS, "colour": (*NAMES, *SHADES, *PALETTE)}
"""What there is of that which is not named in a scene."""


def parse_term(text: str) -> Term:
    """``not near(person, vehicle, tau_m=3)`` as a :class:`Term`; numbers may have a unit.

    Units are m, s, min, m/s, km/h, rad, deg, rad/s, deg/s. Raises :class:`InputError` for what is
    no term and for a unit that the parameter does not have.
    """
    found = _TERM.match(text)
    if found is None:
        raise InputError(f"{text!r} is not a term; expected predicate(role, ..., parameter=value)")
    negated, name, inside = found.groups()
    predicate = _known(name)
    roles: list[str] = []
    parameters: dict[str, float | str] = {}
    for part in filter(None, (piece.strip() for piece in inside.split(","))):
        key, equals, value = (piece.strip() for piece in part.partition("="))
        if not equals:
            if parameters:
                raise InputError(f"{text!r}: the role {part!r} comes after a parameter")
            roles.append(part)
        elif key in parameters:
            raise InputError(f"{text!r}: {key} is given twice")
        else:
            unit = "s" if key == _LAG else _parameter(key, predicate).unit
            parameters[key] = _value(f"{name}: {key}", value, unit)
    return Term(name, tuple(roles), parameters, bool(negated))


def term_text(term: Term) -> str:
    """The term as :func:`parse_term` reads it."""
    given = [f"{key}={_number(value)}" for key, value in term.parameters.items()]
    negation = "not " if term.negated else ""
    return f"{negation}{term.predicate}({', '.join([*term.roles, *given])})"


def check_term(term: Term, roles: Iterable[str]) -> None:
    """Raise :class:`InputError` for an unknown predicate, role or parameter, a wrong number of
    roles, and a value outside its range or of the wrong kind.
    """
    predicate = _known(term.predicate)
    if len(term.roles) != predicate.arity:
        raise InputError(
            f"{term.predicate}: {len(term.roles)} roles, expected {predicate.arity}: "
            f"{term_text(term)}"
        )
    known = tuple(roles)
    for role in term.roles:
        if role not in known:
            raise InputError(f"{term.predicate}: no role {role!r}{nearest(role, known)}")
    if len(set(term.roles)) < len(term.roles):
        raise InputError(f"{term.predicate}: the role {term.roles[0]!r} occurs twice")
    for key, value in term.parameters.items():
        if key == _LAG:
            if isinstance(value, str) or not value >= 0:
                raise InputError(f"{term.predicate}: {_LAG} must not be negative, found {value!r}")
        else:
            _check_value(term.predicate, key, value, _parameter(key, predicate))
    for key, parameter in predicate.parameters.items():
        if parameter.required and key not in term.parameters:
            raise InputError(f"{term.predicate}: the parameter {key} is missing")


def lag_of(term: Term) -> float:
    """How much earlier the last role is looked at, seconds."""
    return float(term.parameters.get(_LAG, 0.0))


def value_of(term: Term, name: str) -> float:
    """A numeric parameter as given, or its default."""
    given = term.parameters.get(name)
    default = PREDICATES[term.predicate].parameters[name].default
    return float(given if given is not None else default)  # type: ignore[arg-type]


def arguments(term: Term) -> dict[str, float | str]:
    """What is given to the predicate's function."""
    return {key: value for key, value in term.parameters.items() if key != _LAG}


def places_of(terms: Iterable[Term], kind: str) -> tuple[str, ...]:
    """Names of the zones, lines or spots (``kind`` "zone", "line", "spot") of the terms."""
    names = [
        str(term.parameters[key])
        for term in terms
        for key, parameter in PREDICATES[term.predicate].parameters.items()
        if parameter.unit == kind and isinstance(term.parameters.get(key), str)
    ]
    return tuple(dict.fromkeys(names))


def _known(name: str) -> Predicate:
    if name not in PREDICATES:
        raise InputError(f"no predicate {name!r}{nearest(name, PREDICATES)}")
    return PREDICATES[name]


def _parameter(key: str, predicate: Predicate) -> Parameter:
    if key not in predicate.parameters:
        known = [*predicate.parameters, _LAG]
        raise InputError(f"{predicate.name}: no parameter {key!r}{nearest(key, known)}")
    return predicate.parameters[key]


def _value(what: str, text: str, unit: str) -> float | str:
    found = _NUMBER.match(text)
    if found is None:
        return text
    kind, size = _UNITS.get(found[2], ("?", 1.0))
    if kind not in (None, unit):
        raise InputError(f"{what} is measured in {unit}, found {text!r}")
    return float(found[1].lstrip(".") if "inf" in found[1] else found[1]) * size


def _check_value(predicate: str, key: str, value: float | str, parameter: Parameter) -> None:
    unit, named = parameter.unit, parameter.unit in NAMED
    if named != isinstance(value, str):
        kind = f"the name of a {unit}" if named else f"a number of {unit}"
        raise InputError(f"{predicate}: {key} must be {kind}, found {value!r}")
    if isinstance(value, str):
        known = _NAMES.get(unit, ())
        if known and not (is_colour(value) if unit == "colour" else value in known):
            raise InputError(f"{predicate}: no {unit} {value!r}{nearest(value, known)}")
    elif not parameter.low <= value <= parameter.high:
        raise InputError(
            f"{predicate}: {key} must lie between {parameter.low:g} and {parameter.high:g}, "
            f"found {value}"
        )


def _number(value: float | str) -> str:
    """Shortest text that reads back as the same."""
    return value if isinstance(value, str) else repr(float(value)).removesuffix(".0")
