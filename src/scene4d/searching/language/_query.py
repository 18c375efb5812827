"""A search in words as an activity, and what was understood of it in lines to read."""

import math
import re
from collections.abc import Collection, Iterable, Mapping, Sequence
from contextlib import suppress
from dataclasses import dataclass, replace
from functools import cache
from itertools import combinations

from lark import Tree
from lark.exceptions import UnexpectedEOF, UnexpectedInput, UnexpectedToken

from scene4d.core.errors import InputError
from scene4d.core.tracks import CLASSES
from scene4d.searching.activities._checking import check_activity
from scene4d.searching.activities._terms import term_text
from scene4d.searching.activities.definition import Activity, Phase, Role
from scene4d.searching.language._composing import compose
from scene4d.searching.language._discourse import NOBODY, Discourse
from scene4d.searching.language._either import Reading, either
from scene4d.searching.language._grammar import Grammar, build_grammar
from scene4d.searching.language._lexicon import Refusal, read_lexicon
from scene4d.searching.language._pieces import Piece, exclude
from scene4d.searching.language._reading import read_tree
from scene4d.searching.language._refusals import refusal_at
from scene4d.searching.language._sentences import Choice, Clock, options_of
from scene4d.searching.language._times import window_of
from scene4d.searching.language._words import Word, read_words, refuse, refused
from scene4d.searching.predicates._when import Window

_MOST_EXPECTED = 12
"""Longer lists of what could be said instead are cut off."""


@dataclass(frozen=True)
class Query:
    """A search: its ``text``, the ``activity`` to look for, its ``predicates`` as lines such as
    ``near(person, vehicle)``, in their order, the time of day (``window``; None for any), and what
    the reader must know of how it was understood (``notes``).
    """

    text: str
    activity: Activity
    predicates: list[str]
    window: Window | None
    notes: list[str]


def parse_query(
    text: str,
    catalogue: Mapping[str, Activity],
    zones: Sequence[str] = (),
    lines: Sequence[str] = (),
) -> Query:
    """What a search in controlled English asks for; docs/search-language.md describes it.

    ``catalogue`` are the activities that may be asked for by their phrases, ``zones`` and
    ``lines`` the names of places. Raises :class:`InputError` for what is not understood, with the
    position (characters from 1) and, for a word, the nearest known ones; also for numbers that
    cannot be, and for somebody or a place that is not there.
    """
    by_name = _by_name(text, catalogue)
    if by_name is not None:
        return Query(text, by_name, [term_text(term) for term in by_name.terms], None, [])
    grammar = build_grammar(catalogue.values())
    vocabulary = grammar.vocabulary(tuple(zones), tuple(lines))

    named = any(vocabulary.word(name) and name in text.casefold() for name in (*zones, *lines))

    def read(said: str, quick: bool) -> list[Reading]:
        words = read_words(said, vocabulary)
        may_fail = quick or named or any(word.value == "or" for word in words)
        try:
            return [_one(said, words, grammar, catalogue, quick=may_fail)]
        except InputError:
            if named:  # a zone may be called "door"
                words = read_words(said, replace(vocabulary, names_first=True))
                with suppress(InputError):
                    return [_one(said, words, grammar, catalogue, quick=quick)]
            several = either(said, words, read, _are_alike)
            if several is not None:
                return several
            if named and not quick:
                return [_one(said, words, grammar, catalogue)]
            raise

    found = [one.query for one in read(text, False)]
    return found[0] if len(found) == 1 else _joined(text, found)


def _one(
    text: str,
    words: Sequence[Word],
    grammar: Grammar,
    catalogue: Mapping[str, Activity],
    *,
    quick: bool = False,
) -> Reading:
    """A search without alternatives; ``quick`` says less of what is not understood."""
    read, notes = read_tree(_parse(text, words, grammar, quick), text, grammar)
    sentences = sorted(options_of(read), key=lambda one: len(one.clocks))
    sentence = sentences[0]  # a time of day is that of the nearest words
    if len({one.clocks for one in sentences}) > 1:
        notes.append("the time of day is taken of the words beside it; say it first for the event")
    discourse = Discourse(text)
    alike = [one.order for one in sentences if one.clocks == sentence.clocks]
    orders = tuple(way for order in alike for way in options_of(order))
    piece = compose(Choice(orders), discourse)
    if any(one.absent for one in discourse.roles()) and len(piece.phases) > 1:
        raise refuse(text, 0, NOBODY)
    _check_possible(piece, discourse)
    activity = _activity(piece, discourse, text, catalogue)
    check_activity(activity)
    window = _window_of(sentence.clocks, discourse, notes)
    terms = [term_text(term) for term in activity.terms]
    for spot in activity.spots:
        terms += [f"{spot.name}: {term_text(term)}" for term in spot.activity.terms]
    notes = [*discourse.notes, *notes]
    return Reading(Query(text, activity, terms, window, notes), sentence)


