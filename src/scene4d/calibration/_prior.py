"""What is believed before any person is seen: a Gaussian over the seven parameters.

Order (log f, tilt, roll, log h, D, cu, cv) with f and the principal point in half diagonals of the
image and D the displacement of the image's corner by the lens; see
:mod:`scene4d.calibration._body`.
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._body import (
    CENTRE,
    CENTRE_U,
    CENTRE_V,
    CORNER,
    FOCAL,
    N_PARAMETERS,
    ROLL,
    TILT,
)
from scene4d.core.orientation import Orientation

# Weak on purpose, and chosen for what is sold and how it is hung: two standard deviations reach
# diagonal fields of view of 15 to 140 degrees, cameras that look 15 degrees up or 65 down, rolls of
# 12 degrees, and heights of 1 to 25 m.
_MEAN = np.array([np.log(1.8), np.radians(25.0), 0.0, np.log(5.0), 0.0, 0.0, 0.0])
_SIGMA = np.array([0.75, np.radians(20.0), np.radians(6.0), 0.8, 0.0, 0.0, 0.0])
_CORNER_SIGMA = 0.04
"""Spread of D over lenses of cameras that nobody has calibrated: PETS 2009 has -0.03,
TownCentre -0.10, and MEVA's cameras 0 to -0.20, for which a lens file is the better way."""

CENTRE_SIGMA = 0.06
"""Spread of principal points about the picture's middle, in half diagonals, along each axis: root
mean square of the three cameras at hand whose principal point was measured (PETS 2009 is off by
(0.12, 0.01), the laboratory by (0.03, 0.02) and (0.05, 0.00)); others were assumed to be 0."""


def inverse_of(matrix: Float[np.ndarray, "k k"], free: np.ndarray) -> Float[np.ndarray, "k k"]:
    """The inverse over the rows that are ``free`` (a mask, or indices), zero elsewhere."""
    found, both = np.zeros_like(matrix), np.ix_(free, free)
    found[both] = np.linalg.inv(matrix[both])
    return found


@dataclass(frozen=True, eq=False)
class Prior:
    """Mean and standard deviation of the seven parameters; sigma 0 holds a parameter fixed.

    ``focal_tilt_correlation`` is that of log f and tilt; it counts where both are free and known.
    ``of_middle`` says that ``mean`` holds the tilt at the picture's middle, and not at the
    principal point: that of somebody who only sees the picture.
    """

    mean: Float[np.ndarray, "7"]
    sigma: Float[np.ndarray, "7"]
    focal_tilt_correlation: float = 0.0
    of_middle: bool = False

    @cached_property
    def free(self) -> Bool[np.ndarray, "7"]:
        """Which parameters are estimated."""
        return self.sigma > 0

    @cached_property
    def precision(self) -> Float[np.ndarray, "7 7"]:
        """Inverse of the covariance, zero where a parameter is unknown or fixed."""
        with np.errstate(divide="ignore"):
            own = np.where(self.free, 1 / self.sigma, 0.0)
        inverse = np.diag(own**2)
        correlation = self.focal_tilt_correlation
        if correlation and own[FOCAL] and own[TILT]:
            pair = np.ix_((FOCAL, TILT), (FOCAL, TILT))
            signs = np.array([[1.0, -correlation], [-correlation, 1.0]])
            scale = np.outer(own[[FOCAL, TILT]], own[[FOCAL, TILT]])
            inverse[pair] = signs * scale / (1 - correlation**2)
        if self.of_middle:
            # The middle lies at -(cu, cv): the ray there is cv / f flatter than the optical axis.
            middle = np.eye(N_PARAMETERS)
            focal, roll = np.exp(self.mean[FOCAL]), self.mean[ROLL]
            middle[TILT, [CENTRE_U, CENTRE_V]] = np.sin(roll) / focal, -np.cos(roll) / focal
            inverse = middle.T @ inverse @ middle
        return inverse

    def costs(self, parameters: Float[np.ndarray, "m 7"]) -> Float[np.ndarray, "m"]:
        """``-2 log p`` of many cameras, up to a constant."""
        gap = parameters - self.mean
        costs: np.ndarray = ((gap @ self.precision) * gap).sum(axis=1)
        return costs

    def with_orientation(self, orientation: Orientation, half_diagonal_px: float) -> "Prior":
        """Replace the beliefs about f, tilt and roll; infinite spreads leave them as they are."""
        mean, sigma = self.mean.copy(), self.sigma.copy()
        log_focal = np.log(orientation.focal_px / half_diagonal_px)
        told = log_focal, orientation.tilt_rad, orientation.roll_rad
        columns, known = (FOCAL, TILT, ROLL), np.isfinite(orientation.spread)
        for index, value, spread in zip(columns, told, orientation.spread, strict=True):
            if np.isfinite(spread):
                mean[index], sigma[index] = value, spread
        both = known[0] and known[1]
        correlation = orientation.focal_tilt_correlation if both else 0.0
        return replace(self, mean=mean, sigma=sigma, focal_tilt_correlation=correlation)

    def with_focal(self, focal_px: float, half_diagonal_px: float) -> "Prior":
        """Hold the focal length fixed."""
        mean, sigma = self.mean.copy(), self.sigma.copy()
        mean[FOCAL], sigma[FOCAL] = np.log(focal_px / half_diagonal_px), 0.0
        return replace(self, mean=mean, sigma=sigma)


def default_prior(*, estimate_distortion: bool = False, centre_sigma: float = 0.0) -> Prior:
    """The weak prior of an unknown surveillance camera; without distortion unless asked for, and
    with its principal point known to ``centre_sigma`` (half diagonals).
    """
    sigma = _SIGMA.copy()
    sigma[CENTRE] = centre_sigma
    sigma[CORNER] = _CORNER_SIGMA if estimate_distortion else 0.0
    assert len(sigma) == N_PARAMETERS
    return Prior(_MEAN.copy(), sigma)
