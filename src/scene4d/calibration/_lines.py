"""Straight lines of the scene: uprights, and the two horizontal directions of streets and houses.

In towns most straight edges follow one of three directions: up, and two horizontal ones at right
angles. Each image line whose direction is one of them passes through that direction's vanishing
point; the angle by which it misses is a residual in (log f, tilt, roll, D) and in the azimuth of
the first horizontal direction. Lines that follow none are outliers to a robust loss, and a scene
without structure says nothing, because then no orientation is better than another.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Float

from scene4d.calibration._body import (
    CENTRE_U,
    CENTRE_V,
    CORNER,
    FOCAL,
    N_PARAMETERS,
    ROLL,
    TILT,
    straightened,
    up_vector,
)

_ANGLE_SIGMA_RAD = np.radians(0.5)
"""How far real edges stray from the three directions (building tolerances, worn kerbs). This and
the next three were chosen by hand on the tuning cameras."""
_END_SIGMA_PX = 0.7
"""Error of a segment's end across the segment: a pixel's rounding (0.3) and blur."""
_LOSS_WIDTH = 2.5
"""Geman-McClure width in sigmas: an edge that misses by more belongs to no direction."""
_LINES_PER_FACT = 20.0
"""Edges of one window, house or kerb err together: so many lines weigh as one observation."""

_GRID = np.radians(np.arange(0.0, 90.0, 1.5))
"""Azimuths (m,) that are tried: a local minimum is about 5° wide."""

_AZIMUTH = N_PARAMETERS
_OF_LENS = [FOCAL, CORNER, CENTRE_U, CENTRE_V]


@dataclass(frozen=True, eq=False)
class Lines:
    """Line segments, centred, in half diagonals and of a ``fisheye`` or an ordinary lens like
    :class:`._body.Points`.

    ``sigma`` (n,) is each one's angular error in radians.
    """

    start: Float[np.ndarray, "2 n"]
    end: Float[np.ndarray, "2 n"]
    sigma: Float[np.ndarray, "n"]
    fisheye: bool = False

    @classmethod
    def from_pixels(
        cls, xyxy: Float[np.ndarray, "n 4"], centre_uv: np.ndarray, half_diagonal_px: float
    ) -> "Lines":
        """Lines from end points in pixels."""
        length = np.hypot(xyxy[:, 2] - xyxy[:, 0], xyxy[:, 3] - xyxy[:, 1])
        sigma = np.hypot(_ANGLE_SIGMA_RAD, np.sqrt(2) * _END_SIGMA_PX / np.maximum(length, 1e-6))
        points = ((xyxy.reshape(-1, 2, 2) - centre_uv) / half_diagonal_px).transpose(1, 2, 0)
        return cls(points[0].copy(), points[1].copy(), sigma)

    @cached_property
    def ends(self) -> Float[np.ndarray, "2 m"]:
        """All starts, then all ends."""
        return np.concatenate([self.start, self.end], axis=1)

    def __len__(self) -> int:
        return len(self.sigma)


@dataclass(frozen=True, eq=False)
class LineTerms:
    """Residuals (n,) in sigmas to the nearest direction, derivatives (8, n), weights, cost."""

    residual: Float[np.ndarray, "n"]
    derivative: Float[np.ndarray, "8 n"]
    weight: Float[np.ndarray, "n"]
    cost: float


def directions(tilt: float, roll: float, azimuth: float) -> tuple[np.ndarray, np.ndarray]:
    """The three directions in camera coordinates (3, 3) and derivatives (3, 8, 3)."""
    ct, st, cr, sr = np.cos(tilt), np.sin(tilt), np.cos(roll), np.sin(roll)
    up, d_up = up_vector(tilt, roll)
    x, y = np.array([cr, sr, 0.0]), np.array([sr * st, -cr * st, ct])
    d_x, d_y = np.zeros((_AZIMUTH + 1, 3)), np.zeros((_AZIMUTH + 1, 3))
    d_x[ROLL] = (-sr, cr, 0.0)
    d_y[TILT], d_y[ROLL] = (sr * ct, -cr * ct, -st), (cr * st, sr * st, 0.0)
    ca, sa = np.cos(azimuth), np.sin(azimuth)
    along, across = ca * x + sa * y, ca * y - sa * x
    d_along, d_across = ca * d_x + sa * d_y, ca * d_y - sa * d_x
    d_along[_AZIMUTH], d_across[_AZIMUTH] = across, -along
    d_upright = np.vstack([d_up, np.zeros(3)])
    return np.stack([up, along, across]), np.stack([d_upright, d_along, d_across])


def line_terms(parameters: Float[np.ndarray, "8"], lines: Lines) -> LineTerms:
    """Residual of every line to the direction that it misses least."""
    focal = np.exp(parameters[FOCAL])
    found = straightened(lines.ends, parameters, fisheye=lines.fisheye)
    middle, edge, length = _middles(found.points)
    both = np.stack([found.by[i] for i in _OF_LENS if i in found.by])
    d_a, d_b = both[..., : len(lines)], both[..., len(lines) :]
    d_middle, d_span = (d_a + d_b) / 2, d_b - d_a
    d_edge = (d_span - edge * (d_span * edge).sum(axis=1, keepdims=True)) / length

    axes, d_axes = directions(parameters[TILT], parameters[ROLL], parameters[_AZIMUTH])
    to_pixels = np.array([focal, focal, 1.0])
    vanishing, d_vanishing = axes * to_pixels, d_axes * to_pixels
    d_vanishing[:, FOCAL, :2] = vanishing[:, :2]

    # Direction from the line's middle to each vanishing point: (3, 2, n).
    toward = vanishing[:, :2, None] - middle * vanishing[:, 2, None, None]
    toward = toward / np.sqrt((toward * toward).sum(axis=1, keepdims=True))
    miss = (edge[0] * toward[:, 1] - edge[1] * toward[:, 0]) / lines.sigma
    nearest = np.abs(miss).argmin(axis=0)
    column = np.arange(len(lines))
    residual = miss[nearest, column]

    v, d_v = vanishing[nearest].T, d_vanishing[nearest].transpose(1, 2, 0)  # (3, n), (8, 3, n)
    d_toward = d_v[:, :2] - middle * d_v[:, 2:3]
    of_lens = _OF_LENS[-len(d_middle) :]
    d_toward[of_lens] -= d_middle * v[2]
    reach = v[:2] - middle * v[2]
    norm = np.sqrt((reach * reach).sum(axis=0))
    unit = reach / norm
    d_unit = (d_toward - unit * (d_toward * unit).sum(axis=1, keepdims=True)) / norm
    derivative = edge[0] * d_unit[:, 1] - edge[1] * d_unit[:, 0]
    derivative[of_lens] += d_edge[:, 0] * unit[1] - d_edge[:, 1] * unit[0]
    derivative /= lines.sigma

    shrink = 1 / (1 + residual**2 / _LOSS_WIDTH**2)
    cost = float((_LOSS_WIDTH**2 * (1 - shrink)).sum()) / _LINES_PER_FACT
    return LineTerms(residual, derivative, shrink**2 / _LINES_PER_FACT, cost)


def _middles(ends: Float[np.ndarray, "2 m"]) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Middles (2, n), unit directions (2, n) and lengths (n,) of lines from all starts, then all
    ends.
    """
    a, b = np.split(ends, 2, axis=1)
    span = b - a
    length = np.sqrt((span * span).sum(axis=0))
    return (a + b) / 2, span / length, length