def _check_possible(piece: Piece, discourse: Discourse) -> None:
    """Refuse what is never so at the same time."""
    for phase in piece.phases:
        for one, other in combinations(phase.terms, 2):
            if exclude(one, other):
                said = f"{term_text(one)} and {term_text(other)} are never so at the same time"
                what = f'{said}; say one of them, or what comes first, as in "A, then B"'
                raise refuse(discourse.text, 0, what)


def _joined(text: str, found: Sequence[Query]) -> Query:
    """A search for any of several things."""
    roles: dict[str, Role] = {}
    for role in (role for one in found for role in one.activity.roles):
        known = roles.setdefault(role.name, role)
        classes = tuple(c for c in CLASSES if c in {*known.classes, *role.classes})
        roles[role.name] = replace(known, classes=classes)
    spots = {spot.name: spot for one in found for spot in one.activity.spots}
    either = tuple(one.activity for one in found)
    name, who = " ".join(text.split()), tuple(roles.values())
    activity = Activity(name, who, (), spots=tuple(spots.values()), alternatives=either)
    windows = list(dict.fromkeys(one.window for one in found if one.window is not None))
    notes = dict.fromkeys(note for one in found for note in one.notes)
    if len(windows) > 1:
        raise refuse(text, 0, "two times of day; one search asks for one")
    if windows and None in [one.window for one in found]:
        notes[f"the time of day, {windows[0]}, is taken of every alternative"] = None
    predicates = [f"{one.activity.name}: {line}" for one in found for line in one.predicates]
    return Query(text, activity, predicates, next(iter(windows), None), list(notes))


def explain(activity: Activity, window: Window | None, notes: Sequence[str]) -> list[str]:
    """The decomposition as text: who, the phases with their durations and terms, when, notes."""
    lines = []
    for number, one in enumerate(activity.alternatives):
        lines += [f'{"or" if number else "either"} "{one.name}"', *_indented(one)]
    lines += [] if activity.alternatives else _explained(activity)
    for spot in activity.spots:
        lines += [f'spot "{spot.name}": another one, {spot.when}', *_indented(spot.activity)]
    if window is not None:
        lines.append(f"time of day: {window}")
    return [*lines, *(f"note: {note}" for note in notes)]


def _indented(activity: Activity) -> list[str]:
    return [f"   {line}" for line in _explained(activity)]


def _explained(activity: Activity) -> list[str]:
    lines = [f"{role.name}: {_how_many(role)}" for role in activity.roles]
    for number, phase in enumerate(activity.phases, 1):
        pause = f", at most {phase.gap_s:g} s later" if number > 1 and phase.gap_s else ""
        lines.append(f"{number}. {phase.name}{_lasting(phase)}{pause}")
        lines += [f"   {term_text(term)}" for term in phase.terms]
    return [*lines, *(f"{r.first} {r.relation} {r.second}" for r in activity.relations)]


def _how_many(role: Role) -> str:
    said = " or ".join(role.classes)
    if role.is_counted:
        said = f"{role.how_many} at the same time, one of them throughout, {said}"
    return f"{said}, of whom there is none" if role.absent else said


def _lasting(phase: Phase) -> str:
    if math.isinf(phase.max_s):
        return f", at least {phase.min_s:g} s" if phase.min_s else ""
    return f", {phase.min_s:g} to {phase.max_s:g} s"


def _by_name(text: str, catalogue: Mapping[str, Activity]) -> Activity | None:
    """The activity whose name, or name in other people's data, the text is; such names have "_"."""
    name = text.strip().casefold()
    if "_" not in name:
        return None
    found = (one for one in catalogue.values() if name in (one.name.casefold(), *one.labels))
    return catalogue.get(name) or next(found, None)


def _activity(
    piece: Piece, discourse: Discourse, text: str, catalogue: Mapping[str, Activity]
) -> Activity:
    """The catalogue's own where it was asked for alone, else one named as it was said."""
    used = {role for phase in piece.phases for term in phase.terms for role in term.roles}
    roles = tuple(role for role in discourse.roles() if role.name in used)
    known = catalogue.get(piece.name) or Activity(" ".join(text.split()), (), ())
    how = {"phases": piece.phases, "relations": piece.relations, "spots": discourse.spots}
    return replace(known, roles=roles, **how)  # type: ignore[arg-type]


def _window_of(clocks: Sequence[Clock], discourse: Discourse, notes: list[str]) -> Window | None:
    """The one time of day that a search asks for.

    Raises :class:`InputError` where two are said, or one that holds no time.
    """
    if not clocks:
        return None
    if len(clocks) > 1:
        raise discourse.refuse(clocks[1].span, "a second time of day; one search asks for one")
    clock = clocks[0]
    window = window_of(clock, discourse.text, clock.span)
    if clock.at is not None:
        notes.append(f'"{discourse.said(clock.span)}" is taken as {window}')
    if window.begin_s >= window.end_s:
        notes.append(f"the time of day {window} goes over midnight")
    return window


# What is not understood --------------------------------------------------------------------------


