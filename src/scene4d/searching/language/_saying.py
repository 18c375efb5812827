"""Clauses with a state: predicates that hold together."""

from collections.abc import Mapping, Sequence
from dataclasses import replace

from scene4d.searching.activities.definition import Phase, Term
from scene4d.searching.language._discourse import NOBODY, Discourse, adjective_terms
from scene4d.searching.language._lexicon import StateEntry, read_lexicon
from scene4d.searching.language._pieces import Piece, duration, state, throughout
from scene4d.searching.language._refusals import plain
from scene4d.searching.language._sentences import Bound, Clause, Delay, Lasting, Noun, Said
from scene4d.searching.predicates._registry import PREDICATES

_INFINITE = float("inf")
_ANYONE = ("anyone", "anybody")
"""Who is not near any of these is alone."""
_MOTIONS = (
    *("moving", "speed_above", "moving_towards", "moving_away", "following", "reversing"),
    *("turning_left", "turning_right"),
)
"""Predicates of verbs that tell what somebody does, until he does something else."""


def state_of(clause: Clause, core: Said, discourse: Discourse) -> Piece:
    """A clause with a state. Raises :class:`InputError` if it is not possible."""
    if any(noun.article == "none" for noun in clause.subjects):
        return _alone(clause, core, discourse)
    said = _simplified(clause, core, discourse)
    subjects, terms = _subjects(clause, said, discourse)
    is_crowd = len(clause.subjects) == 1 and clause.subjects[0].count > 2
    of_core: tuple[Term, ...] = ()
    for number, one in enumerate(said):
        more = () if is_crowd and _is_mutual(one) else _of_all(one, subjects, discourse)
        if number == 0:
            of_core = more
            more = _without_replaced(more, said[1:], discourse)
        terms += more
    (phase,) = with_distances((Phase("", terms),), clause.parts(Bound), discourse)
    terms = phase.terms
    lasting = duration(clause, discourse)
    discourse.subject = subjects
    entry = said[0].entry
    if entry.becomes:
        if said[0].is_denied:
            what = '"not" denies a state, such as "is not in zone NAME", not what becomes so'
            raise discourse.refuse(clause.span, what)
        if plain(discourse.said(core.span)).split()[0] in read_lexicon().verbs["run"].words:
            running = read_lexicon().adjective("running").holds
            terms += tuple(replace(one, roles=(name,)) for one in running for name in subjects)
        return _change(entry, of_core, terms, lasting, discourse)
    is_instant = any(one.entry.instant for one in said)
    if is_instant and lasting.least is not None:
        what = f'"{discourse.said(clause.span)}" is a moment, and lasts no time'
        raise discourse.refuse(lasting.span, what)
    if entry.in_turn:
        return _in_turn(terms, of_core, said[0].is_denied, clause, discourse)
    usual_s = max((one.entry.least_s or 0.0 for one in said), default=0.0)
    piece = state(terms, lasting, is_instant, discourse, usual_s or None)
    is_motion = core.is_verb and core.predicate in _MOTIONS and not clause.polarity.is_state
    return replace(piece, is_motion=is_motion and not clause.polarity.is_denied)


# Who ----------------------------------------------------------------------------------------------


def pair_of(noun: Noun) -> tuple[Noun, Noun]:
    """Two of those whom a noun in the plural names."""
    one = replace(noun, count=1, is_plural=False)
    article = "definite" if noun.article == "definite" else "indefinite"
    return replace(one, article=article), replace(one, article="new")


def _subjects(
    clause: Clause, said: Sequence[Said], discourse: Discourse
) -> tuple[tuple[str, ...], tuple[Term, ...]]:
    """Names of those whom a clause is about, those of the clause before where none is named, and
    what their nouns say of them.
    """
    nouns: Sequence[Noun] = clause.subjects
    if not nouns and discourse.subject:
        return discourse.subject, ()
    if not nouns:
        return (_unsaid_subject(said[0].entry, clause, discourse),), ()
    crowd = None
    mutual = next((one for one in said if _is_mutual(one)), None)
    if mutual is not None and len(nouns) == 1 and nouns[0].article != "pronoun":
        if nouns[0].count > 2:
            crowd = _crowd(mutual, nouns[0].count, discourse)
            nouns = (replace(nouns[0], count=1),)
        elif nouns[0].is_plural or nouns[0].count == 2:
            nouns = pair_of(nouns[0])
    names: tuple[str, ...] = ()
    terms: tuple[Term, ...] = ()
    for noun in nouns:
        names = (*names, discourse.name_of(noun, names))
        terms += noun_terms(noun, names[-1], discourse)
    return names, terms if crowd is None else (*terms, replace(crowd, roles=names))


