"""Alignment of phases that stand in Allen's relations, by a search over the times that matter.

Phases that follow one another are aligned exactly (:mod:`compose`). Relations such as "during"
tie both ends of two intervals, so here the ends are taken from a pool: where some phase turns from
unlikely to likely or back, where its best core lies, and the cast's first and last moment; of a
cast of a few moments, all of them. Among these the best combination is found without a gap in the
search, by branch and bound.
"""

from collections.abc import Callable, Mapping, Sequence

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.searching.activities.compose import STRETCH, Aligned, Moments, Span, odds
from scene4d.searching.activities.definition import Activity

_FEW = 24
_RUNS = 6
# Intervals are half open in time: [s, e + 1) in moments; x is related to y.
_ALLEN: Mapping[str, Callable[..., np.ndarray]] = {
    "before": lambda s, e, u, v: e + 1 < u,
    "meets": lambda s, e, u, v: e + 1 == u,
    "overlaps": lambda s, e, u, v: (s < u) & (u <= e) & (e < v),
    "starts": lambda s, e, u, v: (s == u) & (e < v),
    "during": lambda s, e, u, v: (u < s) & (e < v),
    "finishes": lambda s, e, u, v: (u < s) & (e == v),
    "equals": lambda s, e, u, v: (s == u) & (e == v),
    "after": lambda s, e, u, v: v + 1 < s,
    "met_by": lambda s, e, u, v: v + 1 == s,
    "overlapped_by": lambda s, e, u, v: (u < s) & (s <= v) & (v < e),
    "started_by": lambda s, e, u, v: (s == u) & (v < e),
    "contains": lambda s, e, u, v: (s < u) & (v < e),
    "finished_by": lambda s, e, u, v: (s < u) & (e == v),
}


def holds(relation: str, first: tuple[int, int], second: tuple[int, int]) -> bool:
    """Whether two intervals of moments, both ends included, stand in the relation."""
    return bool(_ALLEN[relation](*first, *second))


def align_related(
    moments: Moments,
    log_p: Float[np.ndarray, "k n"],
    log_judged: Float[np.ndarray, "k n"],
    activity: Activity,
    spans: Sequence[Span],
    step_s: float,
    least_log_score: float,
) -> list[tuple[int, Aligned]]:
    """As :func:`compose.align`, for an activity with relations; the best event first, then those
    wholly before or behind it that are no flanks of it.
    """
    out: list[tuple[int, Aligned]] = []
    ends = [*moments.first[1:], len(moments.tick)]
    for cast, (begin, end) in enumerate(zip(moments.first, ends, strict=True)):
        todo: list[tuple[int, int, bool, bool]] = [(int(begin), int(end), False, False)]
        while todo:
            low, high, before, behind = todo.pop()
            rows = slice(low, high)
            found = _best(
                moments.tick[rows], log_p[:, rows], log_judged[:, rows], activity, spans, step_s
            )
            if found is None or found.log_score < least_log_score:
                continue
            moved = Aligned(
                tuple((a + low, b + low) for a, b in found.core),
                tuple((a + low, b + low) for a, b in found.whole),
                found.log_score,
                found.stretched,
            )
            cuts = low if before else None, high - 1 if behind else None
            if not moved.is_flank(log_p, *cuts):
                out.append((cast, moved))
            todo += [(low, moved.begin, before, True), (moved.end + 1, high, True, behind)]
    return out


class _Choices:
    """Intervals that a phase may take, best first."""

    def __init__(
        self,
        tick: Int[np.ndarray, "n"],
        log_p: Float[np.ndarray, "n"],
        log_judged: Float[np.ndarray, "n"],
        span: Span,
        pool: Int[np.ndarray, "t"],
        weight: float,
    ) -> None:
        s, e = (grid.ravel() for grid in np.meshgrid(pool, pool, indexing="ij"))
        length = tick[np.maximum(s, e)] - tick[s] + 1
        allowed = (s <= e) & (length >= span.shortest)
        if span.longest is not None:
            allowed &= length <= span.longest
        s, e = s[allowed], e[allowed]
        core_first, core = _cores(tick, log_p, span.shortest)
        stretch = np.concatenate([[0.0], np.cumsum(weight * odds(log_judged))])
        value, core_end = np.full(len(s), -np.inf), np.zeros(len(s), int)
        for at, (first, last) in enumerate(zip(s, e, strict=True)):
            inside = np.where(
                core_first[first : last + 1] >= first, core[first : last + 1], -np.inf
            )
            core_end[at] = first + int(np.argmax(inside))
            value[at] = inside.max()
        self.cost = np.minimum(0.0, stretch[e + 1] - stretch[s])
        order = np.argsort(-(value + stretch[e + 1] - stretch[s]), kind="stable")
        order = order[np.isfinite(value[order])]
        self.rank = (value + stretch[e + 1] - stretch[s])[order]
        self.s, self.e, self.value = s[order], e[order], value[order]
        self.cost, self.core_end = self.cost[order], core_end[order]
        self.core_first = core_first[self.core_end]


