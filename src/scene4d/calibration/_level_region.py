"""The outline of a second ground level in the picture."""

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._level_scan import held
from scene4d.calibration._levels import Level
from scene4d.core.ground_regions import GroundRegion

_CORNERS = 12
"""Corners of the circle by which the feet are widened."""
_REACH = 0.5
"""How far the ground reaches beyond the feet that were seen on it, in lengths of a person: about a
step. Chosen: farther away nobody has told what the ground is like."""


def ground_regions(
    level: Level,
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    fits: Bool[np.ndarray, "n"],
    image_size: tuple[int, int],
) -> tuple[GroundRegion, ...]:
    """Where feet stand on the level: the hull of those that were seen there and fit, a step wider,
    within its cuts and the picture. Pixels of the footage.
    """
    rows = held(level.cuts, foot_uv).all(axis=0) & fits
    if not rows.any():
        return ()
    length = float(np.median(np.hypot(*(head_uv - foot_uv)[rows].T)))
    outline = _widened(foot_uv[rows], _REACH * length)
    for cut in (*level.cuts, *_frame(image_size)):
        outline = _clipped(outline, cut)
    return (GroundRegion(outline, level.height_m, level.sigma_m),) if len(outline) >= 3 else ()


def _frame(image_size: tuple[int, int]) -> Float[np.ndarray, "4 3"]:
    """The picture as cuts."""
    width, height = image_size
    return np.array(
        [[1.0, 0, -0.5], [-1, 0, 0.5 - width], [0, 1, -0.5], [0, -1, 0.5 - height]]
    )  # fmt: skip


def _widened(uv: Float[np.ndarray, "n 2"], reach: float) -> Float[np.ndarray, "k 2"]:
    """The convex hull of circles about points."""
    from scipy.spatial import ConvexHull  # slow to import, and seldom needed

    angle = np.arange(_CORNERS) * 2 * np.pi / _CORNERS
    circle = max(reach, 1.0) * np.column_stack([np.cos(angle), np.sin(angle)])
    points = (uv[:, None] + circle).reshape(-1, 2)
    corners: np.ndarray = points[ConvexHull(points).vertices]
    return corners


def _clipped(outline: np.ndarray, cut: np.ndarray) -> np.ndarray:
    """The part of a convex outline where ``a u + b v > c`` (Sutherland and Hodgman 1974)."""
    above = outline @ cut[:2] - cut[2]
    corners = []
    for here, there, a, b in zip(
        outline, np.roll(outline, -1, axis=0), above, np.roll(above, -1), strict=True
    ):
        if a > 0:
            corners.append(here)
        if (a > 0) != (b > 0):
            corners.append(here + (there - here) * (a / (a - b)))
    return np.array(corners).reshape(-1, 2)
