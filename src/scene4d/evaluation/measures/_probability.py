"""Measures of scores and probabilities: ROC and AUC, reliability, Brier score."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.errors import InputError


@dataclass(frozen=True, eq=False)
class Roc:
    """Share of negatives (false) and of positives (true) at or above each threshold, (k,).

    Begins at (0, 0), where nothing is called positive, and ends at (1, 1).
    """

    false_rate: Float[np.ndarray, "k"]
    true_rate: Float[np.ndarray, "k"]

    @property
    def auc(self) -> float:
        """Area under the curve: the chance that a positive scores above a negative, ties half
        (Hanley & McNeil 1982).
        """
        return float(np.trapezoid(self.true_rate, self.false_rate))


def roc_curve(score: Float[np.ndarray, "n"], positive: Bool[np.ndarray, "n"]) -> Roc:
    """The receiver operating characteristic of scores (Fawcett 2006, algorithm 1).

    Equal scores share one point. Raises :class:`InputError` for NaN, and where one class is empty.
    """
    _check(score, positive)
    n_positive = int(positive.sum())
    if n_positive in (0, len(positive)):
        raise InputError(
            f"roc: {n_positive} of {len(positive)} are positive; it needs both classes"
        )
    order = np.argsort(-score, kind="stable")
    ranked = score[order]
    # Compared, not subtracted: infinite scores tie as well.
    last_of_ties = np.append(ranked[1:] != ranked[:-1], True)
    true = np.cumsum(positive[order])[last_of_ties]
    false = np.arange(1, len(score) + 1)[last_of_ties] - true
    n_negative = len(positive) - n_positive
    return Roc(np.append(0.0, false / n_negative), np.append(0.0, true / n_positive))


def brier_score(probability: Float[np.ndarray, "n"], positive: Bool[np.ndarray, "n"]) -> float:
    """Mean squared difference of probability and outcome (Brier 1950): 0 is perfect.

    Raises :class:`InputError` for NaN and for values outside [0, 1].
    """
    _check(probability, positive)
    _check_unit(probability)
    return float(np.mean((probability - positive) ** 2))


@dataclass(frozen=True, eq=False)
class Reliability:
    """Stated probability against how often it came true, in bins that hold anything, (k,)."""

    stated: Float[np.ndarray, "k"]
    observed: Float[np.ndarray, "k"]
    count: Int[np.ndarray, "k"]

    @property
    def expected_error(self) -> float:
        """Mean distance of stated and observed, weighted by count (expected calibration error)."""
        return float(np.average(np.abs(self.stated - self.observed), weights=self.count))


def reliability(
    probability: Float[np.ndarray, "n"], positive: Bool[np.ndarray, "n"], bins: int = 10
) -> Reliability:
    """The reliability diagram (Murphy & Winkler 1977) over equal bins of [0, 1].

    A bin holds its lower edge, the last one 1 as well. Raises :class:`InputError` for NaN, for
    values outside [0, 1], where nothing is given, and for fewer than one bin.
    """
    _check(probability, positive)
    _check_unit(probability)
    if bins < 1:
        raise InputError(f"reliability: at least one bin is needed, found {bins}")
    index = np.minimum((probability * bins).astype(int), bins - 1)
    count = np.bincount(index, minlength=bins)
    held = count > 0
    stated = np.bincount(index, probability, bins)[held] / count[held]
    observed = np.bincount(index, positive, bins)[held] / count[held]
    return Reliability(stated, observed, count[held])


@dataclass(frozen=True)
class TrueError:
    """Expected calibration errors without what chance does to them.

    ``floor`` is the mean error of true probabilities, with so few outcomes, and ``chance`` the one
    that they stay below in 95 % of cases. ``debiased`` is the error at which as much as was seen is
    the median, 0 where true probabilities seem to err more; ``low`` to ``high`` holds 95 %.
    """

    floor: float
    chance: float
    debiased: float
    low: float
    high: float


def true_error(found: Reliability, draws: int = 400) -> TrueError:
    """What the error of a diagram is worth: chance alone sets bins of few outcomes apart.

    Each bin is taken to be as wrong as it looks, times a factor from 0 to 3. For each factor
    outcomes are drawn, independently, the same each time; those factors hold at which an error as
    large as the seen one is neither too rare nor too common (inversion of a test; Neyman 1937).
    """
    rng = np.random.default_rng(0)
    weight = found.count / found.count.sum()
    factor = np.linspace(0.0, 3.0, 31)[:, None]
    share = np.clip(found.stated + factor * (found.observed - found.stated), 0.0, 1.0)
    drawn = rng.binomial(found.count, share[:, None], (len(factor), draws, len(weight)))
    seen = np.abs(drawn / found.count - found.stated) @ weight
    true = np.abs(share - found.stated) @ weight
    rare, middle, common = np.maximum.accumulate(
        np.quantile(seen, [0.025, 0.5, 0.975], axis=1), axis=1
    )
    debiased, low, high = (
        float(np.interp(found.expected_error, quantile, true))
        for quantile in (middle, common, rare)
    )
    chance = float(np.quantile(seen[0], 0.95))
    return TrueError(float(seen[0].mean()), chance, debiased, low, high)


def _check(score: np.ndarray, positive: np.ndarray) -> None:
    if len(score) == 0 or len(score) != len(positive):
        raise InputError(f"{len(score)} scores for {len(positive)} outcomes; one each is needed")
    if np.isnan(score).any():
        raise InputError(f"{int(np.isnan(score).sum())} of {len(score)} scores are NaN")


def _check_unit(probability: np.ndarray) -> None:
    if probability.min() < 0 or probability.max() > 1:
        raise InputError("probabilities must lie in 0 to 1")
