"""Clauses that say an activity of the catalogue."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from scene4d.core.errors import InputError
from scene4d.searching.activities.definition import Activity, Phase, Role, Term
from scene4d.searching.language.naming import is_general, nouns_of, remarked
from scene4d.searching.language.phrases import Slot, Spoken
from scene4d.searching.language.pieces import Piece, distinct
from scene4d.searching.language.reading import NOT_OF_ACTIVITIES
from scene4d.searching.language.referents import Discourse
from scene4d.searching.language.saying import Saying, with_distance
from scene4d.searching.language.sentences import Bound, Clause, Done, Lasting, Noun, Place, Said
from scene4d.searching.language.words import refuse

_Filled = dict[str, Noun | str]
"""Who plays a role: a noun, or the name of somebody known."""


@dataclass(frozen=True)
class Doing:
    """Reads clauses whose core is a phrase of the catalogue."""

    text: str
    assumed: Mapping[str, float]

    def read(self, clause: Clause, done: Done, discourse: Discourse) -> tuple[Piece, Discourse]:
        """The activity as a piece. Raises :class:`InputError` where nobody can do that."""
        found: list[tuple[Piece, Discourse]] = []
        failed: list[InputError] = []
        for spoken in done.meant:
            try:
                found.append(self._as(spoken, clause, done, discourse))
            except InputError as error:
                failed.append(error)
        if not found:
            raise failed[0]
        piece, known = found[0]
        others = sorted({other.name for other, _ in found} - {piece.name})
        if others:
            said = self.text[slice(*clause.span)]
            listed = ", ".join(f'"{name}"' for name in others)
            known = known.noted(f'"{said}" is taken as "{piece.name}"; it could be {listed}')
        return piece, known

    def _as(
        self, spoken: Spoken, clause: Clause, done: Done, discourse: Discourse
    ) -> tuple[Piece, Discourse]:
        activity = spoken.activity
        filled = self._filled(spoken, clause, done, discourse)
        names, discourse = self._bound(spoken, filled, discourse)
        phases = tuple(_renamed(phase, names) for phase in activity.phases)
        phases, discourse = self._placed(phases, done.places, discourse)
        if clause.polarity.is_denied:
            phases = self._denied(phases, clause)
        first = dict(zip(spoken.roles, spoken.slots, strict=False))
        for role, noun in filled.items():
            if isinstance(noun, Noun):
                slot = first.get(role)
                said, discourse = Saying(self.text, self.assumed).noun_terms(
                    noun, names[role], discourse, slot.adjectives if slot else ()
                )
                phases = _with_first(phases, said, names[role])
        subjects = self._subjects(spoken, names, done)
        phases, discourse = self._modified(phases, activity, clause, subjects, discourse)
        discourse = replace(discourse, subject=subjects)
        return Piece(phases, True, activity.name, activity.relations), discourse

    # Who ------------------------------------------------------------------------------------------

    def _filled(self, spoken: Spoken, clause: Clause, done: Done, discourse: Discourse) -> _Filled:
        """Who plays which role, as far as it is said."""
        given: list[Noun | str] = list(done.nouns)
        slots = list(spoken.slots)
        filled: _Filled = {}
        roles = list(spoken.roles)
        if spoken.has_subject:
            subjects: Sequence[Noun | str] = nouns_of(clause.subject) or discourse.subject
            if not subjects:
                raise refuse(self.text, clause.span[0], "who? Say a person or a vehicle first")
            slot = slots.pop(0)
            for subject in subjects:
                self._check(subject, slot, spoken, discourse, clause)
            taken = self._pair(spoken, slot, subjects, clause)
            roles = roles[2 if slot.pair else 1 :]
            filled |= dict(zip(taken, subjects, strict=False))
        for slot, noun, role in zip(slots, given, roles, strict=True):
            self._check(noun, slot, spoken, discourse, clause)
            filled[role] = noun
        if done.owner is not None:
            owner = done.owner
            free = [r for r in spoken.activity.roles if r.name not in filled]
            fitting = [r.name for r in free if owner.kind in (_kind(r), "any")]
            if not fitting:
                raise refuse(self.text, owner.span[0], f'"{owner.word}" has no part in this')
            filled[fitting[0]] = owner
        return filled

    def _pair(
        self, spoken: Spoken, slot: Slot, subjects: Sequence[Noun | str], clause: Clause
    ) -> list[str]:
        """The roles of the subjects; of two the second takes a role that is not spoken of."""
        if slot.pair:
            return list(spoken.roles[:2])
        if len(subjects) == 1:
            return [spoken.roles[0]]
        free = [
            role.name
            for role in spoken.activity.roles
            if role.name not in spoken.roles and _kind(role) == slot.kind
        ]
        if not free:
            raise refuse(
                self.text, clause.span[0], f"{spoken.activity.name} is done by one, not by two"
            )
        return [spoken.roles[0], free[0]]

    def _check(
        self, noun: Noun | str, slot: Slot, spoken: Spoken, discourse: Discourse, clause: Clause
    ) -> None:
        kind = noun.kind if isinstance(noun, Noun) else discourse.referent(noun).kind
        if kind not in (slot.kind, "any"):
            start = noun.span[0] if isinstance(noun, Noun) else clause.span[0]
            raise refuse(
                self.text,
                start,
                f'a {slot.kind} is expected here: "{spoken.activity.phrases[0]}"',
            )
        adjectives = noun.adjectives if isinstance(noun, Noun) else ()
        for wanted in slot.adjectives:
            if all(adjective.predicate != wanted for adjective in adjectives):
                raise refuse(
                    self.text,
                    clause.span[0],
                    f'{spoken.activity.name} is said "{spoken.activity.phrases[0]}"',
                )

    def _bound(
        self, spoken: Spoken, filled: _Filled, discourse: Discourse
    ) -> tuple[dict[str, str], Discourse]:
        """The name of everybody who has a role; those who are new come in the activity's order."""
        activity = spoken.activity
        plural = [r for r, slot in zip(spoken.roles, spoken.slots, strict=False) if slot.is_plural]
        names: dict[str, str | None] = {}
        is_first = not discourse.people
        for role in sorted(activity.roles, key=lambda role: _order(role, filled)):
            taken = [name for name in names.values() if name]
            who = filled.get(role.name)
            if isinstance(who, str):
                names[role.name] = who
            elif who is not None:
                names[role.name], discourse = discourse.meant(who, role.classes, taken)
                discourse = remarked(who, discourse, role.name in plural)
            else:
                names[role.name], discourse = self._unsaid(role, taken, is_first, discourse)
        bound: dict[str, str] = {}
        for role in activity.roles:
            who, name = filled.get(role.name), names[role.name]
            classes = self._classes(activity, role, who, discourse)
            if name is None:
                name, discourse = discourse.add(_kind(role), classes, role.name)
            else:
                discourse = discourse.narrow(name, classes).mention(name)
            bound[role.name] = name
        return bound, discourse

    def _unsaid(
        self, role: Role, taken: Sequence[str], is_first: bool, discourse: Discourse
    ) -> tuple[str | None, Discourse]:
        """Who plays a role of which nothing is said: somebody named before, if there is one."""
        known = [
            name
            for name in discourse.mentions
            if name not in taken and set(discourse.referent(name).classes) & set(role.classes)
        ]
        if is_first or not known:
            return None, discourse
        return known[-1], discourse.noted(f"the {role.name} is taken as {known[-1]}, named before")

    def _classes(
        self, activity: Activity, role: Role, who: Noun | str | None, discourse: Discourse
    ) -> tuple[str, ...]:
        if not isinstance(who, Noun) or is_general(who, discourse):
            return role.classes
        if who.classes[0] not in role.classes:
            raise refuse(self.text, who.span[0], f'{activity.name} is not for "{who.word}"')
        return tuple(name for name in role.classes if name in who.classes)

    def _subjects(self, spoken: Spoken, names: Mapping[str, str], done: Done) -> tuple[str, ...]:
        if not spoken.has_subject:
            return tuple(names[role.name] for role in spoken.activity.roles[:1])
        count = 2 if spoken.slots[0].pair else 1
        return tuple(names[role] for role in spoken.roles[:count])

    # How ------------------------------------------------------------------------------------------

    def _placed(
        self, phases: tuple[Phase, ...], places: Sequence[Place], discourse: Discourse
    ) -> tuple[tuple[Phase, ...], Discourse]:
        """The zones and lines of an activity are those that are named."""
        for place in places:
            default = sorted(
                {
                    str(term.parameters[place.kind])
                    for phase in phases
                    for term in phase.terms
                    if place.kind in term.parameters
                }
            )
            if place.name is None:
                said = " and ".join(f'"{name}"' for name in default)
                discourse = discourse.noted(
                    f"the {place.kind} is taken as {said}, by the catalogue"
                )
                continue
            phases = _with_parameter(phases, place.kind, place.name)
        return phases, discourse

    def _denied(self, phases: tuple[Phase, ...], clause: Clause) -> tuple[Phase, ...]:
        if len(phases) != 1 or len(phases[0].terms) != 1:
            raise refuse(self.text, clause.span[0], NOT_OF_ACTIVITIES)
        term = phases[0].terms[0]
        return (replace(phases[0], terms=(replace(term, negated=not term.negated),)),)

    def _modified(
        self,
        phases: tuple[Phase, ...],
        activity: Activity,
        clause: Clause,
        subjects: tuple[str, ...],
        discourse: Discourse,
    ) -> tuple[tuple[Phase, ...], Discourse]:
        saying = Saying(self.text, self.assumed)
        parts = list(clause.modifiers)
        for part in parts:
            if isinstance(part, Bound):
                phases = self._within(phases, part, activity)
            elif isinstance(part, Said):
                if part.entry.instant:
                    said = self.text[slice(*part.span)]
                    raise refuse(
                        self.text, part.span[0], f'"{said}" is a moment; say "and then ..." for it'
                    )
                for subject in subjects:
                    terms, discourse = saying.terms(part, subject, discourse)
                    phases = _with_terms(phases, terms, subject)
        lasting = [part for part in parts if isinstance(part, Lasting)]
        if lasting:
            phases, discourse = self._lasts(phases, saying.lasting(lasting), activity, discourse)
        return phases, discourse

    def _within(
        self, phases: tuple[Phase, ...], bound: Bound, activity: Activity
    ) -> tuple[Phase, ...]:
        changed = []
        wanted = "near" if bound.is_within else "far"
        for phase in phases:
            has = any(term.predicate == wanted for term in phase.terms)
            terms = with_distance(phase.terms, bound, self.text) if has else phase.terms
            changed.append(replace(phase, terms=terms))
        if tuple(changed) == phases and not any(
            term.predicate == wanted for phase in phases for term in phase.terms
        ):
            said = self.text[slice(*bound.span)]
            raise refuse(
                self.text,
                bound.span[0],
                f'"{said}": {activity.name} does not say how {wanted}; say of whom',
            )
        return tuple(changed)

    def _lasts(
        self, phases: tuple[Phase, ...], lasting: Lasting, activity: Activity, discourse: Discourse
    ) -> tuple[tuple[Phase, ...], Discourse]:
        """The phase that may last longest lasts as was said."""
        longest = max(phase.max_s for phase in phases)
        which = [number for number, phase in enumerate(phases) if phase.max_s == longest]
        if len(which) > 1:
            named = ", ".join(f'"{phase.name}"' for phase in phases)
            raise refuse(
                self.text,
                lasting.span[0],
                f"which part of {activity.name} lasts so long ({named}) cannot be told",
            )
        phase = phases[which[0]]
        most = float("inf") if lasting.most is None else lasting.most
        least = min(phase.min_s, most) if lasting.least is None else lasting.least
        if len(phases) > 1:
            discourse = discourse.noted(
                f'"{self.text[slice(*lasting.span)]}" is said of the phase "{phase.name}"'
            )
        changed = replace(phase, min_s=least, max_s=most)
        return (*phases[: which[0]], changed, *phases[which[0] + 1 :]), discourse


