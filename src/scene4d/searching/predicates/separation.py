"""Where one thing is, seen from another: what all predicates of two roles begin with."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.searching.predicates.gaussian import ANY_RAD, turned
from scene4d.searching.predicates.rows import Rows


@dataclass(frozen=True, eq=False)
class Separation:
    """From a to b: ``vector_m``, its length and direction with their standard deviations.

    The vector's covariance is ``C_a + C_b + D Dᵀ``, with D the difference of the two camera
    factors: the camera misplaces near things alike, so its error hardly enters there. The error
    of the distance is that along the vector, of the direction that across it over the distance.
    Where the two coincide neither has a direction: the mean over all directions is taken.
    """

    vector_m: Float[np.ndarray, "m 2"]
    distance_m: Float[np.ndarray, "m"]
    unit: Float[np.ndarray, "m 2"]
    distance_sigma_m: Float[np.ndarray, "m"]
    direction_sigma_rad: Float[np.ndarray, "m"]
    covariance_m2: Float[np.ndarray, "m 2 2"]

    @classmethod
    def between(cls, a: Rows, b: Rows) -> "Separation":
        """Of rows that belong together, one by one."""
        vector = b.xy_m - a.xy_m
        covariance = a.covariance_m2 + b.covariance_m2
        if a.stage.camera_factor is not None or b.stage.camera_factor is not None:
            apart = b.camera_factor - a.camera_factor
            covariance = covariance + apart @ apart.swapaxes(1, 2)
        distance = np.hypot(vector[:, 0], vector[:, 1])
        apart_at_all = distance > 0
        with np.errstate(divide="ignore", invalid="ignore"):
            unit = np.where(apart_at_all[:, None], vector / distance[:, None], [1.0, 0.0])
        unit = np.where(np.isnan(distance)[:, None], np.nan, unit)
        mean = (covariance[:, 0, 0] + covariance[:, 1, 1]) / 2
        along = np.where(distance == 0, mean, _variance(unit, covariance))
        across = np.where(distance == 0, mean, _variance(turned(unit), covariance))
        with np.errstate(divide="ignore", invalid="ignore"):
            bearing = np.minimum(np.sqrt(across) / distance, ANY_RAD)
        bearing = np.where(distance == 0, ANY_RAD, bearing)
        return cls(vector, distance, unit, np.sqrt(along), bearing, covariance)


def _variance(unit: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    x, y = unit[:, 0], unit[:, 1]
    found: np.ndarray = (
        x * x * covariance[:, 0, 0]
        + x * y * (covariance[:, 0, 1] + covariance[:, 1, 0])
        + y * y * covariance[:, 1, 1]
    )
    return np.maximum(found, 0.0)
