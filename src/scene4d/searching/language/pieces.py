"""Parts of an activity while it is put together: states and events, at once or in order."""

from collections.abc import Mapping
from dataclasses import dataclass, replace

from scene4d.searching.activities.definition import Phase, Relation, Term
from scene4d.searching.activities.terms import term_text

_INFINITE = float("inf")


@dataclass(frozen=True)
class Piece:
    """Phases in their order. A state is one phase whose terms may be joined with others; an event
    is as it is. ``least_s`` and ``most_s`` are what was said of a state's duration, and
    ``is_instant`` that it has none.
    """

    phases: tuple[Phase, ...]
    is_event: bool
    name: str
    relations: tuple[Relation, ...] = ()
    least_s: float | None = None
    most_s: float | None = None
    is_instant: bool = False

    @property
    def label(self) -> str:
        """What it says, for a reader."""
        return self.name if self.is_event else ", ".join(map(term_text, self.terms))

    @property
    def is_timed(self) -> bool:
        """Whether its duration was said."""
        return self.least_s is not None or self.most_s is not None

    @property
    def terms(self) -> tuple[Term, ...]:
        """All terms of a state."""
        return self.phases[0].terms


def state(
    terms: tuple[Term, ...],
    assumed: Mapping[str, float],
    *,
    least_s: float | None = None,
    most_s: float | None = None,
    is_instant: bool = False,
) -> Piece:
    """Terms that hold together, for as long as was said, else as is assumed."""
    terms = distinct(terms)
    least = assumed["instant_min_s" if is_instant else "state_min_s"]
    most = assumed["instant_max_s"] if is_instant else _INFINITE
    if least_s is not None:
        least = least_s
    elif most_s is not None:
        least = min(least, most_s)
    most = most if most_s is None else most_s
    name = ("not " if terms[0].negated else "") + terms[0].predicate.replace("_", " ")
    phase = Phase(name, terms, least, max(least, most))
    return Piece((phase,), False, name, (), least_s, most_s, is_instant)


def distinct(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Each term once."""
    found: list[Term] = []
    for term in terms:
        if term not in found:
            found.append(term)
    return tuple(found)


def in_order(first: Piece, second: Piece, pause_s: float) -> Piece:
    """One, then the other after a pause of at most ``pause_s``."""
    second = _renamed(second, {phase.name for phase in first.phases})
    opening = replace(second.phases[0], gap_s=pause_s)
    return Piece(
        (*first.phases, opening, *second.phases[1:]),
        True,
        f"{first.name}, then {second.name}",
        (*first.relations, *second.relations),
    )


def _renamed(piece: Piece, taken: set[str]) -> Piece:
    """With names of phases that are not taken."""
    names: dict[str, str] = {}
    for phase in piece.phases:
        name, number = phase.name, 2
        while name in taken or name in names.values():
            name, number = f"{phase.name} {number}", number + 1
        names[phase.name] = name
    return replace(
        piece,
        phases=tuple(replace(phase, name=names[phase.name]) for phase in piece.phases),
        relations=tuple(
            Relation(names[r.first], r.relation, names[r.second]) for r in piece.relations
        ),
    )


def throughout(event: Piece, terms: tuple[Term, ...]) -> Piece:
    """An event during all of which these terms hold."""
    phases = tuple(replace(phase, terms=distinct((*phase.terms, *terms))) for phase in event.phases)
    return replace(event, phases=phases)


def during(event: Piece, lasting: Piece) -> Piece:
    """An event within a state that lasts on its own."""
    lasting = _renamed(lasting, {phase.name for phase in event.phases})
    name = lasting.phases[0].name
    relations = tuple(Relation(phase.name, "during", name) for phase in event.phases)
    return Piece(
        (*event.phases, *lasting.phases),
        True,
        f"{event.name} while {lasting.name}",
        (*event.relations, *relations),
    )
