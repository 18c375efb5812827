"""The probability of every phase at every moment of every cast, and no more than is needed."""

from collections.abc import Mapping
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from scene4d.searching.activities.casting import Frames, View, views_of
from scene4d.searching.activities.definition import Activity, Phase, Term
from scene4d.searching.activities.terms import arguments
from scene4d.searching.predicates.registry import Predicate
from scene4d.searching.predicates.rows import Stage

FLOOR = 0.01
"""A statement that is denied for one moment may be a slip of the tracker: no moment counts less."""
_UNJUDGED = 0.5
"""Where a predicate cannot be judged (NaN), nothing is known: the statement is a coin toss."""

_BLOCK = 1 << 17
"""Rows that a predicate is given at a time, so that what it gathers stays small."""

_Atom = tuple[str, tuple[View, ...], tuple[tuple[str, float | str], ...]]


@dataclass(frozen=True, eq=False)
class Evidence:
    """Log probabilities of the phases at every moment, (phases, moments): ``log_p`` the product of
    all terms, ``log_judged`` of those that can be judged. ``terms`` are the probabilities of each
    phase's terms, NaN where unjudged.
    """

    frames: Frames
    log_p: Float[np.ndarray, "k n"]
    log_judged: Float[np.ndarray, "k n"]
    terms: tuple[tuple[Float[np.ndarray, "n"], ...], ...]


def gather(
    stage: Stage,
    activity: Activity,
    frames: Frames,
    predicates: Mapping[str, Predicate],
    least_score: float,
) -> Evidence:
    """The evidence for the casts that can still reach ``least_score``.

    A phase is never more probable than its best moment. So terms are judged one after the other,
    those of one role first, and casts whose best moments multiply to less are dropped; no event of
    ``least_score`` or more is lost.
    """
    judged: dict[_Atom, np.ndarray] = {}
    log_p = np.zeros((len(activity.phases), len(frames)))
    unjudged = np.zeros(log_p.shape)
    for atom, uses in _plan(activity):
        values = _judge(stage, frames, atom, predicates)
        judged[atom] = values
        for phase, negated in uses:
            log_p[phase] += _log_probability(values, negated)
            unjudged[phase] += np.isnan(values)
        if len(frames) == 0:
            continue
        best = np.maximum.reduceat(log_p, frames.first, axis=1).sum(axis=0)
        alive = best >= np.log(max(least_score, 1e-300)) - 1e-9
        if not alive.all():
            keep = np.repeat(alive, frames.count)
            frames, log_p, unjudged = frames.only(alive), log_p[:, keep], unjudged[:, keep]
            judged = {key: value[keep] for key, value in judged.items()}
    # A moment at which nothing of a phase can be judged does not speak for it.
    count = np.array([len(phase.terms) for phase in activity.phases])
    nothing = unjudged == count[:, None]
    log_judged = np.where(nothing, np.log(FLOOR), log_p - unjudged * np.log(_UNJUDGED))
    log_p = np.where(nothing, np.log(FLOOR), log_p)
    terms = tuple(
        tuple(
            1 - judged[_atom(term)] if term.negated else judged[_atom(term)] for term in phase.terms
        )
        for phase in activity.phases
    )
    return Evidence(frames, log_p, log_judged, terms)


def _log_probability(
    values: Float[np.ndarray, "n"], negated: bool = False
) -> Float[np.ndarray, "n"]:
    """Logarithm of a term's probabilities, floored, and of a coin toss where they are NaN."""
    p = 1 - values if negated else values
    return np.log(np.where(np.isnan(p), _UNJUDGED, np.maximum(p, FLOOR)))


def _plan(activity: Activity) -> list[tuple[_Atom, list[tuple[int, bool]]]]:
    """Distinct statements and the phases that use them; those of one role before those of two."""
    uses: dict[_Atom, list[tuple[int, bool]]] = {}
    for number, phase in enumerate(activity.phases):
        for term in phase.terms:
            uses.setdefault(_atom(term), []).append((number, term.negated))
    return sorted(
        uses.items(), key=lambda item: (len(item[0][1]), item[0][0] not in ("near", "far"))
    )


def _atom(term: Term) -> _Atom:
    return (term.predicate, views_of(term), tuple(sorted(arguments(term).items())))


def _judge(
    stage: Stage, frames: Frames, atom: _Atom, predicates: Mapping[str, Predicate]
) -> Float[np.ndarray, "n"]:
    """The predicate at every moment; 0 where a lagged track was not there."""
    name, views, parameters = atom
    rows = [frames.rows[view] for view in views]
    there = np.flatnonzero(np.logical_and.reduce([row >= 0 for row in rows]))
    if len(rows) == 1:
        # A row that many casts share is judged once.
        asked = np.zeros(len(stage.tracks), bool)
        asked[rows[0][there]] = True
        distinct = np.flatnonzero(asked)
        of_row = np.full(len(stage.tracks), np.nan)
        of_row[distinct] = _call(stage, predicates[name], (distinct,), dict(parameters))
        judged = of_row[rows[0][there]]
    else:
        pair = tuple(row[there] for row in rows)
        judged = _call(stage, predicates[name], pair, dict(parameters))
    values = np.zeros(len(frames))
    values[there] = judged
    return values


def _call(
    stage: Stage,
    predicate: Predicate,
    rows: tuple[Int[np.ndarray, "n"], ...],
    parameters: dict[str, float | str],
) -> Float[np.ndarray, "n"]:
    n = len(rows[0])
    out = np.empty(n)
    for begin in range(0, n, _BLOCK):
        block = slice(begin, begin + _BLOCK)
        out[block] = predicate.function(*(stage.rows(row[block]) for row in rows), **parameters)
    return np.clip(out, 0.0, 1.0)


def phase_value(values: Float[np.ndarray, "n"]) -> float:
    """Geometric mean of a term over some moments, as it enters the score; NaN where all are."""
    if np.isnan(values).all():
        return float("nan")
    return float(np.exp(_log_probability(values).mean()))


def steps(phase: Phase, step_s: float) -> tuple[int, int | None, int]:
    """Shortest and longest duration and gap of a phase in moments; None where it has no longest.

    A duration of n moments lasts n steps; a phase lasts one at least.
    """
    shortest = max(1, int(np.ceil(phase.min_s / step_s - 1e-6)))
    if np.isinf(phase.max_s):
        longest = None
    else:
        longest = max(shortest, int(np.floor(phase.max_s / step_s + 1e-6)))
    gap = int(min(np.floor(phase.gap_s / step_s + 1e-6), np.iinfo(np.int32).max))
    return shortest, longest, gap
