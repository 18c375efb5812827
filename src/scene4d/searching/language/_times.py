"""How long and when: the rules of a parse tree that speak of time, and what all are read with."""

from collections.abc import Iterable
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from lark import Transformer, v_args

from scene4d.searching.language._lexicon import Lexicon
from scene4d.searching.language._sentences import Clock, Lasting, Span
from scene4d.searching.language._words import Amount, read_clock, refuse

CLOCKS = {
    "between_clock": ("begin", "end"),
    "after_clock": ("begin",),
    "before_clock": ("end",),
    "at_clock": ("at",),
}
"""What the times of day in a rule are."""


@dataclass(frozen=True)
class Mark:
    """A rule that only records which words were used."""

    name: str
    words: tuple[str, ...] = ()


def all_of(children: Iterable[Any], *kinds: type) -> list[Any]:
    """Those of these types."""
    return [child for child in children if isinstance(child, kinds)]


def first_of(children: Iterable[Any], *kinds: type) -> Any:
    """The first of these types; None where there is none."""
    return next(iter(all_of(children, *kinds)), None)


def span_of(meta: Any) -> Span:
    """The characters of a rule."""
    return (meta.start_pos, meta.end_pos) if not meta.empty else (0, 0)


@v_args(meta=True)
class TimeReader(Transformer):
    """Durations and times of day; one method per rule, by name."""

    def __init__(self, text: str, lexicon: Lexicon) -> None:
        super().__init__(visit_tokens=False)
        self._text = text
        self._lexicon = lexicon

    # How long -------------------------------------------------------------------------------------

    def lasts_at_least(self, meta: Any, children: list) -> Lasting:
        return Lasting(first_of(children, Amount).value, None, span_of(meta))

    def lasts_at_most(self, meta: Any, children: list) -> Lasting:
        return Lasting(None, first_of(children, Amount).value, span_of(meta))

    def lasts_between(self, meta: Any, children: list) -> Lasting:
        amounts = all_of(children, Amount)
        most = amounts[-1].value
        shared = first_of(children, Fraction)  # "5 to 10 minutes": the unit is said once
        least = amounts[0].value if shared is None else float(shared * amounts[-1].unit)
        if not 0 < least <= most:
            raise refuse(self._text, span_of(meta)[0], "the shorter time comes first")
        return Lasting(least, most, span_of(meta))

    # The clock ------------------------------------------------------------------------------------

    def clock(self, meta: Any, children: list) -> float:
        child = children[0]
        word = child.words[0] if isinstance(child, Mark) else str(child)
        return read_clock(self._lexicon.clock.get(word, word), self._text, span_of(meta)[0])

    def _clock(self, name: str, children: list, span: Span) -> Clock:
        times = dict(zip(CLOCKS[name], all_of(children, float), strict=True))
        return replace(Clock(None, None, None, span), **times)

    def part_of_day(self, meta: Any, children: list) -> Clock:
        word = next(m.words[0] for m in all_of(children, Mark) if m.name == "day_word")
        begin, end = (read_clock(time, self._text, 0) for time in self._lexicon.day[word])
        return Clock(begin, end, None, span_of(meta))
