"""Figures of places: over a picture of the scene, and from above."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from scene4d.core.geometry import apply_homography, rigid_fit
from scene4d.core.ground_map import GroundMap
from scene4d.drawing import style
from scene4d.drawing.ground import Area, grid_step, grid_values, thinned, walked_area
from scene4d.drawing.scenery import GridLine, grid_lines, image_of, in_frame
from scene4d.drawing.words import number
from scene4d.evaluation.datasets._reference import Reference
from scene4d.evaluation.pages import _charts as charts
from scene4d.evaluation.pages._headline import Headline
from scene4d.evaluation.trials.outcomes import Evaluation

MAX_PEOPLE = 400
"""People that a picture shows: more hide one another."""
TRUE_COLOUR = "#FFC845"
# Pictures are wider than charts, and shown at the same width.
_LABEL_PT = 14.0


def draw_points(evaluation: Evaluation) -> style.Drawn:
    """The scene with the numbered correspondence points."""
    reference = evaluation.reference
    image = style.checked_image(evaluation.image_bgr, reference.image_size)
    fig, axes, strip = style.picture(image, reference.image_size)
    return style.drawn(fig, [_numbered(axes, reference.points_uv)], strip)


def draw_consensus(evaluation: Evaluation, shown: Headline) -> style.Drawn:
    """The people of a calibration, from foot to head: inliers, and outliers above them."""
    found = shown.calibration
    assert found.inlier is not None
    image = style.checked_image(evaluation.image_bgr, found.image_size)
    fig, axes, strip = style.picture(image, found.image_size, grey=True)
    handles = [
        _people(axes, shown, found.inlier, style.INLIER, "o", "inlier"),
        _people(axes, shown, ~found.inlier, style.OUTLIER, "X", "outlier"),
    ]
    return style.drawn(fig, [handle for handle in handles if handle is not None], strip)


def _people(
    axes: Axes, shown: Headline, rows: Bool[np.ndarray, "n"], colour: str, mark: str, name: str
) -> Line2D | None:
    segments = shown.calibration.segments
    assert segments is not None
    chosen = segments.select(thinned(rows, MAX_PEOPLE, len(rows)))
    if len(chosen) == 0:
        return None
    pairs = np.stack([chosen.foot_uv, chosen.head_uv], axis=1)
    alpha = float(np.clip(120 / len(chosen), 0.45, 0.95))
    dashes = (0, (2.5, 1.2)) if name == "outlier" else "solid"
    axes.add_collection(
        LineCollection(list(pairs), colors=colour, linewidths=1.3, alpha=alpha, linestyles=dashes)
    )
    marks: dict[str, Any] = {"c": colour, "alpha": max(alpha, 0.7), "linewidths": 0.4}
    marks |= {"edgecolors": "white", "zorder": 4}
    style.scatter(axes, chosen.foot_uv, s=22, marker=mark, **marks)
    style.scatter(axes, chosen.head_uv, s=12, marker="_", c=colour, alpha=alpha, zorder=4, lw=1.3)
    label = f"{name}: {int(rows.sum())} of {len(rows)}"
    return Line2D([], [], color=colour, marker=mark, ms=6, mec="white", ls=dashes, label=label)


def draw_ground(evaluation: Evaluation, shown: Headline) -> style.Drawn:
    """The scene with the estimated ground grid, the true course of the same lines, and the
    correspondence points.
    """
    reference = evaluation.reference
    size = reference.image_size
    image = style.checked_image(evaluation.image_bgr, size)
    fig, axes, strip = style.picture(image, size, grey=True)
    estimated, true, step = both_grids(reference, shown)
    axes.add_collection(
        LineCollection(true, colors=TRUE_COLOUR, linewidths=1.1, linestyles=(0, (3, 2)))
    )
    lines = [line.uv for line in estimated]
    axes.add_collection(
        LineCollection(lines, colors="white", linewidths=1.2, path_effects=style.halo(2.2))
    )
    dark: dict[str, Any] = {"path_effects": style.halo(2.8)}
    handles = [
        Line2D([], [], color="white", lw=1.4, label=f"estimated, every {step:g} m", **dark),
        Line2D([], [], color=TRUE_COLOUR, lw=1.6, ls=(0, (3, 2)), label="truth", **dark),
        _numbered(axes, reference.points_uv),
    ]
    return style.drawn(fig, handles, strip)


def both_grids(
    reference: Reference, shown: Headline
) -> tuple[list[GridLine], list[Float[np.ndarray, "n 2"]], float]:
    """The estimated ground grid where people walked, the true course of the same lines, and their
    spacing in metres; nothing where nobody stands on the estimated ground.

    The estimated ground is moved onto the true one as for the correspondence error.
    """
    camera = shown.score.camera
    area = walked_area(camera.locate(reference.walked_uv)[0], camera)
    if area is None:
        return [], [], 0.0
    step = grid_step(area)
    R, t = rigid_fit(camera.locate(reference.points_uv)[0], shown.score.error.true_xy_m)
    lines = grid_lines(camera, area, step)
    true = []
    for line in lines:
        across = (area.y_min, area.y_max) if line.axis == "x" else (area.x_min, area.x_max)
        run, held = np.linspace(*across, 400), np.full(400, line.value_m)
        xy = np.column_stack((held, run) if line.axis == "x" else (run, held))
        uv = true_image(reference, xy @ R.T + t)
        uv[~in_frame(uv, camera.image_size, 0.02 * float(max(camera.image_size)))] = np.nan
        true.append(uv)
    return lines, true, step


def true_image(reference: Reference, xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """True ground points in pixels of the footage; NaN where they are not visible."""
    if isinstance(reference.truth, GroundMap):
        return apply_homography(np.linalg.inv(reference.truth.ground_from_uv), xy_m)[0]
    return image_of(reference.truth, np.column_stack([xy_m, np.zeros(len(xy_m))]))


def _numbered(axes: Axes, uv: Float[np.ndarray, "k 2"]) -> Line2D:
    """Points with their numbers, clear of points and of one another; returns the legend's mark."""
    marks: dict[str, Any] = {"c": TRUE_COLOUR, "linewidths": 1.1, "edgecolors": style.INK}
    style.scatter(axes, uv, s=52, marker="o", zorder=6, clip_on=False, **marks)
    for name, offset in enumerate(_offsets(axes, uv), start=1):
        look: dict[str, Any] = {"ha": "center", "va": "center", "zorder": 7}
        look |= {"fontsize": _LABEL_PT, "fontweight": "bold"}
        look["bbox"] = {"boxstyle": "round,pad=0.16", "fc": style.INK, "ec": "none", "alpha": 0.82}
        look["arrowprops"] = {"arrowstyle": "-", "color": style.INK, "lw": 1.0, "shrinkB": 3}
        style.label(axes, str(name), uv[name - 1], tuple(offset), **look)
    return Line2D(
        [], [], ls="", marker="o", ms=7, c=TRUE_COLOUR, mec=style.INK, label="measured points"
    )


