"""The frame with what the calibration says about it: horizon, verticals, people, uprights, grid."""

from typing import Any

import numpy as np
from jaxtyping import Bool, Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.geometry import horizon_line
from scene4d.core.landmarks import LandmarkFit
from scene4d.core.people import Segments
from scene4d.drawing import style
from scene4d.drawing.ground import Area, footprints, grid_step, thinned, walked_area
from scene4d.drawing.regions import regions_in_picture
from scene4d.drawing.scenery import (
    GridLine,
    grid_lines,
    ground_circle,
    horizon_band,
    horizon_curve,
    in_frame,
    nadir_pixel,
    upright_curves,
    upright_rows,
    vertical_ticks,
)
from scene4d.drawing.words import number

MAX_DOTS, MAX_LINES = 1500, 250


_MOST_ABOVE = 0.6
"""The canvas is extended above the frame to show a horizon, by at most this share of its height."""


def draw_overlay(
    calibration: Calibration, image_bgr: np.ndarray | None = None, network: Camera | None = None
) -> style.Drawn:
    """The frame with the geometry, or with the people alone where there is no camera.

    ``network`` is the camera as the orientation network reads it, of which the horizon is drawn.
    Where a horizon lies above the frame the canvas goes on to show it.
    """
    segments, _ = people_of(calibration)
    camera = calibration.camera if calibration else None
    above = max(_room_above(seen) for seen in (camera, network))
    fig, axes, strip = style.picture(image_bgr, calibration.image_size, above_px=above)
    if camera is None:
        every = np.ones(len(segments), bool)
        handles = _people(axes, segments, [(every, style.SEEN, "o", "person: foot and head")])
    else:
        handles = _geometry(axes, calibration, camera)
    if network is not None:
        handles += _second_horizon(axes, network)
    if calibration.landmarks is not None:
        handles += _landmarks(axes, calibration.landmarks)
    return style.drawn(fig, handles, strip)


def _landmarks(axes: Axes, fit: LandmarkFit) -> list[Any]:
    """Rings where landmarks were seen, with lines to where the camera expects them."""
    known, names = fit.landmarks, fit.landmarks.names()
    seen = [point.uv for point in known.points] + [upright.head_uv for upright in known.uprights]
    effects = style.halo(2.2)
    for row, uv in enumerate(seen):
        colour = style.UPRIGHT if fit.used[row] else style.OUTLIER
        ends = np.array([uv, fit.expected_uv[row]])
        look: dict[str, Any] = {"color": colour, "path_effects": effects, "zorder": 7}
        axes.plot(*ends.T, lw=1.4, **look)
        axes.plot(*uv, marker="o", ms=8, mfc="none", mew=1.6, **look)
        _name(axes, names[row], np.array(uv))
    for row, distance in enumerate(known.distances, start=len(seen)):
        ends = np.array(distance.uv)
        colour = style.UPRIGHT if fit.used[row] else style.OUTLIER
        axes.plot(*ends.T, lw=1.4, marker="|", color=colour, path_effects=effects, zorder=7)
        _name(axes, names[row], ends.mean(axis=0))
    label = "landmark, line to where it is expected"
    look = {"color": style.UPRIGHT, "marker": "o", "ms": 7, "mfc": "none", "lw": 1.4}
    return [Line2D([], [], label=label, **look)]


def _name(axes: Axes, name: str, uv: np.ndarray) -> None:
    style.label(axes, name, uv, (7, 5), path_effects=style.halo(1.8), zorder=8)


def _room_above(camera: Camera | None) -> float:
    """Height of the canvas (px) above the frame that shows the horizon; 0 where none helps."""
    if camera is None or not horizon_shown(camera):
        return 0.0
    highest = float(_between_sides(camera)[:, 1].min())
    return 0.06 * camera.image_size[1] - highest if highest < 0 else 0.0


