"""When another one was there, as seen from a moment."""

from collections.abc import Iterator
from dataclasses import dataclass
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

DAY_S = 86_400.0
_PART_S, _MOST_PARTS = 600.0, 48
"""A run is looked at in so long parts, each with the spots that may fit in it; chosen by hand."""
_ROUNDING_S = 1e-3
"""A day ends so long before the next."""


@dataclass(frozen=True)
class Window:
    """A time of every day, seconds from midnight on the footage's own clock: from ``begin_s`` up
    to ``end_s``, over midnight where the end is not after the beginning.
    """

    begin_s: float
    end_s: float

    def contains(self, second_of_day: float) -> bool:
        """Whether a time of day lies in it."""
        return (second_of_day - self.begin_s) % DAY_S < self.length_s

    @property
    def length_s(self) -> float:
        """Seconds from its beginning to its end."""
        return (self.end_s - self.begin_s) % DAY_S or DAY_S

    def __str__(self) -> str:
        return f"{_written(self.begin_s)} to {_written(self.end_s)}"


def _written(seconds: float) -> str:
    minutes, second = divmod(round(seconds), 60)
    hour, minute = divmod(minutes, 60)
    return f"{hour:02d}:{minute:02d}" + (f":{second:02d}" if second else "")


@dataclass(frozen=True)
class When:
    """When another one was there, seen from a moment: ``least_s`` to ``most_s`` before it, or after
    it where it is ``later``; ``is_over``: all of the time that the other was there. Also on the
    ``day`` that is so many days after the moment's (yesterday: -1), and at a time of day (UTC).
    """

    least_s: float = 0.0
    most_s: float = float("inf")
    later: bool = False
    is_over: bool = False
    day: int | None = None
    clock: Window | None = None

    def __str__(self) -> str:
        side, ends = ("after", "not yet") if self.later else ("before", "no longer")
        low, high = self.least_s, self.most_s
        said = []
        if high < float("inf"):
            said.append(f"{low:g} to {high:g} s {side}" if low else f"at most {high:g} s {side}")
        elif low or self.day is None:
            said.append(f"at least {low:g} s {side}" if low else f"at any time {side}")
        if self.day is not None:
            named = {-1: "the day before", 0: "the same day", 1: "the day after"}
            said.append(named.get(self.day, f"{abs(self.day)} days {side}"))
        if self.clock is not None:
            said.append(f"between {str(self.clock).replace(' to ', ' and ')}")
        return ", ".join([*said, *([ends] if self.is_over else [])])

    def fits(
        self,
        time_s: Float[np.ndarray, "*m"],
        begin_s: Float[np.ndarray, "*k"],
        end_s: Float[np.ndarray, "*k"],
    ) -> Bool[np.ndarray, "*n"]:
        """Whether somebody was there, from ``begin_s`` to ``end_s``, when a moment asks for;
        seconds on one clock. Shapes are broadcast.
        """
        first, last = self._asked(time_s, time_s)
        low, high = np.maximum(begin_s, first), np.minimum(end_s, last)
        fits = low <= high
        if self.is_over:
            least_s = self.least_s
            fits &= begin_s >= time_s + least_s if self.later else end_s <= time_s - least_s
        if self.clock is not None:
            since = (low - self.clock.begin_s) % DAY_S
            fits &= (since < self.clock.length_s) | (DAY_S - since <= high - low)
        return np.asarray(fits)

    def possible(
        self,
        span_s: tuple[float, float],
        begin_s: Float[np.ndarray, "n"],
        end_s: Float[np.ndarray, "n"],
    ) -> Bool[np.ndarray, "n"]:
        """Which of them may fit at some moment of a span."""
        first, last = self._asked(*span_s)
        return np.asarray((begin_s <= last) & (end_s >= first))

    def always(
        self,
        span_s: tuple[float, float],
        begin_s: Float[np.ndarray, "n"],
        end_s: Float[np.ndarray, "n"],
    ) -> Bool[np.ndarray, "n"]:
        """Which of them fit throughout a span, as far as that is sure: those that are over before
        it, or have not begun, where nothing else limits how long ago.
        """
        if self.day is not None or np.isfinite(self.most_s) or self.clock is not None:
            return np.zeros(len(begin_s), bool)
        if self.later:
            return np.asarray(begin_s >= span_s[1] + self.least_s)
        return np.asarray(end_s <= span_s[0] - self.least_s)

    def parts(self, low_s: float, high_s: float) -> Iterator[tuple[float, float]]:
        """The parts of a span that may ask for different times: days where a day is asked for."""
        count = min(_MOST_PARTS, int((high_s - low_s) / _PART_S) + 1)
        edges = list(np.linspace(low_s, high_s, count + 1))
        if self.day is not None:
            first, last = np.floor(low_s / DAY_S) + 1, np.floor(high_s / DAY_S) + 1
            edges = [low_s, *(np.arange(first, last) * DAY_S), high_s]
        edges[-1] = np.inf
        yield from pairwise(edges)

    def _asked(
        self, low_s: float | Float[np.ndarray, "*m"], high_s: float | Float[np.ndarray, "*m"]
    ) -> tuple[float | Float[np.ndarray, "*m"], float | Float[np.ndarray, "*m"]]:
        """From when to when somebody was there, as asked at some moment between two."""
        if self.later:
            first, last = low_s + self.least_s, high_s + self.most_s
        else:
            first, last = low_s - self.most_s, high_s - self.least_s
        if self.day is None:
            return first, last
        early, late = ((np.floor(t / DAY_S) + self.day) * DAY_S for t in (low_s, high_s))
        # The night of a day goes on after midnight.
        begins, length_s = (
            (0.0, DAY_S) if self.clock is None else (self.clock.begin_s, self.clock.length_s)
        )
        last = np.minimum(last, late + begins + length_s - _ROUNDING_S)
        return np.maximum(first, early + begins), last
