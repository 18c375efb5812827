"""Parse trees as sentences."""

from dataclasses import replace
from fractions import Fraction
from itertools import product
from typing import Any

from lark import Token, Tree, v_args
from lark.exceptions import VisitError

from scene4d.searching.activities.definition import Term
from scene4d.searching.language._doing import NOT_OF_ACTIVITIES
from scene4d.searching.language._grammar import Grammar
from scene4d.searching.language._lexicon import StateEntry, base_forms, read_lexicon
from scene4d.searching.language._nouns import NounReader, opposite
from scene4d.searching.language._sentences import (
    Bound,
    Chain,
    Choice,
    Clause,
    Clock,
    Delay,
    Done,
    Joined,
    Lasting,
    Noun,
    Place,
    Polarity,
    Said,
    Sentence,
    Span,
    SpotSaid,
    options_of,
)
from scene4d.searching.language._times import (
    CLOCKS,
    Mark,
    all_of,
    first_of,
    hull,
    joined,
    span_of,
    tense_of,
    value_of,
)
from scene4d.searching.language._words import Amount, amount_of, read_number, refuse
from scene4d.searching.predicates._relation import SIDES
from scene4d.searching.predicates._when import When

_WEIGHED = (Clause, Done, Said, Chain, Joined, Sentence)
"""Where these have several readings, the composer takes the one that makes sense."""
_BOUNDS = {"within": "near", "beyond": "far"}
_TRANSPARENT = (
    *("activity", "whole", "state", "relation", "predication", "subject", "article", "pronoun"),
    *("unit_distance", "unit_duration", "unit_speed"),
)
"""Rules that pass on their content."""


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
class _Reader(NounReader):
    """The meaning of the grammar's rules, bottom up; one method per rule, by name."""

    def __init__(self, text: str, grammar: Grammar) -> None:
        super().__init__(text)
        self._grammar = grammar

    # Rules by their number ------------------------------------------------------------------------

    def __default__(self, data: Any, children: list, meta: Any) -> Any:
        name, span = str(data), span_of(meta)
        stem, _, number = name.rpartition("_")
        if number.isdigit():
            if stem in {"activity", "whole"}:
                return self._done(int(number), children, span)
            if stem in {"state", "relation"}:
                return self._said(int(number), children, span, is_verb=stem == "state")
            if stem.startswith("unit_"):
                return read_lexicon().units[stem.removeprefix("unit_")][int(number)][0]
        if name in {"adjective", "number_word", "count_word"}:
            return self._by_words(name, children)
        if name in {"zone", "line"}:
            return Place(name, str(first_of(children, Token)), span)
        if name in read_lexicon().units:
            return amount_of(name, all_of(children, Fraction), self._text, span)
        if name in _BOUNDS:
            return Bound(first_of(children, Amount).value, _BOUNDS[name], span)
        if name in CLOCKS:
            times = dict(zip(CLOCKS[name], all_of(children, float), strict=True))
            return replace(Clock(None, None, None, span), **times)
        if name in _TRANSPARENT:
            return children[0]
        if name == "delay":
            return Delay(first_of(children, Amount).value, span)
        if name.startswith("t_"):
            owner = first_of(children, Noun)
            return Mark("owner", (), owner)
        return Mark(name, self._words_of(children))

    def _ambig(self, children: list) -> Any:
        options: list[Any] = []
        for child in children:
            for option in child.options if isinstance(child, Choice) else (child,):
                if option not in options:
                    options.append(option)
        if isinstance(options[0], SpotSaid):  # "10 minutes earlier" is when, and not how long
            options = sorted(options, key=lambda one: one.lasting is not None)[:1]
        if len(options) > 1 and not isinstance(options[0], _WEIGHED):
            return self._taken(options)
        return options[0] if len(options) == 1 else Choice(tuple(options))

    def _done(self, number: int, children: list, span: Span) -> Done:
        if any(polarity.is_denied for polarity in all_of(children, Polarity)):
            raise refuse(self._text, span[0], NOT_OF_ACTIVITIES)
        return Done(
            self._grammar.spoken[number],
            tuple(all_of(children, Noun)),
            tuple(all_of(children, Place)),
            value_of(children, "owner"),
            span,
            any(polarity.is_state for polarity in all_of(children, Polarity)),
        )

    def _said(self, number: int, children: list, span: Span, is_verb: bool) -> Said:
        entry = read_lexicon().states[number]
        values: dict[str, float | str] = {}
        for child in all_of(children, Amount):
            values[child.kind] = child.value
        for place in all_of(children, Place):
            if place.name is None:
                raise refuse(self._text, place.span[0], f"which {place.kind}? Say its name")
            values[f"{place.kind}_2" if place.kind in values else place.kind] = place.name
        for mark in all_of(children, Mark):
            if mark.name.removeprefix("s_") in SIDES:
                values["side"] = mark.name.removeprefix("s_")
        nouns, spot = tuple(all_of(children, Noun)), first_of(children, SpotSaid)
        return Said(entry, nouns, values, span, is_verb=is_verb, spot=spot)

    # Order ----------------------------------------------------------------------------------------

    def start(self, _meta: Any, children: list) -> Sentence:
        order = first_of(children, Chain, Choice)
        return Sentence(order, tuple(all_of(children, Clock)))

    def chain(self, _meta: Any, children: list) -> Chain:
        steps = all_of(children, Joined, Choice)
        seconds = tuple(mark.value for mark in all_of(children, Mark))
        return Chain(tuple(steps), seconds, ("then",) * len(seconds))

    def then(self, _meta: Any, children: list) -> Mark:
        return Mark("pause", (), value_of(children, "pause"))

    def first_second(self, _meta: Any, children: list) -> Chain:
        return self._before(children, in_order=True)

    def second_first(self, _meta: Any, children: list) -> Chain:
        return self._before(children, in_order=False)

    def _before(self, children: list, in_order: bool) -> Chain:
        word = next((mark.words[0] for mark in all_of(children, Mark) if mark.words), "after")
        steps = all_of(children, Chain, Choice)[:: 1 if in_order else -1]
        pause = value_of(children, "pause")
        return Chain(tuple(steps), (pause,), (word,), not in_order)

    def pause(self, _meta: Any, children: list) -> Mark:
        amount = first_of(children, Amount)
        seconds = amount.value if amount else read_lexicon().assumed["immediately_s"]
        return Mark("pause", (), seconds)

    def joined(self, _meta: Any, children: list) -> Joined:
        links = [m.name.removeprefix("link_") for m in all_of(children, Mark)]
        return Joined(tuple(all_of(children, Clause, Choice)), tuple(links))

    # Clauses --------------------------------------------------------------------------------------

    def front(self, _meta: Any, children: list) -> Mark:
        return Mark("front", (), children[0])

    def clause(self, meta: Any, children: list) -> Clause | Choice:
        span = span_of(meta)
        fronts = [mark.value for mark in all_of(children, Mark) if mark.name == "front"]
        parts = [part for part in children if not isinstance(part, Mark)]
        subjects: tuple[Noun, ...] = ()
        if isinstance(parts[0], Noun | tuple):
            head = parts.pop(0)
            subjects = head if isinstance(head, tuple) else (head,)
        polarity = first_of(parts, Polarity) or Polarity(False, False)
        parts = [part for part in parts if not isinstance(part, Polarity)]
        whole = hull(span, children)
        readings = product(*map(options_of, (*parts[1:], *fronts)))
        clauses = [Clause(subjects, polarity, parts[0], more, whole) for more in readings]
        return clauses[0] if len(clauses) == 1 else Choice(tuple(clauses))

    def described(self, meta: Any, children: list) -> Clause | Choice:
        """ "An unattended car": what its adjective says."""
        noun = next(child for child in children if isinstance(child, Noun))
        if noun.adjectives:
            core = Said(StateEntry(noun.adjectives[0].holds), (), {}, noun.span)
            noun = replace(noun, adjectives=noun.adjectives[1:])
        elif noun.relatives:
            core, noun = noun.relatives[0], replace(noun, relatives=noun.relatives[1:])
        elif noun.article == "none" and not all_of(children, Said):  # "nobody for 10 minutes"
            core = Said(StateEntry((Term("present", ("a",)),)), (), {}, noun.span)
        else:
            core = None  # refused when it is read, where no other reading makes sense
        more = [child for child in children if not isinstance(child, Noun)]
        return self.clause(meta, [noun, core, *more])

    def emptied(self, meta: Any, children: list) -> Clause | Choice:
        """ "Zone X is empty", "X is free of vehicles": nothing, or none of these, is there."""
        span, place = span_of(meta), first_of(children, Place)
        nouns = all_of(children, Noun)
        polarity = first_of(children, Polarity) or Polarity(False, False)
        if polarity.is_denied:
            what = 'say who is there, as in "a person is in zone NAME"'
            raise refuse(self._text, span[0], what)
        if place.name is None:
            raise refuse(self._text, place.span[0], "which zone? Say its name")
        inside = StateEntry((Term("inside", ("a",), {"zone": place.name}),))
        noun = replace(nouns[0], article="none") if nouns else self._nothing(span)
        more = [child for child in children if not isinstance(child, Noun | Place | Polarity)]
        return self.clause(meta, [noun, Said(inside, (), {}, span), *more])

    def _nothing(self, span: Span) -> Noun:
        entry = read_lexicon().noun("nothing")
        assert entry is not None
        return Noun(entry.kind, entry.classes, "none", "nothing", span)

    def modifier(self, _meta: Any, children: list) -> Any:
        is_denied = any(isinstance(child, Mark) for child in children)
        said = next(child for child in children if not isinstance(child, Mark))
        said = self._taken(options_of(said))
        return opposite(said) if is_denied else said

    def denied(self, _meta: Any, children: list) -> Polarity:
        return Polarity(True, False)

    def affirmed(self, _meta: Any, children: list) -> Polarity:
        forms = [w for mark in all_of(children, Mark) for w in mark.words]
        return Polarity(False, any(form == "be" or "be" in base_forms(form) for form in forms))

    def spot(self, meta: Any, children: list) -> SpotSaid:
        """Where another one was; without a time in the present it is now, which is no spot."""
        noun, span = first_of(children, Noun), hull(span_of(meta), children)
        said, whens = self._text[slice(*span)], all_of(children, When)
        tense = tense_of(self._text[noun.span[1] : span[1]])
        if not whens and tense == "present":
            what = f'"{said}" is now; say "near another person", or where he was, as in "stood"'
            raise refuse(self._text, span[0], what)
        when = joined(whens, said, self._text, span[0])
        when = When(later=True) if tense == "future" and not whens else when
        if when in (When(), When(later=True)):
            when = replace(when, is_over=True)
        polarity = first_of(children, Polarity) or Polarity(False, False)
        if polarity.is_denied or noun.article == "none":
            raise refuse(self._text, noun.span[0], "where somebody never was cannot be asked for")
        core, lasting = first_of(children, Done, Said, Choice), first_of(children, Lasting)
        return SpotSaid(noun, polarity, core, lasting, when, span)

    # Places and amounts ---------------------------------------------------------------------------

    def unnamed_zone(self, meta: Any, _children: list) -> Place:
        return Place("zone", None, span_of(meta))

    def number(self, meta: Any, children: list) -> Fraction:
        found = children[0]
        if isinstance(found, Fraction):
            return found
        return read_number(str(found), self._text, span_of(meta)[0])
