"""The best alignment of an activity's phases with what happened, by dynamic programming.

A phase is at least its *core*: the shortest time that it may last. Its probability is the geometric
mean of its moments' there, so that length is not punished and one bad moment does not kill; an
activity's is the product of its phases'. A phase may last longer than its core, as long as it may
and as long as it is more likely than not; how well it does there decides between alignments only
(:data:`STRETCH`), except that stretching a phase over what denies it costs probability. Before its
first core and after its last one an event lasts while it is more than half as likely as there.

With ``c_k[t]`` the log probability of a core of phase k that ends at moment t, and ``Q_k`` the sum
of what it costs or brings to stretch phase k,

    W_k[v] = max_u (V_k[u] + Q_k[v] - Q_k[u])      u from v - (longest - shortest) to v
    V_k[t] = c_k[t] + max_v W_{k-1}[v]             v up to a gap before the core's first moment

over all moments of all casts at once: the inner maxima are over windows.
"""

from collections.abc import Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float, Int

from scene4d.searching.activities.definition import Phase

FLOOR = 0.01
"""A statement that is denied for one moment may be a slip of the tracker: no moment counts less.
Chosen by hand; half and twice of it change the mean average precision on the tuning cameras by at
most 0.001 (benchmarks/search_constants.py)."""
# Chosen by hand on the tuning cameras (MEVA G341 and G424), where half and twice of either change
# the mean average precision, 0.457, by at most 0.001 (benchmarks/search_constants.py).
STRETCH = 0.04
"""Weight of one second outside the core relative to the whole core (1/s)."""
MOST_GAIN = 0.5
"""Largest log odds of a moment outside the core; the smallest are those of :data:`FLOOR`."""
_DECIMALS = 9
"""Decimal digits of log probabilities that are compared between alignments."""
_ROUNDING = 1e-6
"""Durations are multiples of the step: smaller differences, in steps, are ignored."""


@dataclass(frozen=True)
class Span:
    """Durations of a phase in moments: shortest, longest (None: any), gap before it."""

    shortest: int
    longest: int | None
    gap: int

    @classmethod
    def of(cls, phase: Phase, step_s: float) -> "Span":
        """A duration of n moments lasts n steps; a phase lasts at least one step."""
        shortest = max(1, int(np.ceil(phase.min_s / step_s - _ROUNDING)))
        longest = None
        if np.isfinite(phase.max_s):
            longest = max(shortest, int(np.floor(phase.max_s / step_s + _ROUNDING)))
        gap = int(min(np.floor(phase.gap_s / step_s + _ROUNDING), np.iinfo(np.int32).max))
        return cls(shortest, longest, gap)


@dataclass(frozen=True)
class Aligned:
    """Where a cast does an activity. Positions are those of the moments; all ends are included.

    ``core`` and ``whole``: first and last position of each phase, core and as stretched;
    ``log_score`` is the sum of the phases' log probabilities, ``stretched`` the part of it that
    stretching cost.
    """

    core: tuple[tuple[int, int], ...]
    whole: tuple[tuple[int, int], ...]
    log_score: float
    stretched: float = 0.0

    @property
    def begin(self) -> int:
        """First position of all phases."""
        return min(first for first, _ in self.whole)

    @property
    def end(self) -> int:
        """Last position of all phases."""
        return max(last for _, last in self.whole)

    def among(self, position: Int[np.ndarray, "n"]) -> "Aligned":
        """The same where the moments are these of others."""
        core, whole = (
            tuple((int(position[first]), int(position[last])) for first, last in spans)
            for spans in (self.core, self.whole)
        )
        return Aligned(core, whole, self.log_score, self.stretched)

    def is_flank(
        self, log_p: Float[np.ndarray, "k n"], first: int | None, last: int | None
    ) -> bool:
        """Whether this is the slope of a better event that was cut out before ``first`` or after
        ``last`` (None: none was): a core at the cut whose phase is the one on its other side, or
        whose phase is denied.
        """
        phases = len(self.core)
        for phase, (begin, end) in enumerate(self.core):
            beyond = phase == phases - 1 if begin == first else phase == 0
            if begin == first or end == last:
                mean = float(log_p[phase, begin : end + 1].mean())
                if beyond or mean < np.log(0.5):
                    return True
        return False


