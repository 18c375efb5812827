"""Clauses with an activity of the catalogue."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from scene4d.searching.activities.definition import Phase, Role, Term
from scene4d.searching.language._discourse import Discourse
from scene4d.searching.language._saying import (
    Piece,
    distinct,
    duration,
    known_subject,
    noun_terms,
    nouns_of,
    terms_of,
    with_distance,
)
from scene4d.searching.language._sentences import (
    Bound,
    Clause,
    Done,
    Lasting,
    Noun,
    Said,
    Slot,
    Spoken,
    kind_of,
)

NOT_OF_ACTIVITIES = '"not" denies a state, such as "is not near a vehicle", not an activity'
_Who = Noun | str
"""Who plays a role: a noun, or the name of a known participant."""


def activity_of(clause: Clause, done: Done, discourse: Discourse) -> Piece:
    """The activity as a piece. Raises :class:`InputError` if no role assignment fits."""
    found = discourse.trying(
        done.meant, lambda spoken, known: _Reading(spoken, clause, done, known).piece()
    )
    _, piece, known = found[0]
    discourse.adopt(known)
    others = sorted({other.name for _, other, _ in found} - {piece.name})
    if others:
        listed = ", ".join(f'"{name}"' for name in others)
        said = discourse.said(clause.span)
        discourse.note(f'"{said}" is taken as "{piece.name}"; it could be {listed}')
    return piece


@dataclass
class _Reading:
    """A clause read as one of the activities that its words may mean."""

    spoken: Spoken
    clause: Clause
    done: Done
    discourse: Discourse

    def piece(self) -> Piece:
        """The activity with the roles, places, durations and distances of the clause."""
        activity, discourse = self.spoken.activity, self.discourse
        filled = self._filled()
        names = self._names(filled)
        phases = tuple(_with_names(phase, names) for phase in activity.phases)
        phases = self._placed(phases)
        if self.clause.polarity.is_denied:
            phases = self._denied(phases)
        slots = dict(zip(self.spoken.roles, self.spoken.slots, strict=False))
        for role, noun in filled.items():
            if isinstance(noun, Noun):
                said_already = slots[role].adjectives if role in slots else ()
                said = noun_terms(noun, names[role], discourse, said_already)
                phases = _with_first(phases, said, names[role])
        subjects = self._subjects(names)
        phases = self._modified(phases, subjects)
        discourse.subject = subjects
        return Piece(phases, True, activity.name, activity.relations)

    # Who ------------------------------------------------------------------------------------------

    def _filled(self) -> dict[str, _Who]:
        """Who plays which role, as far as the clause says."""
        spoken = self.spoken
        slots, roles = list(spoken.slots), list(spoken.roles)
        filled: dict[str, _Who] = {}
        if spoken.has_subject:
            subjects: Sequence[_Who] = nouns_of(self.clause.subject)
            subjects = subjects or known_subject(self.clause, self.discourse)
            slot = slots.pop(0)
            for subject in subjects:
                self._check(subject, slot)
            filled |= dict(zip(self._roles_of_subject(slot, subjects), subjects, strict=False))
            roles = roles[2 if slot.pair else 1 :]
        for slot, noun, role in zip(slots, self.done.nouns, roles, strict=True):
            self._check(noun, slot)
            filled[role] = noun
        owner = self.done.owner
        if owner is not None:
            fitting = [
                role.name
                for role in spoken.activity.roles
                if role.name not in filled and owner.kind in (kind_of(role), "any")
            ]
            if not fitting:
                raise self.discourse.refuse(owner.span, f'"{owner.word}" has no part in this')
            filled[fitting[0]] = owner
        return filled

    def _roles_of_subject(self, slot: Slot, subjects: Sequence[_Who]) -> Sequence[str]:
        """The roles of the subjects; the second of two takes a role that is not mentioned."""
        spoken = self.spoken
        if slot.pair:
            return spoken.roles[:2]
        if len(subjects) == 1:
            return spoken.roles[:1]
        free = [
            role.name
            for role in spoken.activity.roles
            if role.name not in spoken.roles and kind_of(role) == slot.kind
        ]
        if not free:
            what = f"{spoken.activity.name} is done by one, not by two"
            raise self.discourse.refuse(self.clause.span, what)
        return spoken.roles[0], free[0]

    def _check(self, who: _Who, slot: Slot) -> None:
        """Refuse a noun of another kind than the phrase has here, or without its adjectives."""
        phrase = self.spoken.activity.phrases[0]
        span, adjectives = self.clause.span, set()
        if isinstance(who, Noun):
            kind, span = who.kind, who.span
            adjectives = {adjective.predicate for adjective in who.adjectives}
        else:
            kind = self.discourse.people[who].kind
        if kind not in (slot.kind, "any"):
            raise self.discourse.refuse(span, f'a {slot.kind} is expected here: "{phrase}"')
        if not adjectives.issuperset(slot.adjectives):
            what = f'{self.spoken.activity.name} is said "{phrase}"'
            raise self.discourse.refuse(self.clause.span, what)

    def _names(self, filled: Mapping[str, _Who]) -> dict[str, str]:
        """The name of everyone who has a role; new names come in the activity's order."""
        activity, discourse = self.spoken.activity, self.discourse
        known: dict[str, str | None] = {}
        is_first = not discourse.people
        for role in sorted(activity.roles, key=lambda role: _order(role, filled)):
            taken = [name for name in known.values() if name]
            known[role.name] = self._known(role, filled.get(role.name), taken, is_first)
        names: dict[str, str] = {}
        for role in activity.roles:
            classes = self._classes(role, filled.get(role.name))
            name = known[role.name]
            if name is None:
                name = discourse.add(kind_of(role), classes, role.name)
            else:
                discourse.narrow(name, classes)
                discourse.mention(name)
            names[role.name] = name
        return names

    def _known(
        self, role: Role, who: _Who | None, taken: Sequence[str], is_first: bool
    ) -> str | None:
        """The name of who plays a role, None for somebody new. Where nothing is said of it, this is
        somebody named before, if there is one.
        """
        if isinstance(who, str):
            return who
        discourse = self.discourse
        if who is not None:
            name = discourse.meant(who, role.classes, taken)
            slots = zip(self.spoken.roles, self.spoken.slots, strict=False)
            discourse.remark(who, any(one == role.name and slot.is_plural for one, slot in slots))
            return name
        fitting = [
            name
            for name in discourse.mentions
            if name not in taken and set(discourse.people[name].classes) & set(role.classes)
        ]
        if is_first or not fitting:
            return None
        discourse.note(f"the {role.name} is taken as {fitting[-1]}, named before")
        return fitting[-1]

    def _classes(self, role: Role, who: _Who | None) -> tuple[str, ...]:
        if not isinstance(who, Noun) or self.discourse.is_general(who):
            return role.classes
        if who.classes[0] not in role.classes:
            what = f'{self.spoken.activity.name} is not for "{who.word}"'
            raise self.discourse.refuse(who.span, what)
        return tuple(name for name in role.classes if name in who.classes)

    def _subjects(self, names: Mapping[str, str]) -> tuple[str, ...]:
        spoken = self.spoken
        if not spoken.has_subject:
            return tuple(names[role.name] for role in spoken.activity.roles[:1])
        count = 2 if spoken.slots[0].pair else 1
        return tuple(names[role] for role in spoken.roles[:count])

    # How ------------------------------------------------------------------------------------------

    def _placed(self, phases: tuple[Phase, ...]) -> tuple[Phase, ...]:
        """Use the zones and lines that are named in the activity."""
        for place in self.done.places:
            if place.name is not None:
                phases = _with_parameter(phases, place.kind, place.name)
                continue
            default = sorted(
                {
                    str(term.parameters[place.kind])
                    for phase in phases
                    for term in phase.terms
                    if place.kind in term.parameters
                }
            )
            said = " and ".join(f'"{name}"' for name in default)
            self.discourse.note(f"the {place.kind} is taken as {said}, by the catalogue")
        return phases

    def _denied(self, phases: tuple[Phase, ...]) -> tuple[Phase, ...]:
        if len(phases) != 1 or len(phases[0].terms) != 1:
            raise self.discourse.refuse(self.clause.span, NOT_OF_ACTIVITIES)
        term = phases[0].terms[0]
        return (replace(phases[0], terms=(replace(term, negated=not term.negated),)),)

    def _modified(self, phases: tuple[Phase, ...], subjects: tuple[str, ...]) -> tuple[Phase, ...]:
        for part in self.clause.modifiers:
            if isinstance(part, Bound):
                phases = self._within(phases, part)
            elif isinstance(part, Said):
                phases = self._also(phases, part, subjects)
        lasting = duration(self.clause, self.discourse)
        if lasting.least is None and lasting.most is None:
            return phases
        return self._lasts(phases, lasting)

    def _also(
        self, phases: tuple[Phase, ...], said: Said, subjects: tuple[str, ...]
    ) -> tuple[Phase, ...]:
        """Further statements hold in every phase that mentions the subject."""
        if said.entry.instant:
            words = self.discourse.said(said.span)
            what = f'"{words}" is a moment; say "and then ..." for it'
            raise self.discourse.refuse(said.span, what)
        for subject in subjects:
            terms = terms_of(said, subject, self.discourse)
            phases = tuple(
                replace(phase, terms=distinct((*phase.terms, *terms)))
                if _speaks_of(phase, subject)
                else phase
                for phase in phases
            )
        return phases

    def _within(self, phases: tuple[Phase, ...], bound: Bound) -> tuple[Phase, ...]:
        has = [any(term.predicate == bound.predicate for term in phase.terms) for phase in phases]
        if not any(has):
            said, name = self.discourse.said(bound.span), self.spoken.activity.name
            what = f'"{said}": {name} does not say how {bound.predicate}; say of whom'
            raise self.discourse.refuse(bound.span, what)
        return tuple(
            replace(phase, terms=with_distance(phase.terms, bound, self.discourse))
            if there
            else phase
            for phase, there in zip(phases, has, strict=True)
        )

    def _lasts(self, phases: tuple[Phase, ...], lasting: Lasting) -> tuple[Phase, ...]:
        """Give the stated duration to the phase that may last longest."""
        longest = max(phase.max_s for phase in phases)
        which = [number for number, phase in enumerate(phases) if phase.max_s == longest]
        if len(which) > 1:
            named = ", ".join(f'"{phase.name}"' for phase in phases)
            raise self.discourse.refuse(
                lasting.span,
                f"which part of {self.spoken.activity.name} lasts so long ({named}) cannot be told",
            )
        phase = phases[which[0]]
        most = float("inf") if lasting.most is None else lasting.most
        least = min(phase.min_s, most) if lasting.least is None else lasting.least
        if len(phases) > 1:
            said = self.discourse.said(lasting.span)
            self.discourse.note(f'"{said}" is said of the phase "{phase.name}"')
        changed = replace(phase, min_s=least, max_s=most)
        return (*phases[: which[0]], changed, *phases[which[0] + 1 :])


