"""Between the image of a fisheye lens and that of a pinhole camera with the same focal length.

An equidistant lens shows a ray at the angle θ from the optical axis at the radius ``f θ``, a
pinhole camera at ``f tan θ``. Both ways are radial maps ``x -> g x``, with derivatives in closed
form. The solver's coefficient D (:mod:`._body`) bends the former: ``r_d = r (1 + D r²)`` with
``r = f θ``, which is OpenCV's fisheye model with ``k1 = D f²`` alone.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

_WIDEST_RAD = np.radians(88.0)
"""Rays further from the axis are not used: on the pinhole's side they are 30 focal lengths away.
From here on the tangent goes on straight, so that searching beyond it stays well-behaved."""
_TINY = 1e-12
"""Squared radius below which the limits at the principal point hold to rounding."""


@dataclass(frozen=True, eq=False)
class RadialMap:
    """Points ``start`` (2, n) moved to ``gain * start``; ``slope`` is the derivative of the new
    radius by the old one. ``valid`` tells which points both lenses show.
    """

    start: Float[np.ndarray, "2 n"]
    gain: Float[np.ndarray, "n"]
    slope: Float[np.ndarray, "n"]
    valid: Bool[np.ndarray, "n"]

    @property
    def points(self) -> Float[np.ndarray, "2 n"]:
        """Where the points are moved to."""
        return self.start * self.gain

    @property
    def by_log_focal(self) -> Float[np.ndarray, "2 n"]:
        """Derivative of ``points`` by log f: lengths in units of f turn the map into itself."""
        return self.start * (self.gain - self.slope)

    @cached_property
    def _bend(self) -> np.ndarray:
        radius2 = (self.start * self.start).sum(axis=0)
        near = radius2 < _TINY
        return np.where(near, 0.0, (self.slope - self.gain) / np.where(near, 1.0, radius2))

    def carry(self, by: Float[np.ndarray, "*p 2 n"]) -> Float[np.ndarray, "*p 2 n"]:
        """Derivatives of ``points`` from those of ``start``."""
        along = self.start[0] * by[..., 0, :] + self.start[1] * by[..., 1, :]
        moved: np.ndarray = self.gain * by + self.start * (self._bend * along)[..., None, :]
        return moved


def flattened(points: Float[np.ndarray, "2 n"], focal: float) -> RadialMap:
    """From the fisheye image to that of the pinhole camera."""
    radius = np.sqrt((points * points).sum(axis=0))
    angle = radius / focal
    within = np.minimum(angle, _WIDEST_RAD)
    tangent = np.tan(within)
    slope = 1 + tangent * tangent
    reached = focal * (tangent + (angle - within) * slope)
    gain = np.where(radius**2 > _TINY, reached / np.where(radius > 0, radius, 1.0), 1.0)
    return RadialMap(points, gain, slope, angle < _WIDEST_RAD)


def curled(points: Float[np.ndarray, "2 n"], focal: float) -> RadialMap:
    """From the image of the pinhole camera to the fisheye image."""
    radius = np.sqrt((points * points).sum(axis=0))
    ratio = radius / focal
    gain = np.where(
        radius**2 > _TINY, focal * np.arctan(ratio) / np.where(radius > 0, radius, 1.0), 1.0
    )
    return RadialMap(points, gain, 1 / (1 + ratio * ratio), np.ones(len(radius), bool))


def ray_gain(
    points: Float[np.ndarray, "2 n"], focal: Float[np.ndarray, "m 1"]
) -> Float[np.ndarray, "m n"]:
    """``tan θ / r`` for many focal lengths: what makes fisheye points rays; NaN beyond the view."""
    radius = np.maximum(np.hypot(points[0], points[1]), 1e-9)
    angle = radius / focal
    return np.where(angle < _WIDEST_RAD, np.tan(np.minimum(angle, _WIDEST_RAD)) / radius, np.nan)
