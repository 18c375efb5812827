"""How the sizes of boxes drift over the picture: a smooth error that all boxes share.

A detector's boxes grow or shrink against the body that they show, with its distance, its place and
the angle under which it is seen; each detector, and each hand that draws, in its own way. A drift
looks like another camera: a trend with distance like another horizon, one across the picture like
roll, a bent trend like another focal length. So it is estimated together with the camera, with a
prior of a few per cent: the logarithm of a box's predicted length L at column x becomes

    λ + g (λ - λ₀) + a x + b (λ - λ₀)²,    λ = log L,

and what it cannot be told from stays uncertain. λ is the predicted length and not the seen one,
whose noise would pass for drift.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.calibration._body import Points

N_DRIFTS = 3
_SIGMA = np.array([0.06, 0.03, 0.06])
"""Spread of g per e-fold of length, a per half diagonal, b per e-fold squared. With the true
cameras g is -0.05, -0.03 and -0.07 for three kinds of boxes of PETS 2009 and 0.03 for TownCentre, a
is -0.02 to -0.04, b -0.04 to 0.1. Between half and twice these values the errors on both cameras
change by less than 0.2 m where the lens is known."""


@dataclass(frozen=True, eq=False)
class Drifted:
    """What drift does to log lengths: ``added`` (n,), the derivative of the sum by the log length
    ``gain`` (n,), and its derivatives ``by`` (3, n) by the coefficients.
    """

    added: Float[np.ndarray, "n"]
    gain: Float[np.ndarray, "n"]
    by: Float[np.ndarray, "3 n"]


@dataclass(frozen=True)
class Drift:
    """The drift of a set of boxes about the logarithm ``middle`` of their lengths."""

    middle: float

    @classmethod
    def of(cls, points: Points) -> "Drift | None":
        """That of the boxes among the people; None where there are none."""
        if not points.has_boxes:
            return None
        return cls(float(np.median(0.5 * np.log(points.seen2[points.from_box]))))

    @property
    def precision(self) -> Float[np.ndarray, "3"]:
        """Of the coefficients, whose mean is zero."""
        return 1 / _SIGMA**2

    def at(
        self, coefficients: Float[np.ndarray, "3"], log_length: Float[np.ndarray, "n"],
        points: Points,
    ) -> Drifted:  # fmt: skip
        """Of people with these predicted lengths; people who are no boxes do not drift."""
        growth, _, bend = coefficients
        away = np.where(points.from_box, log_length - self.middle, 0.0)
        by = np.stack([away, np.where(points.from_box, points.foot[0], 0.0), away * away])
        slope = np.where(points.from_box, growth + 2 * bend * away, 0.0)
        return Drifted(coefficients @ by, 1 + slope, by)
