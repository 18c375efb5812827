"""Colours in parse trees: "a red car", "in a dark jacket", "wears black trousers", "is white"."""

from typing import Any

from lark import v_args

from scene4d.core.colours import is_colour
from scene4d.searching.activities.definition import Term
from scene4d.searching.language._lexicon import Adjective, StateEntry
from scene4d.searching.language._sentences import Said
from scene4d.searching.language._times import Mark, TimeReader, all_of, first_of, span_of
from scene4d.searching.language._words import refuse


def _term(colour: str, part: str) -> Term:
    return Term("coloured", ("a",), {"colour": colour, "part": part})


@v_args(meta=True)
class ColourReader(TimeReader):
    """The meaning of the rules that speak of colours; one method per rule, by name."""

    def colour(self, meta: Any, children: list) -> Adjective:
        """A colour, or a shade, or both: of the upper body, or of a vehicle."""
        marks = {mark.name: " ".join(mark.words) for mark in all_of(children, Mark)}
        shades = [name.removeprefix("s_") for name in marks if name.startswith("s_")]
        said = marks.get("colour_word", "")
        name = next((n for n, words in self._lexicon.colours.items() if said in words), "")
        whole = " ".join([*shades, *name.split()[-1:]]) if shades else name
        if not is_colour(whole):
            what = f'"{whole}" is not told from other colours; say "{name}" alone'
            raise refuse(self._text, span_of(meta)[0], what)
        return Adjective((_term(whole, "upper"),), ())

    def garment(self, _meta: Any, children: list) -> tuple[Term, ...]:
        """A colour, and what has it; without a word for that it is the upper body."""
        (term,) = first_of(children, Adjective).holds
        names = {mark.name for mark in all_of(children, Mark)}
        lower, both = "s_lower_body" in names, "s_whole_body" in names
        parts = ("upper", "lower") if both else ("lower",) if lower else ("upper",)
        return tuple(_term(str(term.parameters["colour"]), part) for part in parts)

    def dressed(self, meta: Any, children: list) -> tuple[Said, ...]:
        """ "In a red jacket" of a noun."""
        return (self._wearing(meta, children),)

    def wears(self, meta: Any, children: list) -> Said:
        """ "Wears a red jacket" as a predication."""
        return self._wearing(meta, children)

    def is_coloured(self, meta: Any, children: list) -> Said:
        """ "(is) red"."""
        return Said(StateEntry(first_of(children, Adjective).holds), (), {}, span_of(meta))

    def _wearing(self, meta: Any, children: list) -> Said:
        terms = tuple(term for child in children if isinstance(child, tuple) for term in child)
        entry = StateEntry(terms, subject="person")
        return Said(entry, (), {}, span_of(meta), is_verb=True)
