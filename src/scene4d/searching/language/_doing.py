"""Clauses with an activity of the catalogue."""

import re
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, replace

from scene4d.searching.activities.definition import Phase, Role, Term
from scene4d.searching.language._discourse import Discourse
from scene4d.searching.language._pieces import (
    Piece,
    choose,
    duration,
    speaks_of,
    with_first,
    with_names,
    with_parameter,
    with_terms,
)
from scene4d.searching.language._refusals import plain
from scene4d.searching.language._saying import noun_terms, pair_of, terms_of, with_distances
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
_COUNTS = 'say "at least 3 people" of what they are, as in "at least 3 people are in zone NAME"'
_AFTERWARDS = "stays so"
_OF_WHAT = ("leave", "enter", "exit")
"""What may be done to a vehicle, a place or the view."""
_Who = Noun | str
"""Who plays a role: a noun, or the name of a known participant."""


def activity_of(clause: Clause, done: Done, discourse: Discourse) -> Piece:
    """The activity as a piece. Raises :class:`InputError` if no role assignment fits."""

    def read(spoken: Spoken, known: Discourse) -> Piece:
        return _Reading(spoken, clause, done, known).piece()

    return choose(done.meant, read, discourse, f'"{discourse.said(clause.span)}"')


@dataclass
class _Reading:
    """A clause read as one of the activities that its words may mean."""

    spoken: Spoken
    clause: Clause
    done: Done
    discourse: Discourse
    after: tuple[Term, ...] = ()

    def piece(self) -> Piece:
        """The activity with the roles, places, durations and distances of the clause."""
        activity, discourse = self.spoken.activity, self.discourse
        self._check_voice()
        filled = self._filled()
        names = self._names(filled)
        phases = tuple(with_names(phase, names) for phase in activity.phases)
        self.after = with_names(Phase("", activity.after), names).terms
        phases = self._counted(self._placed(phases))
        if self.clause.polarity.is_denied:
            phases = self._denied(phases)
        slots = dict(zip(self.spoken.roles, self.spoken.slots, strict=False))
        for role, noun in filled.items():
            if isinstance(noun, Noun):
                said_already = slots[role].adjectives if role in slots else ()
                said = noun_terms(noun, names[role], discourse, said_already)
                phases = with_first(phases, said, names[role])
        subjects = self._subjects(names)
        phases = self._modified(phases, subjects)
        discourse.subject = subjects
        return Piece(phases, True, activity.name, activity.relations)

    def _check_voice(self) -> None:
        """Refuse "is entering" for "is entered"."""
        spoken, clause, discourse = self.spoken, self.clause, self.discourse
        said = discourse.said(self.done.span)
        is_active = re.match(r"(?!being)\w+ing\b", said) is not None
        if said.casefold() == "left" and not clause.subjects:
            what = '{} is a side here, or a past; say "turns left"'
            raise discourse.refuse(self.done.span, what)
        if spoken.is_passive:
            has_be = clause.polarity.is_state or self.done.has_be or not spoken.has_subject
            has_doer = any(discourse.said(p.span).startswith("by ") for p in clause.parts(Said))
            is_wrong = is_active or (spoken.needs_be and (has_doer or not has_be))
        else:
            is_wrong = clause.polarity.is_state and not is_active and spoken.has_subject
        if is_wrong:
            raise discourse.refuse(clause.span, f'{spoken.activity.name} is not said "{said}"')

    # Who ------------------------------------------------------------------------------------------

    def _filled(self) -> dict[str, _Who]:
        """Who plays which role, as far as the clause says."""
        spoken = self.spoken
        slots, roles = list(spoken.slots), list(spoken.roles)
        filled: dict[str, _Who] = {}
        if spoken.has_subject:
            slot = slots.pop(0)
            subjects = self._those_before(slot)
            for subject in subjects:
                self._check(subject, slot)
            filled |= dict(zip(self._roles_of_subject(slot, subjects), subjects, strict=False))
            roles = roles[2 if slot.pair else 1 :]
        else:
            kind = kind_of(spoken.activity.roles[0])
            kinds = {self.discourse.people[name].kind for name in self.discourse.subject}
            if kind != "any" and not kinds & {kind, "any"}:
                self._known_doer(kind)
        for slot, noun, role in zip(slots, self.done.nouns, roles, strict=True):
            self._check(noun, slot)
            self._check_alone(noun)
            filled[role] = noun
        owner = self.done.owner
        if owner is not None:
            free = [role for role in spoken.activity.roles if role.name not in filled]
            fitting = [role.name for role in free if owner.kind in (kind_of(role), "any")]
            if not fitting:
                raise self.discourse.refuse(owner.span, f'"{owner.word}" has no part in this')
            filled[fitting[0]] = owner
        return filled

    def _those_before(self, slot: Slot) -> Sequence[_Who]:
        """The subjects: as said, else those of the clause before, else who else is known, else none
        that is named.
        """
        discourse = self.discourse
        nouns = self.clause.subjects
        if len(nouns) == 1 and nouns[0].count == 2 and self._is_of_two(slot):
            return pair_of(nouns[0])
        if len(nouns) == 1 and not self._is_counted():
            self._check_alone(nouns[0])
        if nouns:
            drives = (nouns[0].kind, slot.kind) == ("person", "vehicle")
            is_known = nouns[0].article in ("definite", "pronoun", "bare")
            return (drives and is_known and self._last_known("vehicle")) or nouns
        kinds = {discourse.people[name].kind for name in discourse.subject}
        if kinds and (slot.kind == "any" or kinds <= {slot.kind, "any"}):
            return discourse.subject
        known = self._known_doer(slot.kind)
        if not known:
            discourse.note("nobody is named: {} is taken of anybody who can", self.clause.span)
        return known

    def _known_doer(self, kind: str) -> Sequence[_Who]:
        """Who was named last and can do it; refused where those of the clause before cannot."""
        known = self._last_known(kind)
        if not known and self.discourse.subject:
            raise self.discourse.refuse(self.clause.span, f"a {kind} is expected: {{}}")
        return known

    def _is_of_two(self, slot: Slot) -> bool:
        """Whether the subjects may be two."""
        roles = [role for role in self.spoken.activity.roles if kind_of(role) == slot.kind]
        used = sum(one.kind == slot.kind for one in self.spoken.slots)
        return slot.pair or len(roles) > used

    def _is_counted(self) -> bool:
        """Whether the activity says of how many it is."""
        return any("count" in term.parameters for term in self.spoken.activity.terms)

    def _check_alone(self, noun: Noun) -> None:
        """Refuse more than one: activities are done by one, or by two."""
        if noun.count > 1:
            what = f"{self.spoken.activity.name} is not counted; {_COUNTS}"
            raise self.discourse.refuse(noun.span, what)

    def _last_known(self, kind: str) -> Sequence[_Who]:
        """Whoever of a kind was named last, with a note: people who drive off are in a vehicle."""
        people = self.discourse.people
        known = [name for name in self.discourse.mentions if people[name].kind == kind]
        if known:
            self.discourse.note(f"{{}} is taken of {known[-1]}", self.clause.span)
        return known[-1:]

    def _counted(self, phases: tuple[Phase, ...]) -> tuple[Phase, ...]:
        """At least so many as are said make a crowd."""
        counts = [noun.count for noun in self.clause.subjects if noun.count > 1]
        is_counted = counts and self._is_counted()
        return with_parameter(phases, "count", float(counts[0])) if is_counted else phases

    def _roles_of_subject(self, slot: Slot, subjects: Sequence[_Who]) -> Sequence[str]:
        """The roles of the subjects; the second of two takes a role that is not mentioned."""
        spoken = self.spoken
        if slot.pair or len(subjects) < 2:
            return spoken.roles[: 2 if slot.pair else len(subjects)]
        others = [role for role in spoken.activity.roles if role.name not in spoken.roles]
        free = [role.name for role in others if kind_of(role) == slot.kind]
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
            adjectives = {one.holds[0].predicate for one in who.adjectives}
        else:
            kind = self.discourse.people[who].kind
        if kind not in (slot.kind, "any") and slot.kind != "any":
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
                who = filled.get(role.name)
                kind = who.kind if isinstance(who, Noun) and who.kind != "any" else kind_of(role)
                name = discourse.add(kind, classes, role.name)
                discourse.unsaid += () if role.name in filled else (name,)
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
            is_new = who.word == "another"
            name = None if is_new else discourse.meant(who, role.classes, taken)
            slots = zip(self.spoken.roles, self.spoken.slots, strict=False)
            discourse.remark(who, any(one == role.name and slot.is_plural for one, slot in slots))
            return name
        might = {n for n, one in discourse.people.items() if set(one.classes) & set(role.classes)}
        fitting = [name for name in discourse.mentions if name in might and name not in taken]
        is_short = self.spoken.is_short and plain(discourse.said(self.done.span)) in _OF_WHAT
        if is_short and not fitting and (discourse.people or self.clause.subjects):
            what = '{} what? Say a vehicle, a zone, or "the scene"'
            raise discourse.refuse(self.done.span, what)
        if is_first or not fitting:
            return None
        discourse.note(f"the {role.name} is taken as {fitting[-1]}, named before")
        return fitting[-1]

    def _classes(self, role: Role, who: _Who | None) -> tuple[str, ...]:
        if isinstance(who, str):
            said = self.discourse.people[who].classes
        elif who is None or not who.classes:
            return role.classes
        else:
            said = who.classes
        common = tuple(name for name in role.classes if name in said)
        known = set(said) - {"vehicle"}
        is_general = isinstance(who, Noun) and self.discourse.is_general(who)
        if not common or not (is_general or known & set(role.classes)):
            word = who if isinstance(who, str) else who.word
            what = f'{self.spoken.activity.name} is not for "{word}"'
            raise self.discourse.refuse(self.clause.span, what)
        return common

    def _subjects(self, names: Mapping[str, str]) -> tuple[str, ...]:
        spoken = self.spoken
        if not spoken.has_subject:
            return tuple(names[role.name] for role in spoken.activity.roles[:1])
        count = 2 if spoken.slots[0].pair else 1
        roles = spoken.roles[:count] or tuple(role.name for role in spoken.activity.roles[:1])
        return tuple(names[role] for role in roles)

    # How ------------------------------------------------------------------------------------------

    def _placed(self, phases: tuple[Phase, ...]) -> tuple[Phase, ...]:
        """Use the zones and lines that are named in the activity."""
        for place in self.done.places:
            if place.name is not None:
                phases = with_parameter(phases, place.kind, place.name)
                continue
            terms = [term.parameters for phase in phases for term in phase.terms]
            names = sorted({f'"{said[place.kind]}"' for said in terms if place.kind in said})
            said = " and ".join(names)
            self.discourse.note(f"the {place.kind} is taken as {said}, by the catalogue")
        return phases

    def _denied(self, phases: tuple[Phase, ...]) -> tuple[Phase, ...]:
        if len(phases) != 1 or len(phases[0].terms) != 1:
            raise self.discourse.refuse(self.clause.span, NOT_OF_ACTIVITIES)
        term = phases[0].terms[0]
        return (replace(phases[0], terms=(replace(term, negated=not term.negated),)),)

    def _modified(self, phases: tuple[Phase, ...], subjects: tuple[str, ...]) -> tuple[Phase, ...]:
        lasting = duration(self.clause, self.discourse)
        state = self.spoken.activity.state
        if self.spoken.activity.after and (lasting.is_said or self.clause.parts(Said)):
            assumed = self.discourse.assumed
            after = Phase(_AFTERWARDS, self.after, assumed("state_min_s"), gap_s=assumed("after_s"))
            phases, state = (*phases, after), _AFTERWARDS
        for said in self.clause.parts(Said):
            phases = self._also(phases, said, subjects, state)
        phases = with_distances(phases, self.clause.parts(Bound), self.discourse)
        return self._lasts(phases, lasting, state) if lasting.is_said else phases

    def _also(
        self, phases: tuple[Phase, ...], said: Said, subjects: tuple[str, ...], state: str
    ) -> tuple[Phase, ...]:
        """Further statements hold in the phase that lasts, where the catalogue names one, else in
        every phase that mentions the subject.
        """
        if said.entry.instant:
            what = '{} is a moment; say "and then ..." for it'
            raise self.discourse.refuse(said.span, what)
        if self.discourse.said(said.span).startswith("to "):
            raise self.discourse.refuse(said.span, "{} is said of who moves")
        for subject in subjects:
            terms = terms_of(said, subject, self.discourse)
            is_meant = [p.name == state if state else speaks_of(p, subject) for p in phases]
            each = zip(phases, is_meant, strict=True)
            phases = tuple(with_terms(phase, terms) if so else phase for phase, so in each)
        return phases

    def _lasts(self, phases: tuple[Phase, ...], lasting: Lasting, state: str) -> tuple[Phase, ...]:
        """Give the stated duration to the phase that the catalogue names, or the only one."""
        activity = self.spoken.activity
        names = [phase.name for phase in phases]
        if len(phases) > 1 and not state:
            named = ", ".join(f'"{name}"' for name in names)
            what = f"which part of {activity.name} lasts so long ({named}) cannot be told"
            raise self.discourse.refuse(lasting.span, what)
        at = names.index(state) if state else 0
        phase = phases[at]
        if len(phases) > 1:
            self.discourse.note(f'{{}} is said of the phase "{phase.name}"', lasting.span)
        least, most = lasting.within(phase.min_s, float("inf"))
        changed = replace(phase, min_s=least, max_s=most)
        return (*phases[:at], changed, *phases[at + 1 :])


def _order(role: Role, filled: Mapping[str, _Who]) -> tuple[int, int]:
    """Mentioned participants first, in the order of the words."""
    who = filled.get(role.name)
    if isinstance(who, str):
        return (0, 0)
    return (2, 0) if who is None else (1, who.span[0])