def _is_mutual(said: Said) -> bool:
    return said.entry.mutual or any(noun.article == "reciprocal" for noun in said.nouns)


def _crowd(said: Said, count: int, discourse: Discourse) -> Term:
    """More than two are together: one of them has so many around."""
    if said.entry.crowd is None:
        raise discourse.refuse(said.span, "{} is said of two")
    return _with_values(said.entry.crowd, {**said.values, "count": float(count)})


def _unsaid_subject(entry: StateEntry, clause: Clause, discourse: Discourse) -> str:
    """Whom a search is about that begins with what they do."""
    if clause.polarity.is_denied:
        raise discourse.refuse(clause.span, "who? Say a person or a vehicle first")
    kind = entry.subject or "person"
    if entry.holds[0].predicate in ("turning_left", "turning_right"):
        kind = "vehicle"
    discourse.note(f"nobody is named: {{}} is taken of a {kind}", clause.span)
    return discourse.add_usual(kind)


def _alone(clause: Clause, core: Said, discourse: Discourse) -> Piece:
    """Nobody is near a thing: it is alone."""
    if len(clause.subjects) > 1:
        raise discourse.refuse(clause.span, NOBODY)
    (noun,), others = clause.subjects, clause.parts(Said)
    if clause.polarity.is_denied or core.entry.becomes or core.entry.instant:
        raise discourse.refuse(noun.span, NOBODY)
    is_near = core.predicate == "near" and len(core.nouns) == 1 and not others
    if noun.kind != "person" or not is_near:
        return _absence(clause, [core, *others], discourse)
    name = discourse.name_of(core.nouns[0], ())
    terms = noun_terms(core.nouns[0], name, discourse)
    near = _with_values(core.entry.holds[0], core.values)
    said = Phase("", (_by_kinds(core.entry, near, ("person", discourse.people[name].kind)),))
    (said,) = with_distances((said,), clause.parts(Bound), discourse)
    alone = Term("alone", (name,), said.terms[0].parameters)
    discourse.subject = (name,)
    return state((alone, *terms), duration(clause, discourse), False, discourse)


def _absence(clause: Clause, said: Sequence[Said], discourse: Discourse) -> Piece:
    """Nobody is so: a role that nobody plays."""
    (noun,) = clause.subjects
    name = discourse.add_nobody(noun)
    discourse.remark(replace(noun, is_plural=False))
    terms = noun_terms(noun, name, discourse)
    for one in said:
        terms = (*terms_of(one, name, discourse), *terms)
    if len(discourse.people) > 1 or any("spot" in term.parameters for term in terms):
        raise discourse.refuse(noun.span, NOBODY)
    discourse.subject = (name,)
    return state(terms, duration(clause, discourse), False, discourse)


# What ---------------------------------------------------------------------------------------------


def noun_terms(
    noun: Noun, name: str, discourse: Discourse, besides: Sequence[str] = ()
) -> tuple[Term, ...]:
    """The terms of a noun: its adjectives, and "that is ..."."""
    terms = adjective_terms(noun, name, besides)
    for relative in noun.relatives:
        terms += terms_of(relative, name, discourse)
    return terms


def terms_of(said: Said, subject: str, discourse: Discourse) -> tuple[Term, ...]:
    """The statements about a subject, as terms; those about the subject come first."""
    _check_kind(said, said.entry.subject, subject, discourse)
    names = [subject]
    of_anyone = any(noun.word in _ANYONE for noun in said.nouns)
    if said.is_denied and said.predicate == "near" and of_anyone:
        near = _with_values(said.entry.holds[0], said.values)
        return (Term("alone", (subject,), near.parameters),)
    more: tuple[Term, ...] = ()
    for noun in _objects(said):
        names.append(discourse.name_of(noun, names))
        more += noun_terms(noun, names[-1], discourse)
    wanted = {role for term in said.entry.holds for role in term.roles}
    if len(names) < len(wanted):
        names.append(_unsaid_object(said, names, discourse))
    if len(names) > len(wanted):
        raise discourse.refuse(said.span, "{} names too many, or too few")
    if len(names) > 1:
        _check_kind(said, said.entry.object, names[1], discourse)
    return (*_holds(said, names, discourse), *more)


