"""Clauses with a state (predicates that hold together), and the pieces of an activity."""

from collections.abc import Sequence
from dataclasses import dataclass, replace

from scene4d.searching.activities._terms import term_text
from scene4d.searching.activities.definition import Phase, Relation, Term
from scene4d.searching.language._discourse import Discourse, adjective_terms
from scene4d.searching.language._sentences import Bound, Clause, Lasting, Noun, Pair, Said

_DISTANCE = "tau_m"
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
    terms: tuple[Term, ...], lasting: Lasting, is_instant: bool, discourse: Discourse
) -> Piece:
    """Terms that hold together, for the given duration, or else the assumed one."""
    terms = distinct(terms)
    least = discourse.assumed("instant_min_s" if is_instant else "state_min_s")
    most = discourse.assumed("instant_max_s") if is_instant else _INFINITE
    if lasting.least is not None:
        least = lasting.least
    elif lasting.most is not None:
        least = min(least, lasting.most)
    most = most if lasting.most is None else lasting.most
    name = ("not " if terms[0].negated else "") + terms[0].predicate.replace("_", " ")
    phase = Phase(name, terms, least, max(least, most))
    return Piece((phase,), False, name, (), lasting.least, lasting.most, is_instant)


def distinct(terms: tuple[Term, ...]) -> tuple[Term, ...]:
    """Each term once."""
    found: list[Term] = []
    for term in terms:
        if term not in found:
            found.append(term)
    return tuple(found)


def in_order(first: Piece, second: Piece, pause_s: float) -> Piece:
    """One piece, then the other after a pause of at most ``pause_s``."""
    second = _renamed(second, {phase.name for phase in first.phases})
    opening = replace(second.phases[0], gap_s=pause_s)
    phases = (*first.phases, opening, *second.phases[1:])
    relations = (*first.relations, *second.relations)
    return Piece(phases, True, f"{first.name}, then {second.name}", relations)


def throughout(event: Piece, terms: tuple[Term, ...]) -> Piece:
    """An event with these terms holding throughout."""
    phases = tuple(replace(phase, terms=distinct((*phase.terms, *terms))) for phase in event.phases)
    return replace(event, phases=phases)


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
    return replace(
        piece,
        phases=tuple(replace(phase, name=names[phase.name]) for phase in piece.phases),
        relations=tuple(
            Relation(names[r.first], r.relation, names[r.second]) for r in piece.relations
        ),
    )


# A state ------------------------------------------------------------------------------------------


def state_of(clause: Clause, core: Said, discourse: Discourse) -> Piece:
    """A clause with a state. Raises :class:`InputError` if it is not possible."""
    subjects, terms = _subjects(clause, discourse)
    said = _simplified(clause, core, discourse)
    of_core: tuple[Term, ...] = ()
    for number, one in enumerate(said):
        more = _of_all(one, subjects, discourse)
        terms += more
        of_core = of_core or (more[:1] if number == 0 else ())
    for bound in clause.modifiers:
        if isinstance(bound, Bound):
            terms = with_distance(terms, bound, discourse)
    lasting = duration(clause, discourse)
    discourse.subject = subjects
    if said[0].entry.becomes:
        return _change(of_core[0], terms, lasting, discourse)
    return state(terms, lasting, any(one.entry.instant for one in said), discourse)


def nouns_of(subject: Noun | Pair | None) -> tuple[Noun, ...]:
    """The subjects: none, one or two."""
    if isinstance(subject, Pair):
        return subject.first, subject.second
    return () if subject is None else (subject,)


def _subjects(clause: Clause, discourse: Discourse) -> tuple[tuple[str, ...], tuple[Term, ...]]:
    """Names of those whom a clause is about, those of the clause before where none is named, and
    what their nouns say of them.
    """
    nouns = nouns_of(clause.subject)
    if not nouns:
        return known_subject(clause, discourse), ()
    names: tuple[str, ...] = ()
    terms: tuple[Term, ...] = ()
    for noun in nouns:
        names = (*names, discourse.name_of(noun, names))
        terms += noun_terms(noun, names[-1], discourse)
    return names, terms


def known_subject(clause: Clause, discourse: Discourse) -> tuple[str, ...]:
    """The subject of the clause before."""
    if not discourse.subject:
        raise discourse.refuse(clause.span, "who? Say a person or a vehicle first")
    return discourse.subject


def noun_terms(
    noun: Noun, name: str, discourse: Discourse, besides: Sequence[str] = ()
) -> tuple[Term, ...]:
    """The terms of a noun: its adjectives, and "that is ..."."""
    terms = adjective_terms(noun, name, besides)
    for relative in noun.relatives:
        terms += terms_of(relative, name, discourse)
    return terms


