"""Matching events with labels, and the numbers that follow, against hand-made and other answers."""

import itertools

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from sklearn.metrics import average_precision_score

from scene4d.core.errors import InputError
from scene4d.evaluation.measures._events import (
    NIST,
    RULES,
    ClipEvents,
    DetCurve,
    Ranked,
    matched,
    may_match,
    precision_interval,
    ranked_clips,
    scaled,
    shared_time,
)

NONE = np.zeros((0, 2))


def spans(*pairs: tuple[float, float]) -> np.ndarray:
    return np.array(pairs, float).reshape(-1, 2)


def clip(label, found, score, involved=None, camera="G1") -> ClipEvents:
    if involved is None:
        involved = np.ones((len(label), len(found)), bool)
    return ClipEvents(camera, 5.0, label, found, np.asarray(score, float), involved)


def pairs(label, found, confidence) -> np.ndarray:
    return matched(may_match(label, found), confidence)


@pytest.mark.parametrize(
    ("label", "found", "expected"),
    [
        ((10, 20), (19, 30), True),  # 1 s
        ((10, 20), (19.01, 30), False),
        ((10, 20), (12, 13), True),
        ((10, 11), (10, 11), True),
        ((10, 11), (10.01, 11), False),  # a label of 1 s needs all of it
        ((10, 10.8), (10.4, 12), True),  # a shorter one half of it
        ((10, 10.8), (10.41, 12), False),
        ((10, 10), (10, 10), False),  # no time in common
        ((10, 20), (21, 30), False),
    ],
)
def test_the_rule_of_overlap(label, found, expected):
    assert may_match(spans(label), spans(found)).tolist() == [[expected]]


def test_each_label_and_each_event_is_used_once():
    label = spans((0, 10), (20, 30))
    found = spans((0, 10), (1, 9), (20, 30), (40, 50))
    assert pairs(label, found, np.array([0.2, 0.9, 0.5, 1.0])).tolist() == [-1, 0, 1, -1]


def test_more_pairs_count_for_more_than_confident_ones():
    # The confident event could be either label, the other one the first alone.
    label = spans((0, 5), (6, 11))
    found = spans((3, 8), (0, 4))
    assert pairs(label, found, np.array([1.0, 0.0])).tolist() == [1, 0]


def test_a_clip_without_labels_or_events():
    assert pairs(NONE, spans((0, 5)), np.array([1.0])).tolist() == [-1]
    assert pairs(spans((0, 5)), NONE, np.zeros(0)).tolist() == []


times = st.integers(0, 60).map(lambda tenths: tenths / 4)
a_span = st.tuples(times, times).map(sorted).map(tuple)


@given(
    st.lists(a_span, max_size=4),
    st.lists(st.tuples(a_span, st.integers(0, 8).map(lambda k: k / 8)), max_size=4),
)
def test_no_assignment_is_better(labels, events):
    label, found = spans(*labels), spans(*(span for span, _ in events))
    confidence = np.array([c for _, c in events], float)
    allowed = may_match(label, found)
    result = matched(allowed, confidence)
    used = result[result >= 0]
    assert len(set(used.tolist())) == len(used)
    assert all(allowed[row, k] for k, row in enumerate(result) if row >= 0)
    choices = itertools.product(range(-1, len(label)), repeat=len(found))
    possible = [
        sum(1 + confidence[k] for k, row in enumerate(rows) if row >= 0)
        for rows in choices
        if len({row for row in rows if row >= 0}) == sum(row >= 0 for row in rows)
        and all(row < 0 or allowed[row, k] for k, row in enumerate(rows))
    ]
    assert (1 + confidence[result >= 0]).sum() == pytest.approx(max(possible))


def test_spans_and_confidences_that_cannot_be():
    with pytest.raises(InputError, match="label ends before"):
        clip(spans((5, 4)), NONE, [])
    with pytest.raises(InputError, match="found event ends before"):
        clip(NONE, spans((5, 4)), [0.5])
    for bad in (-0.1, 1.1, np.nan):
        with pytest.raises(InputError, match="between 0 and 1"):
            pairs(NONE, spans((4, 5)), np.array([bad]))


