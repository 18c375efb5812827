"""A site from straight above: cameras with what they see, and everybody's way by number."""

from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D
from matplotlib.patches import Ellipse, Polygon

from scene4d.core.camera import Camera
from scene4d.core.tracks import Tracks
from scene4d.drawing import style
from scene4d.drawing.birdseye import ground_axes
from scene4d.drawing.ground import Area

_CAMERAS = ("#0072B2", "#D55E00", "#009E73", "#CC79A7", "#E69F00", "#56B4E9")
"""Okabe and Ito's, one for each camera in turn."""
_ALONE, _TRUE, _MAP = "#5D6670", "#9B4DFF", "#C08A00"
_Z95 = np.sqrt(5.991)
"""Half axes of a 95 % ellipse in standard deviations: chi-squared with two degrees of freedom."""
_REACH_M = 30.0
"""What a camera sees is drawn so far at most."""
_COLUMNS, _ROWS = 25, 60
_MOST_LABELS = 14
_LEAST_M2 = 1e-6
"""A position of less variance is what the frame is tied to, and has no ellipse."""


@dataclass(frozen=True, eq=False)
class Way:
    """Positions (n, 2) of somebody in the site, and how many cameras saw him."""

    number: int
    xy_m: Float[np.ndarray, "n 2"]
    cameras: int


def ways_of(tracks: Tracks, cameras: Mapping[int, int]) -> list[Way]:
    """Everybody's way, from fused tracks by identity and by how many cameras each was seen."""
    first = np.flatnonzero(np.diff(tracks.track, prepend=-1))
    return [
        Way(number, tracks.xy_m[rows], cameras[number])
        for rows in np.split(np.arange(len(tracks)), first[1:])
        if len(rows) > 1
        for number in [int(tracks.track[rows[0]])]
    ]


def draw_site_map(
    cameras: Mapping[str, Camera],
    covariances: Mapping[str, Float[np.ndarray, "2 2"]],
    ways: Sequence[Way],
    true: Mapping[str, Camera] | None = None,
    axes_labels: tuple[str, str] = ("metres", "metres"),
    lines: Sequence[Float[np.ndarray, "k 2"]] = (),
) -> style.Drawn:
    """Cameras in the site's frame, 95 % ellipses of their positions that err, and ways.

    ``true`` are cameras as they really stand, drawn as crosses; ``lines`` are those of a map.
    """
    area = _area(cameras, ways)
    fig, axes = ground_axes(area)
    axes.set_facecolor("#F4F5F6")
    axes.set_xlabel(axes_labels[0], fontsize=style.NORMAL, color=style.AXIS)
    axes.set_ylabel(axes_labels[1], fontsize=style.NORMAL, color=style.AXIS)
    reach = min(_REACH_M, max(area.width, area.depth))
    handles = []
    covariances = {n: one for n, one in covariances.items() if np.trace(one) > _LEAST_M2}
    for k, (name, camera) in enumerate(cameras.items()):
        colour = _CAMERAS[k % len(_CAMERAS)]
        handles.append(_draw_camera(axes, name, camera, colour, reach))
        if name in covariances:
            _ellipse(axes, camera.centre_m[:2], covariances[name], colour)
    if covariances:
        handles.append(Line2D([], [], color=style.FAINT, lw=1.4, label="95 % of the position"))
    handles += _draw_ways(axes, ways)
    if lines:
        axes.add_collection(LineCollection(list(lines), colors=_MAP, lw=1.2, ls="--"), False)
        handles.append(Line2D([], [], color=_MAP, lw=1.2, ls="--", label="Line of the map"))
    if true:
        handles.append(_draw_true(axes, true))
    return style.drawn(fig, handles, 0.3)


def field_of_view(camera: Camera, reach_m: float) -> Float[np.ndarray, "n 2"]:
    """Outline of the ground that a camera sees up to a distance; empty where it sees none."""
    width, height = camera.image_size
    u = np.linspace(0, width - 1, _COLUMNS)
    v = np.linspace(height - 1, 0, _ROWS)
    uv = np.stack(np.meshgrid(u, v, indexing="ij"), axis=-1)
    xy, valid = camera.locate(uv.reshape(-1, 2))
    xy, valid = xy.reshape(_COLUMNS, _ROWS, 2), valid.reshape(_COLUMNS, _ROWS)
    offset = xy - camera.centre_m[:2]
    inside = valid & (np.hypot(offset[..., 0], offset[..., 1]) < reach_m)
    near, far = [], []
    for column, seen in enumerate(inside):
        rows = np.flatnonzero(seen)
        if len(rows):
            near.append(xy[column, rows[0]])
            far.append(_farthest(xy[column], int(rows[-1]), camera, reach_m))
    return np.array([*near, *far[::-1]]) if near else np.empty((0, 2))


