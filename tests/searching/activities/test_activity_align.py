"""The dynamic programme against looking at every alignment there is."""

import itertools

import numpy as np
import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from scene4d.searching.activities._compose import (
    FLOOR,
    MOST_GAIN,
    STRETCH,
    Aligned,
    Span,
    Timeline,
    align,
    odds,
    window_max,
)
from scene4d.searching.activities._related import align_related
from scene4d.searching.activities.definition import Activity, Phase, Relation, Role, Term
from scene4d.searching.predicates._meeting import expand, runs

STEP_S = 0.5


@st.composite
def _casts(draw):
    """Moments of one cast, some missing, log probabilities and durations of up to three phases."""
    n = draw(st.integers(1, 9))
    phases = draw(st.integers(1, 3))
    ticks = np.cumsum(draw(st.lists(st.sampled_from([1, 1, 1, 2, 5]), min_size=n, max_size=n)))
    p = draw(
        st.lists(
            st.lists(st.sampled_from([0.01, 0.2, 0.5, 0.7, 0.97]), min_size=n, max_size=n),
            min_size=phases,
            max_size=phases,
        )
    )
    spans = []
    for _ in range(phases):
        shortest = draw(st.sampled_from([1, 2, 3, 6]))
        more = draw(st.sampled_from([0, 1, 3, None]))
        longest = None if more is None else shortest + more
        spans.append(Span(shortest, longest, draw(st.integers(0, 2))))
    return ticks, np.log(np.array(p)), spans


def _stretch(ticks, log_p, first, last):
    """What the moments after ``first`` up to ``last`` bring."""
    rows = odds(log_p[first + 1 : last + 1]).sum()
    missing = (ticks[last] - ticks[first]) - (last - first)
    return STRETCH * STEP_S * (rows + missing * odds(np.log(np.array([FLOOR])))[0])


def _cores(ticks, log_p, shortest):
    for first, last in itertools.combinations_with_replacement(range(len(ticks)), 2):
        there = last - first + 1
        if ticks[last] - ticks[first] == shortest - 1 and 2 * there >= shortest:
            yield first, last, log_p[first : last + 1].mean()


def _exhaustive(ticks, log_p, spans):
    """The best value of all alignments, phase by phase, every core and every end."""
    best = -np.inf

    def after(number, stop, value):
        nonlocal best
        if number == len(spans):
            best = max(best, value)
            return
        for first, last, core in _cores(ticks, log_p[number], spans[number].shortest):
            if number and not 0 < ticks[first] - ticks[stop] <= 1 + spans[number].gap:
                continue
            if number == len(spans) - 1:
                after(number + 1, last, value + core)
                continue
            for end in range(last, len(ticks)):
                longest = spans[number].longest
                if longest is None or ticks[end] - ticks[first] + 1 <= longest:
                    stretched = _stretch(ticks, log_p[number], last, end)
                    after(number + 1, end, value + core + stretched)

    after(0, -1, 0.0)
    return best


def _value(ticks, log_p, found: Aligned):
    total = 0.0
    for number, ((first, last), (_, end)) in enumerate(zip(found.core, found.whole, strict=True)):
        total += log_p[number][first : last + 1].mean()
        if number < len(found.core) - 1:
            total += _stretch(ticks, log_p[number], last, end)
    return total


@given(_casts())
@settings(deadline=None, max_examples=80)
def test_the_first_event_is_the_best_of_all_alignments(cast):
    ticks, log_p, spans = cast
    found = align(Timeline(ticks, np.array([0])), log_p, log_p, spans, STEP_S, -1e9)
    best = _exhaustive(ticks, log_p, spans)
    if not np.isfinite(best):
        assert found == []
        return
    assert _value(ticks, log_p, found[0][1]) == pytest.approx(best, abs=1e-9)


@given(_casts())
@settings(deadline=None, max_examples=80)
def test_durations_gaps_and_order_are_kept_and_events_do_not_overlap(cast):
    ticks, log_p, spans = cast
    found = [
        one for _, one in align(Timeline(ticks, np.array([0])), log_p, log_p, spans, STEP_S, -1e9)
    ]
    for one in found:
        before = None
        for span, (first, last), core in zip(spans, one.whole, one.core, strict=True):
            assert first <= core[0] <= core[1] <= last
            length = ticks[last] - ticks[first] + 1
            assert length >= span.shortest
            assert span.longest is None or length <= span.longest
            if before is not None:
                assert 1 <= ticks[first] - before <= 1 + span.gap
            before = ticks[last]
        assert one.log_score <= 1e-12
    for one, other in itertools.combinations(found, 2):
        assert one.end < other.begin or other.end < one.begin


