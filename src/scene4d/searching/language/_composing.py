"""Sentences as activities: roles for nouns, terms for states, phases for what comes in order."""

from collections.abc import Callable
from dataclasses import replace
from typing import Any

from scene4d.searching.language._discourse import Discourse
from scene4d.searching.language._doing import activity_of
from scene4d.searching.language._lexicon import base_forms, read_lexicon
from scene4d.searching.language._pieces import (
    Piece,
    choose,
    during,
    exclude,
    in_order,
    shortest_of,
    state,
    throughout,
)
from scene4d.searching.language._saying import pair_of, state_of
from scene4d.searching.language._sentences import (
    Chain,
    Choice,
    Clause,
    Delay,
    Done,
    Joined,
    Lasting,
    Said,
    Span,
    options_of,
)
from scene4d.searching.language._spotting import with_spots

_RESTS = ("stationary", "staying", "stooping")


def compose(order: Chain | Choice, discourse: Discourse) -> Piece:
    """The search as one piece. Of several readings the likeliest that makes sense is taken, with a
    note on the others. Raises :class:`InputError` where none makes sense.
    """
    return _fewest(order, discourse, _whole)


def _whole(chain: Chain, discourse: Discourse) -> Piece:
    piece = _step(chain, discourse)
    if piece.delay is not None:
        said = discourse.said(piece.delay.span)
        what = f'{{}} of what? Say first what comes before, as in "vehicle stops, then {said} ..."'
        raise discourse.refuse(piece.delay.span, what)
    return piece


def _fewest(
    node: Chain | Joined | Choice, discourse: Discourse, read: Callable[[Any, Discourse], Piece]
) -> Piece:
    """The reading with the fewest people; a note where another means something else."""
    return choose(options_of(node), read, discourse, "it", lambda _, known: len(known.people))


def _step(chain: Joined | Chain, discourse: Discourse) -> Piece:
    """What comes in order, or what is so at the same time."""
    if isinstance(chain, Joined):
        return _joined(chain, discourse)
    whole, *pieces = _steps(chain, discourse)
    for piece, pause, word in zip(pieces, chain.pauses, chain.words, strict=True):
        if pause is None and piece.delay is not None:
            pause = piece.delay.seconds
        if pause is None:
            pause = discourse.assumed("then_s" if word == "then" else "before_s")
            other = "then within 10 seconds" if word == "then" else f"within 10 seconds {word}"
            what = f'"{word}" is taken as at most {pause:g} s later; say for example'
            discourse.note(f'{what} "{other}" for another pause')
        whole = in_order(whole, piece, pause)
    return whole


def _steps(chain: Chain, discourse: Discourse) -> list[Piece]:
    """The pieces in their order, read as they were said: "leaves after entering" names who enters
    before. Where this makes no sense they are read in their order.
    """

    def read(order: int, known: Discourse) -> list[Piece]:
        return [_fewest(step, known, _step) for step in chain.steps[::order]][::order]

    orders = (-1, 1) if chain.is_turned else (1,)
    _, pieces, known = discourse.trying(orders, read)[0]
    discourse.adopt(known)
    return pieces


def _joined(joined: Joined, discourse: Discourse) -> Piece:
    whole = _clause(joined.clauses[0], discourse)
    begin = _span(joined.clauses[0])[0]
    for before, clause, link in zip(joined.clauses, joined.clauses[1:], joined.links, strict=False):
        _check_agreement(options_of(before)[0], options_of(clause)[0], discourse)
        piece = _clause(clause, discourse)
        whole = _together(whole, piece, link, (begin, _span(clause)[1]), discourse)
    return whole


def _check_agreement(first: Clause, second: Clause, discourse: Discourse) -> None:
    """Refuse "a person in zone A and a car stop": of both is meant what is read of one."""
    has_verb = first.core is not None and not (
        isinstance(first.core, Said) and not first.core.is_verb
    )
    nouns = second.subjects
    if has_verb or first.polarity.is_state or first.polarity.is_denied or len(nouns) != 1:
        return
    verb = discourse.text[nouns[0].span[1] : second.span[1]].split()[:1]
    is_plural = verb in (["are"], ["have"], ["do"]) or (verb and _is_base(verb[0], discourse))
    if is_plural and nouns[0].article in ("indefinite", "definite") and not nouns[0].is_plural:
        raise discourse.refuse(first.span, "of both, or of the last? Say each in full")


