"""Clauses that say a state: predicates that hold together."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from scene4d.searching.activities.definition import Phase, Term
from scene4d.searching.language.naming import adjective_terms, bound, nouns_of
from scene4d.searching.language.pieces import Piece, state, throughout
from scene4d.searching.language.referents import Discourse
from scene4d.searching.language.sentences import Bound, Clause, Lasting, Noun, Said
from scene4d.searching.language.words import refuse

_DISTANCE = "tau_m"


@dataclass(frozen=True)
class Saying:
    """Reads clauses whose core is a state of the lexicon."""

    text: str
    assumed: Mapping[str, float]

    def read(self, clause: Clause, core: Said, discourse: Discourse) -> tuple[Piece, Discourse]:
        """The state as a piece. Raises :class:`InputError` where it cannot be said so."""
        subjects, terms, discourse = self.subjects(clause, discourse)
        said, note = self._simplified(clause, core)
        discourse = discourse.noted(note) if note else discourse
        of_core: tuple[Term, ...] = ()
        for number, one in enumerate(said):
            more, discourse = self._of_all(one, subjects, discourse)
            terms += more
            of_core = of_core or (more[:1] if number == 0 else ())
        terms = self._with_bounds(terms, [m for m in clause.modifiers if isinstance(m, Bound)])
        lasting = self.lasting([m for m in clause.modifiers if isinstance(m, Lasting)])
        discourse = replace(discourse, subject=subjects)
        if said[0].entry.becomes:
            return self._change(of_core, terms, lasting), discourse
        is_instant = any(one.entry.instant for one in said)
        piece = state(
            terms, self.assumed, least_s=lasting.least, most_s=lasting.most, is_instant=is_instant
        )
        return piece, discourse

    def subjects(
        self, clause: Clause, discourse: Discourse
    ) -> tuple[tuple[str, ...], tuple[Term, ...], Discourse]:
        """Names of those whom a clause is about, those of the clause before where none is named,
        and what their nouns say of them.
        """
        nouns = nouns_of(clause.subject)
        if not nouns:
            if not discourse.subject:
                raise refuse(self.text, clause.span[0], "who? Say a person or a vehicle first")
            return discourse.subject, (), discourse
        names: tuple[str, ...] = ()
        terms: tuple[Term, ...] = ()
        for noun in nouns:
            name, discourse = bound(noun, discourse, names)
            names = (*names, name)
            more, discourse = self.noun_terms(noun, name, discourse)
            terms += more
        return names, terms, discourse

    def noun_terms(
        self, noun: Noun, name: str, discourse: Discourse, besides: Sequence[str] = ()
    ) -> tuple[tuple[Term, ...], Discourse]:
        """What a noun says of its role: adjectives, and "that is ..."."""
        terms = adjective_terms(noun, name, besides)
        for relative in noun.relatives:
            more, discourse = self.terms(relative, name, discourse)
            terms += more
        return terms, discourse

    def terms(
        self, said: Said, subject: str, discourse: Discourse
    ) -> tuple[tuple[Term, ...], Discourse]:
        """What is said of a subject as terms."""
        entry = said.entry
        kind = discourse.referent(subject).kind
        if entry.subject not in ("", kind):
            words = self.text[slice(*said.span)]
            raise refuse(self.text, said.span[0], f'"{words}" is said of a {entry.subject} only')
        parameters = {**entry.fixed, **said.values}
        names = [subject]
        more: tuple[Term, ...] = ()
        for node in said.nouns:
            name, discourse = bound(node, discourse, names)
            names.append(name)
            of_noun, discourse = self.noun_terms(node, name, discourse)
            more += of_noun
        if entry.of_object:
            more += (Term(entry.of_object, (names[-1],), parameters),)
        negated = entry.negated != said.is_denied
        return (Term(entry.predicate, tuple(names), parameters, negated), *more), discourse

    def _of_all(
        self, said: Said, subjects: tuple[str, ...], discourse: Discourse
    ) -> tuple[tuple[Term, ...], Discourse]:
        """What is said of every subject; of two also what they are to each other."""
        reciprocal = [n for n in said.nouns if n.article == "reciprocal"]
        if reciprocal and len(subjects) == 2:
            negated = said.entry.negated != said.is_denied
            return tuple(
                Term(said.entry.predicate, pair, {**said.entry.fixed, **said.values}, negated)
                for pair in (subjects, subjects[::-1])[: 1 if _is_symmetric(said) else 2]
            ), discourse
        terms: tuple[Term, ...] = ()
        first = discourse
        for number, subject in enumerate(subjects):
            more, known = self.terms(said, subject, first if number == 0 else discourse)
            if number and len(known.people) > len(discourse.people):
                # The object of the first subject is that of the second too.
                renaming = {
                    new.name: old.name
                    for new, old in zip(
                        known.people[len(discourse.people) :],
                        discourse.people[len(first.people) :],
                        strict=False,
                    )
                }
                more = tuple(
                    replace(t, roles=tuple(renaming.get(r, r) for r in t.roles)) for t in more
                )
                known = discourse
            terms += more
            discourse = known
        return terms, discourse

    def _simplified(self, clause: Clause, core: Said) -> tuple[list[Said], str]:
        """The core and the relations after it; "moves towards" is one thing, not two."""
        relations = [part for part in clause.modifiers if isinstance(part, Said)]
        denied = clause.polarity.is_denied
        stronger = [r for r in relations if core.entry.predicate in r.entry.replaces]
        if stronger and not core.entry.negated:
            if denied:
                first = replace(stronger[0], is_denied=not stronger[0].is_denied)
                relations = [first if r is stronger[0] else r for r in relations]
            said = [stronger[0] if not denied else first]
            said += [r for r in relations if r not in said]
        else:
            said = [replace(core, is_denied=core.is_denied != denied), *relations]
        if not denied or len(said) == 1:
            return said, ""
        words = self.text[slice(*said[0].span)]
        rest = self.text[slice(*said[1].span)]
        return said, f'"not" denies "{words}" alone; to deny the rest say "not {rest}"'

    def _with_bounds(self, terms: tuple[Term, ...], bounds: Sequence[Bound]) -> tuple[Term, ...]:
        for bound_ in bounds:
            terms = with_distance(terms, bound_, self.text)
        return terms

    def lasting(self, parts: Sequence[Lasting]) -> Lasting:
        """All that is said of a duration. Raises :class:`InputError` for an impossible one."""
        least = max((p.least for p in parts if p.least is not None), default=None)
        most = min((p.most for p in parts if p.most is not None), default=None)
        span = parts[0].span if parts else (0, 0)
        if least is not None and most is not None and least > most:
            raise refuse(
                self.text,
                span[0],
                f"impossible duration: at least {least:g} s and at most {most:g} s",
            )
        return Lasting(least, most, span)

    def _change(self, core: tuple[Term, ...], terms: tuple[Term, ...], lasting: Lasting) -> Piece:
        """First it is not so, then it is."""
        least, most = self.assumed["change_min_s"], self.assumed["change_max_s"]
        stated = core[0]
        opposite = replace(stated, negated=not stated.negated)
        name = stated.predicate
        names = (f"not {name}", name)
        names = names[::-1] if stated.negated else names
        after = Phase(names[1], (stated,), least, most)
        if lasting.least is not None or lasting.most is not None:
            longest = float("inf") if lasting.most is None else lasting.most
            after = replace(after, min_s=lasting.least or min(least, longest), max_s=longest)
        phases = (Phase(names[0], (opposite,), least, most), after)
        change = Piece(phases, True, "leaves" if stated.negated else "enters")
        return throughout(change, tuple(term for term in terms if term != stated))


def with_distance(terms: tuple[Term, ...], bound_: Bound, text: str) -> tuple[Term, ...]:
    """Terms that say how near, or how far, with this distance. Raises :class:`InputError` where
    none does.
    """
    predicate = "near" if bound_.is_within else "far"
    changed = tuple(
        replace(term, parameters={**term.parameters, _DISTANCE: bound_.metres})
        if term.predicate == predicate
        else term
        for term in terms
    )
    if not any(term.predicate == predicate for term in terms):
        said = text[slice(*bound_.span)]
        raise refuse(text, bound_.span[0], f'"{said}" of whom? Say "{said} of a vehicle"')
    return changed


def _is_symmetric(said: Said) -> bool:
    return said.entry.predicate in ("near", "far")
