"""The figures that are drawn over a picture of the scene."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from scene4d.drawing import style
from scene4d.drawing.ground import thinned
from scene4d.evaluation import Evaluation
from scene4d.evaluation.pages.headline import Headline
from scene4d.evaluation.pages.places import both_grids

MAX_PEOPLE = 400
POINT, TRUE = "#FFC845", "#FFC845"
# Pictures are wider than charts, and shown as small.
_LABEL_PT, _LEGEND_PT = 12.5, 12.0


def draw_points(evaluation: Evaluation) -> bytes:
    """PNG of the scene with the numbered correspondence points."""
    reference = evaluation.reference
    image = style.checked_image(evaluation.image_bgr, reference.image_size)
    fig, axes, strip = style.picture(image, reference.image_size)
    handles = _numbered(axes, reference.points_uv)
    style.legend_below(fig, handles, strip, columns=3, size=_LEGEND_PT)
    return style.png(fig)


def draw_consensus(evaluation: Evaluation, shown: Headline) -> bytes:
    """PNG of the people of a calibration, from foot to head: inliers, and outliers above them."""
    found = shown.calibration
    assert found.segments is not None
    assert found.inlier is not None
    image = style.checked_image(evaluation.image_bgr, found.image_size)
    fig, axes, strip = style.picture(image, found.image_size, grey=True)
    handles = [
        _people(axes, shown, found.inlier, style.INLIER, "o", "inlier"),
        _people(axes, shown, ~found.inlier, style.OUTLIER, "X", "outlier"),
    ]
    present = [handle for handle in handles if handle is not None]
    style.legend_below(fig, present, strip, columns=3, size=_LEGEND_PT)
    return style.png(fig)


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


def draw_ground(evaluation: Evaluation, shown: Headline) -> bytes:
    """PNG of the scene with the estimated ground grid, the same lines as they truly run, and the
    correspondence points.
    """
    reference = evaluation.reference
    size = reference.image_size
    image = style.checked_image(evaluation.image_bgr, size)
    fig, axes, strip = style.picture(image, size, grey=True)
    estimated, true, step = both_grids(reference, shown)
    axes.add_collection(LineCollection(true, colors=TRUE, linewidths=1.1, linestyles=(0, (3, 2))))
    lines = [line.uv for line in estimated]
    axes.add_collection(
        LineCollection(lines, colors="white", linewidths=1.2, path_effects=style.halo(2.2))
    )
    handles = [
        Line2D([], [], color="white", lw=1.4, path_effects=style.halo(2.8)),
        Line2D([], [], color=TRUE, lw=1.6, ls=(0, (3, 2)), path_effects=style.halo(2.8)),
    ]
    handles[0].set_label(f"estimated ground, every {step:g} m")
    handles[1].set_label("the same lines in truth")
    handles += _numbered(axes, reference.points_uv)
    style.legend_below(fig, handles, strip, columns=3, size=_LEGEND_PT)
    return style.png(fig)


def _numbered(axes: Axes, uv: Float[np.ndarray, "k 2"]) -> list[Any]:
    """Points with their numbers, which stand where they hide neither points nor one another."""
    marks: dict[str, Any] = {"c": POINT, "linewidths": 1.1, "edgecolors": style.INK}
    style.scatter(axes, uv, s=52, marker="o", zorder=6, clip_on=False, **marks)
    per_point = float(axes.figure.dpi) / 72
    at = axes.transData.transform(uv) / per_point
    frame = axes.get_window_extent()
    low = np.array([frame.x0, frame.y0]) / per_point
    high = np.array([frame.x1, frame.y1]) / per_point
    for number, offset in enumerate(label_offsets(at, low, high), start=1):
        axes.annotate(
            str(number),
            tuple(uv[number - 1]),
            xytext=tuple(offset),
            textcoords="offset points",
            ha="center",
            va="center",
            fontsize=_LABEL_PT,
            fontweight="bold",
            color="white",
            bbox={"boxstyle": "round,pad=0.16", "fc": style.INK, "ec": "none", "alpha": 0.82},
            arrowprops={"arrowstyle": "-", "color": style.INK, "lw": 1.0, "shrinkB": 3},
            zorder=7,
        )
    mark = Line2D([], [], ls="", marker="o", ms=7, c=POINT, mec=style.INK)
    mark.set_label("correspondence point")
    return [mark]


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