def _offsets(axes: Axes, xy: Float[np.ndarray, "k 2"]) -> Float[np.ndarray, "k 2"]:
    """Offsets of the labels of points in ``axes``, in points of print."""
    per_point = float(axes.figure.dpi) / 72
    frame = axes.get_window_extent()
    low, high = (np.array(end) / per_point for end in ((frame.x0, frame.y0), (frame.x1, frame.y1)))
    return label_offsets(axes.transData.transform(xy) / per_point, low, high)


def label_offsets(
    at: Float[np.ndarray, "k 2"], low: Float[np.ndarray, "2"], high: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "k 2"]:
    """Offsets of labels from their points, all in points of print: near, inside ``low`` to
    ``high``, and clear of all points and of the labels placed before.
    """
    half = np.array([_LABEL_PT, 0.85 * _LABEL_PT])
    angle = np.radians([90, 45, 135, 0, 180, 315, 225, 270])
    ring = np.column_stack([np.cos(angle), np.sin(angle)])
    candidates = np.concatenate([radius * ring for radius in (17, 26, 36, 48, 62)])
    placed: list[np.ndarray] = []
    offsets = np.empty((len(at), 2))
    for row, point in enumerate(at):
        middle = point + candidates
        outside = np.maximum(low + half - middle, middle + half - high).max(axis=1).clip(0)
        cost = 1e3 * outside + np.linalg.norm(candidates, axis=1)
        cost += 200 * _overlaps(middle, at, half + 4)
        cost += 500 * _overlaps(middle, np.array(placed).reshape(-1, 2), 2 * half)
        best = int(np.argmin(cost))
        offsets[row] = candidates[best]
        placed.append(middle[best])
    return offsets


