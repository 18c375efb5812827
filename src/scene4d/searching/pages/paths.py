"""An event from straight above: where its roles went, and when."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scene4d.core.tracks import Tracks
from scene4d.drawing import style
from scene4d.drawing.ground import Area, grid_step, grid_values
from scene4d.searching.activities.events import Event
from scene4d.searching.pages.look import role_colours

WIDTH_IN, DPI = 4.3, 150
_LEAST_M = 6.0
"""The plot spans at least so much."""
_TIMES = "viridis"
_STANDS_M = 0.4


def draw_paths(
    around: Tracks,
    event: Event,
    zones: Mapping[str, Float[np.ndarray, "_ 2"]] | None = None,
    lines: Mapping[str, Float[np.ndarray, "_ 2"]] | None = None,
) -> bytes | None:
    """PNG of the paths; None where no role has a position. Colours run from the begin to the end.

    ``around`` are the rows of everybody at about that time: the roles' own before and after are
    dotted, those of others grey.
    """
    roles = {role: around.select(_placed(around, number)) for role, number in event.roles.items()}
    during = [xy[_within(rows, event)] for rows in roles.values() for xy in (rows.xy_m,)]
    here = np.concatenate(during) if during else np.zeros((0, 2))
    if not len(here):
        return None
    area = _area(here)
    fig, axes = _axes(area)
    for name, corners in (zones or {}).items():
        _place(axes, name, np.vstack([corners, corners[:1]]))
    for name, points in (lines or {}).items():
        _place(axes, name, points)
    _others(axes, around, event)
    colours = role_colours(roles)
    handles = []
    for role, rows in roles.items():
        if len(rows):
            _role(axes, rows, event, colours[role])
            handles.append(_handle(colours[role], f"{role} {event.roles[role]}"))
    _time_bar(fig, axes, event)
    style.legend_below(fig, handles, 0.16, columns=2, size=style.SMALL)
    return style.png(fig)


def _placed(tracks: Tracks, number: int) -> np.ndarray:
    mine: np.ndarray = (tracks.track == number) & np.isfinite(tracks.xy_m).all(axis=1)
    return mine


def _within(tracks: Tracks, event: Event) -> np.ndarray:
    inside: np.ndarray = (tracks.time_s >= event.begin_s - 1e-6) & (
        tracks.time_s <= event.end_s + 1e-6
    )
    return inside


def _area(xy: Float[np.ndarray, "n 2"]) -> Area:
    """A square about the event."""
    middle = (xy.min(axis=0) + xy.max(axis=0)) / 2
    half = max(_LEAST_M, 1.35 * float(np.ptp(xy, axis=0).max())) / 2
    (x0, y0), (x1, y1) = middle - half, middle + half
    return Area(float(x0), float(x1), float(y0), float(y1))


def _axes(area: Area) -> tuple[Figure, Axes]:
    left, right, bottom, top = 0.55, 0.75, 0.72, 0.12
    side = WIDTH_IN - left - right
    height = side + bottom + top
    fig = style.figure(WIDTH_IN, height)
    fig.set_dpi(DPI)
    axes = fig.add_axes((left / WIDTH_IN, bottom / height, side / WIDTH_IN, side / height))
    axes.set_xlim(area.x_min, area.x_max)
    axes.set_ylim(area.y_min, area.y_max)
    axes.set_autoscale_on(False)
    axes.set_facecolor("#EEF0F2")
    step = grid_step(area, lines=6)
    axes.set_xticks(grid_values(area.x_min, area.x_max, step))
    axes.set_yticks(grid_values(area.y_min, area.y_max, step))
    axes.tick_params(labelsize=style.SMALL, colors=style.INK, length=2)
    axes.set_xlabel("x (m)", fontsize=style.SMALL, color=style.INK, labelpad=1)
    axes.set_ylabel("y (m)", fontsize=style.SMALL, color=style.INK, labelpad=1)
    axes.grid(color="white", lw=0.8)
    axes.set_axisbelow(True)
    for spine in axes.spines.values():
        spine.set_color(style.FAINT)
    return fig, axes


def _place(axes: Axes, name: str, points: Float[np.ndarray, "m 2"]) -> None:
    axes.plot(*points.T, color=style.INK, lw=1.2, ls=(0, (5, 2)), zorder=2)
    axes.annotate(
        name, points[0], fontsize=style.SMALL, color=style.INK, clip_on=True, annotation_clip=True
    )


def _others(axes: Axes, around: Tracks, event: Event) -> None:
    here = _within(around, event) & ~np.isin(around.track, list(event.roles.values()))
    rows = around.select(here & np.isfinite(around.xy_m).all(axis=1))
    if not len(rows):
        return
    starts = np.flatnonzero(np.diff(rows.track, prepend=rows.track[0] - 1))
    paths = np.split(rows.xy_m, starts[1:])
    axes.add_collection(LineCollection(paths, colors="#9AA3AD", linewidths=1.0, zorder=2))
    ends = np.array([path[-1] for path in paths])
    style.scatter(axes, ends, s=9, c="#9AA3AD", lw=0, zorder=2)


def _role(axes: Axes, rows: Tracks, event: Event, colour: str) -> None:
    """The path in the colours of time, on a band in the role's own; a square where it stands."""
    axes.plot(*rows.xy_m.T, color=colour, lw=1.1, ls=(0, (1, 2)), zorder=3)
    now = rows.select(_within(rows, event))
    if not len(now):
        return
    xy = now.xy_m
    if np.ptp(xy, axis=0).max() <= _STANDS_M:
        style.scatter(axes, xy[-1:], s=70, c=colour, marker="s", ec=style.INK, lw=0.8, zorder=5)
        return
    axes.plot(*xy.T, color=colour, lw=6.5, solid_capstyle="round", zorder=3)
    pieces = np.stack([xy[:-1], xy[1:]], axis=1)
    timed = LineCollection(list(pieces), cmap=_TIMES, linewidths=2.6, zorder=4)
    timed.set_array((now.time_s[:-1] + now.time_s[1:]) / 2)
    timed.set_clim(event.begin_s, max(event.end_s, event.begin_s + 1e-3))
    axes.add_collection(timed)
    style.scatter(axes, xy[:1], s=34, c="white", ec=colour, lw=1.8, zorder=5)
    style.scatter(axes, xy[-1:], s=40, c=colour, ec=style.INK, lw=0.9, zorder=5)


def _time_bar(fig: Figure, axes: Axes, event: Event) -> None:
    from matplotlib.cm import ScalarMappable
    from matplotlib.colors import Normalize

    box = axes.get_position()
    bar = fig.add_axes((box.x1 + 0.02, box.y0, 0.025, box.height))
    seconds = max(event.end_s - event.begin_s, 1e-3)
    drawn = fig.colorbar(ScalarMappable(Normalize(0, seconds), _TIMES), cax=bar)
    drawn.set_label("s from the begin", fontsize=style.SMALL, color=style.INK, labelpad=2)
    drawn.ax.tick_params(labelsize=style.SMALL, colors=style.INK, length=2)
    drawn.outline.set_edgecolor(style.FAINT)  # type: ignore[operator]


def _handle(colour: str, label: str) -> Any:
    return Line2D([], [], color=colour, lw=4, marker="o", ms=5, mec=style.INK, mew=0.7, label=label)