@given(st.integers(0, 10_000))
@settings(deadline=None, max_examples=40)
def test_many_casts_at_once_are_as_each_alone(seed):
    rng = np.random.default_rng(seed)
    spans = [Span(2, 5, 0), Span(1, None, 2)]
    casts = []
    for n in rng.integers(1, 20, 4):
        ticks = np.cumsum(rng.choice([1, 1, 1, 3], n))
        casts.append((ticks, np.log(rng.uniform(0.01, 1, (2, n)))))
    first = np.cumsum([0, *(len(ticks) for ticks, _ in casts)])[:-1]
    everybody = Timeline(np.concatenate([ticks for ticks, _ in casts]), first)
    log_p = np.hstack([log_p for _, log_p in casts])
    together = align(everybody, log_p, log_p, spans, STEP_S, -3.0)
    for number, (ticks, log_p) in enumerate(casts):
        alone = align(Timeline(ticks, np.array([0])), log_p, log_p, spans, STEP_S, -3.0)
        mine = [one for cast, one in together if cast == number]
        assert [one.log_score for one in mine] == pytest.approx([a.log_score for _, a in alone])
        offset = first[number]
        moved = [[(a - offset, b - offset) for a, b in one.whole] for one in mine]
        assert moved == [list(one.whole) for _, one in alone]


class _Counted(np.ndarray):
    """Counts the numbers that functions of it make."""

    made = 0

    def __array_ufunc__(self, ufunc, method, *inputs, **more):
        return self._count(getattr(ufunc, method)(*map(self._plain, inputs), **more))

    def __array_function__(self, function, _, inputs, more):
        return self._count(function(*map(self._plain, inputs), **more))

    @staticmethod
    def _plain(value):
        return value.view(np.ndarray) if isinstance(value, _Counted) else value

    @staticmethod
    def _count(found):
        _Counted.made += np.size(found)
        return found.view(_Counted) if isinstance(found, np.ndarray) else found


def test_stepping_back_takes_no_work_by_the_number_of_moments():
    """A cast that misses moments: each of many steps back once took time by all of them."""
    tick = np.delete(np.arange(20_000), [7, 9_000]).view(_Counted)
    moments = Timeline(tick, np.array([0]).view(_Counted))
    expected = [9_999 - 50, 0, 8_999 - 30]
    assert [
        int(moments.back(np.array([at]), by)[0]) for at, by in ((9_999, 50), (3, 9), (8_999, 31))
    ] == expected
    before = _Counted.made
    for at in range(100, 200):
        moments.back(np.array([at]), 10)
    assert before > 20_000
    assert _Counted.made - before < 100 * 20


def test_a_single_bad_moment_does_not_kill_and_length_is_not_punished():
    def score(p):
        log_p = np.log(np.maximum(np.array([p]), FLOOR))
        spans = [Span(5, None, 0)]
        moments = Timeline(np.arange(len(p)), np.array([0]))
        return [one for _, one in align(moments, log_p, log_p, spans, STEP_S, np.log(0.05))]

    good = score([0.9] * 10)
    long = score([0.9] * 400)
    assert long[0].log_score == pytest.approx(good[0].log_score)
    assert (long[0].begin, long[0].end) == (0, 399)
    broken = score([0.9] * 15 + [0.0] + [0.9] * 30)
    assert broken[0].log_score == pytest.approx(good[0].log_score)
    assert (broken[0].begin, broken[0].end) == (0, 45)
    assert len(broken) == 1
    spoilt = score([0.9, 0.9, 0.0, 0.9, 0.9])
    assert -1.2 < spoilt[0].log_score < -0.9  # a factor of 0.01 to the power of a fifth


def test_stretching_over_what_denies_it_costs():
    p = np.full((2, 40), FLOOR)
    p[0, :3], p[1, -3:] = 0.99, 0.99
    moments, log_p = Timeline(np.arange(40), np.array([0])), np.log(p)
    spans = [Span(2, None, 0), Span(2, None, 0)]
    found = align(moments, log_p, log_p, spans, STEP_S, -50.0)[0][1]
    across = STRETCH * STEP_S * (34 * np.log(FLOOR / (1 - FLOOR)) + MOST_GAIN)
    assert found.core == (
        (0, 1),
        (37, 38),
    )  # its third row is stretched over, which brings a little
    assert found.stretched == pytest.approx(across)
    assert found.log_score == pytest.approx(2 * np.log(0.99) + found.stretched)


