"""Probabilities of Gaussian numbers, points and angles, for all predicates."""

from functools import cache
from math import erfc

import numpy as np
from jaxtyping import Float

_MOST_CORRELATED = 0.999
_ALL_BELOW, _ALL_ABOVE = -38.6, 8.3
"""Beyond these Φ is 0 or 1 as a float."""
ANY_RAD = np.pi
"""Spread of an angle that may be anything: at it a Gaussian on the circle is uniform to 1 %."""
_WIDEST_RAD = np.pi / np.sqrt(3)  # the standard deviation of an angle that may be anything


def ndtr(z: Float[np.ndarray, "*m"]) -> Float[np.ndarray, "*m"]:
    """Φ, the distribution function of the standard normal distribution: ``erfc(-z / √2) / 2``.

    SciPy's is faster by number, but loading it takes longer than the thousands of them that a
    search asks for.
    """
    out = np.array(z > 0, float)
    inner = ~((z <= _ALL_BELOW) | (z >= _ALL_ABOVE))
    found = map(erfc, (z[inner] * -np.sqrt(0.5)).tolist())
    out[inner] = np.fromiter(found, float) / 2
    return out


def above(
    value: Float[np.ndarray, "m"],
    threshold: float,
    sigma: float,
    variance: Float[np.ndarray, "m"] | float = 0.0,
) -> Float[np.ndarray, "m"]:
    """P(x > threshold) for ``x ~ N(value, variance)`` and a threshold that is itself
    ``N(threshold, sigma²)``, the softness of a word: ``Φ((value - threshold) / √(σ² + variance))``.
    Without any spread a step, ½ at the threshold.
    """
    margin = value - threshold
    spread = np.sqrt(sigma**2 + variance)
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where((margin == 0) & (spread == 0), 0.0, margin / spread)
    return ndtr(z)


def form(
    left: Float[np.ndarray, "m 2"],
    covariance: Float[np.ndarray, "m 2 2"],
    right: Float[np.ndarray, "m 2"] | None = None,
) -> Float[np.ndarray, "m"]:
    """``leftᵀ C right``; with one vector its variance."""
    right = left if right is None else right
    c = covariance
    x, y = left[:, 0], left[:, 1]
    along = c[:, 0, 0] * right[:, 0] + c[:, 0, 1] * right[:, 1]
    across = c[:, 1, 0] * right[:, 0] + c[:, 1, 1] * right[:, 1]
    return np.asarray(x * along + y * across)


def turned(vector: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 2"]:
    """The vectors a quarter turn to the left."""
    return np.stack([-vector[:, 1], vector[:, 0]], axis=1)


def both_positive(
    first: Float[np.ndarray, "m"],
    second: Float[np.ndarray, "m"],
    correlation: Float[np.ndarray, "m"],
) -> Float[np.ndarray, "m"]:
    """P(both > 0) of two Gaussians of unit variance with these means and correlation.

    Plackett's integral over the correlation, by ten Gauss-Legendre nodes in its arcsine (Drezner
    and Wesolowsky 1990); off by less than 1e-4 up to a correlation of 0.99.
    """
    top = np.arcsin(np.clip(correlation, -_MOST_CORRELATED, _MOST_CORRELATED))
    independent = ndtr(first) * ndtr(second)
    total = np.zeros_like(independent)
    squares, product = first**2 + second**2, 2 * first * second
    for node, weight in _quadrature():
        s = np.sin(top * (node + 1) / 2)
        total += weight * np.exp(-(squares - product * s) / (2 * (1 - s * s)))
    return np.asarray(np.clip(independent + top * total / (4 * np.pi), 0.0, 1.0))


@cache
def _quadrature() -> list[tuple[float, float]]:
    """Ten nodes and their weights; NumPy's polynomials are loaded where somebody needs them."""
    nodes, weights = np.polynomial.legendre.leggauss(10)
    return list(zip(nodes.tolist(), weights.tolist(), strict=True))


def in_wedge(
    point: Float[np.ndarray, "m 2"],
    covariance: Float[np.ndarray, "m 2 2"],
    axis: Float[np.ndarray, "m 2"],
    *,
    apex: float | Float[np.ndarray, "m"],
    half_angle_rad: float,
    axis_sigma_rad: Float[np.ndarray, "m"],
    sigma: float,
) -> Float[np.ndarray, "m"]:
    """P(an uncertain point lies in a wedge) that opens along the unit vector ``axis``.

    The wedge begins at ``apex`` along the axis and opens by ``half_angle_rad`` to either side. It
    is the meeting of two half planes with normals ``n± = u sin α ± u⊥ cos α``; the distances from
    their borders, ``n±·(p - apex u)``, are jointly Gaussian with the covariance of the point plus
    ``σ² I`` for the softness of the word. An axis that is uncertain by a small angle θ moves the
    point by ``θ p⊥``, which is added to its covariance.
    """
    u, across = axis, turned(axis)
    side = turned(point)
    doubt = np.minimum(axis_sigma_rad, _WIDEST_RAD) ** 2
    total = covariance + doubt[:, None, None] * side[:, :, None] * side[:, None, :]
    total = total + sigma**2 * np.eye(2)
    s, c = np.sin(half_angle_rad), np.cos(half_angle_rad)
    left, right = s * u + c * across, s * u - c * across
    away = point - np.broadcast_to(apex, len(u))[:, None] * u
    variance = form(left, total), form(right, total)
    with np.errstate(divide="ignore", invalid="ignore"):
        scale = [1 / np.sqrt(np.maximum(v, 1e-12)) for v in variance]
    first = (left * away).sum(axis=1) * scale[0]
    second = (right * away).sum(axis=1) * scale[1]
    return both_positive(first, second, form(left, total, right) * scale[0] * scale[1])


def angle_between(
    angle_rad: Float[np.ndarray, "m"],
    sigma_rad: Float[np.ndarray, "m"],
    low_rad: float,
    high_rad: float,
) -> Float[np.ndarray, "m"]:
    """P(low < angle < high) of an angle that is Gaussian on the circle (a wrapped normal).

    ``low`` and ``high`` lie in [-π, π]. All turns that matter are summed; a spread of more
    than half a turn counts as that, where the sum is uniform to 1 %.
    """
    sigma = np.clip(sigma_rad, 1e-9, ANY_RAD)
    total = np.zeros_like(angle_rad)
    for whole in (-3, -2, -1, 0, 1, 2, 3):
        shifted = angle_rad + 2 * np.pi * whole
        total += ndtr((high_rad - shifted) / sigma) - ndtr((low_rad - shifted) / sigma)
    return np.asarray(np.clip(total, 0.0, 1.0))


def wrapped(angle_rad: Float[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
    """The same angles in [-π, π]."""
    return np.asarray(np.remainder(angle_rad + np.pi, 2 * np.pi) - np.pi)


def direction(
    vector: Float[np.ndarray, "m 2"], covariance: Float[np.ndarray, "m 2 2"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m"]]:
    """Angle of a vector from +X to +Y and its standard deviation, ``√(n⊥ᵀ C n⊥) / |vector|``."""
    length2 = (vector**2).sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        sigma = np.sqrt(form(turned(vector), covariance)) / length2
    sigma = np.where(length2 == 0, ANY_RAD, np.minimum(sigma, ANY_RAD))
    return np.arctan2(vector[:, 1], vector[:, 0]), sigma
