"""Robust camera height with known orientation: the paper's RANSAC, and the exact consensus.

Given K and R a hypothesis is one number, C_Z. As C_Z varies, the head predicted from the foot
moves along a line in the image; it lies within the tolerance of the seen head on one interval of
1 / C_Z. The C_Z with most inliers is therefore found exactly by sorting interval ends, O(N log N).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

TOLERANCE_PX = 5.0
"""Head reprojection error below which a person is an inlier (the paper's value)."""


@dataclass(frozen=True, eq=False)
class Intervals:
    """Per person the open interval of ``1 / C_Z`` (1/m) on which it is an inlier; NaN: never."""

    low: Float[np.ndarray, "n"]
    high: Float[np.ndarray, "n"]

    def inliers(self, inverse_height: float) -> Bool[np.ndarray, "n"]:
        """Who agrees with a camera at height ``1 / inverse_height``."""
        return (self.low < inverse_height) & (inverse_height < self.high)


def inlier_intervals(
    K: Float[np.ndarray, "3 3"],
    R: Float[np.ndarray, "3 3"],
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    person_height_m: float,
    tolerance_px: float = TOLERANCE_PX,
) -> Intervals:
    """Where ``|head(C_Z) - head_uv| < tolerance`` holds, by a quadratic inequality.

    In pixels, the head is at ``(a + κ b) / (1 + κ c)`` with ``κ = H (-up · d) / C_Z``, where
    ``K d`` is the foot's ray and ``(b, c) = K up``.
    """
    up = K @ R[:, 2]
    rays = np.column_stack([foot_uv, np.ones(len(foot_uv))])
    down = -(rays @ np.linalg.solve(K.T, R[:, 2]))
    alpha = foot_uv - head_uv
    beta = up[:2] - head_uv * up[2]
    # |alpha + κ beta|² < tolerance² (1 + κ c)²
    qa = (beta * beta).sum(axis=1) - (tolerance_px * up[2]) ** 2
    qb = (alpha * beta).sum(axis=1) - tolerance_px**2 * up[2]
    qc = (alpha * alpha).sum(axis=1) - tolerance_px**2
    discriminant = qb * qb - qa * qc
    possible = (discriminant > 0) & (qa > 0) & (down > 0)
    root = np.sqrt(np.where(possible, discriminant, np.nan))
    with np.errstate(divide="ignore", invalid="ignore"):
        per_kappa = 1 / (person_height_m * down)
        low, high = (-qb - root) / qa * per_kappa, (-qb + root) / qa * per_kappa
    # The camera is above the ground (it may be below the person's head, which is then seen above
    # the horizon), and the head is in front of the camera.
    low = np.maximum(low, 0.0)
    if up[2] < 0:
        high = np.minimum(high, -1 / up[2] * per_kappa)
    empty = ~possible | ~(low < high)
    return Intervals(np.where(empty, np.nan, low), np.where(empty, np.nan, high))


def exact_consensus(intervals: Intervals) -> Bool[np.ndarray, "n"]:
    """The largest set of people that agree on one C_Z; never smaller than any RANSAC's."""
    usable = np.isfinite(intervals.low)
    low, high = np.sort(intervals.low[usable]), np.sort(intervals.high[usable])
    if len(low) == 0:
        return np.zeros(len(usable), bool)
    # Just above each lower end: how many have begun, less how many have ended.
    count = np.arange(1, len(low) + 1) - np.searchsorted(high, low, side="right")
    best = int(np.argmax(count))
    after = high[np.searchsorted(high, low[best], side="right")]
    until = low[best + 1] if best + 1 < len(low) else np.inf
    return intervals.inliers((low[best] + min(after, until)) / 2)


def ransac_consensus(
    intervals: Intervals,
    inverse_height: Float[np.ndarray, "n"],
    *,
    rng: np.random.Generator,
    trials: int = 100,
) -> Bool[np.ndarray, "n"]:
    """The paper's RANSAC: one random person a trial proposes its own C_Z; most inliers win.

    ``inverse_height`` is each person's own ``1 / C_Z`` (its least-squares solution alone).
    """
    best = np.zeros(len(inverse_height), bool)
    candidates = np.flatnonzero(np.isfinite(inverse_height) & (inverse_height > 0))
    if len(candidates) == 0:
        return best
    for person in rng.choice(candidates, size=min(trials, len(candidates)), replace=False):
        inlier = intervals.inliers(float(inverse_height[person]))
        if inlier.sum() > best.sum():
            best = inlier
    return best
