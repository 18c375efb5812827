"""Places with names: zones and lines on the ground.

Zones and lines are given in the world of the same camera, which errs alike for them and for what
moves there: only the independent part of a position's covariance counts.
"""

from collections.abc import Mapping
from itertools import pairwise

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.errors import InputError
from scene4d.core.text import nearest
from scene4d.searching.predicates._gaussian import above, form, ndtr, turned
from scene4d.searching.predicates.stage import Stage, StageRows

_INSIDE_SIGMA_M = 0.2
_CROSSING_SIGMA_M = 0.2
"""How vague the borders are that people draw: less than a step, chosen by hand."""
_NEAR_TAU_M, _NEAR_SIGMA_M = 4.0, 1.0
"""As near as to somebody (:func:`.near`)."""
_CROSSING_WINDOW_S = 1.0
_ON_EDGE_M = 1e-9
_FARTHEST_M = 1e7
"""A quarter of the way around the Earth; products of such numbers do not overflow."""
_SAMPLES = 40
"""Points along each side, of which those in a zone tell what share of it is in view."""
_BLOCK = 1 << 14
"""Rows compared with all edges at a time, so that (rows, edges) stays small."""


def inside(a: StageRows, *, zone: str, sigma_m: float = _INSIDE_SIGMA_M) -> Float[np.ndarray, "m"]:
    """P(a stands in the zone).

    ``Φ(s / √(σ² + nᵀ C n))`` with the signed distance s to the nearest edge, positive inside, n
    the direction to it and C the position's own covariance. One edge counts: in zones narrower
    than twice the position's error, and in acute corners, the value is too high. Raises
    :class:`InputError` for a zone that the stage does not have, or that is none.
    """
    return _by_border(a, zone, 0.0, sigma_m)


def _by_border(a: StageRows, zone: str, least_m: float, sigma_m: float) -> Float[np.ndarray, "m"]:
    """P(a is further in than ``least_m``)."""
    corners = _open(place_of(a.stage.zones, "zone", zone))
    found = np.empty(len(a))
    for begin in range(0, len(a), _BLOCK):
        block = slice(begin, begin + _BLOCK)
        signed, normal = _to_border(a.xy_m[block], corners)
        found[block] = above(signed, least_m, sigma_m, form(normal, a.covariance_m2[block]))
    return found


def near_zone(
    a: StageRows, *, zone: str, tau_m: float = _NEAR_TAU_M, sigma_m: float = _NEAR_SIGMA_M
) -> Float[np.ndarray, "m"]:
    """P(a is within ``tau_m`` of the zone, or in it): ``Φ((τ + s) / √(σ² + nᵀ C n))``, s and n as
    for :func:`inside`. Raises as that.
    """
    return _by_border(a, zone, -tau_m, sigma_m)