def terms_of(said: Said, subject: str, discourse: Discourse) -> tuple[Term, ...]:
    """The statements about a subject, as terms."""
    entry = said.entry
    if entry.subject not in ("", discourse.people[subject].kind):
        words = discourse.said(said.span)
        raise discourse.refuse(said.span, f'"{words}" is said of a {entry.subject} only')
    parameters = {**entry.fixed, **said.values}
    names = [subject]
    more: tuple[Term, ...] = ()
    for noun in said.nouns:
        names.append(discourse.name_of(noun, names))
        more += noun_terms(noun, names[-1], discourse)
    if entry.of_object:
        more += (Term(entry.of_object, (names[-1],), parameters),)
    return (Term(entry.predicate, tuple(names), parameters, said.is_negated), *more)


def _of_all(said: Said, subjects: tuple[str, ...], discourse: Discourse) -> tuple[Term, ...]:
    """The statements about every subject; for two also their relation."""
    if len(subjects) == 2 and any(noun.article == "reciprocal" for noun in said.nouns):
        is_symmetric = said.entry.predicate in ("near", "far")
        parameters = {**said.entry.fixed, **said.values}
        return tuple(
            Term(said.entry.predicate, pair, parameters, said.is_negated)
            for pair in (subjects, subjects[::-1])[: 1 if is_symmetric else 2]
        )
    before = len(discourse.people)
    terms = terms_of(said, subjects[0], discourse)
    for subject in subjects[1:]:
        objects = list(discourse.people)[before:]
        ((_, more, known),) = discourse.trying(
            [subject], lambda one, known: terms_of(said, one, known)
        )
        new = list(known.people)[len(discourse.people) :]
        if new:  # the object of the first subject is that of the second too
            same = dict(zip(new, objects, strict=False))
            more = tuple(replace(t, roles=tuple(same.get(r, r) for r in t.roles)) for t in more)
        else:
            discourse.adopt(known)
        terms += more
    return terms


def _simplified(clause: Clause, core: Said, discourse: Discourse) -> list[Said]:
    """The core and the relations after it; "moves towards" is one statement, not two."""
    relations = [part for part in clause.modifiers if isinstance(part, Said)]
    denied = clause.polarity.is_denied
    stronger = next((r for r in relations if core.entry.predicate in r.entry.replaces), None)
    if stronger is not None and not core.entry.negated:
        core = stronger
        relations = [r for r in relations if r != stronger]
    said = [replace(core, is_denied=core.is_denied != denied), *relations]
    if denied and relations:
        words, rest = discourse.said(core.span), discourse.said(relations[0].span)
        discourse.note(f'"not" denies "{words}" alone; to deny the rest say "not {rest}"')
    return said


def duration(clause: Clause, discourse: Discourse) -> Lasting:
    """The duration that a clause gives. Raises :class:`InputError` for an impossible one."""
    parts = [part for part in clause.modifiers if isinstance(part, Lasting)]
    return shortest_of(parts, parts[0].span if parts else clause.span, discourse)


def shortest_of(parts: Sequence[Lasting], span: tuple[int, int], discourse: Discourse) -> Lasting:
    """The duration that all parts allow. Raises :class:`InputError` if they contradict."""
    least = max((p.least for p in parts if p.least is not None), default=None)
    most = min((p.most for p in parts if p.most is not None), default=None)
    if least is not None and most is not None and least > most:
        raise discourse.refuse(
            span, f"impossible duration: at least {least:g} s and at most {most:g} s"
        )
    return Lasting(least, most, span)


def _change(stated: Term, terms: tuple[Term, ...], lasting: Lasting, discourse: Discourse) -> Piece:
    """First the statement does not hold, then it does."""
    least, most = discourse.assumed("change_min_s"), discourse.assumed("change_max_s")
    names = [f"not {stated.predicate}", stated.predicate]
    before, after = names[::-1] if stated.negated else names
    opposite = Phase(before, (replace(stated, negated=not stated.negated),), least, most)
    changed = Phase(after, (stated,), least, most)
    if lasting.least is not None or lasting.most is not None:
        longest = _INFINITE if lasting.most is None else lasting.most
        changed = replace(changed, min_s=lasting.least or min(least, longest), max_s=longest)
    change = Piece((opposite, changed), True, "leaves" if stated.negated else "enters")
    return throughout(change, tuple(term for term in terms if term != stated))


def with_distance(terms: tuple[Term, ...], bound: Bound, discourse: Discourse) -> tuple[Term, ...]:
    """Terms that say how near, or how far, with this distance. Raises :class:`InputError` where
    none does.
    """
    if not any(term.predicate == bound.predicate for term in terms):
        said = discourse.said(bound.span)
        raise discourse.refuse(bound.span, f'"{said}" of whom? Say "{said} of a vehicle"')
    return tuple(
        replace(term, parameters={**term.parameters, _DISTANCE: bound.metres})
        if term.predicate == bound.predicate
        else term
        for term in terms
    )