def _parse(text: str, words: Sequence[Word], grammar: Grammar, quick: bool) -> Tree:
    try:
        return grammar.parse(words, quick=quick)
    except UnexpectedInput as error:
        unknown = InputError(f'search "{text}": it is not understood')
        if quick:
            raise unknown from None
        known = _refused_in(text, words, grammar)
        if known is None and isinstance(error, UnexpectedToken):
            known = _unexpected(text, error, words, grammar)
        elif known is None and isinstance(error, UnexpectedEOF):
            known = _too_early(text, error, words[-1], grammar)
        raise known or unknown from None


def _too_early(text: str, error: UnexpectedEOF, last: Word, grammar: Grammar) -> InputError:
    if last.kind == "number":
        return _no_unit(text, last)
    known = _spoken(error.expected, grammar)
    return refuse(text, last.end, f'it ends too early after "{last.surface}"; {known}')


def _refused_in(text: str, words: Sequence[Word], grammar: Grammar) -> InputError | None:
    """The refusal of a word that may also mean something else, where it cannot here."""
    for word in words:
        if word.kind == "word":
            found = refusal_at(text, word.start, False)
            if found is not None and _is_said(word, found[1]):
                return refused(text, word.start, *found)
    return None


def _is_said(word: Word, refusal: Refusal) -> bool:
    """Whether this very word is refused, or its base form where no other is known: who is "parked"
    is in no park.
    """
    forms = {piece for pattern in refusal.words for piece in re.split(r"[ |=?]+", pattern)}
    surface = word.surface.casefold()
    return surface in forms or (word.value in forms and word.value != "park")


def _unexpected(
    text: str, error: UnexpectedToken, words: Sequence[Word], grammar: Grammar
) -> InputError:
    start = error.token.start_pos or 0
    word = next((word for word in words if word.start == start), words[-1])
    before = [other for other in words if other.end <= start]
    units = _kinds()["a unit"]
    if word.kind in ("zone", "line"):
        say = "in zone" if word.kind == "zone" else "crosses line"
        what = f'"{word.surface}" is a {word.kind}, neither person nor vehicle'
        return refuse(text, start, f'{what}; say "{say} {word.value}", or draw a zone there')
    if any(word.value in words for _, words in read_lexicon().units["speed"]):
        what = f'"{word.surface}": say "faster than" or "slower than" for a speed'
        return refuse(text, start, what)
    if before and before[-1].kind == "number" and word.value not in units:
        return _no_unit(text, before[-1])
    after = f' after "{before[-1].surface}"' if before else " at the beginning"
    known = _spoken(error.expected, grammar)
    return refuse(text, start, f'"{word.surface}" is not understood{after}; {known}')


def _no_unit(text: str, number: Word) -> InputError:
    return refuse(text, number.start, f'"{number.surface}" needs a unit, such as m, s or km/h')


def _spoken(expected: Collection[str], grammar: Grammar) -> str:
    """What could stand there instead: kinds of words, and the words that are of none."""
    there = {word for word, token in grammar.terminals.items() if token in expected}
    said: list[str] = []
    for kind, words in _kinds().items():
        if there & words:
            said.append(kind)
            there -= words
    named = {"NUMBER": "a number", "CLOCK": "a time of day", "ZONE": "a zone", "LINE": "a line"}
    said += [what for name, what in named.items() if name in expected and what not in said]
    said += [f'"{word}"' for word in sorted(there)]
    if not said:
        return "nothing more was expected"
    more = ", ..." if len(said) > _MOST_EXPECTED else ""
    return f"expected: {', '.join(said[:_MOST_EXPECTED])}{more}"


@cache
def _kinds() -> dict[str, frozenset[str]]:
    """Words by what they are called to a reader."""
    lexicon = read_lexicon()

    def first(tables: Iterable[Iterable[str]]) -> frozenset[str]:
        return frozenset(p.split()[0] for table in tables for p in table if p[0] not in "{$")

    tables = (lexicon.articles, lexicon.pronouns, lexicon.colours)
    who = [words for table in tables for words in table.values()]
    who += [entry.words for entry in lexicon.nouns] + [one.words for one in lexicon.adjectives]
    does = [entry.words for entry in lexicon.verbs.values()]
    does += [entry.verb for entry in lexicon.states] + [lexicon.sets["auxiliary"], ("be",)]
    return {
        "a person or vehicle": frozenset(word for words in who for word in words),
        'what they do (such as "enters", "is near")': first(does),
        'where (such as "near", "in zone")': first(entry.relation for entry in lexicon.states),
        "a unit": first(words for table in lexicon.units.values() for _, words in table),
        "a number": first(words for _, words in lexicon.numbers),
    }


def _are_alike(one: Word, other: Word) -> bool:
    """Whether "or" may join what begins with these words: both begin a noun, or neither."""
    kinds = _kinds()
    nouns = kinds["a person or vehicle"] | kinds["a number"]
    return (one.value in nouns) == (other.value in nouns)