@dataclass(frozen=True, eq=False)
class Timeline:
    """Moments of many casts, one after the other: ``tick`` ascends from each of ``first`` on."""

    tick: Int[np.ndarray, "n"]
    first: Int[np.ndarray, "d"]

    @cached_property
    def stop(self) -> Int[np.ndarray, "d"]:
        """One past the last position of each cast."""
        return np.append(self.first[1:], len(self.tick))

    @cached_property
    def cast(self) -> Int[np.ndarray, "n"]:
        """The cast of each moment."""
        return np.repeat(np.arange(len(self.first)), self.stop - self.first)

    @cached_property
    def ticks(self) -> int:
        """A number larger than any difference of moments."""
        return int(np.ptp(self.tick)) + 1 if len(self.tick) else 1

    @cached_property
    def _key(self) -> Int[np.ndarray, "n"] | None:
        """One ascending number for (cast, moment); None if no cast lacks a moment."""
        begin = self.first[self.cast]
        if np.array_equal(self.tick - self.tick[begin], np.arange(len(begin)) - begin):
            return None
        return self.cast * (2 * self.ticks) + (self.tick - self.tick.min())

    def back(self, at: Int[np.ndarray, "m"], by: int) -> Int[np.ndarray, "m"]:
        """First position of the same cast not more than ``by`` moments before."""
        if self._key is None:
            return np.maximum(at - by, self.first[self.cast[at]])
        # No further than the casts are apart in the keys.
        return np.searchsorted(self._key, self._key[at] - min(by, self.ticks))


def align(
    moments: Timeline,
    log_p: Float[np.ndarray, "k n"],
    log_judged: Float[np.ndarray, "k n"],
    spans: Sequence[Span],
    step_s: float,
    least_log_score: float,
) -> list[tuple[int, Aligned]]:
    """Every event of every cast: the cast's number, and the event; best first within a cast.

    ``log_p`` (phases, moments) scores the cores, ``log_judged`` decides how far phases stretch:
    what cannot be judged lowers the one, and says nothing in the other.

    After the best alignment of a cast, what lies before it and what lies after it are searched in
    the same way, until nothing of ``least_log_score`` is left; so a cast's events do not overlap.
    An alignment at the edge of a better event may be that event's slope, and no other event
    (:meth:`Aligned.is_flank`).
    """
    out: list[tuple[int, Aligned]] = []
    needed = sum(span.shortest for span in spans)
    # What is left: pieces of casts, and whether a better event was cut out before and after each.
    position, first = np.arange(len(moments.tick)), moments.first
    cut = np.zeros((len(first), 2), bool)
    while len(position):
        left = Timeline(moments.tick[position], first)
        table = _Table(left, log_p[:, position], log_judged[:, position], spans, step_s)
        pieces: list[tuple[np.ndarray, tuple[bool, bool]]] = []
        for number, last in table.best(least_log_score):
            found = table.trace(last)
            if found.log_score < least_log_score:
                continue
            begin, stop = int(left.first[number]), int(left.stop[number])
            before, after = cut[number]
            if not found.is_flank(
                table.log_p, begin if before else None, stop - 1 if after else None
            ):
                out.append((int(moments.cast[position[begin]]), found.among(position)))
            pieces += [
                (position[begin : found.begin], (before, True)),
                (position[found.end + 1 : stop], (True, after)),
            ]
        pieces = [piece for piece in pieces if len(piece[0]) * 2 >= needed]
        cut = np.array([edges for _, edges in pieces], bool).reshape(-1, 2)
        position = np.concatenate([np.zeros(0, int), *(piece for piece, _ in pieces)])
        first = np.cumsum([0, *(len(piece) for piece, _ in pieces)])[:-1]
    return out