@pytest.mark.parametrize("likely", [0.05, 0.3, 0.9])
def test_an_event_lasts_while_it_is_as_likely_as_its_core(likely):
    p = likely * np.array([0.2, 0.2, 0.7, 1.0, 1.0, 0.9, 0.8, 0.3, 0.7])
    ticks, spans = np.arange(len(p)), [Span(2, None, 0)]
    _, found = align(Timeline(ticks, np.array([0])), *[np.log(p)[None]] * 2, spans, STEP_S, -9.0)[0]
    assert found.core == ((3, 4),)
    assert found.whole == ((2, 6),)


@given(
    st.lists(st.floats(-5, 5), min_size=1, max_size=60),
    st.lists(st.tuples(st.integers(0, 59), st.integers(-3, 59)), min_size=1, max_size=30),
)
def test_window_max(values, windows):
    values = np.array(values)
    low = np.array([min(a, len(values) - 1) for a, _ in windows])
    high = np.array([min(a + b, len(values) - 1) for a, b in windows])
    expected = [
        max((values[at] for at in range(a, b + 1)), default=-np.inf)
        for a, b in zip(low, high, strict=True)
    ]
    assert window_max(values, low, high).tolist() == expected


def test_expand_and_runs():
    owner, number = expand(np.array([5, 9, 2]), np.array([2, 0, 3]))
    assert owner.tolist() == [0, 0, 2, 2, 2]
    assert number.tolist() == [5, 6, 2, 3, 4]
    assert runs(np.array([1, 1, 2, 2]), np.array([0, 0, 0, 3])).tolist() == [0, 2, 3]
    assert runs(np.zeros(0, int)).tolist() == []


def test_half_of_a_core_must_be_there():
    for ticks, expected in (([0, 1, 2, 8, 9], 1), ([0, 1, 8, 9], 0), ([0, 1, 2, 3, 4], 0)):
        log_p = np.zeros((1, len(ticks))) - 0.1
        moments = Timeline(np.array(ticks), np.array([0]))
        found = align(moments, log_p, log_p, [Span(10, None, 0)], STEP_S, -1.0)
        assert len(found) == expected


def _bumps(*middles, n=60, width=3.0):
    """Probabilities of one cast that rise to 0.95 at each of some moments."""
    t = np.arange(n)
    heights = [0.95 * np.exp(-(((t - middle) / width) ** 2) / 2) for middle in middles]
    return np.log(np.maximum(np.maximum.reduce(heights), FLOOR))[None]


def test_the_flanks_of_an_event_are_no_events():
    moments = Timeline(np.arange(60), np.array([0]))
    for middles in ((30,), (12, 45), (9, 30, 51)):
        log_p = _bumps(*middles)
        found = align(moments, log_p, log_p, [Span(2, None, 0)], STEP_S, np.log(0.05))
        cores = sorted(one.core[0] for _, one in found)
        assert len(cores) == len(middles)
        for (first, last), middle in zip(cores, middles, strict=True):
            assert first <= middle <= last


@pytest.mark.parametrize("again", [5, 8, 14, 15, 16, 20])
def test_what_happens_again_at_once_is_another_event(again):
    """Moves and stands, and moves and stands: however the cores lie, these are two stops."""
    moves = np.array([0.95] * 15 + [0.05] * 10 + [0.95] * again + [0.05] * 20)
    log_p = np.log(np.vstack([moves, 1 - moves]))
    moments = Timeline(np.arange(len(moves)), np.array([0]))
    spans = [Span(3, 15, 0), Span(3, 10, 10)]
    found = align(moments, log_p, log_p, spans, 0.2, np.log(0.05))
    assert len(found) == 2


def test_the_flanks_of_an_event_with_relations_are_no_events():
    term = Term("moving", ("person",), {})
    activity = Activity(
        "a",
        (Role("person", ("person",)),),
        (Phase("short", (term,), 0.5), Phase("long", (term,), 1.0)),
        (Relation("short", "during", "long"),),
    )
    log_p = np.vstack([_bumps(30, width=2.0), _bumps(30, width=5.0)])
    moments = Timeline(np.arange(60), np.array([0]))
    spans = [Span(1, None, 0), Span(2, None, 0)]
    found = align_related(moments, log_p, log_p, activity, spans, STEP_S, np.log(1e-3))
    assert len(found) == 1