def _overlaps(
    middle: Float[np.ndarray, "m 2"], other: Float[np.ndarray, "n 2"], room: Float[np.ndarray, "2"]
) -> Float[np.ndarray, "m"]:
    """How many others lie closer than ``room`` in both directions."""
    gaps = np.abs(middle[:, None] - other[None])
    return (gaps < room).all(axis=2).sum(axis=1).astype(float)


def draw_alignment(shown: tuple[Headline, ...]) -> style.Drawn:
    """True and estimated points from above, to scale, after the paper's rigid alignment."""
    true = shown[0].score.error.true_xy_m
    axes = _from_above(_area(np.concatenate([true, *(s.score.error.aligned_xy_m for s in shown)])))
    ring: dict[str, Any] = {"marker": "o", "mfc": "none", "mec": style.AXIS, "c": style.AXIS}
    handles = [Line2D([], [], ls="", ms=8, mew=1.4, label="truth", **ring)]
    for s in shown:
        pairs = np.stack([s.score.error.true_xy_m, s.score.error.aligned_xy_m], axis=1)
        axes.add_collection(LineCollection(list(pairs), colors=s.colour, linewidths=2.2, zorder=3))
        mark: dict[str, Any] = {"marker": s.marker, "lw": 0.5, "ec": "white", "zorder": 5}
        style.scatter(axes, s.score.error.aligned_xy_m, s=26, c=s.colour, **mark)
        label = f"{s.method}: {number(s.score.error.mean_m, 2)} ± {number(s.score.error.sd_m, 2)} m"
        look: dict[str, Any] = {"marker": s.marker, "color": s.colour, "ms": 7, "mec": "white"}
        handles.append(Line2D([], [], label=label, lw=2.2, **look))
    style.scatter(axes, true, s=70, facecolors="none", edgecolors=style.AXIS, lw=1.4, zorder=4)
    for name, offset in enumerate(_offsets(axes, true), start=1):
        look = {"ha": "center", "va": "center", "fontsize": charts.TEXT, "color": style.AXIS}
        style.label(axes, str(name), true[name - 1], tuple(offset), zorder=6, **look)
    fig = axes.get_figure(root=True)
    assert fig is not None
    return style.drawn(fig, handles, 0.3)


def _area(xy: np.ndarray) -> Area:
    low, high = xy.min(axis=0), xy.max(axis=0)
    room = max(0.08 * float((high - low).max()), 0.5)
    (x0, y0), (x1, y1) = (low - room).tolist(), (high + room).tolist()
    return Area(x0, x1, y0, y1).shaped(0.6, 0.45)


def _from_above(area: Area) -> Axes:
    """Axes in metres, to scale, on a figure of the charts' width."""
    left, right, bottom, top = 0.72, 0.15, 1.2, 0.15
    room = charts.WIDTH_IN - left - right
    scale = min(room / area.width, 5.0 / area.depth)
    wide, high = area.width * scale, area.depth * scale
    full = bottom + high + top
    start = left + (room - wide) / 2
    fig = style.figure(charts.WIDTH_IN, full)
    axes = fig.add_axes(
        (start / charts.WIDTH_IN, bottom / full, wide / charts.WIDTH_IN, high / full)
    )
    axes.set_xlim(area.x_min, area.x_max)
    axes.set_ylim(area.y_min, area.y_max)
    axes.set_autoscale_on(False)
    step = grid_step(area)
    axes.set_xticks(grid_values(area.x_min, area.x_max, step))
    axes.set_yticks(grid_values(area.y_min, area.y_max, step))
    charts.quiet(axes, "x of the reference (m)", "y of the reference (m)")
    return axes
