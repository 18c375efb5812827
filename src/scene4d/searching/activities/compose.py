"""The best alignment of an activity's phases with what happened, by dynamic programming.

A phase is at least its *core*: the shortest time that it may last. Its probability is the geometric
mean of its moments' there, so that length is not punished and one bad moment does not kill; an
activity's is the product of its phases'. A phase may last longer than its core, as long as it may
and as long as it is more likely than not; how well it does there decides between alignments only
(:data:`STRETCH`), except that stretching a phase over what denies it costs probability.

With ``c_k[t]`` the log probability of a core of phase k that ends at moment t, and ``Q_k`` the sum
of what it costs or brings to stretch phase k,

    W_k[v] = max_u (V_k[u] + Q_k[v] - Q_k[u])      u from v - (longest - shortest) to v
    V_k[t] = c_k[t] + max_v W_{k-1}[v]             v up to a gap before the core's first moment

over all moments of all casts at once: the inner maxima are over windows.
"""

from collections.abc import Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from scene4d.searching.activities.evidence import FLOOR
from scene4d.searching.activities.ragged import window_max

STRETCH = 0.04
"""Weight of a second outside the core against the core as a whole."""
MOST_GAIN = 0.5
"""Largest log odds that a moment outside the core counts; least: those of :data:`FLOOR`."""


@dataclass(frozen=True)
class Span:
    """Durations of a phase in moments: shortest, longest (None: any), gap before it."""

    shortest: int
    longest: int | None
    gap: int


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

    def is_flank(
        self, log_p: Float[np.ndarray, "k n"], first: int | None, last: int | None
    ) -> bool:
        """Whether this is the slope of a better event, cut out before ``first`` or behind ``last``
        (None: none was): a core at the cut whose phase is the one on its other side, or is denied.
        """
        phases = len(self.core)
        for phase, (begin, end) in enumerate(self.core):
            beyond = phase == phases - 1 if begin == first else phase == 0
            if begin == first or end == last:
                mean = float(log_p[phase, begin : end + 1].mean())
                if beyond or mean < np.log(0.5):
                    return True
        return False


@dataclass(eq=False)
class Moments:
    """Moments of many casts, one behind the other: ``tick`` ascends from each of ``first`` on."""

    tick: Int[np.ndarray, "n"]
    first: Int[np.ndarray, "d"]
    begin: Int[np.ndarray, "n"] = field(init=False)
    dense: bool = field(init=False)

    def __post_init__(self) -> None:
        count = np.diff(np.append(self.first, len(self.tick)))
        self.begin = np.repeat(self.first, count)
        position = np.arange(len(self.tick))
        self.dense = bool((self.tick - self.tick[self.begin] == position - self.begin).all())

    def back(
        self, at: Int[np.ndarray, "m"], by: int | Int[np.ndarray, "m"]
    ) -> Int[np.ndarray, "m"]:
        """First position of the same cast not more than ``by`` moments before."""
        begin = self.begin[at]
        if self.dense:
            return np.maximum(at - by, begin)
        span = int(self.tick.max() - self.tick.min()) + 1
        owner = np.cumsum(np.isin(np.arange(len(self.tick)), self.first))
        low = self.tick.min()
        key = owner * (2 * span) + (self.tick - low)
        wanted = owner[at] * (2 * span) + np.maximum(self.tick[at] - by - low, 0)
        return np.maximum(np.searchsorted(key, wanted), begin)


