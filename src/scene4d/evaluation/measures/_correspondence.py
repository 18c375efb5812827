"""The paper's correspondence error (Wagner et al. 2019, section 4): rigid alignment, no scale."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.errors import InputError
from scene4d.core.geometry import rigid_fit
from scene4d.drawing.ground import spread

POINTS = 12
"""Number of correspondence points, chosen by hand: about as many as a figure can show."""


@dataclass(frozen=True, eq=False)
class CorrespondenceError:
    """Distances (n,) in metres after alignment, with the points in the reference's world."""

    distance_m: Float[np.ndarray, "n"]
    true_xy_m: Float[np.ndarray, "n 2"]
    aligned_xy_m: Float[np.ndarray, "n 2"]

    @property
    def mean_m(self) -> float:
        """Mean distance."""
        return float(self.distance_m.mean())

    @property
    def rms_m(self) -> float:
        """Root mean square distance."""
        return float(np.sqrt((self.distance_m**2).mean()))

    @property
    def sd_m(self) -> float:
        """Standard deviation of the distance."""
        return float(self.distance_m.std())


def spread_points(xy_m: Float[np.ndarray, "n 2"], count: int = POINTS) -> Int[np.ndarray, "k"]:
    """Rows of ``count`` points that differ, spread over the set (:func:`.spread`) from the one
    farthest from the mean; raises :class:`InputError` where there are fewer.
    """
    rows = np.empty(0, int)
    if len(xy_m):
        first = int(np.argmax(np.linalg.norm(xy_m - xy_m.mean(axis=0), axis=1)))
        rows = spread(xy_m, count, first)
    if len(rows) < count:
        raise InputError(f"{count} spread points were asked for, and only {len(rows)} are there")
    return rows


def correspondence_error(
    estimated_xy_m: Float[np.ndarray, "n 2"], true_xy_m: Float[np.ndarray, "n 2"]
) -> CorrespondenceError:
    """Distances between true and estimated ground points after the best rigid motion (Arun 1987).

    Raises :class:`InputError` where an estimated point is missing (NaN): a camera that puts a
    correspondence point above its horizon has no error, it has failed.
    """
    if not np.isfinite(estimated_xy_m).all():
        missing = int((~np.isfinite(estimated_xy_m).all(axis=1)).sum())
        raise InputError(f"{missing} correspondence points have no estimated ground position")
    R, t = rigid_fit(estimated_xy_m, true_xy_m)
    aligned = estimated_xy_m @ R.T + t
    return CorrespondenceError(np.linalg.norm(aligned - true_xy_m, axis=1), true_xy_m, aligned)