def _is_base(word: str, discourse: Discourse) -> bool:
    """Whether a verb is in the form that several have: "a car and a truck stop"."""
    lexicon = read_lexicon()
    verbs = [w for entry in lexicon.verbs.values() for w in entry.words]
    verbs += [w for entry in lexicon.states for w in entry.verb]
    return word.casefold() in {w.split()[0] for w in verbs if w[0] not in "{$"} and not base_forms(
        word.casefold()
    )


def _together(first: Piece, second: Piece, link: str, span: Span, discourse: Discourse) -> Piece:
    """Two pieces at the same time, or in order where "and" cannot mean that."""
    if link == "while":
        return _while(first, second, span, discourse)
    if second.delay is not None:
        return in_order(first, second, second.delay.seconds)
    if first.is_event and second.is_event:
        return _and_then(first, second, discourse)
    if first.is_event or second.is_event:
        event, other = (first, second) if first.is_event else (second, first)
        if other.is_instant or other.is_timed or other.is_motion or _contradict(event, other):
            return _and_then(first, second, discourse)
        return throughout(event, other.terms)
    if _is_moment_in(first, second, discourse) or _is_moment_in(second, first, discourse):
        return _and_then(first, second, discourse)
    if _contradict(first, second) or _settles(first, second) or _settles(second, first):
        return _and_then(first, second, discourse)
    return _merged(first, second, span, discourse)


def _contradict(first: Piece, second: Piece) -> bool:
    """Whether a statement of a state excludes one of another piece."""
    terms = (term for phase in first.phases for term in phase.terms)
    changing = [term for term in second.terms if term.predicate != "coloured"]
    return any(exclude(one, other) for one in terms for other in changing)


def _settles(first: Piece, second: Piece) -> bool:
    """Whether one is somebody's moving, and the other that he rests: he walks up and crouches."""
    rests = {term.roles[0] for term in second.terms if term.predicate in _RESTS}
    moves = {term.roles[0] for term in first.terms}
    return first.is_motion and not second.is_motion and bool(rests & moves)


def _while(first: Piece, second: Piece, span: Span, discourse: Discourse) -> Piece:
    """Two pieces at the same time: the shorter within the longer where they cannot be one."""
    for inner, outer in ((first, second), (second, first)):
        if _is_moment_in(inner, outer, discourse):
            return during(inner, outer)
        if inner.is_event and not outer.is_event and not outer.is_instant:
            return during(inner, outer) if outer.is_timed else throughout(inner, outer.terms)
        if inner.is_instant and outer.is_event and len(outer.phases) == 1:
            return during(inner, outer)
    if first.is_event or second.is_event:
        what = '"while" or "when" needs a state that lasts at one side, such as "is near a vehicle"'
        raise discourse.refuse(span, what)
    return _merged(first, second, span, discourse)


def _is_moment_in(inner: Piece, outer: Piece, discourse: Discourse) -> bool:
    """Whether one is a moment, and the other a state that is said to last longer."""
    moment_s = discourse.assumed("instant_max_s")
    longer = outer.least_s is not None and outer.least_s > moment_s
    return inner.is_instant and not outer.is_instant and not outer.is_event and longer


def _and_then(first: Piece, second: Piece, discourse: Discourse) -> Piece:
    pause = discourse.assumed("then_s")
    what = f'"and" between "{first.label}" and "{second.label}" is taken as "then", at most'
    discourse.note(
        f'{what} {pause:g} s later; say "then", or "is ..." for what is so at the same time'
    )
    return in_order(first, second, pause)


def _merged(first: Piece, second: Piece, span: Span, discourse: Discourse) -> Piece:
    """Two states that hold together, as long as both may."""
    both = [Lasting(one.least_s, one.most_s, span) for one in (first, second)]
    is_instant = first.is_instant or second.is_instant
    lasting = shortest_of(both, span, discourse)
    usual_s = max(first.phases[0].min_s, second.phases[0].min_s)
    terms = (*first.terms, *second.terms)
    return state(terms, lasting, is_instant, discourse, None if is_instant else usual_s)