def align(
    moments: Moments,
    log_p: Float[np.ndarray, "k n"],
    log_judged: Float[np.ndarray, "k n"],
    spans: Sequence[Span],
    step_s: float,
    least_log_score: float,
) -> list[tuple[int, Aligned]]:
    """Every event of every cast: its number, and where; best first within a cast.

    ``log_p`` (phases, moments) scores the cores, ``log_judged`` decides how far phases stretch:
    what cannot be judged lowers the one, and says nothing in the other.

    After the best alignment of a cast, what lies before it and what lies behind it are searched in
    the same way, until nothing of ``least_log_score`` is left; so a cast's events do not overlap.
    An alignment at the edge of a better event may be that event's slope, and no other event
    (:meth:`Aligned.is_flank`).
    """
    out: list[tuple[int, Aligned]] = []
    position = np.arange(len(moments.tick))
    owner = np.repeat(np.arange(len(moments.first)), np.diff([*moments.first, len(position)]))
    cut = np.zeros((len(moments.first), 2), bool)
    needed = sum(span.shortest for span in spans)
    while len(position):
        first = np.flatnonzero(np.append(True, owner[1:] != owner[:-1]))
        left = Moments(moments.tick[position], first)
        table = _Table(left, log_p[:, position], log_judged[:, position], spans, step_s)
        ends = np.append(first[1:], len(position))
        pieces: list[tuple[np.ndarray, tuple[bool, bool]]] = []
        for number, last in table.best(least_log_score):
            found = table.trace(last)
            if found.log_score < least_log_score:
                continue
            begin, end = int(first[number]), int(ends[number])
            piece = position[begin:end]
            before, behind = cut[number]
            cuts = begin if before else None, end - 1 if behind else None
            if not found.is_flank(table.log_p, *cuts):
                cast = int(np.searchsorted(moments.first, piece[0], side="right")) - 1
                out.append((cast, _shifted(found, position)))
            pieces += [
                (piece[: found.begin - begin], (before, True)),
                (piece[found.end - begin + 1 :], (True, behind)),
            ]
        pieces = [piece for piece in pieces if len(piece[0]) * 2 >= needed]
        cut = np.array([edges for _, edges in pieces], bool).reshape(-1, 2)
        position = np.concatenate([np.zeros(0, int), *(piece for piece, _ in pieces)])
        owner = np.repeat(np.arange(len(pieces)), [len(piece) for piece, _ in pieces])
    return out


