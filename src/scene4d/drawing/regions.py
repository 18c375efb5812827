"""Regions of another ground, in the picture and from above, each with its height."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import to_rgba
from matplotlib.lines import Line2D

from scene4d.core.calibration import Calibration
from scene4d.core.ground_regions import GroundRegion
from scene4d.drawing import style
from scene4d.drawing.ground import Area
from scene4d.drawing.words import number, plus_minus

_POINTS_PER_SIDE = 24
"""Enough that the outline of a region follows the lens."""


def regions_in_picture(axes: Axes, calibration: Calibration) -> list[Any]:
    """Outlines over the frame, labelled; returns their legend."""
    for region in calibration.ground_regions:
        _outline(axes, region.polygon_uv, region)
    return _legend(calibration)


def regions_from_above(axes: Axes, calibration: Calibration, area: Area) -> list[Any]:
    """Outlines over the ground from above, as far as they lie in ``area``; returns their legend."""
    camera = calibration.camera
    assert camera is not None
    for region in calibration.ground_regions:
        ends = np.roll(region.polygon_uv, -1, axis=0)
        steps = np.arange(_POINTS_PER_SIDE)[:, None, None] / _POINTS_PER_SIDE
        sides = region.polygon_uv + steps * (ends - region.polygon_uv)
        outline_uv = sides.transpose(1, 0, 2).reshape(-1, 2)
        xy = camera.locate(outline_uv, region.height_m)[0]
        low, high = (area.x_min, area.y_min), (area.x_max, area.y_max)
        _outline(axes, np.clip(xy[np.isfinite(xy).all(axis=1)], low, high), region)
    return _legend(calibration)


def height_text(region: GroundRegion) -> str:
    """Its height with sign and standard deviation: "+0.55 ± 0.06 m"."""
    sign = "+" if region.height_m > 0 else ""
    return sign + plus_minus(region.height_m, region.sigma_m, "m", 2)


def _outline(axes: Axes, points: Float[np.ndarray, "k 2"], region: GroundRegion) -> None:
    if len(points) == 0:
        return
    axes.fill(*points.T, fc=to_rgba(style.REGION, 0.12), ec="none", zorder=2.2)
    line: dict[str, Any] = {"color": style.REGION, "lw": 1.6, "ls": (0, (4, 2)), "zorder": 4.5}
    axes.plot(*np.vstack([points, points[:1]]).T, path_effects=style.halo(2.6), **line)
    look = {"ha": "center", "color": style.REGION, **style.boxed()}
    style.label(axes, height_text(region), points.mean(axis=0), **look)


def _legend(calibration: Calibration) -> list[Any]:
    if not calibration.ground_regions:
        return []
    height_m = number(calibration.ground_regions[0].height_m, 2)
    label = f"ground at {height_m} m"
    return [Line2D([], [], color=style.REGION, lw=1.6, ls=(0, (4, 2)), label=label)]
