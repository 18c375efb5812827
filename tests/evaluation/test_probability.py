"""ROC, Brier score and reliability: by hand, and against scikit-learn."""

import numpy as np
import pytest
from hypothesis import given
from hypothesis import strategies as st
from hypothesis.extra.numpy import arrays
from sklearn import metrics
from sklearn.calibration import calibration_curve

from scene4d.core.errors import InputError
from scene4d.evaluation.measures._probability import (
    brier_score,
    reliability,
    roc_curve,
    true_error,
)

SEED = st.integers(0, 2**32 - 1)


@st.composite
def scored(draw, values=None):
    """Scores with many ties, and outcomes of both classes."""
    n = draw(st.integers(2, 30))
    values = st.integers(-4, 4).map(float) if values is None else values
    score = draw(arrays(float, n, elements=values))
    positive = draw(arrays(bool, n))
    positive[0], positive[-1] = True, False
    return score, positive


def by_pairs(score: np.ndarray, positive: np.ndarray) -> float:
    """Hanley and McNeil's meaning of AUC, counted over all pairs of a positive and a negative."""
    high, low = score[positive][:, None], score[~positive][None]
    return float(np.mean((high > low) + 0.5 * (high == low)))


def test_a_curve_by_hand():
    roc = roc_curve(np.array([0.9, 0.8, 0.8, 0.3]), np.array([True, True, False, False]))
    np.testing.assert_array_equal(roc.false_rate, [0, 0, 0.5, 1])
    np.testing.assert_array_equal(roc.true_rate, [0, 0.5, 1, 1])
    # Of four pairs three are in order and one is a tie.
    assert roc.auc == 3.5 / 4


def test_perfect_worthless_and_inverted_scores():
    positive = np.array([True, True, False, False])
    assert roc_curve(np.array([4.0, 3.0, 2.0, 1.0]), positive).auc == 1
    assert roc_curve(np.array([1.0, 2.0, 3.0, 4.0]), positive).auc == 0
    flat = roc_curve(np.ones(4), positive)
    assert flat.auc == 0.5
    np.testing.assert_array_equal(flat.false_rate, [0, 1])


@given(scored())
def test_auc_is_that_of_scikit_learn_with_ties(case):
    score, positive = case
    assert roc_curve(score, positive).auc == pytest.approx(metrics.roc_auc_score(positive, score))


@given(scored(st.floats(-1e3, 1e3)))
def test_the_curve_is_that_of_scikit_learn(case):
    score, positive = case
    roc = roc_curve(score, positive)
    false_rate, true_rate, _ = metrics.roc_curve(positive, score, drop_intermediate=False)
    np.testing.assert_allclose(roc.false_rate, false_rate)
    np.testing.assert_allclose(roc.true_rate, true_rate)


@given(scored(st.sampled_from([-np.inf, -1.0, 0.0, 2.0, np.inf])))
def test_infinite_scores_tie_like_others(case):
    """Pairs that a camera sees above its horizon are infinitely far apart, all alike."""
    score, positive = case
    roc = roc_curve(score, positive)
    assert roc.auc == pytest.approx(by_pairs(score, positive))
    finite = np.nan_to_num(score, posinf=9.0, neginf=-9.0)
    assert roc.auc == pytest.approx(metrics.roc_auc_score(positive, finite))
    assert len(roc.true_rate) == len(np.unique(score)) + 1


@given(scored(), SEED)
def test_order_does_not_matter(case, seed):
    score, positive = case
    shuffled = np.random.default_rng(seed).permutation(len(score))
    one, other = roc_curve(score, positive), roc_curve(score[shuffled], positive[shuffled])
    np.testing.assert_array_equal(one.true_rate, other.true_rate)
    np.testing.assert_array_equal(one.false_rate, other.false_rate)
    probability = (score + 4) / 8
    assert brier_score(probability, positive) == pytest.approx(
        brier_score(probability[shuffled], positive[shuffled])
    )
    a = reliability(probability, positive)
    b = reliability(probability[shuffled], positive[shuffled])
    np.testing.assert_allclose(a.stated, b.stated)
    np.testing.assert_allclose(a.observed, b.observed)
    np.testing.assert_array_equal(a.count, b.count)


@given(scored(), st.sampled_from([np.exp, np.cbrt, np.arctan, lambda x: 3 * x - 7]))
def test_only_the_order_of_scores_counts(case, grows):
    score, positive = case
    assert roc_curve(grows(score), positive).auc == roc_curve(score, positive).auc
    assert roc_curve(-score, positive).auc == pytest.approx(1 - roc_curve(score, positive).auc)


@given(scored())
def test_the_curve_rises_from_corner_to_corner(case):
    roc = roc_curve(*case)
    for rate in (roc.false_rate, roc.true_rate):
        assert rate[0] == 0
        assert rate[-1] == 1
        assert (np.diff(rate) >= 0).all()


def test_brier_by_hand():
    found = brier_score(np.array([1.0, 0.0, 0.5, 0.8]), np.array([True, False, True, False]))
    assert found == pytest.approx((0 + 0 + 0.25 + 0.64) / 4)


@given(scored(st.floats(0.0, 1.0)))
def test_brier_is_that_of_scikit_learn(case):
    probability, positive = case
    expected = metrics.brier_score_loss(positive, probability, pos_label=True)
    assert brier_score(probability, positive) == pytest.approx(expected)


