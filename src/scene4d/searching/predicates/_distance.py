"""How far two things are from one another on the ground."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.searching.predicates._gaussian import ANY_RAD, above, form, ndtr, turned
from scene4d.searching.predicates.stage import StageRows

NEAR_TAU_M = 4.0
"""Distance below which two things are near (Wagner et al. 2019)."""
NEAR_SIGMA_M = 1.0
"""Softness of the word "near"; the paper gives none, and 1 m is about its own position error."""

_SAME_PLACE_M = 1.5
_SAME_PLACE_SIGMA_M = 0.5
"""A step or two, chosen by hand: who stands where another stood."""
_BETWEEN_M = 2.0
_BETWEEN_SIGMA_M = 0.3
"""Half the length of a car, which is how wide the gap between two parked side by side is; chosen by
hand."""


@dataclass(frozen=True, eq=False)
class Separation:
    """From a to b: ``vector_m``, its length and direction with their standard deviations.

    The vector's covariance is ``C_a + C_b + D Dᵀ``, with D the difference of the two camera
    factors: the camera misplaces near things alike, so its error hardly counts there. The error
    of the distance is that along the vector; that of the direction is the error across it over the
    distance. Where the two coincide there is no direction: the mean over all of them is taken.
    """

    vector_m: Float[np.ndarray, "m 2"]
    distance_m: Float[np.ndarray, "m"]
    unit: Float[np.ndarray, "m 2"]
    distance_sigma_m: Float[np.ndarray, "m"]
    direction_sigma_rad: Float[np.ndarray, "m"]
    covariance_m2: Float[np.ndarray, "m 2 2"]

    @classmethod
    def between(cls, a: StageRows, b: StageRows) -> "Separation":
        """Of rows that belong together, one by one."""
        covariance = a.covariance_m2 + b.covariance_m2
        return cls.of(b.xy_m - a.xy_m, covariance, a.camera_factor, b.camera_factor)

    @classmethod
    def of(
        cls,
        vector: Float[np.ndarray, "m 2"],
        covariance: Float[np.ndarray, "m 2 2"],
        of_a: Float[np.ndarray, "m 2 k"] | None,
        of_b: Float[np.ndarray, "m 2 k"] | None,
    ) -> "Separation":
        """Of vectors, the sums of both ends' own covariances, and their camera factors."""
        if of_a is not None and of_b is not None:
            apart = of_b - of_a
            covariance = covariance + apart @ apart.swapaxes(1, 2)
        distance = np.hypot(vector[:, 0], vector[:, 1])
        same = distance == 0
        with np.errstate(divide="ignore", invalid="ignore"):
            unit = np.where(same[:, None], [1.0, 0.0], vector / distance[:, None])
        mean = (covariance[:, 0, 0] + covariance[:, 1, 1]) / 2
        along, across = (
            np.where(same, mean, np.maximum(form(axis, covariance), 0.0))
            for axis in (unit, turned(unit))
        )
        with np.errstate(divide="ignore", invalid="ignore"):
            bearing = np.minimum(np.sqrt(across) / distance, ANY_RAD)
        bearing = np.where(same, ANY_RAD, bearing)
        return cls(vector, distance, unit, np.sqrt(along), bearing, covariance)

    def near(self, tau_m: float, sigma_m: float) -> Float[np.ndarray, "m"]:
        """P(near) of the distances (:func:`near_probability`)."""
        return near_probability(
            self.distance_m,
            tau_m=tau_m,
            sigma_m=sigma_m,
            distance_sigma_m=self.distance_sigma_m,
        )


def near(
    a: StageRows, b: StageRows, *, tau_m: float = NEAR_TAU_M, sigma_m: float = NEAR_SIGMA_M
) -> Float[np.ndarray, "m"]:
    """P(a and b are near): :func:`near_probability` of their distance, whose variance along the
    line between them is ``uᵀ (C_a + C_b + D Dᵀ) u`` (:class:`Separation`). τ and σ in metres
    (Wagner et al. 2019). NaN where one of them has no position.
    """
    return Separation.between(a, b).near(tau_m, sigma_m)


def far(
    a: StageRows, b: StageRows, *, tau_m: float = NEAR_TAU_M, sigma_m: float = NEAR_SIGMA_M
) -> Float[np.ndarray, "m"]:
    """P(a and b are far from one another): the rest to :func:`near` with the same τ, metres."""
    return 1 - near(a, b, tau_m=tau_m, sigma_m=sigma_m)


