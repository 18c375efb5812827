"""From directions of up and latitudes in the picture to roll, tilt and field of view.

A camera's pose fixes, at every point of its picture, which way is up and how high above the horizon
one looks there; so a network that predicts both locally leaves three numbers to be fitted to
hundreds of local opinions (Jin et al. 2023, Veicht et al. 2024). The fit here is a sum of
log-likelihoods over a grid, which is a distribution and not only its best point.
"""

from functools import cache

import numpy as np
from jaxtyping import Float
from scipy.special import i0e

from scene4d.core.geometry import rotation_from_tilt_roll
from scene4d.perception.orientation.grid import ASPECT, ROLL_RAD, SHAPE, TILT_RAD, VFOV_RAD, Belief

_LOG_SPREAD = (-5.0, 2.0)
_OUTLIERS = 0.1
"""Share of cells whose opinion has nothing to do with the camera."""


def field_belief(dense: Float[np.ndarray, "4 r c"], power: float) -> Belief:
    """The pose that the local opinions speak for.

    ``dense`` holds per cell of the picture a vector whose direction is up in the image and whose
    length is the concentration of a von Mises distribution, the latitude in radians, and the
    logarithm of its Laplace spread. ``power`` discounts cells for repeating one another.
    """
    rows, columns = dense.shape[1:]
    log_weight = np.empty(SHAPE)
    vector = dense[:2].reshape(2, -1).astype(np.float64)
    concentration = np.hypot(*vector)
    log_normaliser = np.log(2 * np.pi * i0e(concentration)) + concentration
    latitude = dense[2].ravel().astype(np.float64)
    log_spread = np.clip(dense[3].ravel().astype(np.float64), *_LOG_SPREAD)
    floor_up, floor_latitude = _OUTLIERS / (2 * np.pi), _OUTLIERS / np.pi
    for n in range(len(ROLL_RAD)):
        up, expected = _tables(rows, columns, n)
        agree = np.einsum("tvkx,xk->tvk", up, vector) - log_normaliser
        apart = np.abs(expected - latitude) * np.exp(-log_spread)
        log_up = np.log((1 - _OUTLIERS) * np.exp(agree) + floor_up)
        log_latitude = np.log(
            (1 - _OUTLIERS) * np.exp(-apart - log_spread - np.log(2.0)) + floor_latitude
        )
        log_weight[n] = (log_up + log_latitude).sum(axis=-1)
    return Belief.normalised(power * log_weight)


@cache
def _tables(rows: int, columns: int, roll: int) -> tuple[np.ndarray, np.ndarray]:
    """Up (tilt, vfov, cell, 2) and latitude (tilt, vfov, cell) for one roll."""
    half = 0.5
    y = (np.arange(rows) + 0.5) / rows - half
    x = ((np.arange(columns) + 0.5) / columns - half) * ASPECT[0] / ASPECT[1]
    plane = np.stack([a.ravel() for a in np.meshgrid(x, y)], axis=-1)
    focal = half / np.tan(VFOV_RAD / 2)
    ray = plane[None] / focal[:, None, None]
    up = np.stack([rotation_from_tilt_roll(t, ROLL_RAD[roll])[:, 2] for t in TILT_RAD])
    moved = up[:, None, None, :2] - ray[None] * up[:, None, None, 2:]
    moved /= np.linalg.norm(moved, axis=-1, keepdims=True)
    length = np.sqrt((ray**2).sum(axis=-1) + 1)
    height = np.einsum("tx,vkx->tvk", up[:, :2], ray) + up[:, 2, None, None]
    return moved, np.arcsin(np.clip(height / length, -1, 1))
