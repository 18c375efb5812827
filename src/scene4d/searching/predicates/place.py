"""Places with names: zones and lines on the ground.

Zones and lines are given in the world of the same camera, which errs alike for them and for what
moves there: only the independent part of a position's covariance counts.
"""

import difflib
from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from jaxtyping import Float
from scipy.special import ndtr

from scene4d.core.errors import InputError
from scene4d.searching.predicates.gaussian import above, form, turned
from scene4d.searching.predicates.rows import Rows

_INSIDE_SIGMA_M = 0.2
_CROSSING_SIGMA_M = 0.2
_CROSSING_WINDOW_S = 1.0
_BLOCK = 1 << 14


def inside(a: Rows, *, zone: str, sigma_m: float = _INSIDE_SIGMA_M) -> Float[np.ndarray, "m"]:
    """P(a stands in the zone).

    ``Φ(s / √(σ² + nᵀ C n))`` with the signed distance s to the nearest edge, positive inside, n
    the direction to it and C the position's own covariance. One edge counts: in zones narrower
    than twice the position's error, and in acute corners, the value is too high. Raises
    :class:`InputError` for a zone that the stage does not have.
    """
    polygon = _named(a.stage.zones, zone, "zone", 3)
    start, end = polygon, np.roll(polygon, -1, axis=0)
    found = np.empty(len(a))
    for block in _blocks(len(a)):
        xy = a.xy_m[block]
        away = _to_segments(xy, start, end)
        distance = np.hypot(away[:, :, 0], away[:, :, 1])
        edge = distance.argmin(axis=1)
        row = np.arange(len(xy))
        normal = turned(end - start)[edge]
        normal = normal / np.hypot(normal[:, 0], normal[:, 1])[:, None]
        nearest, vector = distance[row, edge], away[row, edge]
        # On the edge itself its normal is the direction to it.
        clear = nearest > 1e-9
        normal[clear] = vector[clear] / nearest[clear][:, None]
        signed = np.where(_contains(xy, start, end), nearest, -nearest)
        found[block] = above(signed, 0.0, sigma_m, form(normal, a.covariance_m2[block]))
    return found


def crosses(
    a: Rows,
    *,
    line: str,
    window_s: float = _CROSSING_WINDOW_S,
    sigma_m: float = _CROSSING_SIGMA_M,
) -> Float[np.ndarray, "m"]:
    """P(a crosses the line within ``window_s`` seconds about the moment), either way.

    With the velocity v, the distance d from a straight piece of the line, its normal n and its
    direction e: the position errs by as much before and after, so the sides differ with
    probability ``|Φ((d + vₙ w/2) / s) - Φ((d - vₙ w/2) / s)|``, ``s² = σ² + nᵀ C n``. That is times
    the probability that the crossing point lies between the ends of the piece,
    ``Φ(t / s_e) - Φ((t - L) / s_e)``; pieces add up. Who stands on the line does not cross it.
    Raises :class:`InputError` for a line that the stage does not have.
    """
    points = _named(a.stage.lines, line, "line", 2)
    found = np.zeros(len(a))
    for start, end in pairwise(points):
        length = float(np.hypot(*(end - start)))
        along = np.tile((end - start) / length, (len(a), 1))
        normal = turned(along)
        off = a.xy_m - start
        d, t = (off * normal).sum(axis=1), (off * along).sum(axis=1)
        through = (a.velocity_mps * normal).sum(axis=1)
        half = through * window_s / 2
        s = np.sqrt(sigma_m**2 + form(normal, a.covariance_m2))
        sides = np.abs(ndtr((d + half) / s) - ndtr((d - half) / s))
        # Where the path meets the line, as far as it does so within the window.
        with np.errstate(divide="ignore", over="ignore", invalid="ignore"):
            until = np.clip(np.where(through == 0, 0.0, -d / through), -window_s / 2, window_s / 2)
        meets = t + until * (a.velocity_mps * along).sum(axis=1)
        spread = np.sqrt(sigma_m**2 + form(along, a.covariance_m2))
        found += sides * (ndtr(meets / spread) - ndtr((meets - length) / spread))
    return np.minimum(found, 1.0)


def _named(places: Mapping[str, np.ndarray], name: str, kind: str, least: int) -> np.ndarray:
    if name not in places:
        near = difflib.get_close_matches(name, places, n=1)
        hint = f", perhaps {near[0]!r}" if near else ""
        known = ", ".join(sorted(places)) or "none"
        raise InputError(f"there is no {kind} {name!r}{hint}; known: {known}")
    points = np.asarray(places[name], float)
    if len(points) < least or not np.isfinite(points).all():
        raise InputError(f"{kind} {name!r} needs at least {least} points with finite coordinates")
    if kind == "zone" and (points[0] == points[-1]).all():
        points = points[:-1]
    pieces = np.diff(points, axis=0, append=points[:1] if kind == "zone" else points[-1:] + 1.0)
    if not (np.abs(pieces).sum(axis=1) > 0).all():
        raise InputError(f"{kind} {name!r} holds the same point twice in a row")
    return points


def _blocks(n: int) -> list[slice]:
    return [slice(i, min(i + _BLOCK, n)) for i in range(0, n, _BLOCK)]


def _to_segments(xy: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Vectors (m, e, 2) from points to the nearest point of every edge."""
    way = end - start
    off = xy[:, None] - start
    share = np.clip((off * way).sum(axis=2) / (way**2).sum(axis=1), 0.0, 1.0)
    return np.asarray(share[:, :, None] * way - off)


def _contains(xy: np.ndarray, start: np.ndarray, end: np.ndarray) -> np.ndarray:
    """Even-odd rule: how many edges does the ray along +X meet?"""
    x, y = xy[:, :1], xy[:, 1:]
    straddles = (start[:, 1] > y) != (end[:, 1] > y)
    # Of edges that straddle the ray the share lies in 0 to 1, however little they rise.
    share = np.divide(
        y - start[:, 1], end[:, 1] - start[:, 1], where=straddles, out=np.zeros(straddles.shape)
    )
    meets = start[:, 0] + share * (end[:, 0] - start[:, 0])
    inside: np.ndarray = (straddles & (x < meets)).sum(axis=1) % 2 == 1
    return inside
