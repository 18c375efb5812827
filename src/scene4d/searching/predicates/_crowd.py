"""How many are near: predicates over everybody at a moment."""

import numpy as np
from jaxtyping import Float

from scene4d.searching.predicates._distance import NEAR_SIGMA_M, NEAR_TAU_M, near_probability
from scene4d.searching.predicates._gaussian import form
from scene4d.searching.predicates._meeting import BOUND_SIGMA, meetings
from scene4d.searching.predicates.stage import Stage, StageRows

_COUNT, _RADIUS_M = 5.0, 3.0
"""What a crowd is, unless it is said otherwise; chosen by hand."""
_SOFTNESS_M = 0.5
"""How vague a crowd's radius is; chosen by hand."""


def crowded(
    a: StageRows, *, count: float = _COUNT, radius_m: float = _RADIUS_M
) -> Float[np.ndarray, "m"]:
    """P(at least ``count`` of a's kind, a among them, are within ``radius_m`` of a).

    Each of the others is within with P(near), independently; the number of them is then
    Poisson-binomial, and its tail is summed exactly. NaN where a has no position.
    """
    stage = a.stage
    kind = stage.tracks.class_name
    # Of rows that are of one moment the first one counts; the others are judged as they are.
    mine = np.unique(a.index)
    others = np.flatnonzero(np.isin(kind, np.unique(kind[mine])) & stage.used)
    # Wide enough for every spread: the boxes grow by the positions' own.
    reach_m = radius_m + BOUND_SIGMA * _SOFTNESS_M
    row_a, row_b = meetings(stage, mine, others, reach_m=reach_m)
    same = kind[row_a] == kind[row_b]
    row_a, row_b = row_a[same], row_b[same]
    p = _within(stage, row_a, row_b, radius_m, _SOFTNESS_M)
    tail = at_least(np.searchsorted(mine, row_a), p, len(mine), round(count) - 1)
    tail[~np.isfinite(stage.tracks.xy_m[mine]).all(axis=1)] = np.nan
    return tail[np.searchsorted(mine, a.index)]


def alone(
    a: StageRows, *, tau_m: float = NEAR_TAU_M, sigma_m: float = NEAR_SIGMA_M
) -> Float[np.ndarray, "m"]:
    """P(no person, a aside, is within ``tau_m`` of a): the product of 1 - P(near) over all people
    of the moment, each of whom is near independently. NaN where a has no position.
    """
    stage = a.stage
    mine = np.unique(a.index)
    people = np.flatnonzero((stage.tracks.class_name == "person") & stage.used)
    row_a, row_b = meetings(stage, mine, people, reach_m=tau_m + BOUND_SIGMA * sigma_m)
    away = np.log1p(-np.minimum(_within(stage, row_a, row_b, tau_m, sigma_m), 1 - 1e-12))
    total = np.bincount(np.searchsorted(mine, row_a), away, len(mine)).astype(float)
    total[~np.isfinite(stage.tracks.xy_m[mine]).all(axis=1)] = np.nan
    return np.exp(total)[np.searchsorted(mine, a.index)]


def _within(
    stage: Stage, row_a: np.ndarray, row_b: np.ndarray, radius_m: float, sigma_m: float
) -> Float[np.ndarray, "p"]:
    tracks = stage.tracks
    apart = tracks.xy_m[row_a] - tracks.xy_m[row_b]
    distance = np.linalg.norm(apart, axis=1)
    along = apart / np.maximum(distance, 1e-9)[:, None]
    variance = form(along, tracks.covariance_m2[row_a] + tracks.covariance_m2[row_b])
    p = near_probability(
        distance,
        tau_m=float(radius_m),
        sigma_m=sigma_m,
        distance_sigma_m=np.sqrt(np.maximum(variance, 0.0)),
    )
    return np.nan_to_num(p)


def at_least(
    owner: np.ndarray, p: Float[np.ndarray, "p"], n: int, least: int
) -> Float[np.ndarray, "n"]:
    """P(at least ``least`` of each owner's independent events happen), of ``n`` owners: the tail of
    the Poisson-binomial distribution, summed exactly.
    """
    if least <= 0:
        return np.ones(n)
    order = np.argsort(owner, kind="stable")
    owner, p = owner[order], p[order]
    rank = np.arange(len(owner)) - np.searchsorted(owner, owner)
    # Column k: exactly k happened so far; the last: enough did.
    chance = np.zeros((n, least + 1))
    chance[:, 0] = 1.0
    for turn in range(int(rank.max(initial=-1)) + 1):
        now = rank == turn
        row, q = owner[now], p[now][:, None]
        old = chance[row]
        new = old * (1 - q)
        new[:, 1:] += old[:, :-1] * q
        new[:, -1] += old[:, -1] * q[:, 0]
        chance[row] = new
    return np.minimum(chance[:, -1], 1.0)
