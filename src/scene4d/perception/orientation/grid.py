"""Probability over a camera's roll, tilt and vertical field of view, on one fixed grid."""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

ROLL_RAD = np.radians(np.arange(-24.0, 24.1, 1.5))
"""Roll of the cells' centres, (33,)."""
TILT_RAD = np.radians(np.arange(-17.5, 72.6, 2.5))
"""Tilt below the horizon of the cells' centres, (37,)."""
VFOV_RAD = np.radians(np.geomspace(9.0, 110.0, 21))
"""Vertical field of view of the cells' centres, (21,): equal steps of its logarithm."""
SHAPE = (len(ROLL_RAD), len(TILT_RAD), len(VFOV_RAD))


@dataclass(frozen=True, eq=False)
class Belief:
    """Log-probability of every cell of the grid, normalised to sum to one.

    ``log_p`` has the axes roll, tilt, vertical field of view. The field of view is that of the
    picture's largest centred 4:3 crop (:func:`scene4d.perception.orientation.network.centre_crop`).
    """

    log_p: Float[np.ndarray, "33 37 21"]

    @classmethod
    def normalised(cls, log_weight: Float[np.ndarray, "33 37 21"]) -> "Belief":
        """From unnormalised log-weights."""
        shifted = log_weight - log_weight.max()
        return cls(shifted - np.log(np.exp(shifted).sum()))

    @cached_property
    def p(self) -> Float[np.ndarray, "33 37 21"]:
        """Probability of every cell."""
        return np.exp(self.log_p)

    def marginal(self, axis: int) -> Float[np.ndarray, "n"]:
        """Probability over one axis: 0 roll, 1 tilt, 2 vertical field of view."""
        return self.p.sum(axis=tuple(other for other in range(3) if other != axis))
