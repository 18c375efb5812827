"""Parse trees as sentences."""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from lark import Token, Transformer, Tree, v_args
from lark.exceptions import VisitError

from scene4d.searching.language._doing import NOT_OF_ACTIVITIES
from scene4d.searching.language._grammar import Grammar
from scene4d.searching.language._lexicon import Adjective, Lexicon, base_forms
from scene4d.searching.language._sentences import (
    Bound,
    Chain,
    Choice,
    Clause,
    Clock,
    Done,
    Joined,
    Lasting,
    Noun,
    Pair,
    Place,
    Polarity,
    Said,
    Sentence,
    Span,
    options_of,
)
from scene4d.searching.language._words import Amount, amount_of, read_clock, read_number, refuse
from scene4d.searching.predicates._relation import SIDES

_WEIGHED = (Clause, Done, Said, Chain, Joined, Sentence)
"""Where these have several readings, the composer takes the one that makes sense."""
_CLOCKS = {
    "between_clock": ("begin", "end"),
    "after_clock": ("begin",),
    "before_clock": ("end",),
    "at_clock": ("at",),
}
"""What the times of day in a rule are."""
_BOUNDS = {"within": "near", "beyond": "far"}
_TRANSPARENT = (
    *("activity", "whole", "state", "relation", "predication", "subject", "article", "pronoun"),
    *("unit_distance", "unit_duration", "unit_speed"),
)
"""Rules that pass on their content."""


@dataclass(frozen=True)
class _Mark:
    """A rule that only records which words were used."""

    name: str
    words: tuple[str, ...] = ()


@dataclass(frozen=True)
class _Owner:
    noun: Noun


@dataclass(frozen=True)
class _Pause:
    seconds: float | None


def _all(children: Iterable[Any], *kinds: type) -> list[Any]:
    return [child for child in children if isinstance(child, kinds)]


def _first(children: Iterable[Any], *kinds: type) -> Any:
    return next(iter(_all(children, *kinds)), None)


def _span(meta: Any) -> Span:
    return (meta.start_pos, meta.end_pos) if not meta.empty else (0, 0)


def _hull(span: Span, nodes: Iterable[Any]) -> Span:
    """The span, including those of the parts; a tree of several readings has none of its own."""
    spans = [span]
    for node in nodes:
        for option in options_of(node):
            if isinstance(option, Pair):
                spans.append(_hull(span, (option.first, option.second)))
            elif hasattr(option, "span"):
                spans.append(option.span)
    there = [(start, end) for start, end in spans if end > start]
    return (min(s for s, _ in there), max(e for _, e in there)) if there else span


def read_tree(tree: Tree, text: str, grammar: Grammar) -> tuple[Sentence | Choice, list[str]]:
    """The sentence of a tree, or several readings, with notes on other possible readings.

    Raises :class:`InputError` for impossible numbers and times.
    """
    reader = _Reader(text, grammar)
    try:
        return reader.transform(tree), reader.notes
    except VisitError as error:  # whatever is raised within comes wrapped
        raise error.orig_exc from None