def horizon_shown(camera: Camera) -> bool:
    """Whether the figure shows the horizon: it crosses the frame, or passes a little above it."""
    rows, height = _between_sides(camera)[:, 1], camera.image_size[1]
    return len(rows) > 0 and bool(-_MOST_ABOVE * height <= rows.min() <= height)


def _between_sides(camera: Camera) -> Float[np.ndarray, "n 2"]:
    """The points of the horizon that lie above, in or below the frame, not beside it."""
    curve = horizon_curve(camera)
    with np.errstate(invalid="ignore"):
        return curve[(curve[:, 0] >= -0.5) & (curve[:, 0] <= camera.image_size[0] - 0.5)]


def _geometry(axes: Axes, calibration: Calibration, camera: Camera) -> list[Any]:
    segments, used = people_of(calibration)
    xy = footprints(camera, segments)[
        used & (calibration.ground_height_m(segments.foot_uv)[0] == 0)
    ]
    if not used.any():
        xy = vehicle_feet(calibration)
    uprights, curves = _uprights(axes, camera, xy, calibration.person_height_m)
    people = _people(
        axes,
        segments,
        [
            (~used, style.OUTLIER, "X", "outlier: foot and head"),
            (used, style.INLIER, "o", "inlier: foot and head"),
        ],
    )
    area = walked_area(xy, camera)
    grid = [] if area is None else _grid(axes, camera, area, curves)
    horizon = _horizon(axes, camera, calibration.covariance)
    regions = regions_in_picture(axes, calibration)
    vehicles = _vehicles(axes, calibration)
    return [*people, *uprights, *vehicles, *horizon, *_ticks(axes, camera), *grid, *regions]


def vehicle_feet(calibration: Calibration) -> Float[np.ndarray, "n 2"]:
    """Ground points (m) under the near ends of the vehicles that were used."""
    if calibration.camera is None or calibration.vehicles is None:
        return np.empty((0, 2))
    return calibration.camera.locate(calibration.vehicles.box_foot_uv)[0]


def _vehicles(axes: Axes, calibration: Calibration) -> list[Any]:
    """The boxes of vehicles that were used, one of each: its largest."""
    found = calibration.vehicles
    if found is None or not len(found):
        return []
    area = (found.box_xyxy[:, 2:] - found.box_xyxy[:, :2]).prod(axis=1)
    order = np.lexsort([-area, found.track])
    chosen = order[np.unique(found.track[order], return_index=True)[1]]
    x1, y1, x2, y2 = found.box_xyxy[chosen].T
    outlines = np.stack([[x1, y1], [x2, y1], [x2, y2], [x1, y2], [x1, y1]]).transpose(2, 0, 1)
    axes.add_collection(LineCollection(list(outlines), colors=style.INLIER, linewidths=1.0))
    return [Line2D([], [], color=style.INLIER, lw=1.0, label="vehicle: its box")]


def people_of(calibration: Calibration) -> tuple[Segments, Bool[np.ndarray, "n"]]:
    """The segments of a calibration (maybe none) and which of them are inliers."""
    segments = calibration.segments
    if segments is None:
        segments = Segments.from_points(np.empty((0, 2)), np.empty((0, 2)))
    used = calibration.inlier
    return segments, np.ones(len(segments), bool) if used is None else used


def _people(
    axes: Axes, segments: Segments, layers: list[tuple[Bool[np.ndarray, "n"], str, str, str]]
) -> list[Any]:
    """Feet with thin lines to the heads; each layer is (rows, colour, marker, label)."""
    handles: list[Any] = []
    for rows, colour, marker, label in layers:
        dots = thinned(rows, MAX_DOTS, len(segments))
        lines = thinned(rows, MAX_LINES, len(segments))
        if len(dots) == 0:
            continue
        pairs = np.stack([segments.foot_uv[lines], segments.head_uv[lines]], axis=1)
        alpha = float(np.clip(60 / len(lines), 0.3, 0.9))
        axes.add_collection(LineCollection(list(pairs), colors=colour, linewidths=0.9, alpha=alpha))
        style.scatter(
            axes,
            segments.foot_uv[dots],
            s=float(np.clip(7000 / len(segments), 9, 26)),
            c=colour,
            marker=marker,
            linewidths=0.35,
            edgecolors="white",
            alpha=0.9,
            zorder=4,
        )
        handles.insert(0, Line2D([], [], color=colour, marker=marker, ms=5, lw=0.9, label=label))
    return handles