def same_place(
    a: StageRows,
    b: StageRows,
    *,
    tau_m: float = _SAME_PLACE_M,
    sigma_m: float = _SAME_PLACE_SIGMA_M,
) -> Float[np.ndarray, "m"]:
    """P(a and b stand in one place): :func:`near` within a step. The rows may be of different
    times: where something stood is where the caller aligns it.
    """
    return near(a, b, tau_m=tau_m, sigma_m=sigma_m)


def between(
    a: StageRows,
    b: StageRows,
    c: StageRows,
    *,
    tau_m: float = _BETWEEN_M,
    sigma_m: float = _BETWEEN_SIGMA_M,
) -> Float[np.ndarray, "m"]:
    """P(a is between b and c): past b on the way to c and not past c, and within ``tau_m`` of the
    line between them.

    With u from b to c, n across it and q the foot of a on the line, which moves with b and c:
    ``P(past b) + P(not past c) - 1``, times ``Φ((τ - t) / s) - Φ((-τ - t) / s)``, t = n·(a - q).
    Each spread is that of its own difference of positions along u or n, camera included, and
    ``sigma_m`` for the word. NaN where one of the three has no position.
    """
    to_c, from_b, from_c = (Separation.between(*pair) for pair in ((b, c), (b, a), (a, c)))
    u, across = to_c.unit, turned(to_c.unit)
    past_b = above((from_b.vector_m * u).sum(axis=1), 0.0, sigma_m, form(u, from_b.covariance_m2))
    before_c = above((from_c.vector_m * u).sum(axis=1), 0.0, sigma_m, form(u, from_c.covariance_m2))
    off = (from_b.vector_m * across).sum(axis=1)
    length = np.maximum(to_c.distance_m, sigma_m)
    share = np.clip((from_b.vector_m * u).sum(axis=1) / length, 0.0, 1.0)
    variance = (1 - share) * form(across, from_b.covariance_m2)
    variance = variance + share * form(across, from_c.covariance_m2)
    beside = above(off, -tau_m, sigma_m, variance) - above(off, tau_m, sigma_m, variance)
    return np.asarray(np.clip(past_b + before_c - 1, 0.0, 1.0) * beside)


def near_probability(
    distance_m: float | Float[np.ndarray, "*shape"],
    *,
    tau_m: float = NEAR_TAU_M,
    sigma_m: float = NEAR_SIGMA_M,
    distance_sigma_m: float | Float[np.ndarray, "*shape"] = 0.0,
) -> Float[np.ndarray, "*shape"]:
    """P(near) of distances on the ground in metres: an array of any shape, or a number for an
    array without axes. NaN where the distance or its spread is NaN.

    With a known distance this is the paper's ``½ (1 - erf((d - τ) / (√2 σ)))``. Where the distance
    is Gaussian with standard deviation ``distance_sigma_m`` = s, its expectation has the same form:
    a difference of Gaussians is one, so

        E[P(near)] = Φ((τ - d) / √(σ² + s²)).

    ``sigma_m`` says how vague the word is, ``distance_sigma_m`` how uncertain the positions are;
    with ``sigma_m = 0`` the value is the probability that the true distance is below τ. Where both
    are zero the step is 1 below τ, ½ at τ. A distance may be infinite (P = 0). Raises
    :class:`InputError` for a τ that is not finite and for spreads that are negative or infinite.
    """
    if not np.isfinite(tau_m):
        raise InputError(f"near: tau_m must be a distance in metres, found {tau_m}")
    if not 0 <= sigma_m < np.inf:
        raise InputError(f"near: sigma_m must be finite and not negative, found {sigma_m}")
    bad = (np.asarray(distance_sigma_m) < 0) | np.isinf(distance_sigma_m)
    if bad.any():
        found = np.asarray(distance_sigma_m)[bad].flat[0]
        raise InputError(f"near: distance_sigma_m must be finite and not negative, found {found}")
    spread = np.hypot(sigma_m, distance_sigma_m)
    margin = tau_m - np.asarray(distance_m)
    with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
        z = np.where((margin == 0) & (spread == 0), 0.0, margin / spread)
    return ndtr(z)