def _order(role: Role, filled: Mapping[str, _Who]) -> tuple[int, int]:
    """Mentioned participants first, in the order of the words."""
    who = filled.get(role.name)
    if isinstance(who, str):
        return (0, 0)
    return (2, 0) if who is None else (1, who.span[0])


def _with_names(phase: Phase, names: Mapping[str, str]) -> Phase:
    terms = tuple(
        replace(term, roles=tuple(names[role] for role in term.roles)) for term in phase.terms
    )
    return replace(phase, terms=terms)


def _with_parameter(phases: tuple[Phase, ...], key: str, value: str) -> tuple[Phase, ...]:
    def changed(term: Term) -> Term:
        given = term.parameters
        return replace(term, parameters={**given, key: value}) if key in given else term

    return tuple(replace(p, terms=tuple(map(changed, p.terms))) for p in phases)


def _with_first(phases: tuple[Phase, ...], terms: tuple[Term, ...], role: str) -> tuple[Phase, ...]:
    """These hold in the role's first phase: the parked vehicle that starts was parked."""
    first = next((n for n, phase in enumerate(phases) if _speaks_of(phase, role)), 0)
    here = replace(phases[first], terms=distinct((*phases[first].terms, *terms)))
    return (*phases[:first], here, *phases[first + 1 :])


def _speaks_of(phase: Phase, role: str) -> bool:
    return any(role in term.roles for term in phase.terms)
