"""The ground seen from straight above: the rectified frame with a metric grid and footprints."""

from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from jaxtyping import Bool, Float, Int, Shaped, UInt8
from matplotlib.axes import Axes
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.drawing import style
from scene4d.drawing.ground import Area, footprints, grid_step, grid_values, thinned, walked_area
from scene4d.drawing.overlay import people_of, vehicle_feet
from scene4d.drawing.regions import regions_from_above
from scene4d.drawing.scenery import in_frame

_MAX_SIDE_PX = 1100
MAX_DOTS = 1500


@dataclass(frozen=True, eq=False)
class Rectified:
    """The ground of ``area`` from above, north (+Y) up; ``seen`` is where the frame shows it."""

    area: Area
    image_rgb: UInt8[np.ndarray, "h w 3"] | None
    seen: Bool[np.ndarray, "h w"]


def draw_birdseye(
    calibration: Calibration, image_bgr: np.ndarray | None = None
) -> style.Drawn | None:
    """The view from above; None where no inlier stands on the ground."""
    camera = calibration.camera
    if camera is None:
        raise ValueError("a bird's-eye view needs a camera")
    segments, used = people_of(calibration)
    xy = footprints(camera, segments, calibration.ground_height_m(segments.foot_uv)[0])
    walked = walked_area(xy[used] if used.any() else vehicle_feet(calibration), camera)
    if walked is None:
        return None
    area = with_camera(walked, camera)
    view = rectify(camera, area, image_bgr)
    fig, axes = ground_axes(area)
    show_ground(axes, view)
    handles = [*viewed(axes, camera, view), *_footprints(axes, xy, used, segments.track)]
    handles += camera_mark(axes, camera, area)
    handles += regions_from_above(axes, calibration, area)
    return style.drawn(fig, handles, 0.27)


def with_camera(area: Area, camera: Camera) -> Area:
    """The area, widened to hold the camera unless it is far away, and to a readable shape."""
    x, y = camera.centre_m[:2]
    x0, x1, y0, y1 = area.x_min, area.x_max, area.y_min, area.y_max
    size = max(area.width, area.depth)
    outside = np.hypot(max(x0 - x, x - x1, 0.0), max(y0 - y, y - y1, 0.0))
    if outside < 0.75 * size:
        room = 0.05 * size
        x0, x1, y0, y1 = min(x0, x - room), max(x1, x + room), min(y0, y - room), max(y1, y + room)
    return Area(x0, x1, y0, y1).shaped(0.6, 0.5)


def rectify(
    camera: Camera, area: Area, image_bgr: np.ndarray | None, max_side_px: int = _MAX_SIDE_PX
) -> Rectified:
    """The frame warped onto the ground of ``area`` (inverse warp through the lens).

    Both sides are at most ``max_side_px`` long; what the frame does not show is not ``seen``.
    """
    metres = max(area.width, area.depth) / max_side_px
    columns, rows = (max(round(side / metres), 2) for side in (area.width, area.depth))
    uv, _ = camera.project(_lattice(area, columns, rows))
    seen = in_frame(uv, camera.image_size).reshape(rows, columns)
    if image_bgr is None:
        return Rectified(area, None, seen)
    uv = np.nan_to_num(uv, nan=-1e4).clip(-1e4, 1e4).reshape(rows, columns, 2)
    warped = cv2.remap(
        image_bgr,
        uv[..., 0].astype(np.float32),
        uv[..., 1].astype(np.float32),
        interpolation=cv2.INTER_LINEAR,
        borderMode=cv2.BORDER_REPLICATE,
    )
    return Rectified(area, np.ascontiguousarray(warped[..., ::-1]), seen)


def _lattice(area: Area, columns: int, rows: int) -> Float[np.ndarray, "n 3"]:
    """Ground points at the centres of the view's pixels, row by row from the far side."""
    x = area.x_min + (np.arange(columns) + 0.5) * area.width / columns
    y = area.y_max - (np.arange(rows) + 0.5) * area.depth / rows
    xx, yy = np.meshgrid(x, y)
    return np.column_stack([xx.ravel(), yy.ravel(), np.zeros(xx.size)])


def ground_axes(area: Area) -> tuple[Figure, Axes]:
    """A figure whose axes are metres on the ground, with a grid."""
    left, right, bottom, top = 0.72, 0.2, 1.05, 0.2
    room = style.WIDTH_IN - left - right
    scale = min(room / area.width, 7.6 / area.depth)
    wide, high = area.width * scale, area.depth * scale
    full = max(wide + left + right, 5.6), high + bottom + top
    left = (full[0] - wide + left - right) / 2
    fig = style.figure(*full)
    axes = fig.add_axes((left / full[0], bottom / full[1], wide / full[0], high / full[1]))
    axes.set_xlim(area.x_min, area.x_max)
    axes.set_ylim(area.y_min, area.y_max)
    axes.set_autoscale_on(False)
    axes.set_facecolor("#C4CAD1")
    step = grid_step(area)
    axes.set_xticks(grid_values(area.x_min, area.x_max, step))
    axes.set_yticks(grid_values(area.y_min, area.y_max, step))
    axes.tick_params(labelsize=style.NORMAL, colors=style.AXIS, length=3)
    axes.set_xlabel("metres to the right of the camera", fontsize=style.NORMAL, color=style.AXIS)
    axes.set_ylabel("metres ahead of the camera", fontsize=style.NORMAL, color=style.AXIS)
    axes.grid(color=style.INK, alpha=0.22, lw=0.6)
    axes.set_axisbelow(False)
    for spine in axes.spines.values():
        spine.set_color(style.FAINT)
    return fig, axes


