"""Found events against labelled ones: matching rules, average precision, DET curve."""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from scene4d.core.errors import InputError

OVERLAP_S = 1.0
"""An event and a label may match where they overlap by so many seconds (NIST, ActEV SDL V2)."""
OVERLAP_SHARE = 0.5
"""Of a label that is shorter than :data:`OVERLAP_S` this share is enough (NIST, ActEV SDL V2)."""
_ROUNDING_S = 1e-9
"""Frame times are decimal fractions: an overlap may fall short of the rule by rounding."""
_DRAWS = 400
"""Of clips, for an interval."""


def may_match(
    label_s: Float[np.ndarray, "r 2"], found_s: Float[np.ndarray, "d 2"]
) -> Bool[np.ndarray, "r d"]:
    """Which labels and found events overlap by enough; both are begin and end in seconds."""
    begin = np.maximum(label_s[:, None, 0], found_s[None, :, 0])
    end = np.minimum(label_s[:, None, 1], found_s[None, :, 1])
    length = label_s[:, 1] - label_s[:, 0]
    needed = np.where(length < OVERLAP_S, OVERLAP_SHARE * length, OVERLAP_S)
    overlap = end - begin
    enough: np.ndarray = (overlap >= needed[:, None] - _ROUNDING_S) & (overlap > 0)
    return enough


def shared_time(
    label_s: Float[np.ndarray, "r 2"], found_s: Float[np.ndarray, "d 2"]
) -> Float[np.ndarray, "r d"]:
    """Temporal intersection over union of labels and found events; 0 of two that last no time."""
    begin = np.maximum(label_s[:, None, 0], found_s[None, :, 0])
    end = np.minimum(label_s[:, None, 1], found_s[None, :, 1])
    both = np.maximum(end - begin, 0.0)
    length = np.diff(label_s) + np.diff(found_s).T
    share: np.ndarray = both / np.maximum(length - both, _ROUNDING_S)
    return share


def matched(
    allowed: Bool[np.ndarray, "r d"], confidence: Float[np.ndarray, "d"]
) -> Int[np.ndarray, "d"]:
    """Row of the label that each found event of one clip is; -1 where it is none.

    Each label and each event is used once. Of all ``allowed`` assignments the one with the greatest
    sum of ``1 + confidence`` counts: as many pairs as possible, then confident ones. ``confidence``
    is the score scaled to 0 to 1. Raises :class:`InputError` for other values.
    """
    if not ((confidence >= 0) & (confidence <= 1)).all():
        raise InputError("matching: a confidence is not between 0 and 1")
    rows, columns = linear_sum_assignment(
        np.where(allowed, 1.0 + confidence[None, :], 0.0), maximize=True
    )
    held = allowed[rows, columns]
    found = np.full(allowed.shape[1], -1)
    found[columns[held]] = rows[held]
    return found


def scaled(score: Float[np.ndarray, "d"]) -> Float[np.ndarray, "d"]:
    """Scores of all events of an activity as confidences: 0 the lowest, 1 the highest."""
    if not len(score):
        return score
    low, high = float(score.min()), float(score.max())
    return np.ones_like(score) if high == low else np.clip((score - low) / (high - low), 0, 1)


@dataclass(frozen=True, eq=False)
class ClipEvents:
    """Labels of one clip and the events found in it: begin and end in seconds, scores.

    ``involved`` says of which labels all who take part in a found event are actors. Raises
    :class:`InputError` for spans that end before they begin.
    """

    camera: str
    minutes: float
    label_s: Float[np.ndarray, "r 2"]
    found_s: Float[np.ndarray, "d 2"]
    score: Float[np.ndarray, "d"]
    involved: Bool[np.ndarray, "r d"]

    def __post_init__(self) -> None:
        for name, span in (("label", self.label_s), ("found event", self.found_s)):
            if not (span[:, 1] >= span[:, 0]).all():
                raise InputError(f"matching: a {name} ends before it begins")


Rule = Callable[[ClipEvents], np.ndarray]
"""Which labels and found events of a clip may be one, (r, d)."""


def overlap_by(share: float) -> Rule:
    """The rule of a temporal intersection over union of at least ``share``."""
    return lambda clip: shared_time(clip.label_s, clip.found_s) >= share


RULES: Mapping[str, Rule] = {
    "1 s": lambda clip: may_match(clip.label_s, clip.found_s),
    "IoU 0.2": overlap_by(0.2),
    "IoU 0.5": overlap_by(0.5),
    "participants": lambda clip: may_match(clip.label_s, clip.found_s) & clip.involved,
}
"""NIST's rule (:func:`may_match`); overlaps in time; NIST's rule for the right participants."""
NIST = "1 s"


