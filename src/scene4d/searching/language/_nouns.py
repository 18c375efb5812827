"""Nouns in parse trees: who, how many, described how, and of which colour ("in a dark jacket")."""

import re
from collections.abc import Sequence
from dataclasses import replace
from fractions import Fraction
from typing import Any

from lark import Token, v_args

from scene4d.core.colours import is_colour
from scene4d.core.tracks import CLASSES
from scene4d.searching.activities.definition import Term
from scene4d.searching.language._lexicon import Adjective, StateEntry, read_lexicon
from scene4d.searching.language._sentences import Choice, Noun, Polarity, Said, options_of
from scene4d.searching.language._times import (
    Mark,
    TimeReader,
    all_of,
    first_of,
    marks_of,
    span_of,
    value_of,
)
from scene4d.searching.language._words import read_number, refuse

_SEVERAL, _MOST_COUNTED = 3, 100
"""How many several are, and the largest number of people that can be asked for; chosen by hand."""


@v_args(meta=True)
class NounReader(TimeReader):
    """The meaning of the rules that say who; one method per rule, by name."""

    def noun(self, meta: Any, children: list) -> Noun:
        span, marks = span_of(meta), marks_of(children)
        if "s_each_other" in marks:
            return Noun("any", (), "reciprocal", "each other", span)
        if "s_new_one" in marks:
            return Noun("any", (), "new", "another", span)
        pronoun = next((name for name in marks if name.startswith("pronoun_")), None)
        if pronoun:
            kind = pronoun.removeprefix("pronoun_")
            return Noun(kind, (), "pronoun", marks[pronoun], span)
        nouns = [mark for mark in all_of(children, Mark) if mark.name == "noun_word"]
        words = [" ".join(mark.words) for mark in nouns]
        word = words[0]
        said = [(one, w) for w in words if (one := read_lexicon().noun(w)) is not None]
        entry = said[0][0]
        kinds = {one.kind for one, _ in said}
        classes = [name for one, _ in said for name in one.classes]
        adjectives = all_of(children, Adjective)
        if entry.adjective:
            adjectives.append(read_lexicon().adjective(entry.adjective))
        articles = {name.removeprefix("article_") for name in marks if name.startswith("article_")}
        if "s_else" in marks:
            articles = {"new"}
        if word in entry.none or "s_none" in marks:
            articles = {"none"}
        if word in entry.indefinite and not articles:
            articles = {"indefinite"}
        if len(words) > 1 and (adjectives or any(w in one.none for one, w in said)):
            what = f'"{self._said_at(span)}": say each in full, as in "A stops or B stops"'
            raise refuse(self._text, span[0], what)
        surface = self._said_at(span).casefold()
        count, exactly = value_of(children, "count") or (1, False)
        return Noun(
            kinds.pop() if len(kinds) == 1 else "any",
            tuple(name for name in CLASSES if name in classes),
            _introduced(articles),
            word,
            span,
            tuple(adjectives),
            sum(all_of(children, tuple), ()),
            word == "people"
            or re.search(rf"^(?!each|every).*\b{re.escape(word)}\b", surface) is None,
            count,
            exactly,
        )

    def noun_where(self, meta: Any, children: list) -> Noun:
        """ "A person near a car" before a verb: who is there."""
        noun, *relations = children
        said = tuple(self._taken(options_of(one)) for one in relations)
        return replace(noun, relatives=(*noun.relatives, *said), span=span_of(meta))

    def relative(self, meta: Any, children: list) -> tuple:
        polarity = first_of(children, Polarity)
        words = self._said_at(span_of(meta))
        if re.search(r"\b(was|were|had)\b", words, re.IGNORECASE):
            self.notes.append(f'"{words}" is read of the time of the event; say "then" for earlier')
        said = [self._taken(options_of(child)) for child in all_of(children, Said, Choice)]
        if polarity and polarity.is_denied:
            said[0] = opposite(said[0])
        return tuple(said)

    def pair(self, _meta: Any, children: list) -> tuple[Noun, ...]:
        return tuple(all_of(children, Noun))

    def _words_of(self, children: list) -> tuple[str, ...]:
        words = (
            c.words if isinstance(c, Mark) else (str(c),) for c in all_of(children, Mark, Token)
        )
        return tuple(word for said in words for word in said)

    def _by_words(self, name: str, children: list) -> Adjective | Fraction:
        """The adjective, or the number, that has these words."""
        said = " ".join(self._words_of(children))
        if name == "adjective":
            return read_lexicon().adjective(said)
        return next(number for number, words in read_lexicon().numbers if said in words)

    def _taken(self, options: Sequence[Any]) -> Any:
        """The first of several readings, with a note."""
        if len(options) == 1:
            return options[0]
        start, end = getattr(options[0], "span", (0, len(self._text)))
        said = self._text[start:end]
        self.notes.append(f'"{said}" can be read in {len(options)} ways; one of them is taken')
        return options[0]

    def count(self, meta: Any, children: list) -> Mark:
        """How many at least: "three", "more than two"; or exactly."""
        marks, start = marks_of(children), span_of(meta)[0]
        if "s_several" in marks:
            self.notes.append(f'"{marks["s_several"]}" is taken as at least {_SEVERAL}')
            return Mark("count", (), (_SEVERAL, False))
        if "s_one" in marks or "s_two" in marks:
            return Mark("count", (), (1, True) if "s_one" in marks else (2, False))
        said = first_of(children, Fraction, Token)
        number = said if isinstance(said, Fraction) else read_number(said, self._text, start)
        is_more = marks.get("s_at_least", "") in read_lexicon().sets["more_than"]
        if number.denominator != 1 or not 1 <= number <= _MOST_COUNTED:
            raise refuse(self._text, start, f"a whole number up to {_MOST_COUNTED} is expected")
        return Mark("count", (), (int(number) + is_more, "s_exactly" in marks))

    # Colours --------------------------------------------------------------------------------------

    def colour(self, meta: Any, children: list) -> Adjective:
        """A colour, or a shade, or both: of the upper body, or of a vehicle."""
        marks = marks_of(children)
        shades = [name.removeprefix("s_") for name in marks if name.startswith("s_")]
        said = marks.get("colour_word", "")
        name = next((n for n, words in read_lexicon().colours.items() if said in words), "")
        whole = " ".join([*shades, *name.split()[-1:]]) if shades else name
        if not is_colour(whole):
            what = f'"{whole}" is not told from other colours; say "{name}" alone'
            raise refuse(self._text, span_of(meta)[0], what)
        return Adjective((_term(whole, "upper"),), ())

    def garment(self, _meta: Any, children: list) -> tuple[Term, ...]:
        """A colour, and what has it; without a word for that it is the upper body."""
        (term,) = first_of(children, Adjective).holds
        bodies = {"s_whole_body": ("upper", "lower"), "s_lower_body": ("lower",)}
        parts = next((bodies[name] for name in marks_of(children) if name in bodies), ("upper",))
        return tuple(_term(str(term.parameters["colour"]), part) for part in parts)

    def dressed(self, meta: Any, children: list) -> tuple[Said, ...]:
        """ "In a red jacket" of a noun."""
        return (self.wears(meta, children),)

    def wears(self, meta: Any, children: list) -> Said:
        """ "Wears a red jacket" as a predication."""
        terms = tuple(term for child in all_of(children, tuple) for term in child)
        return Said(StateEntry(terms, subject="person"), (), {}, span_of(meta), is_verb=True)

    def is_coloured(self, meta: Any, children: list) -> Said:
        """ "(is) red"."""
        return Said(StateEntry(first_of(children, Adjective).holds), (), {}, span_of(meta))


def _term(colour: str, part: str) -> Term:
    return Term("coloured", ("a",), {"colour": colour, "part": part})


def _introduced(articles: set[str]) -> str:
    """How a noun is introduced: "the other" is already known, "another" is new."""
    if "new" in articles:
        return "other" if "definite" in articles else "new"
    return next(iter(sorted(articles)), "bare")


def opposite(node: Any) -> Any:
    return replace(node, is_denied=not node.is_denied) if isinstance(node, Said) else node
