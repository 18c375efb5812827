"""True and estimated points from above, after the rigid alignment of the paper."""

from typing import Any

import numpy as np
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scene4d.drawing import style
from scene4d.drawing.ground import Area, grid_step, grid_values
from scene4d.drawing.words import number
from scene4d.evaluation.pages import look
from scene4d.evaluation.pages.headline import Headline
from scene4d.evaluation.pages.pictures import label_offsets

_STRIP_IN = 1.35


def draw_alignment(shown: tuple[Headline, ...]) -> bytes:
    """PNG: the points from above, to scale, and below them how far each one is off."""
    true = shown[0].error.true_xy_m
    area = _area(np.concatenate([true, *(s.error.aligned_xy_m for s in shown)]))
    fig, above, below = _panels(area)
    for s in shown:
        pairs = np.stack([s.error.true_xy_m, s.error.aligned_xy_m], axis=1)
        above.add_collection(LineCollection(list(pairs), colors=s.colour, linewidths=2.2, zorder=3))
        style.scatter(
            above, s.error.aligned_xy_m, s=26, c=s.colour, marker=s.marker, lw=0.5, ec="white",
            zorder=5,
        )  # fmt: skip
    style.scatter(above, true, s=70, facecolors="none", edgecolors=style.INK, lw=1.4, zorder=4)
    _numbers(above, true)
    _strip(below, shown)
    handles = [
        Line2D([], [], ls="", marker="o", ms=8, mfc="none", mec=style.INK, mew=1.4, label="truth")
    ]
    for s in shown:
        label = f"{s.name}: {number(s.error.mean_m, 2)} ± {number(s.error.sd_m, 2)} m"
        look_of: dict[str, Any] = {
            "marker": s.marker,
            "ms": 7,
            "mec": "white",
            "color": s.colour,
            "lw": 2.2,
        }
        handles.append(Line2D([], [], label=label, **look_of))
    style.legend_below(fig, handles, 0.3)
    return style.png(fig)


def _area(xy: np.ndarray) -> Area:
    low, high = xy.min(axis=0), xy.max(axis=0)
    room = max(0.08 * float((high - low).max()), 0.5)
    x0, y0 = low - room
    x1, y1 = high + room
    deepen = max(0.0, 0.45 * (x1 - x0) - (y1 - y0)) / 2
    widen = max(0.0, 0.6 * (y1 - y0) - (x1 - x0)) / 2
    return Area(float(x0 - widen), float(x1 + widen), float(y0 - deepen), float(y1 + deepen))


def _panels(area: Area) -> tuple[Figure, Axes, Axes]:
    left, right, bottom, gap, top = 0.72, 0.15, 1.15, 0.72, 0.15
    room = look.WIDTH_IN - left - right
    scale = min(room / area.width, 5.4 / area.depth)
    wide, high = area.width * scale, area.depth * scale
    full = bottom + _STRIP_IN + gap + high + top
    fig = style.figure(look.WIDTH_IN, full)
    start = left + (room - wide) / 2
    base = (bottom + _STRIP_IN + gap) / full
    above = fig.add_axes((start / look.WIDTH_IN, base, wide / look.WIDTH_IN, high / full))
    above.set_xlim(area.x_min, area.x_max)
    above.set_ylim(area.y_min, area.y_max)
    above.set_autoscale_on(False)
    step = grid_step(area)
    above.set_xticks(grid_values(area.x_min, area.x_max, step))
    above.set_yticks(grid_values(area.y_min, area.y_max, step))
    look.quiet(above, "x of the reference (m)", "y of the reference (m)")
    below = fig.add_axes(
        (left / look.WIDTH_IN, bottom / full, room / look.WIDTH_IN, _STRIP_IN / full)
    )
    return fig, above, below


def _numbers(axes: Axes, xy: np.ndarray) -> None:
    per_point = float(axes.figure.dpi) / 72
    at = axes.transData.transform(xy) / per_point
    frame = axes.get_window_extent()
    ends = [np.array(end) / per_point for end in ((frame.x0, frame.y0), (frame.x1, frame.y1))]
    for name, offset in enumerate(label_offsets(at, *ends), start=1):
        axes.annotate(
            str(name), tuple(xy[name - 1]), xytext=tuple(offset), textcoords="offset points",
            ha="center", va="center", fontsize=look.TEXT, color=style.INK, zorder=6,
        )  # fmt: skip


def _strip(axes: Axes, shown: tuple[Headline, ...]) -> None:
    """Distance of every point, with the mean of each method as a line."""
    count = len(shown[0].error.distance_m)
    index = np.arange(1, count + 1)
    for k, s in enumerate(shown):
        at = index + 0.26 * (k - (len(shown) - 1) / 2)
        axes.vlines(at, 0, s.error.distance_m, color=s.colour, lw=2.2)
        style.scatter(
            axes, np.column_stack([at, s.error.distance_m]), s=26, c=s.colour, marker=s.marker,
            lw=0.5, ec="white", zorder=4, clip_on=False,
        )  # fmt: skip
        axes.axhline(s.error.mean_m, color=s.colour, lw=1.0, ls=(0, (4, 3)))
    axes.set_xlim(0.4, count + 0.6)
    highest = max(float(s.error.distance_m.max()) for s in shown)
    axes.set_ylim(0, 1.08 * max(highest, 0.01))
    axes.set_xticks(index)
    look.quiet(axes, "point", "off by (m)", grid="y")