class _Table:
    """The dynamic programme over moments: see the formulas above."""

    def __init__(
        self,
        moments: Timeline,
        log_p: Float[np.ndarray, "k n"],
        log_judged: Float[np.ndarray, "k n"],
        spans: Sequence[Span],
        step_s: float,
    ) -> None:
        self.moments, self.log_p, self.spans = moments, log_p, spans
        missing = np.diff(moments.tick, prepend=moments.tick[:1]) - 1
        missing[moments.first] = 0
        denied = odds(np.log(np.array([FLOOR])))[0]
        self.log_judged, self.denied = log_judged, denied * missing
        self.gain = STRETCH * step_s * (odds(log_judged) + self.denied)
        self.stretch = np.cumsum(self.gain, axis=1)
        self.core_first: list[np.ndarray] = []
        self.value: list[np.ndarray] = []
        for number, span in enumerate(spans):
            first, core = cores(moments, log_p[number], span.shortest)
            if number:
                core = core + window_max(self._reached(number - 1), *self._gap(number, first))
            self.core_first.append(first)
            # Rounded, so that equal values stay equal whatever was summed before them.
            self.value.append(np.round(core, _DECIMALS))

    def _gap(
        self, number: int, first: Int[np.ndarray, "m"]
    ) -> tuple[Int[np.ndarray, "m"], Int[np.ndarray, "m"]]:
        """First and last position at which the phase before may end; the last is below the first
        where there is none.
        """
        begin = self.moments.first[self.moments.cast[first]]
        low = self.moments.back(first, 1 + self.spans[number].gap)
        return low, np.where(first > begin, first - 1, low - 1)

    def _reached(self, number: int) -> Float[np.ndarray, "n"]:
        """W: best value of the phases so far if this one, extended, ends at each moment."""
        value, stretch = self.value[number], self.stretch[number]
        more = self._more(number)
        if more == 0:
            return value
        at = np.arange(len(value))
        # Minus infinity minus a number is minus infinity, so nothing here is NaN.
        return window_max(value - stretch, self.moments.back(at, more), at) + stretch

    def _more(self, number: int) -> int:
        """Moments by which a phase may be longer than its core."""
        span = self.spans[number]
        return self.moments.ticks if span.longest is None else span.longest - span.shortest

    def best(self, least: float) -> list[tuple[int, int]]:
        """Casts that can reach the score, and where the last core of the best alignment ends."""
        value, first, stop = self.value[-1], self.moments.first, self.moments.stop
        rounded = len(self.spans) * 10.0**-_DECIMALS
        casts = np.flatnonzero(np.maximum.reduceat(value, first) >= least - rounded)
        return [
            (int(cast), int(first[cast] + np.argmax(value[first[cast] : stop[cast]])))
            for cast in casts
        ]

    def trace(self, last: int) -> Aligned:
        """The alignment whose last core ends here, extended beyond its cores."""
        core: list[tuple[int, int]] = []
        ends = [last]
        cost = 0.0
        for number in range(len(self.spans) - 1, -1, -1):
            first = int(self.core_first[number][last])
            core.insert(0, (first, last))
            if number:
                stop, last = self._stretched_before(number, first)
                cost += min(0.0, float(self.gain[number - 1][last + 1 : stop + 1].sum()))
                ends.insert(0, stop)
        total = sum(
            float(row[first : last + 1].mean())
            for row, (first, last) in zip(self.log_p, core, strict=True)
        )
        whole = [(first, end) for (first, _), end in zip(core, ends, strict=True)]
        whole[0] = (self._stretched_back(core[0], whole[0][1]), whole[0][1])
        whole[-1] = (whole[-1][0], self._stretched_on(whole[-1][0], core[-1]))
        return Aligned(tuple(core), tuple(whole), total + cost, cost)

    def _stretched_before(self, number: int, first: int) -> tuple[int, int]:
        """Best end of the previous phase and of its core if this core begins at ``first``."""
        low, high = (int(x[0]) for x in self._gap(number, np.array([first])))
        stops = np.arange(low, high + 1)
        froms = self.moments.back(stops, self._more(number - 1))
        rows = slice(int(froms[0]), high + 1)
        value = self.value[number - 1][rows] - self.stretch[number - 1][rows]
        best = window_max(value, froms - froms[0], stops - froms[0])
        best += self.stretch[number - 1][stops]
        # The last of equals, of both ends.
        at = len(stops) - 1 - int(np.argmax(best[::-1]))
        window = value[froms[at] - froms[0] : stops[at] + 1 - froms[0]]
        return int(stops[at]), int(stops[at]) - int(np.argmax(window[::-1]))

    def _stretched_back(self, core: tuple[int, int], end: int) -> int:
        """Best begin of the first phase if it ends at ``end``."""
        tick, first = self.moments.tick, core[0]
        left = max(self._more(0) - int(tick[end] - tick[core[1]]), 0)
        low = int(self.moments.back(np.array([first]), left)[0])
        if low == first:
            return first
        gains = np.cumsum(self._own_gain(0, core, slice(low, first))[::-1])[::-1]
        return low + int(np.argmax(gains)) if gains.max() > 0 else first

    def _own_gain(self, number: int, core: tuple[int, int], at: slice) -> Float[np.ndarray, "n"]:
        """Log odds that moments belong to the event that has this core: its own moments do, likely
        or not, and others as far as they are as likely.
        """
        core_mean = float(self.log_judged[number, core[0] : core[1] + 1].mean())
        relative = self.log_judged[number, at] - core_mean
        return np.asarray(odds(relative) + self.denied[at])

    def _stretched_on(self, begin: int, core: tuple[int, int]) -> int:
        """Best end of the last phase if it begins at ``begin``."""
        last = core[1]
        tick, longest = self.moments.tick, self.spans[-1].longest
        stop = int(self.moments.stop[self.moments.cast[last]])
        if longest is not None:
            stop = int(np.searchsorted(tick[begin:stop], tick[begin] + longest)) + begin
        gains = np.cumsum(self._own_gain(len(self.spans) - 1, core, slice(last + 1, stop)))
        return last + 1 + int(np.argmax(gains)) if gains.max(initial=0.0) > 0 else last


