"""Found events against labelled ones: NIST's matching rule, average precision, DET curve."""

from collections.abc import Sequence
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


def matched(
    label_s: Float[np.ndarray, "r 2"],
    found_s: Float[np.ndarray, "d 2"],
    confidence: Float[np.ndarray, "d"],
) -> Int[np.ndarray, "d"]:
    """Row of the label that each found event of one clip is; -1 where it is none.

    Each label and each event is used once. Of all assignments the one with the greatest sum of
    ``1 + confidence`` counts: as many pairs as possible, then confident ones. ``confidence`` is the
    score scaled to 0 to 1. Raises :class:`InputError` for other values, and for spans that end
    before they begin.
    """
    for name, span in (("label", label_s), ("found event", found_s)):
        if not (span[:, 1] >= span[:, 0]).all():
            raise InputError(f"matching: a {name} ends before it begins")
    if not ((confidence >= 0) & (confidence <= 1)).all():
        raise InputError("matching: a confidence is not between 0 and 1")
    allowed = may_match(label_s, found_s)
    rows, columns = linear_sum_assignment(
        np.where(allowed, 1.0 + confidence[None, :], 0.0), maximize=True
    )
    held = allowed[rows, columns]
    found = np.full(len(found_s), -1)
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
    """Labels of one clip and the events found in it: begin and end in seconds, scores."""

    label_s: Float[np.ndarray, "r 2"]
    found_s: Float[np.ndarray, "d 2"]
    score: Float[np.ndarray, "d"]


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
    def of_clips(cls, clips: Sequence[ClipEvents], minutes: float) -> "Ranked":
        """Match clip by clip (:func:`matched`), and rank over all clips."""
        score = np.concatenate([np.zeros(0), *(clip.score for clip in clips)])
        ends = np.cumsum([0, *(len(clip.score) for clip in clips)])
        confidence = scaled(score)
        correct = np.zeros(len(score), bool)
        for clip, begin, end in zip(clips, ends[:-1], ends[1:], strict=True):
            found = matched(clip.label_s, clip.found_s, confidence[begin:end])
            correct[begin:end] = found >= 0
        return cls(score, correct, sum(len(clip.label_s) for clip in clips), float(minutes))

    @property
    def average_precision(self) -> float | None:
        """Precision averaged over the labels: ``sum (R_k - R_(k-1)) P_k`` over falling thresholds.

        Labels that were never found count as recall that is never reached; nothing is interpolated
        (Salton & McGill 1983; as scikit-learn). None where nothing is labelled.
        """
        if not self.labels:
            return None
        true, false = self._counts()
        gained = np.diff(true, prepend=0.0) / self.labels
        return float(np.sum(gained * true / (true + false)))

    @property
    def det(self) -> DetCurve | None:
        """The DET curve (Martin et al. 1997), with false alarms per minute; None without labels."""
        if not self.labels:
            return None
        true, false = self._counts()
        return DetCurve(false / self.minutes, 1.0 - true / self.labels)

    def _counts(self) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
        """Correct and false events at or above each score, from the highest on; ties share one."""
        order = np.argsort(-self.score, kind="stable")
        ranked = self.score[order]
        last_of_ties = np.append(ranked[1:] != ranked[:-1], True) if len(ranked) else ranked > 0
        true = np.cumsum(self.correct[order], dtype=float)[last_of_ties]
        return true, np.arange(1.0, len(ranked) + 1)[last_of_ties] - true
