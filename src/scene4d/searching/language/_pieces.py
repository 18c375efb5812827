"""The pieces of an activity, and how they are put together."""

from collections.abc import Callable, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any, TypeVar

from scene4d.searching.activities._terms import term_text
from scene4d.searching.activities.definition import Phase, Relation, Term
from scene4d.searching.language._discourse import Discourse
from scene4d.searching.language._sentences import Clause, Delay, Lasting

_INFINITE = float("inf")
_Option = TypeVar("_Option")


@dataclass(frozen=True)
class Piece:
    """Phases in their order. A state is one phase whose terms may be joined with others; an event
    is as it is. ``least_s`` and ``most_s`` are what was said of a state's duration, and
    ``is_instant`` that it has none. ``is_motion``: the state is somebody's moving, which ends where
    something else is done. ``begins``: its first phase only says that it was not so before.
    ``delay`` is how soon it comes after what was said before.
    """

    phases: tuple[Phase, ...]
    is_event: bool
    name: str
    relations: tuple[Relation, ...] = ()
    least_s: float | None = None
    most_s: float | None = None
    is_instant: bool = False
    is_motion: bool = False
    begins: bool = False
    delay: Delay | None = None

    @property
    def label(self) -> str:
        """The piece in words."""
        return self.name if self.is_event else ", ".join(map(term_text, self.terms))

    @property
    def is_timed(self) -> bool:
        """Whether its duration was given."""
        return self.least_s is not None or self.most_s is not None

    @property
    def terms(self) -> tuple[Term, ...]:
        """All terms of a state."""
        return self.phases[0].terms


def state(
    terms: tuple[Term, ...],
    lasting: Lasting,
    is_instant: bool,
    discourse: Discourse,
    usual_s: float | None = None,
) -> Piece:
    """Terms that hold together, for the given duration, or else the usual or the assumed one."""
    terms = distinct(terms)
    least = usual_s or discourse.assumed("instant_min_s" if is_instant else "state_min_s")
    most = discourse.assumed("instant_max_s") if is_instant else _INFINITE
    least, most = lasting.within(least, most)
    name = ("not " if terms[0].negated else "") + terms[0].predicate.replace("_", " ")
    phase = Phase(name, terms, least, max(least, most))
    return Piece((phase,), False, name, (), lasting.least, lasting.most, is_instant)


def choose(
    options: Iterable[_Option],
    read: Callable[[_Option, Discourse], Piece],
    discourse: Discourse,
    what: str,
    rank: Callable[[_Option, Discourse], Any] = lambda *_: 0,
) -> Piece:
    """What the likeliest reading means; a note says of ``what``, and what else it could be."""
    found = sorted(discourse.trying(options, read), key=lambda one: rank(one[0], one[2]))
    _, piece, known = found[0]
    discourse.adopt(known)
    others = sorted({f'"{other.label}"' for _, other, _ in found} - {f'"{piece.label}"'})
    if others:
        discourse.note(f'{what} is taken as "{piece.label}"; it could be {", ".join(others)}')
    return piece