@dataclass(frozen=True, eq=False)
class DetCurve:
    """Detection error tradeoff: false alarms per minute and share of labels missed, (k,), at
    falling thresholds. Empty where nothing was found.
    """

    false_per_minute: Float[np.ndarray, "k"]
    missed: Float[np.ndarray, "k"]

    def missed_at(self, false_per_minute: float) -> float:
        """Pmiss@RFA as NIST's scorer computes it: linear between two points of the curve, 1 left of
        the first one, constant right of the last one.
        """
        x, y = self.false_per_minute, self.missed
        if not len(x) or x[0] > false_per_minute:
            return 1.0
        last = int(np.searchsorted(x, false_per_minute, side="right")) - 1
        if last == len(x) - 1 or x[last] == false_per_minute:
            return float(y[last])
        share = (false_per_minute - x[last]) / (x[last + 1] - x[last])
        return float(y[last] + share * (y[last + 1] - y[last]))


@dataclass(frozen=True, eq=False)
class Ranked:
    """Found events of one activity over all clips, and whether each is a labelled one.

    ``labels`` is how many there are to be found, ``minutes`` how long the clips are together.
    """

    score: Float[np.ndarray, "d"]
    correct: Bool[np.ndarray, "d"]
    labels: int
    minutes: float

    def __post_init__(self) -> None:
        if np.isnan(self.score).any():
            raise InputError("activities: a score is NaN")
        if self.correct.sum() > self.labels or not self.minutes > 0:
            raise InputError(
                f"activities: {self.correct.sum()} correct of {self.labels} in {self.minutes} min"
            )

    @classmethod
    def pooled(cls, parts: Sequence["Ranked"]) -> "Ranked":
        """All parts, such as clips, as one ranking; at least one."""
        return cls(
            np.concatenate([part.score for part in parts]),
            np.concatenate([part.correct for part in parts]),
            sum(part.labels for part in parts),
            sum(part.minutes for part in parts),
        )

    @property
    def average_precision(self) -> float | None:
        """Precision averaged over the labels: ``sum (R_k - R_(k-1)) P_k`` over falling thresholds.

        Labels that were never found count as recall that is never reached; nothing is interpolated
        (Salton & McGill 1983; as scikit-learn). None where nothing is labelled.
        """
        weight = np.ones((1, len(self.score)))
        return float(self._precisions(weight, np.array([self.labels]))[0]) if self.labels else None

    def _precisions(
        self, weight: Float[np.ndarray, "b d"], labels: Int[np.ndarray, "b"]
    ) -> Float[np.ndarray, "b"]:
        """Average precision where each event, and so many labels, count so often."""
        order, last_of_ties = self._order()
        weight = weight[:, order]
        true = np.cumsum(weight * self.correct[order], axis=1)[:, last_of_ties]
        total = np.maximum(np.cumsum(weight, axis=1)[:, last_of_ties], 1e-9)
        gained = np.diff(true, prepend=0.0, axis=1)
        return np.asarray((gained * true / total).sum(axis=1) / labels)

    @property
    def det(self) -> DetCurve | None:
        """The DET curve (Martin et al. 1997), with false alarms per minute; None without labels."""
        if not self.labels:
            return None
        true, false = self._counts()
        return DetCurve(false / self.minutes, 1.0 - true / self.labels)

    def _counts(self) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
        """Correct and false events at or above each score, from the highest on; ties share one."""
        order, last_of_ties = self._order()
        true = np.cumsum(self.correct[order], dtype=float)[last_of_ties]
        return true, np.arange(1.0, len(order) + 1)[last_of_ties] - true

    def _order(self) -> tuple[Int[np.ndarray, "d"], Bool[np.ndarray, "d"]]:
        """The events from the highest score on, and which is the last of equal ones."""
        order = np.argsort(-self.score, kind="stable")
        ranked = self.score[order]
        last = np.append(ranked[1:] != ranked[:-1], True) if len(ranked) else ranked > 0
        return order, last


def ranked_clips(clips: Sequence[ClipEvents], rule: Rule) -> list[Ranked]:
    """The events of each clip, matched with its labels; scores are scaled over all clips."""
    confidence = scaled(np.concatenate([np.zeros(0), *(clip.score for clip in clips)]))
    ends = np.cumsum([len(clip.score) for clip in clips])
    out = []
    for clip, end in zip(clips, ends, strict=True):
        found = matched(rule(clip), confidence[end - len(clip.score) : end])
        out.append(Ranked(clip.score, found >= 0, len(clip.label_s), clip.minutes))
    return out


def precision_interval(clips: Sequence[Ranked], seed: int = 0) -> tuple[float, float] | None:
    """95 % of the average precision over clips drawn with replacement (Efron 1979, percentiles).

    Draws without a label are left out; None where nothing is labelled.
    """
    pooled = Ranked.pooled(clips)
    if not pooled.labels:
        return None
    share = np.full(len(clips), 1 / len(clips))
    often = np.random.default_rng(seed).multinomial(len(clips), share, size=_DRAWS)
    labels = often @ np.array([clip.labels for clip in clips])
    often, labels = often[labels > 0], labels[labels > 0]
    weight = np.repeat(often, [len(clip.score) for clip in clips], axis=1).astype(float)
    low, high = np.quantile(pooled._precisions(weight, labels), [0.025, 0.975])
    return float(low), float(high)