def cores(
    moments: Timeline, log_p: Float[np.ndarray, "n"], length: int
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """First position and log probability of the cores that end at each moment.

    At least half of a core's moments must exist, including its first and its last.
    """
    at = np.arange(len(log_p))
    first = moments.back(at, length - 1)
    count = at - first + 1
    total = np.concatenate([[0.0], np.cumsum(log_p)])
    whole = (moments.tick[at] - moments.tick[first] == length - 1) & (2 * count >= length)
    return first, np.where(whole, (total[at + 1] - total[first]) / count, -np.inf)


def odds(log_p: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Log odds of log probabilities, at most :data:`MOST_GAIN`."""
    # log(p / (1 - p)) grows with p, so capping p caps the log odds.
    most = -np.log1p(np.exp(-MOST_GAIN))
    capped = np.minimum(log_p, most)
    return capped - np.log(-np.expm1(capped))


def window_max(
    values: Float[np.ndarray, "n"], low: Int[np.ndarray, "m"], high: Int[np.ndarray, "m"]
) -> Float[np.ndarray, "m"]:
    """``max(values[low : high + 1])`` of every window; minus infinity where it is empty.

    A sparse table of which only one level is kept at a time: O(n log w) for windows of w.
    """
    out = np.full(len(low), -np.inf)
    length = high - low + 1
    some = np.flatnonzero(length > 0)
    if len(some) == 0:
        return out
    level = np.frexp(length[some].astype(float))[1] - 1
    table = values
    for step in range(int(level.max()) + 1):
        at = some[level == step]
        if len(at):
            out[at] = np.maximum(table[low[at]], table[high[at] + 1 - (1 << step)])
        half = 1 << step
        if len(table) > half:
            table = np.maximum(table[:-half], table[half:])
    return out
