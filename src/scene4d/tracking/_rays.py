"""Viewing rays through pixels of the footage, and their intersections with horizontal planes."""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.camera import Camera

_STEP_PX = 0.5
_MIN_DEPTH_M = 1e-6


@dataclass(frozen=True, eq=False)
class Level:
    """Points (n, 2) where rays meet a level, NaN where they do not, with their derivatives.

    ``by_uv`` (m/px) is the derivative with respect to the pixel of the footage, ``by_height`` with
    respect to the level's height. ``px_per_m`` is the image scale there, perpendicular to the view.
    """

    xy_m: Float[np.ndarray, "n 2"]
    by_uv: Float[np.ndarray, "n 2 2"]
    by_height: Float[np.ndarray, "n 2"]
    px_per_m: Float[np.ndarray, "n"]


@dataclass(frozen=True, eq=False)
class Rays:
    """Rays of the world through pixels of the footage; NaN for pixels without one.

    ``direction`` has unit depth along the optical axis; ``by_uv`` is its derivative with respect to
    the pixel. ``row_normal`` is the unit normal of the plane in which the rays of the pixel's row
    lie (touch it, where the lens bends the row), down the image. ``scale_px`` is the image scale at
    unit depth, perpendicular to the view.
    """

    origin_m: Float[np.ndarray, "3"]
    direction: Float[np.ndarray, "n 3"]
    by_uv: Float[np.ndarray, "n 3 2"]
    row_normal: Float[np.ndarray, "n 3"]
    scale_px: Float[np.ndarray, "n"]

    @classmethod
    def through(cls, camera: Camera, uv: Float[np.ndarray, "n 2"]) -> "Rays":
        """The rays through pixels of the footage as decoded."""
        flat, valid = camera.undistort(uv)
        flat = np.where(valid[:, None], flat, np.nan)
        to_world = np.linalg.inv(camera.K).T @ camera.R
        direction = np.column_stack([flat, np.ones(len(flat))]) @ to_world
        by_uv = to_world[:2].T @ _undistortion(camera, flat)
        normal = np.cross(direction, by_uv[:, :, 0])
        return cls(
            origin_m=camera.centre_m,
            direction=direction,
            by_uv=by_uv,
            row_normal=normal / np.linalg.norm(normal, axis=1, keepdims=True),
            scale_px=camera.focal_px * _shrinkage(camera, uv, flat),
        )

    def select(self, rows: Bool[np.ndarray, "n"] | slice) -> "Rays":
        """The given rays."""
        arrays = ("direction", "by_uv", "row_normal", "scale_px")
        return replace(self, **{name: getattr(self, name)[rows] for name in arrays})

    def meet(self, height_m: float | Float[np.ndarray, "n"]) -> Level:
        """Where the rays meet ``Z = height_m``, in front of the camera."""
        d, above = self.direction, np.asarray(height_m, float) - self.origin_m[2]
        with np.errstate(all="ignore"):  # rays along the level never meet it
            depth = above / d[:, 2]
            depth = np.where((depth > _MIN_DEPTH_M) & np.isfinite(depth), depth, np.nan)
            slope = d[:, :2] / d[:, 2:]
            by_uv = depth[:, None, None] * (
                self.by_uv[:, :2] - slope[:, :, None] * self.by_uv[:, 2:]
            )
            met = depth / depth  # 1, or NaN where the ray does not meet the level
            xy_m = self.origin_m[:2] + depth[:, None] * d[:, :2]
        return Level(xy_m, by_uv, slope * met[:, None], self.scale_px / depth)


def _shrinkage(camera: Camera, uv: np.ndarray, flat: np.ndarray) -> np.ndarray:
    """Distance of pixels (n,) from the principal point, as a share of the undistorted distance."""
    centre = camera.K[:2, 2]
    straight = np.hypot(*(flat - centre).T)
    share = np.hypot(*(uv - centre).T) / np.where(straight > 1.0, straight, np.nan)
    return np.where(straight > 1.0, share, 1.0)


def _undistortion(camera: Camera, flat: np.ndarray) -> np.ndarray:
    """Derivative (n, 2, 2) of undistorted pixels with respect to pixels of the footage.

    The inverse of the distortion's derivative, from central differences.
    """
    if not camera.bends:
        return np.broadcast_to(np.eye(2), (len(flat), 2, 2))
    with np.errstate(all="ignore"):  # pixels without a ray
        columns = [
            (camera.distort(flat + step)[0] - camera.distort(flat - step)[0]) / (2 * _STEP_PX)
            for step in _STEP_PX * np.eye(2)
        ]
        (a, c), (b, d) = columns[0].T, columns[1].T
        inverse = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return np.moveaxis(inverse, 2, 0)
