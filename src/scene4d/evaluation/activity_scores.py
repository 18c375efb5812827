"""How good ranked events are: average precision, DET curve, misses at a rate of false alarms."""

from collections.abc import Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.errors import InputError
from scene4d.evaluation.activity_matching import matched, scaled


@dataclass(frozen=True, eq=False)
class ClipEvents:
    """What is labelled in one clip and what was found in it: begin and end in seconds, scores."""

    label_s: Float[np.ndarray, "r 2"]
    found_s: Float[np.ndarray, "d 2"]
    score: Float[np.ndarray, "d"]


@dataclass(frozen=True, eq=False)
class Ranked:
    """Found events of one activity over all clips, with whether each is a labelled one.

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
        """Match clip by clip (:mod:`.activity_matching`), and rank over all of them."""
        score = np.concatenate([np.zeros(0), *(clip.score for clip in clips)])
        ends = np.cumsum([0, *(len(clip.score) for clip in clips)])
        confidence = scaled(score)
        correct = np.zeros(len(score), bool)
        for clip, begin, end in zip(clips, ends[:-1], ends[1:], strict=True):
            found = matched(clip.label_s, clip.found_s, confidence[begin:end])
            correct[begin:end] = found >= 0
        return cls(score, correct, sum(len(clip.label_s) for clip in clips), float(minutes))

    def counts(self) -> tuple[Float[np.ndarray, "k"], Float[np.ndarray, "k"]]:
        """Correct and false events at or above each score, from the highest on; ties share one."""
        order = np.argsort(-self.score, kind="stable")
        ranked = self.score[order]
        last_of_ties = np.append(ranked[1:] != ranked[:-1], True) if len(ranked) else ranked > 0
        true = np.cumsum(self.correct[order], dtype=float)[last_of_ties]
        return true, np.arange(1.0, len(ranked) + 1)[last_of_ties] - true


@dataclass(frozen=True, eq=False)
class DetCurve:
    """Detection error tradeoff: false alarms per minute and share of labels missed, (k,), at
    falling thresholds. Empty where nothing was found.
    """

    false_per_minute: Float[np.ndarray, "k"]
    missed: Float[np.ndarray, "k"]

    def missed_at(self, false_per_minute: float) -> float:
        """Pmiss@RFA: between two points of the curve on the straight line, 1 left of the first
        one, and as far as it goes right of the last one, as NIST's scorer has it.
        """
        x, y = self.false_per_minute, self.missed
        if not len(x) or x[0] > false_per_minute:
            return 1.0
        last = int(np.searchsorted(x, false_per_minute, side="right")) - 1
        if last == len(x) - 1 or x[last] == false_per_minute:
            return float(y[last])
        share = (false_per_minute - x[last]) / (x[last + 1] - x[last])
        return float(y[last] + share * (y[last + 1] - y[last]))


def average_precision(ranked: Ranked) -> float | None:
    """Precision averaged over the labels: ``sum (R_k - R_(k-1)) P_k`` over falling thresholds.

    What was never found counts as recall that is never reached; nothing is interpolated (Salton &
    McGill 1983; as scikit-learn). None where nothing is labelled.
    """
    if not ranked.labels:
        return None
    true, false = ranked.counts()
    gained = np.diff(true, prepend=0.0) / ranked.labels
    return float(np.sum(gained * true / (true + false)))


def det_curve(ranked: Ranked) -> DetCurve | None:
    """The DET curve (Martin et al. 1997), with false alarms per minute; None without labels."""
    if not ranked.labels:
        return None
    true, false = ranked.counts()
    return DetCurve(false / ranked.minutes, 1.0 - true / ranked.labels)