def _cores(
    tick: Int[np.ndarray, "n"], log_p: Float[np.ndarray, "n"], length: int
) -> tuple[Int[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """First position and mean of the cores that end at each moment."""
    first = np.searchsorted(tick, tick - length + 1)
    total = np.concatenate([[0.0], np.cumsum(log_p)])
    at = np.arange(len(tick))
    count = at - first + 1
    whole = (tick - tick[first] == length - 1) & (2 * count >= length)
    return first, np.where(whole, (total[at + 1] - total[first]) / count, -np.inf)


def _best(
    tick: Int[np.ndarray, "n"],
    log_p: Float[np.ndarray, "k n"],
    log_judged: Float[np.ndarray, "k n"],
    activity: Activity,
    spans: Sequence[Span],
    step_s: float,
) -> Aligned | None:
    if len(tick) == 0:
        return None
    pool = _pool(tick, log_judged, spans)
    choices = [
        _Choices(tick, row, judged, span, pool, STRETCH * step_s)
        for row, judged, span in zip(log_p, log_judged, spans, strict=True)
    ]
    if any(len(choice.s) == 0 for choice in choices):
        return None
    chosen = _search(tick, choices, activity, spans)
    if chosen is None:
        return None
    picked = [(choice, at) for choice, at in zip(choices, chosen, strict=True)]
    cost = float(sum(choice.cost[at] for choice, at in picked))
    return Aligned(
        tuple((int(choice.core_first[at]), int(choice.core_end[at])) for choice, at in picked),
        tuple((int(choice.s[at]), int(choice.e[at])) for choice, at in picked),
        float(sum(choice.value[at] for choice, at in picked)) + cost,
        cost,
    )


def _pool(
    tick: Int[np.ndarray, "n"], log_p: Float[np.ndarray, "k n"], spans: Sequence[Span]
) -> Int[np.ndarray, "t"]:
    n = len(tick)
    if n <= _FEW:
        return np.arange(n)
    ends = {0, n - 1}
    for row, span in zip(log_p, spans, strict=True):
        likely = np.concatenate([[False], odds(row) > 0, [False]])
        begin = np.flatnonzero(likely[1:] & ~likely[:-1])
        end = np.flatnonzero(likely[:-1] & ~likely[1:]) - 1
        for at in np.argsort(-(end - begin), kind="stable")[:_RUNS]:
            ends |= {int(begin[at]), int(end[at])}
        first, core = _cores(tick, row, span.shortest)
        if np.isfinite(core).any():
            best = int(np.argmax(core))
            ends |= {int(first[best]), best}
    # Neighbours too: an interval may end where another begins, or within it by a moment.
    return np.unique(np.clip([end + by for end in ends for by in (-1, 0, 1)], 0, n - 1))


def _search(
    tick: Int[np.ndarray, "n"],
    choices: Sequence[_Choices],
    activity: Activity,
    spans: Sequence[Span],
) -> list[int] | None:
    """The best choice for every phase that obeys all relations; None where there is none."""
    names = [phase.name for phase in activity.phases]
    related = {frozenset((r.first, r.second)) for r in activity.relations}

    def allowed(number: int, taken: list[int]) -> Bool[np.ndarray, "d"]:
        choice = choices[number]
        keep = np.ones(len(choice.s), bool)
        own = (tick[choice.s], tick[choice.e])
        for before, at in enumerate(taken):
            other = (tick[choices[before].s[at]], tick[choices[before].e[at]])
            for r in activity.relations:
                if (r.first, r.second) == (names[number], names[before]):
                    keep &= _ALLEN[r.relation](*own, *other)
                elif (r.second, r.first) == (names[number], names[before]):
                    keep &= _ALLEN[r.relation](*other, *own)
            if before == number - 1 and frozenset((names[number], names[before])) not in related:
                pause = own[0] - other[1]
                keep &= (pause >= 1) & (pause <= 1 + spans[number].gap)
        return keep

    rest = np.cumsum([choice.rank[0] for choice in choices][::-1])[::-1]
    rest = np.append(rest, 0.0)
    best: tuple[float, list[int] | None] = (-np.inf, None)

    def visit(taken: list[int], value: float) -> None:
        nonlocal best
        number = len(taken)
        if number == len(choices):
            if value > best[0]:
                best = (value, list(taken))
            return
        for at in np.flatnonzero(allowed(number, taken)):
            bound = value + float(choices[number].rank[at])
            if bound + rest[number + 1] <= best[0]:
                return
            visit([*taken, int(at)], bound)

    visit([], 0.0)
    return best[1]
