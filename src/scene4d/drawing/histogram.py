"""Heights of the people, as the calibrated camera sees them."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.lines import Line2D
from matplotlib.patches import Patch
from matplotlib.ticker import MaxNLocator

from scene4d.core.body import HEIGHT_SIGMA_M
from scene4d.core.calibration import Calibration
from scene4d.drawing import style
from scene4d.drawing.ground import implied_heights, track_medians
from scene4d.drawing.overlay import people_of

_BIN_M = 0.025
_MEAN = "#4A90D9"


def inlier_heights(
    calibration: Calibration,
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "m"]]:
    """Implied heights of the inliers, and the median of each known track among them."""
    segments, used = people_of(calibration)
    if calibration.camera is None or not used.any():
        return np.empty(0), np.empty(0)
    chosen = segments.select(used)
    ground_m, _ = calibration.ground_height_m(chosen.foot_uv)
    heights = implied_heights(calibration.camera, chosen, ground_m)
    medians = track_medians(heights, chosen.track)
    return heights[np.isfinite(heights)], medians


def draw_histogram(calibration: Calibration) -> style.Drawn:
    """The histogram, with the assumed mean and one standard deviation to either side."""
    heights, medians = inlier_heights(calibration)
    mean = calibration.person_height_m
    fig = style.figure(style.WIDTH_IN, 3.9)
    axes = fig.add_axes((0.075, 0.24, 0.905, 0.68), facecolor="none")
    low, high = mean - 0.6, mean + 0.6
    inside = heights[(heights >= low) & (heights < high)]
    bins = mean + _BIN_M * np.arange(-24, 25)
    axes.axvspan(
        mean - HEIGHT_SIGMA_M, mean + HEIGHT_SIGMA_M, color=_MEAN, alpha=0.25, lw=0, zorder=0
    )
    axes.axvline(mean, color=_MEAN, lw=1.6, zorder=3)
    counts = np.histogram(inside, bins)[0]
    axes.bar(bins[:-1], counts, _BIN_M, align="edge", color="#8FBCEB", ec="white", lw=0.6, zorder=2)
    handles: list[Any] = [
        Patch(color="#8FBCEB", label="sightings (inliers)"),
        Line2D([], [], color=_MEAN, lw=1.6, label=f"assumed mean, {mean:.2f} m"),
        Patch(color=_MEAN, alpha=0.25, label=f"± {HEIGHT_SIGMA_M:.2f} m, adults"),
    ]
    top = 1.18 * max(float(counts.max()), 1.0)
    if len(medians) > 1:
        handles.append(_medians(axes, medians, top))
    _frame(axes, (low, high), top, len(heights) - len(inside))
    return style.drawn(fig, handles, 0.24)


def _medians(axes: Axes, medians: Float[np.ndarray, "m"], top: float) -> Line2D:
    look: dict[str, Any] = {"ls": "", "marker": "v", "ms": 6, "color": style.AXIS}
    rows = np.full(len(medians), 0.95 * top)
    axes.plot(medians, rows, mec="white", mew=0.5, alpha=0.8, zorder=4, **look)
    return Line2D([], [], label=f"median of each of {len(medians)} tracks", **look)


def _frame(axes: Axes, limits: tuple[float, float], top: float, outside: int) -> None:
    axes.set_xlim(limits)
    axes.set_ylim(0, top)
    axes.set_xlabel("implied height of the person (m)", fontsize=style.NORMAL, color=style.AXIS)
    axes.set_ylabel("sightings", fontsize=style.NORMAL, color=style.AXIS)
    axes.yaxis.set_major_locator(MaxNLocator(6, integer=True))
    axes.tick_params(labelsize=style.NORMAL, colors=style.AXIS, length=3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(style.FAINT)
    axes.grid(axis="y", color=style.FAINT, alpha=0.4, lw=0.7)
    axes.set_axisbelow(True)
    if outside:
        note = f"{outside} outside this range"
        axes.set_title(note, loc="right", fontsize=style.SMALL, color=style.FAINT)