def _objects(said: Said) -> tuple[Noun, ...]:
    """Those whom a statement names: "between two cars" names two."""
    is_of_three = any("c" in term.roles for term in said.entry.holds)
    is_pair = len(said.nouns) == 1 and (said.nouns[0].is_plural or said.nouns[0].count == 2)
    return pair_of(said.nouns[0]) if is_of_three and is_pair else said.nouns


def _unsaid_object(said: Said, names: Sequence[str], discourse: Discourse) -> str:
    """Of whom it is said where no object is named: whoever was named last, else a new one."""
    if not said.entry.bare or len(names) > 1:
        raise discourse.refuse(said.span, "{} of whom?")
    other = "person" if discourse.people[names[0]].kind == "vehicle" else "vehicle"
    known = [name for name in discourse.mentions if name not in names]
    name = known[-1] if known else discourse.add_usual(other)
    discourse.note(f"{{}} is taken of {name}", said.span)
    return name


def _check_kind(said: Said, kind: str, name: str, discourse: Discourse) -> None:
    if kind not in ("", discourse.people[name].kind):
        raise discourse.refuse(said.span, f"{{}} is said of a {kind} only")


def _holds(said: Said, names: Sequence[str], discourse: Discourse) -> tuple[Term, ...]:
    """The terms of a statement with its roles and values, or their opposite."""
    called = dict(zip("abc", names, strict=False))
    terms = [_with_values(term, said.values) for term in said.entry.holds]
    kinds = [discourse.people[name].kind for name in names[:2]]
    if "spot" in said.values:
        kinds.append(discourse.elsewhere[str(said.values["spot"])])
    terms[0] = _by_kinds(said.entry, terms[0], kinds)
    if said.is_denied:
        terms[0] = replace(terms[0], negated=not terms[0].negated)
        if any(len(term.roles) > 1 for term in terms[1:]):
            raise discourse.refuse(said.span, "{} cannot be denied as a whole")
        terms = terms[:1]
    return tuple(replace(term, roles=tuple(called[role] for role in term.roles)) for term in terms)


def _with_values(term: Term, values: Mapping[str, float | str]) -> Term:
    """A term with what the words say for "{distance}" and the like."""
    given = {
        key: values[value.strip("{}")] if isinstance(value, str) and value[:1] == "{" else value
        for key, value in term.parameters.items()
    }
    return replace(term, parameters=given)


def _by_kinds(entry: StateEntry, term: Term, kinds: Sequence[str]) -> Term:
    """With the values for these kinds, where none are given."""
    usual = entry.by_kinds.get("-".join(kinds), {})
    return replace(term, parameters={**usual, **term.parameters})


def _of_all(said: Said, subjects: tuple[str, ...], discourse: Discourse) -> tuple[Term, ...]:
    """The statements about every subject; for two also their relation."""
    if _is_mutual(said):
        return _mutual(said, subjects, discourse)
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


def _mutual(said: Said, subjects: tuple[str, ...], discourse: Discourse) -> tuple[Term, ...]:
    """What two are to each other."""
    if len(subjects) != 2:
        raise discourse.refuse(said.span, '{} needs two, such as "two people"')
    for name in subjects:
        _check_kind(said, said.entry.subject, name, discourse)
    pairs: tuple[tuple[str, ...], ...] = (subjects, subjects[::-1])
    if all(PREDICATES[term.predicate].symmetric for term in said.entry.holds):
        pairs = pairs[:1]
    return tuple(term for pair in pairs for term in _holds(said, pair, discourse))


