"""What a detector gets wrong with everybody alike: a smooth error over the picture.

Boxes grow or shrink against the body that they show, with its distance, its place and the angle
under which it is seen; keypoints do so less, and are seen leaning too little or too much, or all of
them by the same angle; each detector, and each hand that draws, in its own way. A drift looks like
another camera: a trend of size with distance like another horizon, one across the picture like
roll, a bent trend or too small a lean like another focal length. So it is estimated together with
the camera, with a prior, and what it cannot be told from stays uncertain. The logarithm λ of the
predicted length at column x, and the predicted lean φ (radians), become

    λ + g (λ - λ₀) + a x + b (λ - λ₀)² + w (λ - λₜ),    φ + s φ + o,

with b and w for boxes alone, and s and o for keypoints, since a box has no lean. λₜ is the mean
along a track: how a person's box grows along a walk and how large boxes of different people are at
different distances do not quite agree. Predicted values stand in the drift and not seen ones, whose
noise would pass for it.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int

from scene4d.calibration._body import Points

N_DRIFTS = 6
_SIGMA = np.array([0.06, 0.03, 0.06, 0.12, 0.012, 0.1])
"""Spread of g and w per e-fold of length, a per half diagonal, b per e-fold squared, s, and o
(radians), in the order g, a, b, s, o, w.

With the true cameras g of boxes is -0.05, -0.03 and -0.07 for three kinds of PETS 2009 and 0.03 for
TownCentre, a -0.02 to -0.04, b -0.04 to 0.1. Between half and twice these values the errors on both
cameras change by less than 0.2 m where the lens is known. For keypoints on five cameras (PETS, two
cuts of TownCentre, two laboratory cameras) s is -0.08, -0.01, -0.07, 0.13 and 0.08, and o is -0.2,
0.8, 0.3, 0.8 and -2.2 degrees, the last two of five people each; within tracks g is 0.06, 0.21,
-0.03, -0.01 and 0.07. Growth of boxes within tracks less that between people has an rms of 0.11
over nine recordings, without laboratory camera 2 and its five people
(`python -m benchmarks.shared_errors`). With w for keypoints too their errors grow by a fifth and
more, and what is stated fits them no better."""


@dataclass(frozen=True, eq=False)
class Drifted:
    """What drift does to (log length, lean): ``added`` (2, n), the derivative of the sum by the
    value itself ``gain`` (2, n), its derivatives ``by`` (6, 2, n) by the coefficients, and those of
    the gain of log length ``gain_by`` (6, n).
    """

    added: Float[np.ndarray, "2 n"]
    gain: Float[np.ndarray, "2 n"]
    by: Float[np.ndarray, "6 2 n"]
    gain_by: Float[np.ndarray, "6 n"]


@dataclass(frozen=True)
class Drift:
    """The drift of a set of people about the logarithm ``middle`` of their lengths, and of each
    one's along its track; NaN for who is seen once.
    """

    middle: float
    own_middle: Float[np.ndarray, "n"]

    @classmethod
    def of(cls, points: Points, track: Int[np.ndarray, "n"]) -> "Drift":
        """That of these people; tracks are numbered from 0."""
        size = 0.5 * np.log(points.seen2)
        count = np.bincount(track)
        own = np.bincount(track, size) / np.where(count > 1, count, np.nan)
        return cls(float(np.median(size)), own[track])

    def select(self, rows: np.ndarray) -> "Drift":
        """The same drift of some of the people."""
        return replace(self, own_middle=self.own_middle[rows])

    @property
    def precision(self) -> Float[np.ndarray, "6"]:
        """Of the coefficients, whose mean is zero."""
        return 1 / _SIGMA**2

    def at(
        self,
        coefficients: Float[np.ndarray, "6"],
        log_length: Float[np.ndarray, "n"],
        lean: Float[np.ndarray, "n"],
        points: Points,
    ) -> Drifted:
        """Of people with these predicted lengths and leans."""
        box, away = points.from_box, log_length - self.middle
        walks = box & ~np.isnan(self.own_middle)
        by, gain_by = np.zeros((N_DRIFTS, 2, len(box))), np.zeros((N_DRIFTS, len(box)))
        by[0, 0], by[1, 0] = away, points.foot[0]
        by[2, 0] = np.where(box, away * away, 0.0)
        by[5, 0] = np.where(walks, log_length - self.own_middle, 0.0)
        by[3, 1], by[4, 1] = np.where(box, 0.0, lean), ~box
        gain_by[0], gain_by[5] = 1.0, walks
        gain_by[2] = np.where(box, 2 * away, 0.0)
        straightened = np.where(box, 0.0, coefficients[3])
        gain = 1 + np.stack([coefficients @ gain_by, straightened])
        added = (coefficients @ by.reshape(N_DRIFTS, -1)).reshape(2, -1)
        return Drifted(added, gain, by, gain_by)
