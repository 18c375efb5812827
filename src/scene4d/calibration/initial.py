"""Starting points for the refinement: a coarse grid over focal length, tilt and roll.

For one orientation every person tells its own ``κ`` in closed form (:mod:`.body`: the head's ray is
``d + κ up``), hence its own camera height; the median is the height, and what is left over is how
badly the people agree. Thousands of orientations are tried at once on a few hundred people.
"""

import numpy as np
from jaxtyping import Float

from scene4d.calibration.body import CORNER, FOCAL, HEIGHT, ROLL, TILT, Points, undistort
from scene4d.calibration.prior import Prior

_ALONG, _ACROSS = 0.07, 0.06
"""Rough spread of a head about its prediction, in lengths of the person (height included)."""
_OUTLIER = 3.0
_GRID_PEOPLE = 64
"""So many people are enough to tell a good orientation from a bad one."""


def _grid(prior: Prior) -> np.ndarray:
    """Orientations (m, 3): the fixed values where fixed, else a spread over the prior."""
    focal = [-0.6, -0.25, 0.1, 0.45, 0.8, 1.15, 1.5]
    tilt = np.radians([0, 5, 10, 16, 23, 31, 40, 50, 62, 75])
    roll = prior.mean[ROLL] + np.radians([-10, -3, 3, 10])
    axes: list[np.ndarray] = []
    for index, full in ((FOCAL, focal), (TILT, tilt), (ROLL, roll)):
        mean, sigma = prior.mean[index], prior.sigma[index]
        values = np.asarray(full)
        if sigma == 0:
            values = np.array([mean])
        elif sigma < 0.3:
            # A told value: its neighbourhood, unless the general grid is finer than that.
            near = mean + sigma * np.array([-2.0, -1.0, 0.0, 1.0, 2.0])
            values = near if index != ROLL or sigma < 0.05 else values
        axes.append(values)
    return np.stack(np.meshgrid(*axes, indexing="ij"), axis=-1).reshape(-1, 3)


def starting_points(
    points: Points,
    weight: Float[np.ndarray, "n"],
    person_height_m: float,
    prior: Prior,
    keep: int = 3,
) -> Float[np.ndarray, "m 5"]:
    """The best ``keep`` distinct parameter vectors of the grid, best first."""
    corner = prior.mean[CORNER]
    if len(weight) > _GRID_PEOPLE:
        rows = np.linspace(0, len(weight) - 1, _GRID_PEOPLE).astype(int)
        points, weight = points.select(rows), weight[rows]
    foot, head = undistort(points.foot, corner)[0], undistort(points.head, corner)[0]
    orientations = _grid(prior)
    focal = np.exp(orientations[:, 0])[:, None]
    tilt, roll = orientations[:, 1], orientations[:, 2]
    up = np.stack(
        [np.sin(roll) * np.cos(tilt), -np.cos(roll) * np.cos(tilt), -np.sin(tilt)], axis=1
    )
    up = up[:, :, None]
    x, y = foot[0] / focal, foot[1] / focal
    a, b = head[0] / focal, head[1] / focal

    # Head: (x + κ up_x, y + κ up_y) = (a, b) (1 + κ up_z); least squares over the two rows.
    row_x, row_y = up[:, 0] - a * up[:, 2], up[:, 1] - b * up[:, 2]
    gap_x, gap_y = a - x, b - y
    norm2 = row_x**2 + row_y**2 + 1e-12
    kappa = (row_x * gap_x + row_y * gap_y) / norm2
    across = (row_x * gap_y - row_y * gap_x) / norm2 / np.where(kappa > 1e-9, kappa, np.nan)
    down = -(up[:, 0] * x + up[:, 1] * y + up[:, 2])
    with np.errstate(divide="ignore", invalid="ignore"):
        log_ratio = np.log(np.where((kappa > 0) & (down > 1e-6), kappa / down, np.nan))

    usable = np.isfinite(log_ratio).mean(axis=1) > 0.3
    orientations, log_ratio, across = orientations[usable], log_ratio[usable], across[usable]
    if len(orientations) == 0:
        return np.empty((0, 5))
    # Median of what is finite, log H / h: sorting puts NaN last.
    middle = np.isfinite(log_ratio).sum(axis=1) // 2
    level = np.sort(log_ratio, axis=1)[np.arange(len(log_ratio)), middle]
    chi2 = ((log_ratio - level[:, None]) / _ALONG) ** 2 + (across / _ACROSS) ** 2
    chi2 = np.where(np.isfinite(chi2), chi2, np.inf)
    cost = (weight * (1 - 1 / (1 + chi2 / _OUTLIER**2))).sum(axis=1) * _OUTLIER**2

    parameters = np.empty((len(orientations), 5))
    parameters[:, [FOCAL, TILT, ROLL]] = orientations
    parameters[:, HEIGHT] = np.log(person_height_m) - level
    parameters[:, CORNER] = corner
    gap = parameters - prior.mean
    cost += ((gap @ prior.precision) * gap).sum(axis=1)
    return parameters[_distinct(parameters, np.argsort(cost), keep)]


def _distinct(parameters: np.ndarray, order: np.ndarray, keep: int) -> list[int]:
    """Indices of the first ``keep`` candidates that differ clearly from one another."""
    apart = np.array([0.5, 0.2, 0.2])
    chosen: list[int] = []
    for index in order:
        gap = np.abs(parameters[chosen, :3] - parameters[index, :3]) / apart
        if len(chosen) == 0 or (gap.max(axis=1) > 1).all():
            chosen.append(int(index))
        if len(chosen) == keep:
            break
    return chosen