def _grid(axes: Axes, camera: Camera, area: Area, avoid: Float[np.ndarray, "m k 2"]) -> list[Any]:
    step = grid_step(area)
    lines = grid_lines(camera, area, step)
    axes.add_collection(
        LineCollection([g.uv for g in lines], colors="white", linewidths=0.6, alpha=0.4, zorder=1.5)
    )
    across = [g for g in lines if g.axis == "y"]
    _grid_labels(axes, across, camera.image_size, list(avoid.reshape(-1, 2)))
    handle = Line2D([], [], color="white", lw=0.8, path_effects=style.halo(1.8))
    handle.set_label(f"ground grid, every {step:g} m")
    return [handle] if lines else []


def _grid_labels(
    axes: Axes, lines: list[GridLine], image_size: tuple[int, int], taken: list[np.ndarray]
) -> None:
    """Distances at the cross lines, as far left as there is room."""
    width, height = image_size
    shift, room = np.array([0.03 * width, -0.01 * height]), (0.05 * width, 0.035 * height)
    for line in lines:
        inside = line.uv[in_frame(line.uv, image_size, -0.02 * width)]
        inside = inside[np.argsort(inside[:, 0])][: max(len(inside) // 2, 1)]
        gaps = np.abs((inside + shift)[:, None] - np.array(taken).reshape(1, -1, 2))
        free = np.flatnonzero(~(gaps < room).all(axis=2).any(axis=1))
        if len(free) == 0:
            continue
        at = inside[free[0]]
        taken.append(at + shift)
        text = f"{number(line.value_m, int(line.value_m % 1 != 0))} m"
        style.label(axes, text, at, (2, 1.5), alpha=0.9, path_effects=style.halo(1.6))


def _ticks(axes: Axes, camera: Camera) -> list[Any]:
    curves = vertical_ticks(camera)
    effects = style.halo(1.6)
    look: dict[str, Any] = {"colors": style.TICK, "linewidths": 0.9, "alpha": 0.75, "zorder": 1.6}
    axes.add_collection(LineCollection(list(curves), path_effects=effects, **look))
    nadir = nadir_pixel(camera)
    if nadir is not None:
        dark: dict[str, Any] = {"path_effects": style.halo()}
        style.scatter(axes, nadir[None], s=90, marker="+", c="white", lw=1.4, **dark)
        style.label(axes, "straight down", nadir, (7, 5), **dark)
    label = "vertical direction"
    return [Line2D([], [], ls="", marker="|", ms=9, c="white", path_effects=effects, label=label)]


def _horizon(axes: Axes, camera: Camera, covariance: Float[np.ndarray, "p p"] | None) -> list[Any]:
    curve = horizon_curve(camera)
    if not horizon_shown(camera):
        return [_unseen(camera, "horizon", style.HORIZON)]
    if covariance is not None:
        upper, lower = horizon_band(camera, covariance, curve)
        whole = np.isfinite(upper).all(axis=1) & np.isfinite(lower).all(axis=1)
        rim = np.vstack([upper[whole], lower[whole][::-1]])
        axes.fill(*rim.T, color=style.HORIZON, alpha=0.3, lw=0, zorder=2)
    axes.plot(*curve.T, color=style.HORIZON, lw=1.6, path_effects=style.halo(2.6), zorder=2)
    band = covariance is not None
    effects = style.halo(9.0 if band else 2.6, style.HORIZON if band else "#14181D")
    label = "horizon and its 95 % band" if band else "horizon"
    return [Line2D([], [], color="#0E9AA0", lw=1.6, path_effects=effects, label=label)]


def _unseen(camera: Camera, name: str, colour: str) -> Line2D:
    """The entry of a horizon that does not cross the picture."""
    where = "above" if camera.tilt_rad > 0 else "below"
    where = where if abs(camera.tilt_rad) < np.radians(80) else "outside"
    label = f"{name}: {_rows_away(camera)}{where} the picture"
    mark = {"above": "^", "below": "v"}.get(where, "o")
    return Line2D([], [], ls="", marker=mark, ms=6, c=colour, mec="k", label=label)


def _second_horizon(axes: Axes, network: Camera) -> list[Any]:
    """Thin and dashed: a second opinion, not the answer."""
    curve = horizon_curve(network)
    if not horizon_shown(network):
        return [_unseen(network, "network's horizon", style.NETWORK)]
    look: dict[str, Any] = {"color": style.NETWORK, "lw": 1.1, "ls": (0, (6, 4))}
    look["path_effects"] = style.halo(2.0)
    axes.plot(*curve.T, zorder=1.9, **look)
    return [Line2D([], [], label="network's horizon", **look)]


def _rows_away(camera: Camera) -> str:
    """How far beyond the picture the horizon is at mid-width ("150 px "), or an empty text."""
    a, b, c = horizon_line(camera.K, camera.R)
    width, height = camera.image_size
    if not abs(b) > 1e-3:
        return ""
    middle = (width - 1) / 2
    v = float(camera.distort([middle, -(a * middle + c) / b])[0][1])
    away = -v if v < 0 else v - (height - 1)
    return f"{away:.0f} px " if 0 < away < 5 * height else ""


def _uprights(
    axes: Axes, camera: Camera, xy_m: Float[np.ndarray, "n 2"], height_m: float
) -> tuple[list[Any], Float[np.ndarray, "m k 2"]]:
    """Draws the uprights; returns their legend and their curves."""
    xy = xy_m[np.isfinite(xy_m).all(axis=1)]
    xy = xy[upright_rows(camera, xy, height_m)]
    curves = upright_curves(camera, xy, height_m)
    effects = style.halo(3.6)
    for at, curve in zip(xy, curves, strict=True):
        ring = ground_circle(camera, at, 0.3)
        axes.plot(*ring.T, color=style.UPRIGHT, lw=1.1, path_effects=style.halo(2.2), zorder=5)
        axes.plot(*curve.T, color=style.UPRIGHT, lw=2.2, path_effects=effects, zorder=5)
        _upright_label(axes, camera, at, curve)
    label = f"upright of {height_m:.2f} m, and its distance"
    handle = Line2D([], [], color=style.UPRIGHT, lw=2.2, path_effects=effects, label=label)
    return [handle] if len(xy) else [], curves


def _upright_label(
    axes: Axes, camera: Camera, xy_m: Float[np.ndarray, "2"], curve: Float[np.ndarray, "k 2"]
) -> None:
    """The distance along the ground, beyond the head, or below the foot where that is cut off."""
    distance = float(np.hypot(*(xy_m - camera.centre_m[:2])))
    size = np.array(camera.image_size)
    head, foot = curve[-1], curve[0]
    towards = (head - foot) / max(float(np.linalg.norm(head - foot)), 1e-9)
    fits = in_frame(
        (head + 0.03 * size.min() * towards)[None], camera.image_size, -0.02 * size.min()
    )
    at, offset = (head, 10 * towards) if fits[0] else (foot, -14 * towards)
    side = "left" if at[0] < 0.04 * size[0] else "right" if at[0] > 0.96 * size[0] else "center"
    text = f"{distance:.0f} m" if distance >= 10 else f"{distance:.1f} m"
    away = (offset[0], -offset[1])
    style.label(axes, text, at, away, ha=side, color=style.UPRIGHT, **style.boxed())
