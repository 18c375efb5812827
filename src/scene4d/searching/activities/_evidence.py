"""The probability of every phase at every moment of every cast, and no more than is needed."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.searching.activities._casting import Casts, View, views_of
from scene4d.searching.activities._compose import FLOOR, Span, Timeline, cores
from scene4d.searching.activities._terms import arguments
from scene4d.searching.activities.definition import Activity, Role, Term
from scene4d.searching.predicates._crowd import at_least
from scene4d.searching.predicates._meeting import expand, runs
from scene4d.searching.predicates._registry import PREDICATES
from scene4d.searching.predicates.stage import Stage

_UNJUDGED = 0.5
"""Where a predicate cannot be judged (NaN), nothing is known: the statement is a coin toss."""
_ROUNDING = 1e-6
"""Sums of logarithms over a whole day are off by less: what just reaches the least score does."""
_UNLIKELY = 0.01
"""Who does as is said with less probability is not counted among several; chosen by hand."""
_BLOCK = 1 << 17
"""Rows that a predicate is given at a time, so that what it gathers stays small."""

_Statement = tuple[str, tuple[View, ...], tuple[tuple[str, float | str], ...]]
"""A predicate of some views with its parameters."""


@dataclass(frozen=True, eq=False)
class Evidence:
    """Log probabilities of the phases at every moment, (phases, moments): ``log_p`` the product of
    all terms, ``log_judged`` of those that can be judged. ``terms`` are the probabilities of each
    phase's terms, NaN where unjudged; ``enough`` of each phase that enough others are so, where a
    role is played by several.
    """

    casts: Casts
    log_p: Float[np.ndarray, "k n"]
    log_judged: Float[np.ndarray, "k n"]
    terms: tuple[tuple[Float[np.ndarray, "n"], ...], ...]
    enough: Float[np.ndarray, "k n"] | None = None


def gather(stage: Stage, activity: Activity, casts: Casts, least_score: float) -> Evidence:
    """The evidence for the casts that can still reach ``least_score``.

    A phase is never more probable than its best core. So terms are judged one after the other,
    those of one role first, and casts whose best cores multiply to less are dropped; no event of
    ``least_score`` or more is lost, and with 0 no cast is dropped. Where several play a role all
    casts are kept to count them, and the probability that enough others do as this one does is one
    more factor of each phase.
    """
    judged: dict[_Statement, np.ndarray] = {}
    log_p = np.zeros((len(activity.phases), len(casts)))
    unjudged = np.zeros(log_p.shape)
    spans = [Span.of(phase, stage.step_s) for phase in activity.phases]
    drops = least_score > 0 and not played_by_several(activity)
    for statement, uses in _statements(activity):
        values = judged[statement] = _judge(stage, casts, statement)
        for phase, negated in uses:
            log_p[phase] += _log_probability(values, negated)
            unjudged[phase] += np.isnan(values)
        if not drops:
            continue
        alive = _alive(_best_cores(log_p, casts, spans), least_score)
        if not alive.all():
            keep = np.repeat(alive, casts.count)
            casts, log_p, unjudged = casts.only(alive), log_p[:, keep], unjudged[:, keep]
            judged = {key: value[keep] for key, value in judged.items()}
    # A moment at which nothing of a phase can be judged does not speak for it.
    count = np.array([len(phase.terms) for phase in activity.phases])
    nothing = unjudged == count[:, None]
    log_judged = np.where(nothing, np.log(FLOOR), log_p - unjudged * np.log(_UNJUDGED))
    log_p = np.where(nothing, np.log(FLOOR), log_p)
    terms = tuple(
        tuple(_negated(judged[_statement(term)], term.negated) for term in phase.terms)
        for phase in activity.phases
    )
    counted = played_by_several(activity)
    if counted is None:
        return Evidence(casts, log_p, log_judged, terms)
    enough = _enough(activity, counted, casts, terms)
    log_enough = np.log(np.maximum(enough, FLOOR))
    return Evidence(casts, log_p + log_enough, log_judged + log_enough, terms, enough)


def played_by_several(activity: Activity) -> Role | None:
    """The role that several play, if there is one."""
    return next((role for role in activity.roles if role.is_counted), None)


def _enough(
    activity: Activity, role: Role, casts: Casts, terms: tuple[tuple[np.ndarray, ...], ...]
) -> Float[np.ndarray, "k n"]:
    """P(so many others are as the phase says of the role that several play), at every moment.

    Others are those of the same moment with the same partners; each is so with the product of what
    is said of him, 0 where that cannot be judged, independently of the rest.
    """
    names = [one.name for one in activity.roles]
    who = np.repeat(np.delete(casts.tracks, names.index(role.name), axis=1), casts.count, axis=0)
    keys = [*who.T, casts.tick]
    order = np.lexsort(keys[::-1])
    begin = runs(*(key[order] for key in keys))
    size = np.diff(np.append(begin, len(order)))
    group = np.repeat(np.arange(len(begin)), size)
    found = np.ones((len(terms), len(casts)))
    for number, phase in enumerate(activity.phases):
        said = zip(phase.terms, terms[number], strict=True)
        own = [np.nan_to_num(values)[order] for term, values in said if role.name in term.roles]
        if own:
            p = np.prod(own, axis=0)
            found[number, order] = _others(p, group, begin, size, role)
    return found


def _others(
    p: Float[np.ndarray, "n"],
    group: Int[np.ndarray, "n"],
    begin: Int[np.ndarray, "k"],
    size: Int[np.ndarray, "k"],
    role: Role,
) -> Float[np.ndarray, "n"]:
    """P(so many others of each one's group as the role says); who is unlikely himself counts as
    nobody, and has no value.
    """
    likely = np.flatnonzero(p > _UNLIKELY)
    # The likely ones of each group, as ranges of ``likely``.
    low = np.searchsorted(likely, begin)[group[likely]]
    high = np.searchsorted(likely, begin + size)[group[likely]]
    owner, other = expand(low, high - low)
    apart = owner != other
    found, others = np.zeros(len(p)), (owner[apart], p[likely[other[apart]]], len(likely))
    found[likely] = at_least(*others, role.count - 1)
    if role.exactly:
        found[likely] -= at_least(*others, role.count)
    return found


def promising(
    stage: Stage,
    activity: Activity,
    role: str,
    rows: Int[np.ndarray, "n"],
    least_score: float,
) -> Int[np.ndarray, "m"]:
    """The rows of those tracks that can reach ``least_score`` by what is said of their role alone:
    as :func:`gather`, before any casts are made. Of which moments a cast consists is not known yet:
    here a phase is never more probable than its best moment.
    """
    first = np.flatnonzero(np.diff(stage.track_of_row[rows], prepend=-1))
    alone = Casts(
        {(role, 0.0): rows}, stage.tick[rows], first, stage.track_of_row[rows[first]][:, None]
    )
    log_p = np.zeros((len(activity.phases), len(rows)))
    for statement, uses in _statements(activity):
        if statement[1] == ((role, 0.0),):
            values = _judge(stage, alone, statement)
            for phase, negated in uses:
                log_p[phase] += _log_probability(values, negated)
    best = np.maximum.reduceat(log_p, first, axis=1) if len(first) else log_p
    return rows[np.repeat(_alive(best, least_score), alone.count)]


def _best_cores(
    log_p: Float[np.ndarray, "k n"], casts: Casts, spans: Sequence[Span]
) -> Float[np.ndarray, "k d"]:
    """Log probability of the best core of each phase, of each cast."""
    if len(casts.first) == 0:
        return np.zeros((len(spans), 0))
    moments = Timeline(casts.tick, casts.first)
    value = np.stack(
        [cores(moments, p, span.shortest)[1] for p, span in zip(log_p, spans, strict=True)]
    )
    return np.maximum.reduceat(value, casts.first, axis=1)


def _alive(best: Float[np.ndarray, "k d"], least_score: float) -> Bool[np.ndarray, "d"]:
    """Casts of which the best values of all phases multiply to the least score, or more."""
    return np.asarray(best.sum(axis=0) >= np.log(least_score) - _ROUNDING)


def _negated(values: Float[np.ndarray, "n"], negated: bool) -> Float[np.ndarray, "n"]:
    return 1 - values if negated else values


def _log_probability(
    values: Float[np.ndarray, "n"], negated: bool = False
) -> Float[np.ndarray, "n"]:
    """Logarithm of a term's probabilities, floored, and of a coin toss where they are NaN."""
    p = _negated(values, negated)
    return np.log(np.where(np.isnan(p), _UNJUDGED, np.maximum(p, FLOOR)))


def _statements(activity: Activity) -> list[tuple[_Statement, list[tuple[int, bool]]]]:
    """Distinct statements, and the phases that use them; those of one role before those of two, and
    of these the cheapest first.
    """
    uses: dict[_Statement, list[tuple[int, bool]]] = {}
    for number, phase in enumerate(activity.phases):
        for term in phase.terms:
            uses.setdefault(_statement(term), []).append((number, term.negated))
    return sorted(
        uses.items(), key=lambda item: (len(item[0][1]), item[0][0] not in ("near", "far"))
    )


def _statement(term: Term) -> _Statement:
    return (term.predicate, views_of(term), tuple(sorted(arguments(term).items())))


def _judge(stage: Stage, casts: Casts, statement: _Statement) -> Float[np.ndarray, "n"]:
    """The predicate at every moment; 0 where a lagged track was not there."""
    name, views, parameters = statement
    rows = [casts.rows[view] for view in views]
    there = np.flatnonzero(np.logical_and.reduce([row >= 0 for row in rows]))
    asked = [row[there] for row in rows]
    values = np.zeros(len(casts))
    if len(asked) == 1:
        # A row that many casts share is judged once.
        distinct = np.flatnonzero(np.bincount(asked[0], minlength=len(stage.tracks)))
        of_row = np.full(len(stage.tracks), np.nan)
        of_row[distinct] = _call(stage, name, [distinct], dict(parameters))
        values[there] = of_row[asked[0]]
    else:
        values[there] = _call(stage, name, asked, dict(parameters))
    return values


def _call(
    stage: Stage, name: str, rows: list[np.ndarray], parameters: dict[str, float | str]
) -> Float[np.ndarray, "n"]:
    out = np.empty(len(rows[0]))
    for begin in range(0, len(out), _BLOCK):
        block = [stage.rows(row[begin : begin + _BLOCK]) for row in rows]
        out[begin : begin + _BLOCK] = PREDICATES[name].function(*block, **parameters)
    return np.clip(out, 0.0, 1.0)


def phase_value(values: Float[np.ndarray, "n"]) -> float:
    """Geometric mean of a term over some moments, as it enters the score; NaN where all are."""
    if np.isnan(values).all():
        return float("nan")
    return float(np.exp(_log_probability(values).mean()))