def _kind(role: Role) -> str:
    return "person" if "person" in role.classes else "vehicle"


def _order(role: Role, filled: _Filled) -> tuple[int, int]:
    """Those of whom something is said come first, in the order of the words."""
    who = filled.get(role.name)
    if isinstance(who, str):
        return (0, 0)
    return (2, 0) if who is None else (1, who.span[0])


def _renamed(phase: Phase, names: Mapping[str, str]) -> Phase:
    terms = tuple(
        replace(term, roles=tuple(names[role] for role in term.roles)) for term in phase.terms
    )
    return replace(phase, terms=terms)


def _with_parameter(phases: tuple[Phase, ...], key: str, value: str) -> tuple[Phase, ...]:
    def changed(term: Term) -> Term:
        given = term.parameters
        return replace(term, parameters={**given, key: value}) if key in given else term

    return tuple(replace(p, terms=tuple(map(changed, p.terms))) for p in phases)


def _with_terms(phases: tuple[Phase, ...], terms: tuple[Term, ...], role: str) -> tuple[Phase, ...]:
    """These hold wherever something is said of the role."""
    return tuple(
        replace(phase, terms=distinct((*phase.terms, *terms))) if _speaks_of(phase, role) else phase
        for phase in phases
    )


def _with_first(phases: tuple[Phase, ...], terms: tuple[Term, ...], role: str) -> tuple[Phase, ...]:
    """These hold when the role first comes up: the parked vehicle that starts was parked."""
    first = next((n for n, phase in enumerate(phases) if _speaks_of(phase, role)), 0)
    here = replace(phases[first], terms=distinct((*phases[first].terms, *terms)))
    return (*phases[:first], here, *phases[first + 1 :])


def _speaks_of(phase: Phase, role: str) -> bool:
    return any(role in term.roles for term in phase.terms)
