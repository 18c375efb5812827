"""Near and far on the ground."""

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from scene4d.errors import InputError

NEAR_TAU_M = 4.0
"""Distance below which two things are near (Wagner et al. 2019)."""
NEAR_SIGMA_M = 1.0
"""Softness of the word "near"; the paper gives none, and 1 m is about its own position error."""


def near_probability(
    distance_m: Float[np.ndarray, "*shape"],
    *,
    tau_m: float = NEAR_TAU_M,
    sigma_m: float = NEAR_SIGMA_M,
    distance_sigma_m: float | Float[np.ndarray, "*shape"] = 0.0,
) -> Float[np.ndarray, "*shape"]:
    """P(near) of distances on the ground in metres, any shape; NaN where the distance is NaN.

    With a known distance this is the paper's ``½ (1 - erf((d - τ) / (√2 σ)))``. Where the distance
    is Gaussian with standard deviation ``distance_sigma_m`` = s, its expectation has the same form:
    a difference of Gaussians is one, so

        E[P(near)] = Φ((τ - d) / √(σ² + s²)).

    ``sigma_m`` says how vague the word is, ``distance_sigma_m`` how uncertain the positions are;
    with ``sigma_m = 0`` the value is the probability that the true distance is below τ. Where both
    are zero the step is 1 below τ, ½ at τ. Raises :class:`InputError` for negative spreads.
    """
    if sigma_m < 0 or np.any(np.asarray(distance_sigma_m) < 0):
        raise InputError("near: sigma_m and distance_sigma_m must not be negative")
    spread = np.hypot(sigma_m, distance_sigma_m)
    margin = tau_m - distance_m
    with np.errstate(divide="ignore", invalid="ignore"):
        z = np.where(margin == 0, 0.0, margin / spread)
    return ndtr(z)
