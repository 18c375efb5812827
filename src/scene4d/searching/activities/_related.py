"""Alignment of phases that stand in Allen's relations, by a search over the times that matter.

Phases that follow one another are aligned exactly (:mod:`compose`). Relations such as "during"
tie both ends of two intervals, so here the ends are taken from a pool: where some phase turns from
unlikely to likely or back, where its best core lies, and the cast's first and last moment; of a
cast of a few moments, all of them. Among these the best combination is found by branch and bound.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.searching.activities._compose import STRETCH, Aligned, Span, Timeline, cores, odds
from scene4d.searching.activities.definition import Activity

_FEW = 24
"""Moments of a cast of which each may begin or end a phase; the pairs of more take too long. Chosen
by hand, as is the next."""
_RUNS = 6
"""Of a longer cast, the longest likely stretches of a phase whose ends are tried."""
# Intervals are half open in time: [s, e + 1) in moments; x = (s, e) is related to y = (u, v).
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


def align_related(
    moments: Timeline,
    log_p: Float[np.ndarray, "k n"],
    log_judged: Float[np.ndarray, "k n"],
    activity: Activity,
    spans: Sequence[Span],
    step_s: float,
    least_log_score: float,
) -> list[tuple[int, Aligned]]:
    """As :func:`compose.align`, for an activity with relations; the best event first, then those
    wholly before or after it that are no flanks of it.
    """
    out: list[tuple[int, Aligned]] = []
    for cast, (begin, stop) in enumerate(zip(moments.first, moments.stop, strict=True)):
        todo: list[tuple[int, int, bool, bool]] = [(int(begin), int(stop), False, False)]
        while todo:
            low, high, before, after = todo.pop()
            rows = slice(low, high)
            found = _best(
                moments.tick[rows], log_p[:, rows], log_judged[:, rows], activity, spans, step_s
            )
            if found is None or found.log_score < least_log_score:
                continue
            found = found.among(np.arange(low, high))
            if not found.is_flank(log_p, low if before else None, high - 1 if after else None):
                out.append((cast, found))
            todo += [(low, found.begin, before, True), (found.end + 1, high, True, after)]
    return out


def _best(
    tick: Int[np.ndarray, "n"],
    log_p: Float[np.ndarray, "k n"],
    log_judged: Float[np.ndarray, "k n"],
    activity: Activity,
    spans: Sequence[Span],
    step_s: float,
) -> Aligned | None:
    """The best alignment of one cast; None where there is none."""
    if len(tick) == 0:
        return None
    moments = Timeline(tick, np.zeros(1, int))
    of_cores = [cores(moments, row, span.shortest) for row, span in zip(log_p, spans, strict=True)]
    pool = _pool(log_judged, of_cores)
    choices = [
        _choices(tick, core, STRETCH * step_s * odds(judged), span, pool)
        for core, judged, span in zip(of_cores, log_judged, spans, strict=True)
    ]
    if any(len(choice.begin) == 0 for choice in choices):
        return None
    chosen = _search(tick, choices, activity, spans)
    if chosen is None:
        return None
    picked = list(zip(choices, chosen, strict=True))
    cost = float(sum(choice.cost[at] for choice, at in picked))
    return Aligned(
        tuple((int(choice.core_first[at]), int(choice.core_end[at])) for choice, at in picked),
        tuple((int(choice.begin[at]), int(choice.end[at])) for choice, at in picked),
        float(sum(choice.value[at] for choice, at in picked)) + cost,
        cost,
    )


def _pool(
    log_p: Float[np.ndarray, "k n"], of_cores: Sequence[tuple[np.ndarray, np.ndarray]]
) -> Int[np.ndarray, "t"]:
    """Positions at which a phase may begin or end."""
    n = log_p.shape[1]
    if n <= _FEW:
        return np.arange(n)
    ends = {0, n - 1}
    for row, (first, core) in zip(log_p, of_cores, strict=True):
        likely = np.concatenate([[False], odds(row) > 0, [False]])
        begin = np.flatnonzero(likely[1:] & ~likely[:-1])
        end = np.flatnonzero(likely[:-1] & ~likely[1:]) - 1
        for at in np.argsort(-(end - begin), kind="stable")[:_RUNS]:
            ends |= {int(begin[at]), int(end[at])}
        if np.isfinite(core).any():
            best = int(np.argmax(core))
            ends |= {int(first[best]), best}
    # Neighbours too: an interval may end where another begins, or within it by a moment.
    return np.unique(np.clip([end + by for end in ends for by in (-1, 0, 1)], 0, n - 1))


@dataclass(frozen=True, eq=False)
class _Choices:
    """Intervals that a phase may take, best first: by the log probability of the best core within
    (``value``) and what stretching brings, together ``rank``. ``cost`` is what stretching costs.
    """

    begin: Int[np.ndarray, "m"]
    end: Int[np.ndarray, "m"]
    core_first: Int[np.ndarray, "m"]
    core_end: Int[np.ndarray, "m"]
    value: Float[np.ndarray, "m"]
    cost: Float[np.ndarray, "m"]
    rank: Float[np.ndarray, "m"]


def _choices(
    tick: Int[np.ndarray, "n"],
    core: tuple[np.ndarray, np.ndarray],
    gain: Float[np.ndarray, "n"],
    span: Span,
    pool: Int[np.ndarray, "t"],
) -> _Choices:
    begin, end = (grid.ravel() for grid in np.meshgrid(pool, pool, indexing="ij"))
    length = tick[np.maximum(begin, end)] - tick[begin] + 1
    allowed = (begin <= end) & (length >= span.shortest)
    if span.longest is not None:
        allowed &= length <= span.longest
    begin, end = begin[allowed], end[allowed]
    core_first, log_core = core
    value, core_end = np.full(len(begin), -np.inf), np.zeros(len(begin), int)
    for at, (first, last) in enumerate(zip(begin, end, strict=True)):
        rows = slice(first, last + 1)
        inside = np.where(core_first[rows] >= first, log_core[rows], -np.inf)
        core_end[at] = first + int(np.argmax(inside))
        value[at] = inside.max()
    total = np.concatenate([[0.0], np.cumsum(gain)])
    brought = total[end + 1] - total[begin]
    rank = value + brought
    order = np.argsort(-rank, kind="stable")
    order = order[np.isfinite(value[order])]
    core_end = core_end[order]
    return _Choices(
        begin[order],
        end[order],
        core_first[core_end],
        core_end,
        value[order],
        np.minimum(0.0, brought)[order],
        rank[order],
    )


def _search(
    tick: Int[np.ndarray, "n"],
    choices: Sequence[_Choices],
    activity: Activity,
    spans: Sequence[Span],
) -> list[int] | None:
    """The best choice for every phase that obeys all relations; None where there is none."""
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
        for at in np.flatnonzero(_allowed(tick, choices, taken, activity, spans[number].gap)):
            bound = value + float(choices[number].rank[at])
            if bound + rest[number + 1] <= best[0]:
                return
            visit([*taken, int(at)], bound)

    visit([], 0.0)
    return best[1]


def _allowed(
    tick: Int[np.ndarray, "n"],
    choices: Sequence[_Choices],
    taken: Sequence[int],
    activity: Activity,
    gap: int,
) -> Bool[np.ndarray, "m"]:
    """Which choices of the next phase stand as they must to those taken for the ones before; a
    phase without a relation to the one before it follows that within ``gap``.
    """
    number, names = len(taken), [phase.name for phase in activity.phases]
    choice = choices[number]
    own = (tick[choice.begin], tick[choice.end])
    keep = np.ones(len(choice.begin), bool)
    for before, at in enumerate(taken):
        other = (tick[choices[before].begin[at]], tick[choices[before].end[at]])
        related = False
        for r in activity.relations:
            if (r.first, r.second) == (names[number], names[before]):
                related, keep = True, keep & _ALLEN[r.relation](*own, *other)
            elif (r.second, r.first) == (names[number], names[before]):
                related, keep = True, keep & _ALLEN[r.relation](*other, *own)
        if before == number - 1 and not related:
            pause = own[0] - other[1]
            keep &= (pause >= 1) & (pause <= 1 + gap)
    return keep