def test_scores_as_confidences():
    assert scaled(np.array([3.0, 5.0, 4.0])).tolist() == [0, 1, 0.5]
    assert scaled(np.array([3.0, 3.0])).tolist() == [1, 1]
    assert scaled(np.zeros(0)).tolist() == []


# Ten labels in 100 minutes, nine events, of which five are right: worked out by hand.
#   score     0.9  0.8  0.7  0.6  0.6  0.5  0.4  0.3  0.2
#   correct    +    +    -    +    -    +    -    -    +
#   true       1    2    2       3      4    4    4    5
#   false      0    0    1       2      2    3    4    4
SCORE = np.array([0.6, 0.9, 0.8, 0.7, 0.6, 0.5, 0.4, 0.3, 0.2])
CORRECT = np.array([True, True, True, False, False, True, False, False, True])
HAND = Ranked(SCORE, CORRECT, 10, 100.0)


def test_average_precision_by_hand():
    assert HAND.average_precision == pytest.approx((1 + 1 + 3 / 5 + 4 / 6 + 5 / 9) / 10)


def test_the_det_curve_by_hand():
    curve = HAND.det
    np.testing.assert_allclose(curve.false_per_minute, [0, 0, 0.01, 0.02, 0.02, 0.03, 0.04, 0.04])
    np.testing.assert_allclose(curve.missed, [0.9, 0.8, 0.8, 0.7, 0.6, 0.6, 0.6, 0.5])


@pytest.mark.parametrize(
    ("rate", "missed"),
    [
        (0.0, 0.8),  # the last point with that rate
        (0.005, 0.8),
        (0.01, 0.8),
        (0.015, 0.75),  # half way to (0.02, 0.7), the next threshold
        (0.02, 0.6),
        (0.025, 0.6),
        (0.035, 0.6),
        (0.04, 0.5),
        (0.15, 0.5),  # nothing more was found
    ],
)
def test_misses_at_a_rate_by_hand(rate, missed):
    assert HAND.det.missed_at(rate) == pytest.approx(missed)


def test_a_curve_that_begins_with_false_alarms():
    # Both ties in one point: a rate of 0.5 a minute; left of it nothing is found.
    ranked = Ranked(np.array([0.9, 0.9, 0.1]), np.array([True, False, True]), 4, 2.0)
    curve = ranked.det
    assert curve.missed_at(0.49) == 1.0
    assert curve.missed_at(0.5) == 0.5
    assert Ranked(np.zeros(0), np.zeros(0, bool), 4, 2.0).det.missed_at(0.15) == 1.0
    assert isinstance(curve, DetCurve)


def test_nothing_labelled_is_no_number():
    ranked = Ranked(np.array([0.5]), np.array([False]), 0, 5.0)
    assert ranked.average_precision is None
    assert ranked.det is None


def test_nothing_found_is_the_worst():
    ranked = Ranked(np.zeros(0), np.zeros(0, bool), 3, 5.0)
    assert ranked.average_precision == 0.0


@given(
    st.lists(st.tuples(st.integers(0, 5), st.booleans()), min_size=1, max_size=30),
    st.integers(0, 10),
)
def test_average_precision_as_scikit_learn(events, never_found):
    score = np.array([float(s) for s, _ in events])
    correct = np.array([c for _, c in events])
    found = int(correct.sum())
    if not found:
        return
    ours = Ranked(score, correct, found + never_found, 1.0).average_precision
    theirs = average_precision_score(correct, score) * found / (found + never_found)
    assert ours == pytest.approx(theirs)