def _farthest(xy: np.ndarray, last: int, camera: Camera, reach_m: float) -> np.ndarray:
    """The end of a column: where the picture ends, or at the distance that is drawn."""
    if last == len(xy) - 1:
        return np.asarray(xy[last])
    ahead = xy[last] - camera.centre_m[:2]
    return np.asarray(camera.centre_m[:2] + ahead * reach_m / max(np.hypot(*ahead), 1e-9))


def _area(cameras: Mapping[str, Camera], ways: Sequence[Way]) -> Area:
    points = [camera.centre_m[None, :2] for camera in cameras.values()]
    points += [way.xy_m for way in ways if len(way.xy_m)]
    every = np.concatenate(points)
    low, high = np.quantile(every, [0.005, 0.995], axis=0)
    centres = np.concatenate(points[: len(cameras)])
    low, high = np.minimum(low, centres.min(axis=0)), np.maximum(high, centres.max(axis=0))
    room = 1.0 + 0.06 * float(np.max(high - low))
    (x0, y0), (x1, y1) = (low - room).tolist(), (high + room).tolist()
    return Area(x0, x1, y0, y1).shaped(0.7, 0.5)


def _draw_camera(axes: Axes, name: str, camera: Camera, colour: str, reach_m: float) -> Any:
    outline = field_of_view(camera, reach_m)
    if len(outline):
        axes.add_patch(Polygon(outline, closed=True, fc=colour, ec="none", alpha=0.1, zorder=1))
        axes.add_patch(Polygon(outline, closed=True, fc="none", ec=colour, lw=0.9, zorder=2))
    x, y = camera.centre_m[:2]
    ahead = camera.R[2, :2] / max(float(np.hypot(*camera.R[2, :2])), 1e-9)
    axes.annotate(
        "",
        (x, y),
        xytext=tuple(22 * ahead),
        textcoords="offset points",
        arrowprops={"arrowstyle": "<|-", "color": colour, "lw": 1.6},
        zorder=7,
    )
    axes.scatter([x], [y], s=70, marker="s", c=colour, ec="white", lw=1.0, zorder=8)
    return Line2D([], [], ls="", marker="s", ms=8, c=colour, mec="white", label=name)


def _ellipse(axes: Axes, at: np.ndarray, covariance: Float[np.ndarray, "2 2"], colour: str) -> None:
    size, turn = np.linalg.eigh(covariance)
    width, height = 2 * _Z95 * np.sqrt(np.maximum(size, 0.0))
    angle = float(np.degrees(np.arctan2(turn[1, 0], turn[0, 0])))
    look = {"fc": "none", "ec": colour, "lw": 1.4, "zorder": 6}
    axes.add_patch(Ellipse(tuple(at), width, height, angle=angle, **look))


def _draw_ways(axes: Axes, ways: Sequence[Way]) -> list[Any]:
    """Ways of those whom several cameras saw in colours, the others in grey."""
    alone = [way.xy_m for way in ways if way.cameras < 2]
    axes.add_collection(LineCollection(alone, colors=_ALONE, linewidths=0.9, alpha=0.7, zorder=3))
    several = sorted((way for way in ways if way.cameras > 1), key=lambda way: -len(way.xy_m))
    for k, way in enumerate(several):
        colour = style.TRACKS[way.number % len(style.TRACKS)]
        axes.plot(*way.xy_m.T, color="white", lw=3.0, zorder=4)
        axes.plot(*way.xy_m.T, color=colour, lw=1.7, zorder=5)
        style.scatter(axes, way.xy_m[-1:], s=22, c=colour, ec="white", lw=0.8, zorder=5)
        if k < _MOST_LABELS:
            look: dict[str, Any] = {"path_effects": style.halo(2.0, "#FFFFFF"), "zorder": 9}
            style.label(axes, str(way.number), way.xy_m[-1], (5, 3), color=style.INK, **look)
    handles = []
    if several:
        label = f"{len(several)} seen by several cameras"
        handles.append(Line2D([], [], color=style.TRACKS[0], lw=2, label=label))
    if alone:
        handles.append(Line2D([], [], color=_ALONE, lw=1, label=f"{len(alone)} seen by one"))
    return handles


def _draw_true(axes: Axes, true: Mapping[str, Camera]) -> Any:
    for camera in true.values():
        x, y = camera.centre_m[:2]
        ahead = camera.R[2, :2] / max(float(np.hypot(*camera.R[2, :2])), 1e-9)
        axes.scatter([x], [y], s=90, marker="x", c=_TRUE, lw=2.0, zorder=10)
        end = (x, y) + 0.06 * np.ptp(axes.get_xlim()) * ahead
        axes.plot([x, end[0]], [y, end[1]], color=_TRUE, lw=1.4, ls=(0, (3, 2)), zorder=10)
    return Line2D([], [], ls="", marker="x", ms=8, c=_TRUE, mew=2, label="true camera")