def best_azimuths(parameters: Float[np.ndarray, "7"], lines: Lines, keep: int = 2) -> list[float]:
    """Azimuths (radians, 0 to π/2) of the best local minima of the lines' cost."""
    straight = straightened(lines.ends, parameters, (), fisheye=lines.fisheye)
    middle, edge, _ = _middles(straight.points)
    upright, along, across = directions(parameters[TILT], parameters[ROLL], 0.0)[0]
    turned = np.cos(_GRID)[:, None] * along + np.sin(_GRID)[:, None] * across
    cross = np.cos(_GRID)[:, None] * across - np.sin(_GRID)[:, None] * along
    focal = np.exp(parameters[FOCAL])

    def miss2(axes: Float[np.ndarray, "k 3"]) -> Float[np.ndarray, "k n"]:
        x, y, z = (axes * [focal, focal, 1.0]).T[:, :, None]
        x, y = x - middle[0] * z, y - middle[1] * z
        found: np.ndarray = (edge[0] * y - edge[1] * x) ** 2 / (x * x + y * y)
        return found

    least = np.minimum(np.minimum(miss2(turned), miss2(cross)), miss2(upright[None]))
    chi2 = least / lines.sigma**2
    cost = (chi2 / (_LOSS_WIDTH**2 + chi2)).sum(axis=1)
    lowest = (cost <= np.roll(cost, 1)) & (cost < np.roll(cost, -1))
    candidates = np.flatnonzero(lowest)
    return [float(_GRID[i]) for i in candidates[np.argsort(cost[candidates])][:keep]]
