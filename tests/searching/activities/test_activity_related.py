"""Phases in Allen's relations, against looking at every pair of intervals."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.searching.activities._compose import STRETCH, Span, Timeline, odds
from scene4d.searching.activities._related import _ALLEN, align_related
from scene4d.searching.activities.definition import ALLEN, Activity, Phase, Relation, Role, Term

STEP_S = 0.5


def _activity(relation):
    term = (Term("lit", ("a",)),)
    return Activity(
        "x",
        (Role("a", ("person",)),),
        (Phase("p", term), Phase("q", term)),
        (Relation("p", relation, "q"),),
    )


def _holds(relation, one, other):
    return bool(_ALLEN[relation](*one, *other))


def _intervals(n):
    return list(itertools.combinations_with_replacement(range(n), 2))


def test_exactly_one_relation_holds_between_any_two_intervals():
    for one, other in itertools.product(_intervals(5), repeat=2):
        found = [relation for relation in ALLEN if _holds(relation, one, other)]
        assert len(found) == 1
        back = [relation for relation in ALLEN if _holds(relation, other, one)]
        expected = {
            "before": "after",
            "meets": "met_by",
            "overlaps": "overlapped_by",
            "starts": "started_by",
            "during": "contains",
            "finishes": "finished_by",
            "equals": "equals",
        }
        pairs = expected | {b: a for a, b in expected.items()}
        assert back == [pairs[found[0]]]


@given(st.sampled_from(ALLEN), st.integers(0, 10_000), st.integers(1, 9))
@settings(deadline=None, max_examples=60)
def test_the_best_of_all_pairs_of_intervals(relation, seed, n):
    rng = np.random.default_rng(seed)
    log_p = np.log(rng.uniform(0.01, 0.99, (2, n)))
    spans = [Span(int(rng.integers(1, 3)), [None, 4][rng.integers(2)], 0) for _ in range(2)]
    found = align_related(
        Timeline(np.arange(n), np.array([0])),
        log_p,
        log_p,
        _activity(relation),
        spans,
        STEP_S,
        -1e9,
    )

    def value(row, span, first, last):
        length = last - first + 1
        if length < span.shortest or (span.longest is not None and length > span.longest):
            return -np.inf
        cores = [
            row[at : at + span.shortest].mean() for at in range(first, last - span.shortest + 2)
        ]
        return max(cores) + STRETCH * STEP_S * odds(row[first : last + 1]).sum()

    best = max(
        (
            value(log_p[0], spans[0], *one) + value(log_p[1], spans[1], *other)
            for one, other in itertools.product(_intervals(n), repeat=2)
            if _holds(relation, one, other)
        ),
        default=-np.inf,
    )
    if not np.isfinite(best):
        assert found == []
        return
    one, other = found[0][1].whole
    assert _holds(relation, one, other)
    assert value(log_p[0], spans[0], *one) + value(log_p[1], spans[1], *other) == pytest.approx(
        best
    )


def test_of_a_long_cast_the_turning_points_are_enough():
    p = np.full((2, 200), 0.05)
    p[0, 50:150], p[1, 80:90] = 0.9, 0.9
    log_p = np.log(p)
    spans = [Span(3, None, 0), Span(3, None, 0)]
    moments = Timeline(np.arange(200), np.array([0]))
    found = align_related(moments, log_p, log_p, _activity("contains"), spans, STEP_S, -1.0)
    assert found[0][1].whole == ((50, 149), (80, 89))
    assert found[0][1].log_score == pytest.approx(2 * np.log(0.9))
    found = align_related(moments, log_p, log_p, _activity("before"), spans, STEP_S, -1.0)
    (_, before), (first, last) = found[0][1].whole
    assert before < first - 1
    assert last == 89