def _clause(clause: Clause | Choice, discourse: Discourse) -> Piece:
    """The reading that is meant: an activity, unless "is" or "not" ask for a state."""
    readings = [
        replace(option, core=core)
        for option in options_of(clause)
        for core in options_of(option.core)
    ]
    what = f'"{discourse.said(_span(clause))}"'
    return choose(readings, _read, discourse, what, lambda one, _: _rank(one))


def _read(clause: Clause, discourse: Discourse) -> Piece:
    delay = next(iter(clause.parts(Delay)), None)
    if clause.core is None:
        what = '{} does what? Say for example "a person stands for 10 seconds"'
        raise discourse.refuse(clause.span, what)
    clause = with_spots(clause, discourse, _clause)
    _check_exactly(clause, discourse)
    if isinstance(clause.core, Done):
        piece = _done(clause, clause.core, discourse)
    else:
        assert isinstance(clause.core, Said)
        piece = state_of(clause, clause.core, discourse)
    of_way = isinstance(clause.core, Said) and clause.core.entry.in_turn
    return piece if delay is None or of_way else replace(piece, delay=delay)


def _check_exactly(clause: Clause, discourse: Discourse) -> None:
    """Refuse exactly so many who do something, or are something to one another."""
    core = clause.core
    said = [one for one in (core, *clause.modifiers) if isinstance(one, Said)]
    mutual = any(one.entry.mutual for one in said)
    nouns = clause.subjects if isinstance(core, Done) or mutual else ()
    nouns += core.nouns if isinstance(core, Done) else ()
    for noun in nouns:
        if noun.exactly:
            what = 'exactly so many can be said of what they are, as in "are in zone NAME"'
            raise discourse.refuse(noun.span, what)


def _done(clause: Clause, done: Done, discourse: Discourse) -> Piece:
    """An activity; of two who cannot do it as one, one after the other."""
    nouns = clause.subjects
    if len(nouns) == 1 and nouns[0].count == 2:
        nouns = pair_of(nouns[0])
    if len(nouns) != 2:
        return activity_of(clause, done, discourse)
    if any(noun.article == "reciprocal" for noun in done.nouns):  # the one does it to the other
        others = tuple(nouns[1] if n.article == "reciprocal" else n for n in done.nouns)
        clause, done = replace(clause, subjects=nouns[:1]), replace(done, nouns=others)
        return activity_of(clause, done, discourse)

    def apart(known: Discourse) -> Piece:
        first = activity_of(replace(clause, subjects=nouns[:1]), done, known)
        objects = tuple(replace(n, article="definite", count=1) for n in done.nouns)
        again = replace(done, nouns=objects)
        both = known.subject
        second = activity_of(replace(clause, subjects=nouns[1:]), again, known)
        known.subject = (*both, *known.subject)
        return _and_then(first, second, known)

    def whole(known: Discourse) -> Piece:
        return activity_of(clause, done, known)

    ways = discourse.trying((whole, apart), lambda way, known: way(known))
    _, piece, known = ways[0]
    discourse.adopt(known)
    return piece


def _rank(clause: Clause) -> tuple[int, int, bool]:
    """Smaller is likelier: the reading with fewer loose parts, then what is preferred here.

    A state is preferred where it is denied, said with "is", or said to last; the passive has a "be"
    of its own.
    """
    core = clause.core
    is_timed = bool(clause.parts(Lasting))
    wants_state = clause.polarity.is_denied or clause.polarity.is_state or is_timed
    if isinstance(core, Done):
        passive = any(one.is_passive for one in core.meant)
        short = all(one.is_short for one in core.meant)
        is_cut = any(one.is_short for one in core.meant)
        loose = is_cut and any(said.spot is not None for said in clause.parts(Said))
        return (len(clause.modifiers) + loose, int(wants_state and not passive), short)
    return (len(clause.modifiers), int(not wants_state), False)


def _span(clause: Clause | Choice) -> Span:
    span: Span = options_of(clause)[0].span
    return span