@v_args(meta=True)
class _Reader(Transformer):
    """The meaning of the grammar's rules, bottom up; one method per rule, by name."""

    def __init__(self, text: str, grammar: Grammar) -> None:
        super().__init__(visit_tokens=False)
        self._text = text
        self._grammar = grammar
        self._lexicon: Lexicon = grammar.lexicon
        self.notes: list[str] = []

    # Rules by their number ------------------------------------------------------------------------

    def __default__(self, data: Any, children: list, meta: Any) -> Any:
        name, span = str(data), _span(meta)
        stem, _, number = name.rpartition("_")
        if number.isdigit():
            if stem in {"activity", "whole"}:
                return self._done(int(number), children, span)
            if stem in {"state", "relation"}:
                return self._said(int(number), children, span)
            if stem.startswith("unit_"):
                return self._lexicon.units[stem.removeprefix("unit_")][int(number)][0]
        if name in {"adjective", "number_word"}:
            return self._by_words(name, children)
        if name in {"zone", "line"}:
            return Place(name, str(_first(children, Token)), span)
        if name in self._lexicon.units:
            return amount_of(name, _all(children, Fraction), self._text, span)
        if name in _BOUNDS:
            return Bound(_first(children, Amount).value, _BOUNDS[name], span)
        if name in _CLOCKS:
            return self._clock(name, children, span)
        if name in _TRANSPARENT:
            return children[0]
        if name.startswith("t_"):
            owner = _first(children, Noun)
            return _Mark(name) if owner is None else _Owner(owner)
        return _Mark(name, self._words_of(children))

    def _by_words(self, name: str, children: list) -> Adjective | Fraction:
        """The adjective, or the number, that has these words."""
        said = " ".join(self._words_of(children))
        if name == "adjective":
            return next(entry for entry in self._lexicon.adjectives if said in entry.words)
        return next(number for number, words in self._lexicon.numbers if said in words)

    def _words_of(self, children: list) -> tuple[str, ...]:
        words = (
            c.words if isinstance(c, _Mark) else (str(c),) for c in _all(children, _Mark, Token)
        )
        return tuple(word for said in words for word in said)

    def _ambig(self, children: list) -> Any:
        options: list[Any] = []
        for child in children:
            for option in child.options if isinstance(child, Choice) else (child,):
                if option not in options:
                    options.append(option)
        if len(options) > 1 and not isinstance(options[0], _WEIGHED):
            return self._taken(options)
        return options[0] if len(options) == 1 else Choice(tuple(options))

    def _taken(self, options: Sequence[Any]) -> Any:
        """The first of several readings, with a note."""
        start, end = getattr(options[0], "span", (0, len(self._text)))
        said = self._text[start:end]
        self.notes.append(f'"{said}" can be read in {len(options)} ways; one of them is taken')
        return options[0]

    def _done(self, number: int, children: list, span: Span) -> Done:
        if any(polarity.is_denied for polarity in _all(children, Polarity)):
            raise refuse(self._text, span[0], NOT_OF_ACTIVITIES)
        owner = _first(children, _Owner)
        return Done(
            self._grammar.spoken[number],
            tuple(_all(children, Noun)),
            tuple(_all(children, Place)),
            owner.noun if owner else None,
            span,
        )

    def _said(self, number: int, children: list, span: Span) -> Said:
        entry = self._lexicon.states[number]
        values: dict[str, float | str] = {}
        for child in _all(children, Amount):
            values[child.kind] = child.value
        for place in _all(children, Place):
            if place.name is None:
                raise refuse(self._text, place.span[0], f"which {place.kind}? Say its name")
            values[place.kind] = place.name
        for mark in _all(children, _Mark):
            if mark.name.removeprefix("s_") in SIDES:
                values["side"] = mark.name.removeprefix("s_")
        given = {parameter: values[name] for name, parameter in entry.values.items()}
        return Said(entry, tuple(_all(children, Noun)), given, span)

    # Order ----------------------------------------------------------------------------------------

    def start(self, _meta: Any, children: list) -> Sentence:
        order = _first(children, Chain, Choice)
        return Sentence(order, tuple(_all(children, Clock)))

    def chain(self, _meta: Any, children: list) -> Chain:
        steps, pauses = _all(children, Joined, Choice), _all(children, _Pause)
        seconds = tuple(pause.seconds for pause in pauses)
        return Chain(tuple(steps), seconds, ("then",) * len(pauses))

    def then(self, _meta: Any, children: list) -> _Pause:
        return _first(children, _Pause) or _Pause(None)

    def first_second(self, _meta: Any, children: list) -> Chain:
        return self._before(children, in_order=True)

    def second_first(self, _meta: Any, children: list) -> Chain:
        return self._before(children, in_order=False)

    def _before(self, children: list, in_order: bool) -> Chain:
        word = next(mark.words[0] for mark in _all(children, _Mark) if mark.words)
        steps = _all(children, Chain, Choice)
        pause = _first(children, _Pause)
        ordered = steps if in_order else steps[::-1]
        return Chain(tuple(ordered), (pause.seconds if pause else None,), (word,))

    def pause(self, _meta: Any, children: list) -> _Pause:
        amount = _first(children, Amount)
        return _Pause(amount.value if amount else self._lexicon.assumed["immediately_s"])

    pause_to = pause

    def joined(self, _meta: Any, children: list) -> Joined:
        links = [m.name.removeprefix("link_") for m in _all(children, _Mark)]
        return Joined(tuple(_all(children, Clause, Choice)), tuple(links))

    # Clauses --------------------------------------------------------------------------------------

    def clause(self, meta: Any, children: list) -> Clause:
        span = _span(meta)
        parts = list(children)
        subject = None
        head = parts[0]
        if isinstance(head, Noun | Pair):
            subject = parts.pop(0)
        polarity = _first(parts, Polarity) or Polarity(False, False)
        parts = [part for part in parts if not isinstance(part, Polarity)]
        return Clause(subject, polarity, parts[0], tuple(parts[1:]), _hull(span, children))

    def modifier(self, _meta: Any, children: list) -> Any:
        denied = any(isinstance(child, _Mark) for child in children)
        said = next(child for child in children if not isinstance(child, _Mark))
        said = self._taken(said.options) if isinstance(said, Choice) else said
        return _denied(said) if denied else said

    def denied(self, _meta: Any, children: list) -> Polarity:
        return Polarity(True, False)

    def affirmed(self, _meta: Any, children: list) -> Polarity:
        forms = [w for mark in _all(children, _Mark) for w in mark.words]
        return Polarity(False, any(form == "be" or "be" in base_forms(form) for form in forms))

    # Nouns ----------------------------------------------------------------------------------------

    def noun(self, meta: Any, children: list) -> Noun:
        relatives = next((child for child in children if isinstance(child, tuple)), ())
        return self._noun(_span(meta), children, relatives)

    def _noun(self, span: Span, children: list, relatives: tuple) -> Noun:
        marks = {mark.name: mark for mark in _all(children, _Mark)}
        if "s_each_other" in marks:
            return Noun("any", (), "reciprocal", "each other", span)
        pronoun = next((name for name in marks if name.startswith("pronoun_")), None)
        if pronoun:
            kind = pronoun.removeprefix("pronoun_")
            return Noun(kind, (), "pronoun", " ".join(marks[pronoun].words), span)
        word = marks["noun_word"].words[0]
        entry = self._lexicon.noun(word)
        assert entry is not None
        articles = {name.removeprefix("article_") for name in marks if name.startswith("article_")}
        if "s_else" in marks:
            articles = {"new"}
        if word in entry.indefinite and not articles:
            articles = {"indefinite"}
        surface = self._text[slice(*span)].casefold()
        return Noun(
            entry.kind,
            entry.classes,
            _introduced(articles),
            word,
            span,
            tuple(_all(children, Adjective)),
            relatives,
            word == "people" or re.search(rf"\b{re.escape(word)}\b", surface) is None,
        )

    def relative(self, _meta: Any, children: list) -> tuple:
        polarity = _first(children, Polarity)
        said = next(child for child in children if isinstance(child, Said | Choice))
        said = self._taken(said.options) if isinstance(said, Choice) else said
        return (_denied(said) if polarity and polarity.is_denied else said,)

    def pair(self, _meta: Any, children: list) -> Pair:
        first, second = _all(children, Noun)
        return Pair(first, second)

    def two(self, meta: Any, children: list) -> Pair:
        noun = replace(self._noun(_span(meta), children, ()), is_plural=False)
        return Pair(replace(noun, article="indefinite"), replace(noun, article="new"))

    # Places and amounts ---------------------------------------------------------------------------

    def unnamed_zone(self, meta: Any, _children: list) -> Place:
        return Place("zone", None, _span(meta))

    def number(self, meta: Any, children: list) -> Fraction:
        found = children[0]
        if isinstance(found, Fraction):
            return found
        return read_number(str(found), self._text, _span(meta)[0])

    # How long -------------------------------------------------------------------------------------

    def lasts_at_least(self, meta: Any, children: list) -> Lasting:
        return Lasting(_first(children, Amount).value, None, _span(meta))

    def lasts_at_most(self, meta: Any, children: list) -> Lasting:
        return Lasting(None, _first(children, Amount).value, _span(meta))

    def lasts_between(self, meta: Any, children: list) -> Lasting:
        amounts = _all(children, Amount)
        most = amounts[-1].value
        shared = _first(children, Fraction)  # "5 to 10 minutes": the unit is said once
        least = amounts[0].value if shared is None else float(shared * amounts[-1].unit)
        if not 0 < least <= most:
            raise refuse(self._text, _span(meta)[0], "the shorter time comes first")
        return Lasting(least, most, _span(meta))

    # The clock ------------------------------------------------------------------------------------

    def clock(self, meta: Any, children: list) -> float:
        child = children[0]
        word = child.words[0] if isinstance(child, _Mark) else str(child)
        return read_clock(self._lexicon.clock.get(word, word), self._text, _span(meta)[0])

    def _clock(self, name: str, children: list, span: Span) -> Clock:
        times = dict(zip(_CLOCKS[name], _all(children, float), strict=True))
        return replace(Clock(None, None, None, span), **times)

    def part_of_day(self, meta: Any, children: list) -> Clock:
        word = next(m.words[0] for m in _all(children, _Mark) if m.name == "day_word")
        begin, end = (read_clock(time, self._text, 0) for time in self._lexicon.day[word])
        return Clock(begin, end, None, _span(meta))


def _introduced(articles: set[str]) -> str:
    """How a noun is introduced: "the other" is already known, "another" is new."""
    if "new" in articles:
        return "other" if "definite" in articles else "new"
    return next(iter(sorted(articles)), "bare")


def _denied(node: Any) -> Any:
    return replace(node, is_denied=not node.is_denied) if isinstance(node, Said) else node