def distinct(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Each term once."""
    return tuple(term for at, term in enumerate(terms) if term not in terms[:at])


def in_order(first: Piece, second: Piece, pause_s: float) -> Piece:
    """One piece, then the other after a pause of at most ``pause_s``.

    Of who walks and then begins to run it need not be said that he did not run before.
    """
    if second.begins and not first.is_event:
        second = replace(second, phases=second.phases[1:])
    second = _renamed(second, {phase.name for phase in first.phases})
    opening = replace(second.phases[0], gap_s=pause_s)
    phases = (*first.phases, opening, *second.phases[1:])
    relations = (*first.relations, *second.relations)
    name = f"{first.name}, then {second.name}"
    return Piece(phases, True, name, relations, delay=first.delay)


def with_terms(phase: Phase, terms: tuple[Term, ...]) -> Phase:
    """A phase in which these hold, too."""
    return replace(phase, terms=distinct((*phase.terms, *terms)))


def throughout(event: Piece, terms: tuple[Term, ...]) -> Piece:
    """An event with these terms holding throughout."""
    return replace(event, phases=tuple(with_terms(phase, terms) for phase in event.phases))


def during(event: Piece, lasting: Piece) -> Piece:
    """An event within a state that has its own duration."""
    lasting = _renamed(lasting, {phase.name for phase in event.phases})
    name = lasting.phases[0].name
    relations = tuple(Relation(phase.name, "during", name) for phase in event.phases)
    phases = (*event.phases, *lasting.phases)
    return Piece(phases, True, f"{event.name} while {lasting.name}", event.relations + relations)


def _renamed(piece: Piece, taken: set[str]) -> Piece:
    """A copy with phase names that are not taken."""
    names: dict[str, str] = {}
    for phase in piece.phases:
        name, number = phase.name, 2
        while name in taken or name in names.values():
            name, number = f"{phase.name} {number}", number + 1
        names[phase.name] = name
    phases = tuple(replace(phase, name=names[phase.name]) for phase in piece.phases)
    of = piece.relations
    relations = tuple(Relation(names[r.first], r.relation, names[r.second]) for r in of)
    return replace(piece, phases=phases, relations=relations)


def duration(clause: Clause, discourse: Discourse) -> Lasting:
    """The duration that a clause gives. Raises :class:`InputError` for an impossible one."""
    parts = clause.parts(Lasting)
    return shortest_of(parts, parts[0].span if parts else clause.span, discourse)


def shortest_of(parts: Sequence[Lasting], span: tuple[int, int], discourse: Discourse) -> Lasting:
    """The duration that all parts allow. Raises :class:`InputError` if they contradict."""
    least = max((p.least for p in parts if p.least is not None), default=None)
    most = min((p.most for p in parts if p.most is not None), default=None)
    if least is not None and most is not None and least > most:
        what = f"impossible duration: at least {least:g} s and at most {most:g} s"
        raise discourse.refuse(span, what)
    return Lasting(least, most, span)


# What excludes what ------------------------------------------------------------------------------

_MOVES = (
    *("moving", "moving_towards", "moving_away", "following", "reversing"),
    *("turning_left", "turning_right"),
)
_OPPOSITE = {"moving": "stationary", "stationary": "moving"}
_APART = ({"moving_towards", "moving_away"}, {"turning_left", "turning_right"})


def exclude(one: Term, other: Term) -> bool:
    """Whether two statements never hold at the same time: who stands does not run."""
    said, also = ((t.predicate, t.roles, t.parameters) for t in (one, other))
    if said == also:
        return one.negated != other.negated
    if one.roles == other.roles and {one.predicate, other.predicate} in _APART:
        return not one.negated and not other.negated
    if one.predicate == other.predicate == "coloured":
        return one.roles == other.roles and _differ_in_colour(one, other)
    (low, high), (least, most) = _speeds(one), _speeds(other)
    return one.roles[0] == other.roles[0] and (low >= most or least >= high)


def _differ_in_colour(one: Term, other: Term) -> bool:
    """Whether one part cannot have both colours; what is dark may be blue, or black."""
    colours = {str(term.parameters["colour"]).split()[-1] for term in (one, other)}
    is_same_part = one.parameters.get("part") == other.parameters.get("part")
    are_affirmed = not one.negated and not other.negated
    return are_affirmed and is_same_part and len(colours - {"dark", "light"}) > 1


def _speeds(term: Term) -> tuple[float, float]:
    """From which speed and below which one a statement holds, m/s; any where it says none."""
    predicate = _OPPOSITE.get(term.predicate, "") if term.negated else term.predicate
    if predicate in _MOVES:
        return 0.0, _INFINITE
    speed = float(term.parameters.get("speed_mps", 0.0))
    if predicate == "speed_above":
        return speed, _INFINITE
    return -1.0, {"stationary": 0.0, "speed_below": speed}.get(predicate, _INFINITE)


# Phases of an activity ---------------------------------------------------------------------------


def with_names(phase: Phase, names: Mapping[str, str]) -> Phase:
    """The phase with other names for its roles."""
    terms = tuple(
        replace(term, roles=tuple(names[role] for role in term.roles)) for term in phase.terms
    )
    return replace(phase, terms=terms)


def with_parameter(phases: tuple[Phase, ...], key: str, value: float | str) -> tuple[Phase, ...]:
    """With another value where the parameter is given."""

    def changed(term: Term) -> Term:
        given = term.parameters
        return replace(term, parameters={**given, key: value}) if key in given else term

    return tuple(replace(p, terms=tuple(map(changed, p.terms))) for p in phases)


def with_first(phases: tuple[Phase, ...], terms: tuple[Term, ...], role: str) -> tuple[Phase, ...]:
    """These hold in the role's first phase: the parked vehicle that starts was parked."""
    first = next((n for n, phase in enumerate(phases) if speaks_of(phase, role)), 0)
    return (*phases[:first], with_terms(phases[first], terms), *phases[first + 1 :])


def speaks_of(phase: Phase, role: str) -> bool:
    """Whether the role occurs in the phase."""
    return any(role in term.roles for term in phase.terms)