def crosses(
    a: StageRows,
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
    Raises :class:`InputError` for a line that the stage does not have, or that is none.
    """
    found = np.zeros(len(a))
    for start, end in pairwise(place_of(a.stage.lines, "line", line)):
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


def in_view(stage: Stage, corners: Float[np.ndarray, "m 2"]) -> float:
    """The share of a zone that is in the picture; 1 without a camera, of which nothing is known."""
    if stage.camera is None:
        return 1.0
    corners = _open(corners)
    (x0, y0), (x1, y1) = corners.min(axis=0), corners.max(axis=0)
    x, y = ((np.arange(_SAMPLES) + 0.5) / _SAMPLES * (b - a) + a for a, b in ((x0, x1), (y0, y1)))
    points = np.stack(np.meshgrid(x, y), axis=-1).reshape(-1, 2)
    points = points[_contains(points, corners, np.roll(corners, -1, axis=0))]
    uv, visible = stage.camera.project(np.column_stack([points, np.zeros(len(points))]))
    seen = visible & (uv >= 0).all(axis=1) & (uv < stage.image_size).all(axis=1)
    return float(seen.mean()) if len(seen) else 1.0


def place_of(
    places: Mapping[str, Float[np.ndarray, "_ 2"]], kind: str, name: str
) -> Float[np.ndarray, "m 2"]:
    """The points of a "zone" or "line"; raises as :func:`check_place`, and where there is none of
    the name.
    """
    if name not in places:
        raise InputError(f"no {kind} {name!r}{nearest(name, places)}")
    check_place(kind, name, places[name])
    return places[name]


def check_place(kind: str, name: str, points: Float[np.ndarray, "m 2"]) -> None:
    """Raise :class:`InputError` unless the points of a "zone" bound one area, a simple polygon, or
    those of a "line" are two or more, none twice in a row.

    The last corner of a zone is joined to the first, and may repeat it.
    """
    what, least = f"{kind} {name!r}", 3 if kind == "zone" else 2
    if not (np.abs(points) < _FARTHEST_M).all():
        raise InputError(f"{what}: a point is not finite, or farther than {_FARTHEST_M:g} m")
    if kind == "zone":
        points = _open(points)
    if len(points) < least:
        raise InputError(f"{what}: {len(points)} points, expected at least {least}")
    before = np.roll(points, 1, axis=0) if kind == "zone" else np.vstack([points[:1] + 1, points])
    twice = (points == before[: len(points)]).all(axis=1)
    if twice.any():
        raise InputError(f"{what}: point {int(twice.argmax()) + 1} repeats the one before it")
    crossing = _crossing(points) if kind == "zone" else None
    if crossing is not None:
        first, second = crossing
        raise InputError(
            f"{what} crosses itself: the edge from point {first + 1} meets the edge from "
            f"point {second + 1}; give the points in their order around the zone"
        )


def _open(corners: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "k 2"]:
    """A zone without its first corner repeated at the end."""
    closed = len(corners) > 1 and (corners[0] == corners[-1]).all()
    return corners[:-1] if closed else corners


def _to_border(
    xy: Float[np.ndarray, "m 2"], corners: Float[np.ndarray, "k 2"]
) -> tuple[Float[np.ndarray, "m"], Float[np.ndarray, "m 2"]]:
    """Distance of points from the nearest edge, positive inside, and the direction to it."""
    start, end = corners, np.roll(corners, -1, axis=0)
    away = _to_segments(xy, start, end)
    distance = np.hypot(away[:, :, 0], away[:, :, 1])
    edge, row = distance.argmin(axis=1), np.arange(len(xy))
    normal = turned(end - start)[edge]
    normal = normal / np.hypot(normal[:, 0], normal[:, 1])[:, None]
    nearest_m, vector = distance[row, edge], away[row, edge]
    # On the edge itself its normal is the direction to it.
    clear = nearest_m > _ON_EDGE_M
    normal[clear] = vector[clear] / nearest_m[clear][:, None]
    return np.where(_contains(xy, start, end), nearest_m, -nearest_m), normal


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


def _crossing(corners: Float[np.ndarray, "m 2"]) -> tuple[int, int] | None:
    """Two edges, not neighbours, that touch; or neighbours that fold back on one another."""
    m = len(corners)
    a, b = corners, np.roll(corners, -1, axis=0)
    fold = _turn(a, b, np.roll(b, -1, axis=0)) == 0
    back = ((b - a) * (np.roll(b, -1, axis=0) - b)).sum(axis=1) < 0
    if (fold & back).any():
        first = int((fold & back).argmax())
        return first, (first + 1) % m
    i, j = np.triu_indices(m, 2)
    apart = ~((i == 0) & (j == m - 1))
    i, j = i[apart], j[apart]
    touching = _touch(a[i], b[i], a[j], b[j])
    return (int(i[touching][0]), int(j[touching][0])) if touching.any() else None


def _touch(
    a: Float[np.ndarray, "n 2"],
    b: Float[np.ndarray, "n 2"],
    c: Float[np.ndarray, "n 2"],
    d: Float[np.ndarray, "n 2"],
) -> Bool[np.ndarray, "n"]:
    """Whether the segments ab and cd share a point: their ends lie on both sides of one another."""
    boxes = (
        np.maximum(np.minimum(a, b), np.minimum(c, d))
        <= np.minimum(np.maximum(a, b), np.maximum(c, d))
    ).all(axis=1)
    sides = (_turn(a, b, c) * _turn(a, b, d) <= 0) & (_turn(c, d, a) * _turn(c, d, b) <= 0)
    return boxes & sides


def _turn(
    a: Float[np.ndarray, "n 2"], b: Float[np.ndarray, "n 2"], c: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n"]:
    """Sign of the turn from ab to ac."""
    ab, ac = b - a, c - a
    return np.sign(ab[:, 0] * ac[:, 1] - ab[:, 1] * ac[:, 0])
