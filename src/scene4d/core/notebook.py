"""Cameras and tracks in a notebook: HTML with a small picture (inline SVG), nothing to load."""

from collections.abc import Iterable, Mapping
from html import escape
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Float

from scene4d.core.body import PERSON_HEIGHT_M

if TYPE_CHECKING:
    from scene4d.core.camera import Camera

_WIDTH_PX = 360
_HORIZON, _GRID, _UPRIGHT, _VEHICLE = "#0072B2", "#777777", "#D55E00", "#D55E00"
"""Okabe and Ito's colours, which colour-blind people can distinguish."""
_PERSON, _CYCLE = "#0072B2", "#009E73"
_COLOURS = {"person": _PERSON, "bicycle": _CYCLE, "motorcycle": _CYCLE}
_STEPS_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0)
_FARTHEST = 12.0
"""Extent of the grid in camera heights: farther lines merge."""


def beside(rows: Mapping[str, str], picture: str) -> str:
    """A table of names and values, and a picture at its side."""
    cells = "".join(f"<tr><th>{escape(k)}</th><td>{escape(v)}</td></tr>" for k, v in rows.items())
    return (
        '<div style="display:flex;flex-wrap:wrap;gap:1em;align-items:flex-start">'
        f"<table>{cells}</table>{picture}</div>"
    )


def camera_svg(camera: "Camera") -> str:
    """What the camera sees: the horizon, the ground's grid, and uprights as tall as a person."""
    width, height = camera.image_size
    ground, step_m = _ground(camera)
    lines = [_line(uv, _GRID, width / 500) for uv in _grid(camera, ground, step_m)]
    lines += [_line(uv, _UPRIGHT, width / 130) for uv in _uprights(camera)]
    lines.append(_line(_horizon(camera), _HORIZON, width / 200))
    label = "What the camera sees: horizon (blue), uprights of 1.70 m (orange)"
    grid = f", grid of {step_m:g} m" if len(ground) else ""
    return _svg("".join(lines), np.array([-0.5, -0.5, width, height]), label + grid)


def plan_svg(paths: Iterable[tuple[str, Float[np.ndarray, "n 2"]]]) -> str:
    """Paths of objects on the ground by class, +Y up; empty if none has a position."""
    known = [(name, xy[np.isfinite(xy).all(axis=1)]) for name, xy in paths]
    known = [(name, xy) for name, xy in known if len(xy)]
    if not known:
        return ""
    every = np.concatenate([xy for _, xy in known])
    low, high = np.quantile(every, [0.01, 0.99], axis=0) + np.array([[-1.0], [1.0]])
    width, depth = high - low
    lines = "".join(
        _line((xy - low) * [1, -1] + [0, depth], _COLOURS.get(name, _VEHICLE), width / 200)
        for name, xy in known
    )
    label = f"Paths on the ground, {width:.0f} m by {depth:.0f} m"
    return _svg(lines, np.array([0.0, 0.0, width, depth]), label)


def _svg(content: str, view: Float[np.ndarray, "4"], label: str) -> str:
    box = " ".join(f"{value:.2f}" for value in view)
    return (
        f'<svg width="{_WIDTH_PX}" viewBox="{box}" role="img" aria-label="{label}" fill="none" '
        f'stroke-linecap="round" style="background:#f4f4f4">{content}</svg>'
    )


def _line(uv: np.ndarray, colour: str, width: float) -> str:
    """The pieces of a curve between invisible points (NaN)."""
    seen = np.isfinite(uv).all(axis=1)
    pieces = np.split(uv, np.flatnonzero(np.diff(seen)) + 1) if len(uv) else []
    return "".join(
        f'<polyline points="{" ".join(f"{x:.2f},{y:.2f}" for x, y in piece)}" '
        f'stroke="{colour}" stroke-width="{width:.2f}"/>'
        for piece in pieces
        if len(piece) and np.isfinite(piece[0]).all()
    )


def _near(camera: "Camera", uv: np.ndarray) -> np.ndarray:
    """The curve, NaN farther than one image size outside the image."""
    size = np.array(camera.image_size)
    near = np.all((uv > -size) & (uv < 2 * size), axis=1)
    return np.where(near[:, None], uv, np.nan)


def _horizon(camera: "Camera") -> np.ndarray:
    """Points at the camera's own height lie on the horizon, however far away."""
    angle = np.linspace(0, 2 * np.pi, 721)
    level = np.column_stack([np.cos(angle), np.sin(angle), np.zeros(len(angle))])
    return _near(camera, camera.project(camera.centre_m + level)[0])


def _places(camera: "Camera", columns: int, rows: int) -> np.ndarray:
    """Ground points (n, 2) seen on a lattice of pixels, not too far away."""
    width, height = camera.image_size
    u, v = (np.arange(columns) + 0.5) / columns * width, (np.arange(rows) + 0.5) / rows * height
    xy, valid = camera.locate(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    near = np.hypot(*(xy - camera.centre_m[:2]).T) < _FARTHEST * abs(camera.height_m)
    return xy[valid & near]


def _ground(camera: "Camera") -> tuple[np.ndarray, float]:
    """The seen ground's corners (2, 2), and the spacing of its grid; none where none is seen."""
    xy = _places(camera, 24, 24)
    if len(xy) < 2:
        return np.empty((0, 2)), 1.0
    corners = np.array([xy.min(axis=0), xy.max(axis=0)])
    size = float(np.ptp(corners, axis=0).max())
    return corners, next((step for step in _STEPS_M if size / step <= 12), _STEPS_M[-1])


def _grid(camera: "Camera", corners: np.ndarray, step_m: float) -> Iterable[np.ndarray]:
    for axis in (0, 1) if len(corners) else ():
        (start, end), (low, high) = corners[:, 1 - axis], corners[:, axis]
        run = np.linspace(start, end, 60)
        for value in np.arange(np.ceil(low / step_m), np.floor(high / step_m) + 1) * step_m:
            xyz = np.zeros((len(run), 3))
            xyz[:, axis], xyz[:, 1 - axis] = value, run
            yield _near(camera, camera.project(xyz)[0])


def _uprights(camera: "Camera") -> Iterable[np.ndarray]:
    for x, y in _places(camera, 5, 4):
        rise = np.linspace(0, PERSON_HEIGHT_M, 9)
        yield camera.project(np.column_stack([np.full(9, x), np.full(9, y), rise]))[0]