@given(
    st.lists(st.tuples(st.floats(0, 1), st.booleans()), max_size=30),
    st.floats(0, 2),
    st.floats(0, 2),
)
def test_more_false_alarms_never_miss_more(events, rate, more):
    score, correct = (np.array([e[k] for e in events]) for k in (0, 1))
    ranked = Ranked(score.astype(float), correct.astype(bool), int(correct.sum()) + 1, 10.0)
    curve = ranked.det
    assert 1 >= curve.missed_at(rate) >= curve.missed_at(rate + more) >= 0
    for x, y in zip(curve.false_per_minute, curve.missed, strict=True):
        assert curve.missed_at(float(x)) <= y + 1e-12


def test_clips_are_matched_apart_and_ranked_together():
    first = clip(spans((0, 5)), spans((0, 5), (0, 4)), [0.3, 0.9])
    second = clip(spans((10, 15)), spans((0, 5)), [0.5])
    ranked = Ranked.pooled(ranked_clips([first, second], RULES[NIST]))
    assert ranked.minutes == 10.0
    assert ranked.correct.tolist() == [False, True, False]
    assert ranked.labels == 2
    assert ranked.average_precision == pytest.approx(0.5)
    assert ranked.det.missed_at(0.15) == pytest.approx(0.5)


def test_ranks_that_cannot_be():
    with pytest.raises(InputError, match="NaN"):
        Ranked(np.array([np.nan]), np.array([True]), 1, 1.0)
    with pytest.raises(InputError, match="2 correct of 1"):
        Ranked(np.ones(2), np.ones(2, bool), 1, 1.0)
    with pytest.raises(InputError, match="0"):
        Ranked(np.ones(1), np.ones(1, bool), 1, 0.0)


def test_time_in_common():
    label, found = spans((0, 10)), spans((0, 10), (5, 15), (0, 5), (10, 20), (3, 3))
    np.testing.assert_allclose(shared_time(label, found), [[1.0, 1 / 3, 0.5, 0.0, 0.0]])
    assert shared_time(spans((3, 3)), spans((3, 3))).tolist() == [[0.0]]


def test_the_rules():
    """An event a little longer than the label, one a third of it, one right in time with others."""
    involved = np.array([[True, True, False]])
    one = clip(spans((10, 20)), spans((10, 22), (16, 19.5), (10, 20)), np.zeros(3), involved)
    said = {name: rule(one)[0].tolist() for name, rule in RULES.items()}
    assert said == {
        "1 s": [True, True, True],
        "IoU 0.2": [True, True, True],
        "IoU 0.5": [True, False, True],
        "participants": [True, True, False],
    }


def random_clips(rng: np.random.Generator, count: int, skill: float) -> list[Ranked]:
    """Clips with two labels each, and four events, right with a probability of ``skill``."""
    out = []
    for _ in range(count):
        correct = rng.random(4) < [skill, skill, 0, 0]
        out.append(Ranked(rng.random(4) + correct, correct, 2, 5.0))
    return out


def test_the_interval_holds_what_is_true_as_often_as_it_says():
    rng = np.random.default_rng(0)
    truth = Ranked.pooled(random_clips(rng, 4000, 0.6)).average_precision
    held = []
    for seed in range(60):
        low, high = precision_interval(random_clips(rng, 40, 0.6), seed=seed)
        held.append(low <= truth <= high)
    assert 0.85 <= np.mean(held) <= 1.0
    few, many = (precision_interval(random_clips(rng, n, 0.6)) for n in (20, 320))
    assert 2.5 < (few[1] - few[0]) / (many[1] - many[0]) < 6.5  # 4 by the root of the clips


def test_the_weights_of_a_draw_are_clips_drawn_again():
    parts = random_clips(np.random.default_rng(1), 3, 0.5)
    pooled = Ranked.pooled(parts)
    drawn = pooled._precisions(np.repeat([[2.0, 0.0, 1.0]], 4, axis=1), np.array([6]))
    again = Ranked.pooled([parts[0], parts[0], parts[2]]).average_precision
    assert drawn[0] == pytest.approx(again)


def test_without_a_label_there_is_no_interval():
    assert precision_interval([Ranked(np.ones(1), np.zeros(1, bool), 0, 5.0)]) is None