class _Table:
    """The dynamic programme over moments."""

    def __init__(
        self,
        moments: Moments,
        log_p: Float[np.ndarray, "k n"],
        log_judged: Float[np.ndarray, "k n"],
        spans: Sequence[Span],
        step_s: float,
    ) -> None:
        self.moments, self.log_p, self.spans = moments, log_p, spans
        at = np.arange(len(moments.tick))
        missing = np.diff(moments.tick, prepend=moments.tick[:1]) - 1
        missing[moments.first] = 0
        denied = odds(np.log(np.array([FLOOR])))[0]
        self.gain = STRETCH * step_s * (odds(log_judged) + denied * missing)
        self.stretch = np.cumsum(self.gain, axis=1)
        self.core_first: list[np.ndarray] = []
        self.core: list[np.ndarray] = []
        self.value: list[np.ndarray] = []
        for number in range(len(spans)):
            first, core = self._cores(number, at)
            self.core_first.append(first)
            self.core.append(core)
            before = self._before(number, first) if number else np.zeros(len(at))
            # Rounded, so that equals stay equal whatever was summed before them.
            self.value.append(np.round(core + before, 9))

    def _cores(
        self, number: int, at: Int[np.ndarray, "n"]
    ) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """First position and log probability of the cores that end at each moment.

        At least half of a core's moments must be there, its first and its last among them.
        """
        length = self.spans[number].shortest
        first = self.moments.back(at, length - 1)
        whole = self.moments.tick[at] - self.moments.tick[first] == length - 1
        count = at - first + 1
        total = np.cumsum(self.log_p[number])
        before = np.where(first > 0, total[first - 1], 0.0)
        mean = (total - before) / count
        return first, np.where(whole & (2 * count >= length), mean, -np.inf)

    def _before(self, number: int, first: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """Best of the phases before, for cores that begin at ``first``."""
        reached = self._reached(number - 1)
        low, high = self._gap(number, first)
        return window_max(reached, low, high)

    def _gap(
        self, number: int, first: Int[np.ndarray, "n"]
    ) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
        """Where the phase before may end."""
        high = np.where(first > self.moments.begin[first], first - 1, -2)
        low = self.moments.back(first, 1 + self.spans[number].gap)
        return low, np.where(high < low, low - 1, high)

    def _reached(self, number: int) -> Float[np.ndarray, "n"]:
        """W: best value of the phases so far when this one, stretched, ends at each moment."""
        value = self.value[number]
        more = self._more(number)
        if more == 0:
            return value
        at = np.arange(len(value))
        low = self.moments.back(at, more)
        # Minus infinity minus a number is itself; nothing here is NaN.
        return window_max(value - self.stretch[number], low, at) + self.stretch[number]

    def _more(self, number: int) -> int:
        span = self.spans[number]
        if span.longest is None:
            return int(self.moments.tick.max() - self.moments.tick.min()) + 1
        return span.longest - span.shortest

    def best(self, least: float) -> list[tuple[int, int]]:
        """Casts that may reach the score, and where the last core of the best alignment ends."""
        value = self.value[-1]
        best = np.maximum.reduceat(value, self.moments.first)
        casts = np.flatnonzero(best >= least)
        ends = [*self.moments.first[1:], len(value)]
        return [
            (
                int(cast),
                int(self.moments.first[cast])
                + int(np.argmax(value[self.moments.first[cast] : ends[cast]])),
            )
            for cast in casts
        ]

    def trace(self, last: int) -> Aligned:
        """The alignment whose last core ends here, stretched."""
        core: list[tuple[int, int]] = []
        ends: list[int] = []
        cost = 0.0
        end = last
        for number in range(len(self.spans) - 1, -1, -1):
            first = int(self.core_first[number][end])
            core.insert(0, (first, end))
            if number:
                low, high = (int(x[0]) for x in self._gap(number, np.array([first])))
                stop, start = self._stretched_before(number - 1, low, high)
                cost += min(0.0, float(self.gain[number - 1][start + 1 : stop + 1].sum()))
                ends.insert(0, stop)
                end = start
        total = sum(
            float(row[first : last + 1].mean())
            for row, (first, last) in zip(self.log_p, core, strict=True)
        )
        return Aligned(tuple(core), self._whole(core, ends), total + cost, cost)

    def _stretched_before(self, number: int, low: int, high: int) -> tuple[int, int]:
        """Where a phase and its core end, best, if it ends from low to high."""
        stretch, value = self.stretch[number], self.value[number]
        best, found = -np.inf, (high, high)
        for stop in range(high, low - 1, -1):
            from_ = int(self.moments.back(np.array([stop]), self._more(number))[0])
            gain = value[from_ : stop + 1] - stretch[from_ : stop + 1]
            start = from_ + len(gain) - 1 - int(np.argmax(gain[::-1]))
            total = float(gain[start - from_] + stretch[stop])
            if total > best:
                best, found = total, (stop, start)
        return found

    def _whole(self, core: list[tuple[int, int]], ends: list[int]) -> tuple[tuple[int, int], ...]:
        """Phases as stretched between one another, the first also back and the last forward."""
        whole = [(first, end) for (first, _), end in zip(core, [*ends, core[-1][1]], strict=True)]
        tick = self.moments.tick
        begin = self.moments.begin[core[0][0]]
        left = self._more(0) - int(tick[whole[0][1]] - tick[core[0][1]])
        low = max(int(self.moments.back(np.array([core[0][0]]), max(left, 0))[0]), int(begin))
        # Stretching from s to the core's first moment f brings Q[f - 1] - Q[s - 1].
        brought = self.stretch[0][low : core[0][0]]
        if len(brought):
            gains = brought[-1] - np.concatenate(
                [[self.stretch[0][low - 1] if low else 0.0], brought[:-1]]
            )
            if gains.max() > 0:
                whole[0] = (low + int(np.argmax(gains)), whole[0][1])
        last = core[-1][1]
        used = int(tick[whole[-1][1]] - tick[whole[-1][0]]) + 1
        longest = self.spans[-1].longest
        later = np.searchsorted(self.moments.first, last, side="right")
        stop = int([*self.moments.first, len(tick)][later])
        reach = np.flatnonzero(
            tick[last + 1 : stop] - tick[last] <= (np.inf if longest is None else longest - used)
        )
        if len(reach):
            gains = self.stretch[-1][last + 1 : last + 1 + len(reach)] - self.stretch[-1][last]
            if gains.max() > 0:
                whole[-1] = (whole[-1][0], last + 1 + int(np.argmax(gains)))
        return tuple(whole)


def odds(log_p: Float[np.ndarray, "*shape"]) -> Float[np.ndarray, "*shape"]:
    """Log odds of log probabilities, at most :data:`MOST_GAIN`."""
    # log(p / (1 - p)) grows with p, so p is capped where it is the most that counts.
    most = -np.log1p(np.exp(-MOST_GAIN))
    capped = np.minimum(log_p, most)
    return capped - np.log(-np.expm1(capped))


def _shifted(found: Aligned, position: Int[np.ndarray, "n"]) -> Aligned:
    """The same in positions of all moments."""

    def moved(spans: tuple[tuple[int, int], ...]) -> tuple[tuple[int, int], ...]:
        return tuple((int(position[first]), int(position[last])) for first, last in spans)

    return Aligned(moved(found.core), moved(found.whole), found.log_score, found.stretched)
