"""What a second ground level adds to a calibration: its outline in the picture, and a sentence."""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._case import saying
from scene4d.calibration._level_scan import held
from scene4d.calibration._levels import Level
from scene4d.core.calibration import Calibration
from scene4d.core.ground_regions import GroundRegion

_CORNERS = 12
"""Corners of the circle by which the feet are widened."""
_REACH = 0.5
"""How far the ground reaches beyond the feet that were seen on it, in lengths of a person: about a
step. Chosen: farther away nobody has told what the ground is like."""


def with_level(
    found: Calibration, level: Level | None, usable: Bool[np.ndarray, "n"]
) -> Calibration:
    """The calibration with the regions of a level that is believed; a warning in either case."""
    if level is None or not found or found.camera is None:
        return found
    if not level.believed:
        shorter = 1 - found.camera.height_m / (found.camera.height_m - level.height_m)
        return saying(found, _undecided(level, shorter))
    assert found.segments is not None and found.inlier is not None
    segments = found.segments.select(usable)
    regions = _regions(
        level,
        segments.foot_uv,
        segments.head_uv,
        found.inlier[usable] & level.inside,
        found.image_size,
    )
    return saying(replace(found, ground_regions=regions), _believed(level))


def _believed(level: Level) -> str:
    where = "above" if level.height_m > 0 else "below"
    return (
        f"{level.people} people stand on a second ground level, {abs(level.height_m):.2f} ± "
        f"{level.sigma_m:.2f} m {where} the one that the camera refers to; positions there use its "
        "height; check its outline in the figure."
    )


def _undecided(level: Level, shorter: float) -> str:
    return (
        f"{level.people} people in one part of the picture are seen {shorter:.0%} shorter than "
        f"elsewhere, as if its ground were {-level.height_m:.1f} m lower, or as if they were "
        "children, seated, or hidden below the knee; if it is lower, positions there are that much "
        "too near; footage in which people walk from one part to the other would tell."
    )


def _regions(
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
