"""Which found events are which labelled ones: NIST's rule for ActEV (protocol SDL V2).

An event and a label may match where they overlap by :data:`OVERLAP_S`, or, where the label itself
is shorter than that, by :data:`OVERLAP_SHARE` of it. Each is used once. Of all assignments the one
with the greatest sum of ``1 + c`` counts, where ``c`` is the event's score, scaled to 0 to 1 over
all events of the activity: first as many pairs as there can be, then confident ones.
"""

import numpy as np
from jaxtyping import Bool, Float, Int
from scipy.optimize import linear_sum_assignment

from scene4d.core.errors import InputError

OVERLAP_S = 1.0
OVERLAP_SHARE = 0.5
_ROUNDING_S = 1e-9


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

    ``confidence`` is the score scaled to 0 to 1. Raises :class:`InputError` for other values, and
    for spans that end before they begin.
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
