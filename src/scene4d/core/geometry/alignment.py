"""Rigid least-squares alignment of point sets."""

import numpy as np
from jaxtyping import Float


def rigid_fit(
    source: Float[np.ndarray, "n d"], target: Float[np.ndarray, "n d"]
) -> tuple[Float[np.ndarray, "d d"], Float[np.ndarray, "d"]]:
    """Rotation R and translation t that minimise ``Σ |R source + t - target|²``; no scale.

    Arun, Huang and Blostein (1987), with the reflection case of Umeyama (1991).
    Raises ``ValueError`` for fewer than ``d`` points or values that are not finite.
    """
    n, d = source.shape
    if n < d:
        raise ValueError(f"a rigid fit in {d} dimensions needs at least {d} points, found {n}")
    if not (np.isfinite(source).all() and np.isfinite(target).all()):
        raise ValueError("a rigid fit needs finite points; drop the invalid ones first")
    source_mean, target_mean = source.mean(axis=0), target.mean(axis=0)
    u, _, vt = np.linalg.svd((source - source_mean).T @ (target - target_mean))
    sign = np.ones(d)
    sign[-1] = np.sign(np.linalg.det(vt.T @ u.T))
    R = vt.T @ (sign[:, None] * u.T)
    return R, target_mean - R @ source_mean