def test_reliability_by_hand():
    probability = np.array([0.05, 0.06, 0.55, 0.55, 0.6, 1.0])
    positive = np.array([False, True, True, False, True, False])
    found = reliability(probability, positive)
    np.testing.assert_allclose(found.stated, [0.055, 0.55, 0.6, 1.0])
    np.testing.assert_allclose(found.observed, [0.5, 0.5, 1.0, 0.0])
    np.testing.assert_array_equal(found.count, [2, 2, 1, 1])
    assert found.expected_error == pytest.approx((2 * 0.445 + 2 * 0.05 + 0.4 + 1.0) / 6)


def test_a_bin_holds_its_lower_edge_and_the_last_one_too():
    edges = np.arange(11) / 10
    found = reliability(edges, np.zeros(11, bool))
    np.testing.assert_array_equal(found.count, [1] * 9 + [2])
    np.testing.assert_allclose(found.stated, [*edges[:9], 0.95])


@given(SEED, st.integers(1, 25))
def test_reliability_is_that_of_scikit_learn(seed, bins):
    rng = np.random.default_rng(seed)
    probability = rng.uniform(0.0, 1.0, 60) ** 2
    positive = rng.uniform(size=60) < probability
    found = reliability(probability, positive, bins)
    observed, stated = calibration_curve(positive, probability, n_bins=bins)
    np.testing.assert_allclose(found.observed, observed)
    np.testing.assert_allclose(found.stated, stated)
    assert found.count.sum() == 60


def test_outcomes_drawn_from_the_probabilities_are_reliable():
    rng = np.random.default_rng(5)
    probability = rng.uniform(size=20_000)
    positive = rng.uniform(size=20_000) < probability
    found = reliability(probability, positive)
    band = 4 * np.sqrt(found.stated * (1 - found.stated) / found.count)
    assert (np.abs(found.stated - found.observed) < band).all()
    assert found.expected_error < 0.02
    # Overstated: the mean of |p^(1/4) - p| over the unit interval is 4/5 - 1/2.
    assert reliability(probability**0.25, positive).expected_error == pytest.approx(0.3, abs=0.01)


BOTH = np.array([True, False])


@pytest.mark.parametrize(
    ("score", "positive", "message"),
    [
        (np.array([0.1, 0.2]), np.array([True, True]), "2 of 2 are positive; it needs both"),
        (np.array([0.1, 0.2]), np.array([False, False]), "0 of 2 are positive; it needs both"),
        (np.array([0.1, np.nan]), BOTH, "1 of 2 scores are NaN"),
        (np.zeros(0), np.zeros(0, bool), "0 scores for 0 outcomes"),
    ],
)
def test_a_curve_that_cannot_be_is_refused(score, positive, message):
    with pytest.raises(InputError, match=message):
        roc_curve(score, positive)


@pytest.mark.parametrize("measure", [brier_score, reliability])
@pytest.mark.parametrize(
    ("probability", "message"),
    [
        (np.array([0.1, np.nan]), "1 of 2 scores are NaN"),
        (np.array([0.1, 1.0001]), "probabilities must lie in 0 to 1"),
        (np.array([-0.0001, 0.5]), "probabilities must lie in 0 to 1"),
        (np.array([0.5, np.inf]), "probabilities must lie in 0 to 1"),
    ],
)
def test_what_is_no_probability_is_refused(measure, probability, message):
    with pytest.raises(InputError, match=message):
        measure(probability, BOTH)


@pytest.mark.parametrize("measure", [brier_score, reliability])
def test_nothing_is_refused(measure):
    with pytest.raises(InputError, match="0 scores for 0 outcomes"):
        measure(np.zeros(0), np.zeros(0, bool))


@pytest.mark.parametrize("bins", [0, -3])
def test_no_bins_are_refused(bins):
    with pytest.raises(InputError, match=f"at least one bin is needed, found {bins}"):
        reliability(np.array([0.1, 0.9]), BOTH, bins)


TWISTS = {"true": lambda p: p, "too sure": lambda p: 0.2 + 0.6 * p, "too low": np.sqrt}


@pytest.mark.parametrize(("twist", "events"), [("true", 100), ("too low", 100), ("too sure", 400)])
def test_the_error_without_chance_is_the_true_one(events, twist):
    """Its median and its range, where the raw error is too high."""
    rng = np.random.default_rng(1)
    inside, middle, raw, floor = [], [], [], []
    for _ in range(60):
        stated = rng.beta(0.4, 0.8, events)
        share = TWISTS[twist](stated)
        truth = reliability_of_shares(stated, share)
        found = reliability(stated, rng.random(events) < share)
        known = true_error(found)
        inside.append(known.low <= truth <= known.high)
        middle.append(known.debiased - truth)
        raw.append(found.expected_error - truth)
        floor.append(known.floor)
        assert known.low <= known.debiased <= known.high
        assert known.floor < known.chance
    assert 0.8 <= np.mean(inside) <= 1
    assert 0.3 < np.mean(np.array(middle) <= 0) < 0.7
    if twist == "true":
        assert np.mean(raw) == pytest.approx(np.mean(floor), rel=0.1)
        assert 0.9 * np.sqrt(0.5 / events) < np.mean(floor) < 1.4 * np.sqrt(0.5 / events)


def reliability_of_shares(stated, share, bins=10):
    """The error that no chance is in."""
    index = np.minimum((stated * bins).astype(int), bins - 1)
    return np.abs(np.bincount(index, share - stated, bins)).sum() / len(stated)
