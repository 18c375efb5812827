"""How long and when: the rules of a parse tree that speak of time, and what all are read with."""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass, replace
from fractions import Fraction
from typing import Any

from lark import Transformer, v_args

from scene4d.searching.language._lexicon import base_forms, read_lexicon
from scene4d.searching.language._sentences import Clock, Lasting, Span, options_of
from scene4d.searching.language._words import Amount, read_clock, refuse
from scene4d.searching.predicates._when import DAY_S, When, Window

CLOCKS = {
    "between_clock": ("begin", "end"),
    "after_clock": ("begin",),
    "before_clock": ("end",),
    "at_clock": ("at",),
}
"""What the times of day in a rule are."""
_DAYS = {"s_yesterday": -1, "s_last_night": -1, "s_today": 0, "s_this": 0, "s_tomorrow": 1}
"""The days after that of the moment that is searched for."""


@dataclass(frozen=True)
class Mark:
    """A rule that only records which words were used, or what they amount to."""

    name: str
    words: tuple[str, ...] = ()
    value: Any = None


def all_of(children: Iterable[Any], *kinds: type) -> list[Any]:
    """Those of these types."""
    return [child for child in children if isinstance(child, kinds)]


def first_of(children: Iterable[Any], *kinds: type) -> Any:
    """The first of these types; None where there is none."""
    return next(iter(all_of(children, *kinds)), None)


def marks_of(children: Iterable[Any]) -> dict[str, str]:
    """The words of all marks by their names."""
    return {mark.name: " ".join(mark.words) for mark in all_of(children, Mark)}


def value_of(children: Iterable[Any], name: str) -> Any:
    """What a mark amounts to; None where there is none."""
    return next((mark.value for mark in all_of(children, Mark) if mark.name == name), None)


def span_of(meta: Any) -> Span:
    """The characters of a rule."""
    return (meta.start_pos, meta.end_pos) if not meta.empty else (0, 0)


def window_of(clock: Clock, text: str, span: Span) -> Window:
    """The time of day that is said. Raises :class:`InputError` for one that holds no time."""
    if clock.at is not None:
        at_s = read_lexicon().assumed["at_s"]
        return Window((clock.at - at_s) % DAY_S, (clock.at + at_s) % DAY_S)
    begin = 0.0 if clock.begin is None else clock.begin
    end = DAY_S if clock.end is None else clock.end
    if begin == end or ((begin, end) == (0.0, DAY_S) and None in (clock.begin, clock.end)):
        said = text[slice(*span)]
        what = f'"{said}" holds no time, or all; say "between midnight and 6 am", for example'
        raise refuse(text, span[0], what)
    return Window(begin % DAY_S, end)


def hull(span: Span, nodes: Iterable[Any]) -> Span:
    """The span, including those of the parts; a tree of several readings has none of its own."""
    options = [option for node in nodes for option in options_of(node)]
    spans = [
        hull(span, one) if isinstance(one, tuple) else getattr(one, "span", span) for one in options
    ]
    there = [(start, end) for start, end in (span, *spans) if end > start]
    return (min(s for s, _ in there), max(e for _, e in there)) if there else span


def tense_of(text: str) -> str:
    """Whether the first verb of a text is in the present or the future: "stands", "will stand"."""
    first = next(iter(text.casefold().split()), "")
    if first == "will":
        return "future"
    bases = base_forms(first)
    is_present = first in ("is", "are") or (first != "was" and (not bases or first[-1:] == "s"))
    return "present" if is_present else "past"


def joined(whens: Sequence[When], said: str, text: str, start: int) -> When:
    """All that is said of when another one was there. Raises :class:`InputError` where two say
    the same thing of it.
    """
    told: dict[str, Any] = {}
    for when in whens:
        for name, value in vars(when).items():
            if value != getattr(When(), name) and told.setdefault(name, value) != value:
                raise refuse(text, start, f'"{said}" says twice when that was')
    return When(**told)


@v_args(meta=True)
class TimeReader(Transformer):
    """Durations and times of day; one method per rule, by name."""

    def __init__(self, text: str) -> None:
        super().__init__(visit_tokens=False)
        self.notes: list[str] = []
        self._text = text

    def _said_at(self, span: Span) -> str:
        return self._text[slice(*span)]

    # How long, and how long before ---------------------------------------------------------------

    def at_least(self, _meta: Any, children: list) -> Lasting:
        return Lasting(first_of(children, Amount).value)

    def at_most(self, _meta: Any, children: list) -> Lasting:
        return Lasting(None, first_of(children, Amount).value)

    def from_to(self, meta: Any, children: list) -> Lasting:
        amounts = all_of(children, Amount)
        most = amounts[-1].value
        shared = first_of(children, Fraction)  # "5 to 10 minutes": the unit is said once
        least = amounts[0].value if shared is None else float(shared * amounts[-1].unit)
        if not 0 < least <= most:
            raise refuse(self._text, span_of(meta)[0], "the shorter time comes first")
        return Lasting(least, most)

    def lasting(self, meta: Any, children: list) -> Lasting:
        return replace(first_of(children, Lasting), span=span_of(meta))

    def when_range(self, _meta: Any, children: list) -> When:
        """ "Earlier", "more than 10 minutes before", "within 5 minutes later"."""
        said = first_of(children, Lasting) or Lasting()
        least_s, most_s = said.within(0.0, float("inf"))
        return When(least_s, most_s, "s_later" in marks_of(children))

    def when_about(self, meta: Any, children: list) -> When:
        """ "Two days ago" is a day; "an hour ago" about so long, which is told."""
        amount = first_of(children, Amount)
        later = "s_later" in marks_of(children)
        days = amount.value / DAY_S
        if amount.unit >= DAY_S and days.is_integer():
            return When(later=later, day=int(days) if later else -int(days))
        off_s = read_lexicon().assumed["about"] * amount.value
        when = When(amount.value - off_s, amount.value + off_s, later)
        self.notes.append(f'"{self._said_at(span_of(meta))}" is taken as {when}')
        return when

    def when_day(self, _meta: Any, children: list) -> When:
        marks = marks_of(children)
        day = next((_DAYS[name] for name in marks if name in _DAYS), 0)
        part = "night" if "s_last_night" in marks else marks.get("day_word")
        if part is None:
            return When(day=day, later=day > 0)
        return When(day=day, later=day > 0, clock=Window(*self._part_of_day(part)))

    def _part_of_day(self, word: str) -> tuple[float, float]:
        begin, end = read_lexicon().day[word]
        return read_clock(begin, self._text, 0), read_clock(end, self._text, 0)

    def when_clock(self, meta: Any, children: list) -> When:
        clock = first_of(children, Clock)
        return When(clock=window_of(clock, self._text, span_of(meta)))

    # The clock ------------------------------------------------------------------------------------

    def clock(self, meta: Any, children: list) -> float:
        child = children[0]
        word = child.words[0] if isinstance(child, Mark) else str(child)
        return read_clock(read_lexicon().clock.get(word, word), self._text, span_of(meta)[0])

    def part_of_day(self, meta: Any, children: list) -> Clock:
        begin, end = self._part_of_day(marks_of(children)["day_word"])
        return Clock(begin, end, None, span_of(meta))