def _simplified(clause: Clause, core: Said, discourse: Discourse) -> list[Said]:
    """The core and the relations after it."""
    relations = clause.parts(Said)
    denied = clause.polarity.is_denied
    stronger = next((r for r in relations if core.predicate in r.entry.replaces), None)
    if denied and stronger is not None:  # who does not walk towards something may walk
        core, relations = stronger, [r for r in relations if r != stronger]
    if denied and relations:
        rest = discourse.said(relations[0].span)
        discourse.note(f'"not" denies {{}} alone; to deny the rest say "not {rest}"', core.span)
    return [replace(core, is_denied=core.is_denied != denied), *relations]


def _without_replaced(
    terms: tuple[Term, ...], relations: Sequence[Said], discourse: Discourse
) -> tuple[Term, ...]:
    """What a relation says more exactly goes: "moves towards" is one statement, not two."""
    replaced = {name for one in relations for name in one.entry.replaces if not one.is_denied}
    return tuple(term for term in terms if term.negated or term.predicate not in replaced)


def _change(
    entry: StateEntry,
    said: tuple[Term, ...],
    terms: tuple[Term, ...],
    lasting: Lasting,
    discourse: Discourse,
) -> Piece:
    """The first statement holds, or does not, in phases that follow one another; of two, for both
    at once.
    """
    stated = said[0]
    changing = tuple(term for term in said if term.predicate == stated.predicate)
    least, most = discourse.assumed("change_min_s"), discourse.assumed("change_max_s")
    phases: list[Phase] = []
    count = len(entry.becomes)
    for number, is_so in enumerate(entry.becomes):
        now = tuple(replace(term, negated=term.negated == is_so) for term in changing)
        name = ("not " if now[0].negated else "") + stated.predicate
        name += " again" if name in (phase.name for phase in phases) else ""
        is_timed = number == count // 2 and lasting.is_said
        longest = _INFINITE if is_timed or (count, number) == (3, 1) else most
        times = lasting.within(least, longest) if is_timed else (least, longest)
        phases.append(Phase(name, now, *times))
    others = tuple(term for term in terms if term not in changing)
    name = "crosses" if count == 3 else "enters" if entry.becomes[-1] else "leaves"
    is_of_one = len(stated.roles) == 1 and not stated.parameters.get("zone")
    begins = is_of_one and entry.becomes == (False, True)
    change = Piece(tuple(phases), True, name, begins=begins)
    if not entry.settles:
        return throughout(change, others)
    settled = throughout(replace(change, phases=change.phases[-1:]), others)
    return replace(change, phases=(*change.phases[:-1], *settled.phases))


def _in_turn(
    terms: tuple[Term, ...],
    core: tuple[Term, ...],
    is_denied: bool,
    clause: Clause,
    discourse: Discourse,
) -> Piece:
    """One statement after the other, with what else is said throughout."""
    if is_denied or duration(clause, discourse).is_said:
        what = "of a way it is only said that it is gone, not how long, and not that it is not"
        raise discourse.refuse(clause.span, what)
    least, pause = discourse.assumed("change_min_s"), discourse.assumed("before_s")
    told = clause.parts(Delay)
    if told:
        pause = told[0].seconds
    else:
        what = f"{{}} is taken as at most {pause:g} s from the one to the other"
        discourse.note(what, clause.span)
    others = tuple(term for term in terms if term not in core)
    first, second = (f"in {term.parameters['zone']}" for term in core)
    phases = (
        Phase(first, (core[0], *others), least),
        Phase(f"then {second}", (core[1], *others), least, gap_s=pause),
    )
    return Piece(phases, True, "goes")


def with_distances(
    phases: tuple[Phase, ...], bounds: Sequence[Bound], discourse: Discourse
) -> tuple[Phase, ...]:
    """With these distances where it is said how near, or how far. Raises :class:`InputError` where
    it is not.
    """
    for bound in bounds:
        if not any(t.predicate == bound.predicate for phase in phases for t in phase.terms):
            what = f'{{}} of whom? Say "{discourse.said(bound.span)} of a vehicle"'
            raise discourse.refuse(bound.span, what)
        phases = tuple(
            replace(p, terms=tuple(_within(bound, term) for term in p.terms)) for p in phases
        )
    return phases


def _within(bound: Bound, term: Term) -> Term:
    if term.predicate != bound.predicate:
        return term
    return replace(term, parameters={**term.parameters, "tau_m": bound.metres})
