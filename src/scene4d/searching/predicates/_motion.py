"""How fast something moves, from its smoothed velocity and the covariance of that."""

import numpy as np
from jaxtyping import Float

from scene4d.searching.predicates._distance import far, near
from scene4d.searching.predicates._gaussian import above, form
from scene4d.searching.predicates.stage import StageRows

MOVING_MPS = 0.5
"""What moves slower than this stands: people sway, boxes jitter. Chosen by hand."""
SPEED_SIGMA_MPS = 0.2
"""Softness of words of speed; chosen by hand."""
_STAYING_M = 5.0
_STAYING_SIGMA_M = 1.0
_STAYING_S = 60.0
"""Who gets no further in a minute stays about a place, however much he paces; chosen by hand."""

_PLACE_M, _PLACE_SIGMA_M = 3.0, 1.0
"""Who is further away is elsewhere: more than half of a car's length; chosen by hand."""
_SOON_S = 60.0
"""How long a vehicle waits for somebody to get in or out, at most; chosen by hand."""


def speed(
    velocity_mps: Float[np.ndarray, "m 2"], covariance: Float[np.ndarray, "m 2 2"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Mean and variance of the length of a Gaussian velocity, m/s and m²/s².

    The length of a vector known to ±1 m/s is about 1.25 m/s even where its mean is zero. The
    square ``q = |v|²`` has mean ``Q = |v|² + tr C`` and variance ``V = 2 tr C² + 4 vᵀ C v``; to
    second order its root has mean ``√Q (1 - V / 8Q²)`` and mean square Q. P(speed) from these is
    off by 0.02 where the errors are round, by up to 0.13 where the velocity is uncertain along one
    line only and by more than its own size.
    """
    square = (velocity_mps**2).sum(axis=1) + covariance[:, 0, 0] + covariance[:, 1, 1]
    variance = 2 * (covariance**2).sum(axis=(1, 2)) + 4 * form(velocity_mps, covariance)
    with np.errstate(divide="ignore", invalid="ignore"):
        share = np.where(square < 1e-12, 0.0, variance / (8 * square**2))
    mean = np.sqrt(square) * (1 - share)
    return mean, np.maximum(square - mean**2, 0.0)


def speed_above(
    a: StageRows, *, speed_mps: float = 2.5, sigma_mps: float = SPEED_SIGMA_MPS
) -> Float[np.ndarray, "m"]:
    """P(a is faster than ``speed_mps``), m/s.

    ``Φ((μ - s) / √(σ² + ν))`` with mean μ and variance ν of the length of the velocity
    (:func:`speed`). The default divides walking from running. NaN without a velocity.
    """
    mean, variance = speed(a.velocity_mps, a.velocity_covariance)
    return above(mean, speed_mps, sigma_mps, variance)


def speed_below(
    a: StageRows, *, speed_mps: float = 2.5, sigma_mps: float = SPEED_SIGMA_MPS
) -> Float[np.ndarray, "m"]:
    """P(a is slower than ``speed_mps``), m/s: the rest to :func:`speed_above`."""
    return 1 - speed_above(a, speed_mps=speed_mps, sigma_mps=sigma_mps)


def moving(
    a: StageRows, *, speed_mps: float = MOVING_MPS, sigma_mps: float = SPEED_SIGMA_MPS
) -> Float[np.ndarray, "m"]:
    """P(a moves): :func:`speed_above` of 0.5 m/s."""
    return speed_above(a, speed_mps=speed_mps, sigma_mps=sigma_mps)


def stationary(
    a: StageRows, *, speed_mps: float = MOVING_MPS, sigma_mps: float = SPEED_SIGMA_MPS
) -> Float[np.ndarray, "m"]:
    """P(a stands): the rest to :func:`moving` with the same speed."""
    return 1 - moving(a, speed_mps=speed_mps, sigma_mps=sigma_mps)


def staying(
    a: StageRows,
    *,
    radius_m: float = _STAYING_M,
    window_s: float = _STAYING_S,
    sigma_m: float = _STAYING_SIGMA_M,
) -> Float[np.ndarray, "m"]:
    """P(a stays about a place): within ``window_s`` seconds about the moment it gets no further
    than ``radius_m``, whatever it does between.

    :func:`near` of its first and its last position in the window; of a shorter track of those that
    there are. NaN where one is missing.
    """
    early, late = a.stage.window(a.index, window_s / 2)
    return near(a.stage.rows(early), a.stage.rows(late), tau_m=radius_m, sigma_m=sigma_m)


def arrived(
    a: StageRows,
    *,
    radius_m: float = _PLACE_M,
    window_s: float = _SOON_S,
    sigma_m: float = _PLACE_SIGMA_M,
) -> Float[np.ndarray, "m"]:
    """P(a was elsewhere, further than ``radius_m`` from here, ``window_s`` seconds ago), or where
    its track begins if that is later: it has come here. As :func:`staying`.
    """
    early, _ = a.stage.window(a.index, window_s)
    return far(a, a.stage.rows(early), tau_m=radius_m, sigma_m=sigma_m)


def departs(
    a: StageRows,
    *,
    radius_m: float = _PLACE_M,
    window_s: float = _SOON_S,
    sigma_m: float = _PLACE_SIGMA_M,
) -> Float[np.ndarray, "m"]:
    """P(a will be elsewhere, further than ``radius_m`` from here, in ``window_s`` seconds), or
    where its track ends if that is earlier: :func:`arrived` with time reversed.
    """
    _, late = a.stage.window(a.index, window_s)
    return far(a, a.stage.rows(late), tau_m=radius_m, sigma_m=sigma_m)


def present(a: StageRows) -> Float[np.ndarray, "m"]:
    """P(a is there at all): 1 wherever it has a position, and else NaN."""
    return np.where(np.isfinite(a.xy_m).all(axis=1), 1.0, np.nan)