def show_ground(axes: Axes, view: Rectified) -> None:
    """The rectified picture, where the camera sees ground."""
    area = view.area
    rgba = np.empty((*view.seen.shape, 4), np.uint8)
    rgba[..., :3] = 200 if view.image_rgb is None else view.image_rgb
    rgba[..., 3] = 255 * view.seen
    extent = (area.x_min, area.x_max, area.y_min, area.y_max)
    axes.imshow(rgba, extent=extent, aspect="auto", interpolation="antialiased", zorder=1)


def viewed(axes: Axes, camera: Camera, view: Rectified) -> list[Any]:
    """Outline of the ground in view, and the wedge from the camera to its sides."""
    seen = view.seen
    ground = _lattice(view.area, seen.shape[1], seen.shape[0])
    if seen.any() and not seen.all():
        x, y = ground[: seen.shape[1], 0], ground[:: seen.shape[1], 1]
        axes.contour(x, y, seen.astype(float), levels=[0.5], colors=style.INK, linewidths=1.0)
    for end in wedge(camera, ground[seen.ravel(), :2]):
        axes.plot(*np.array([camera.centre_m[:2], end]).T, color=style.INK, lw=1.0, ls=(0, (4, 3)))
    return [Line2D([], [], color=style.INK, lw=1.0, label="ground in view")]


def wedge(camera: Camera, seen_xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "m 2"]:
    """The outermost seen ground points, left and right, as directions from the camera.

    Empty where the camera sees the ground round about itself (it has no wedge then).
    """
    if len(seen_xy_m) == 0:
        return np.empty((0, 2))
    offset = seen_xy_m - camera.centre_m[:2]
    ahead = camera.R[2, :2] / max(float(np.linalg.norm(camera.R[2, :2])), 1e-12)
    forward = offset @ ahead
    angle = np.arctan2(offset @ np.array([ahead[1], -ahead[0]]), forward)
    if np.ptp(angle) >= np.pi or forward.min() <= 0:
        return np.empty((0, 2))
    # The nearest point at each edge's bearing: there the wedge meets the outline.
    ends = []
    for extreme in (angle.min(), angle.max()):
        rows = np.flatnonzero(np.abs(angle - extreme) < 5e-3)
        ends.append(seen_xy_m[rows[np.argmin(forward[rows])]])
    return np.array(ends)


def _footprints(
    axes: Axes,
    xy: Float[np.ndarray, "n 2"],
    used: Bool[np.ndarray, "n"],
    track: Int[np.ndarray, "n"],
) -> list[Any]:
    handles = _dots(axes, xy, thinned(~used, MAX_DOTS, len(used)), style.OUTLIER, "X", "outlier")
    rows = thinned(used, MAX_DOTS, len(used))
    tracked = len(np.unique(track[rows][track[rows] >= 0])) > 1
    if not tracked:
        return _dots(axes, xy, rows, style.INLIER, "o", "inlier") + handles
    colours = np.where(track[rows] < 0, style.FAINT, np.array(style.TRACKS)[track[rows] % 5])
    label = "inlier, coloured by track"
    return _dots(axes, xy, rows, colours, "o", label) + handles


def _dots(
    axes: Axes,
    xy: Float[np.ndarray, "n 2"],
    rows: Int[np.ndarray, "m"],
    colour: str | Shaped[np.ndarray, "m"],
    marker: str,
    label: str,
) -> list[Any]:
    if len(rows) == 0:
        return []
    size = float(np.clip(9000 / len(rows), 12, 34))
    edge = 0.35 if size > 20 else 0.2
    style.scatter(
        axes, xy[rows], s=size, c=colour, marker=marker, lw=edge, edgecolors="white", zorder=4
    )
    colour = colour if isinstance(colour, str) else style.TRACKS[0]
    return [Line2D([], [], ls="", marker=marker, ms=6, c=colour, mec="white", mew=0.5, label=label)]


def camera_mark(axes: Axes, camera: Camera, area: Area) -> list[Any]:
    """Where the camera hangs, or which way it is; handles for the legend."""
    x, y = camera.centre_m[:2]
    if area.x_min <= x <= area.x_max and area.y_min <= y <= area.y_max:
        axes.scatter(x, y, s=110, marker="^", c=style.INK, ec="white", lw=1.0, zorder=5)
        label = f"camera, {camera.height_m:.1f} m up"
        return [Line2D([], [], ls="", marker="^", ms=9, c=style.INK, mec="white", label=label)]
    inside = np.array([np.clip(x, area.x_min, area.x_max), np.clip(y, area.y_min, area.y_max)])
    away = float(np.hypot(*(inside - (x, y))))
    towards = (np.array([x, y]) - inside) / away
    axes.annotate(
        f"camera, {away:.0f} m further",
        inside + 0.005 * area.depth * towards,
        xytext=tuple(-34 * towards),
        textcoords="offset points",
        ha="center",
        va="center",
        fontsize=style.NORMAL,
        color="white",
        bbox={"boxstyle": "round,pad=0.25", "fc": style.INK, "ec": "none", "alpha": 0.85},
        arrowprops={"arrowstyle": "-|>", "color": style.INK, "lw": 1.4},
        zorder=6,
    )
    return []
