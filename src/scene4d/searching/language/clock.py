"""Times of day."""

import re
from collections.abc import Sequence
from dataclasses import dataclass

from scene4d.searching.language.sentences import Clock
from scene4d.searching.language.words import refuse

_DAY_S = 86400.0
_CLOCK = re.compile(
    r"(?P<hour>\d{1,2})(?::(?P<minute>\d{2}))?(?::(?P<second>\d{2}))?\s*(?P<half>[ap])?\.?m?\.?",
    re.IGNORECASE,
)


@dataclass(frozen=True)
class Window:
    """A time of every day, seconds from midnight on the footage's own clock: from ``begin_s`` up
    to ``end_s``, over midnight where the end is not after the beginning.
    """

    begin_s: float
    end_s: float

    def contains(self, second_of_day: float) -> bool:
        """Whether a time of day lies in it."""
        second = second_of_day % _DAY_S
        if self.begin_s < self.end_s:
            return self.begin_s <= second < self.end_s
        return second >= self.begin_s or second < self.end_s

    def __str__(self) -> str:
        return f"{_written(self.begin_s)} to {_written(self.end_s)}"


def _written(seconds: float) -> str:
    minutes, second = divmod(round(seconds), 60)
    hour, minute = divmod(minutes, 60)
    return f"{hour:02d}:{minute:02d}" + (f":{second:02d}" if second else "")


def read_clock(word: str, text: str, start: int) -> float:
    """ "14:05", "9 pm" as seconds from midnight. Raises :class:`InputError` for what is no time."""
    match = _CLOCK.fullmatch(word.strip())
    if match is None:
        raise refuse(text, start, f'"{word}" is no time of day')
    hour = int(match["hour"])
    minute, second = int(match["minute"] or 0), int(match["second"] or 0)
    half = (match["half"] or "").lower()
    ends_day = (hour, minute, second) == (24, 0, 0) and not half
    if minute > 59 or second > 59 or (not 1 <= hour <= 12 if half else hour > 23 and not ends_day):
        raise refuse(text, start, f'"{word}" is no time of day')
    if half:
        hour = hour % 12 + (12 if half == "p" else 0)
    return 3600.0 * hour + 60.0 * minute + second


def window_of(clocks: Sequence[Clock], text: str, at_s: float, notes: list[str]) -> Window | None:
    """The one time of day that a search asks for. ``at_s`` is how far "at" reaches to both sides.

    Raises :class:`InputError` where two are said, or one that holds no time.
    """
    if not clocks:
        return None
    if len(clocks) > 1:
        raise refuse(text, clocks[1].span[0], "a second time of day; one search asks for one")
    clock = clocks[0]
    if clock.at is not None:
        window = Window((clock.at - at_s) % _DAY_S, (clock.at + at_s) % _DAY_S)
        notes.append(f'"{_said(clock, text)}" is taken as {window}')
    else:
        begin = 0.0 if clock.begin is None else clock.begin
        end = _DAY_S if clock.end is None else clock.end
        if begin == end:
            raise refuse(text, clock.span[0], f'"{_said(clock, text)}" holds no time')
        window = Window(begin % _DAY_S, end)
    if window.begin_s >= window.end_s:
        notes.append(f"the time of day {window} goes over midnight")
    return window


def _said(clock: Clock, text: str) -> str:
    return text[slice(*clock.span)]
