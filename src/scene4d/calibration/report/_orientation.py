"""What the orientation network reads in a picture: horizon and verticals, and how sure it is."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.figure import Figure
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from scene4d.core.camera import Camera
from scene4d.drawing import style
from scene4d.drawing.words import number
from scene4d.perception.orientation import Belief, crop_size
from scene4d.perception.orientation.grid import ROLL_RAD, TILT_RAD, VFOV_RAD

DRAWS = 4000
"""Cameras drawn from the belief: the band's rims are then known to a few per cent of its width."""
COLUMNS = 81
_SIDE_IN, _STRIP_IN, _PAD_IN = 3.3, 0.75, 0.3
_PICTURE_IN = (8.2, 6.4)
_LEAST_HIGH_IN = 4.6
_BAR, _BAND = "#9CC9CC", "#E3F3F4"


def draw_orientation(
    belief: Belief,
    camera: Camera,
    image_bgr: np.ndarray | None = None,
    *,
    focal_known: bool = False,
    frames: int = 1,
) -> bytes:
    """PNG: the picture with horizon, its 95 % band and verticals, and what is believed of roll,
    tilt and field of view.

    ``camera`` is the reading as a camera of any height; the picture is without its distortion.
    ``focal_known`` says that its focal length was told. Raises :class:`InputError` for a picture
    of another size.
    """
    image = style.checked_image(image_bgr, camera.image_size)
    fig, axes, side = _layout(camera.image_size)
    _picture(axes, image, camera.image_size)
    focal = camera.focal_px if focal_known else None
    _horizon(axes, belief, camera, focal)
    _verticals(axes, camera)
    _legend(fig, axes, _handles(belief, camera, focal))
    _marginals(side, belief, camera, focal)
    of = "one picture says" if frames == 1 else f"{frames} pictures say"
    side[0].set_title(f"what {of}", loc="left", fontsize=style.NORMAL, color=style.INK)
    return style.png(fig)


def horizon_rows(
    belief: Belief,
    image_size: tuple[int, int],
    u: Float[np.ndarray, "k"],
    *,
    focal_px: float | None = None,
    seed: int = 0,
) -> Float[np.ndarray, "k 2"]:
    """Central 95 % of the rows at which the horizon crosses the columns ``u``, in pixels.

    From cameras drawn from the belief, each evenly within its cell; ``focal_px`` where it is told.
    Nothing is assumed about the shape of the belief. The optical axis meets the picture's centre.
    """
    rng = np.random.default_rng(seed)
    cells = rng.choice(belief.p.size, DRAWS, p=belief.p.ravel() / belief.p.sum())
    indices = np.unravel_index(cells, belief.p.shape)
    axes = (ROLL_RAD, TILT_RAD, np.log(VFOV_RAD))
    roll, tilt, log_vfov = (
        nodes[index] + (nodes[1] - nodes[0]) * rng.uniform(-0.5, 0.5, DRAWS)
        for nodes, index in zip(axes, indices, strict=True)
    )
    focal = np.full(DRAWS, focal_px or 0.0)
    if focal_px is None:
        focal = crop_size(image_size)[1] / 2 / np.tan(np.exp(log_vfov) / 2)
    width, height = image_size
    # A ray (x, y, f) is level where it is normal to up = (cos t sin r, -cos t cos r, -sin t).
    x = u[:, None] - (width - 1) / 2
    rows = (height - 1) / 2 + x * np.tan(roll) - focal * np.tan(tilt) / np.cos(roll)
    return np.quantile(rows, [0.025, 0.975], axis=1).T


def _layout(image_size: tuple[int, int]) -> tuple[Figure, Axes, list[Axes]]:
    width, height = image_size
    scale = min(_PICTURE_IN[0] / width, _PICTURE_IN[1] / height)
    wide, high = width * scale, max(height * scale, _LEAST_HIGH_IN)
    full_w, full_h = wide + _SIDE_IN + 2 * _PAD_IN, high + _STRIP_IN + _PAD_IN
    fig = style.figure(full_w, full_h)
    bottom = _STRIP_IN + (high - height * scale) / 2
    picture = (_PAD_IN / full_w, bottom / full_h, wide / full_w, height * scale / full_h)
    each, gap = (high - 2 * 0.62) / 3, 0.62
    left = (wide + 2.5 * _PAD_IN) / full_w
    side = [
        fig.add_axes(
            (
                left,
                (_STRIP_IN + (2 - row) * (each + gap)) / full_h,
                (_SIDE_IN - 1.5 * _PAD_IN) / full_w,
                each / full_h,
            )
        )
        for row in range(3)
    ]
    return fig, fig.add_axes(picture), side


def _picture(axes: Axes, image: np.ndarray | None, image_size: tuple[int, int]) -> None:
    width, height = image_size
    extent = (-0.5, width - 0.5, height - 0.5, -0.5)
    axes.set_axis_off()
    if image is None:
        axes.axhspan(-0.5, height - 0.5, color=style.CANVAS, zorder=0)
    else:
        axes.imshow(style.shown(image), extent=extent, aspect="auto", interpolation="antialiased")
    axes.set_xlim(extent[:2])
    axes.set_ylim(extent[2:])
    axes.set_autoscale_on(False)


def _horizon(axes: Axes, belief: Belief, camera: Camera, focal_px: float | None) -> None:
    u, band, middle = _curves(belief, camera, focal_px)
    axes.fill_between(u, *band.T, color=style.HORIZON, alpha=0.3, lw=0, zorder=2)
    axes.plot(u, middle, color=style.HORIZON, lw=1.8, path_effects=style.halo(2.8), zorder=3)


def _curves(
    belief: Belief, camera: Camera, focal_px: float | None
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Columns, band and middle of the horizon; the principal point is the picture's centre."""
    width, height = camera.image_size
    u = np.linspace(-0.5, width - 0.5, COLUMNS)
    band = horizon_rows(belief, camera.image_size, u, focal_px=focal_px)
    slope, drop = np.tan(camera.roll_rad), np.tan(camera.tilt_rad) / np.cos(camera.roll_rad)
    middle = (height - 1) / 2 + (u - (width - 1) / 2) * slope - camera.focal_px * drop
    return u, band, middle


def _verticals(axes: Axes, camera: Camera) -> None:
    """Arrows towards up on a lattice over the picture."""
    width, height = camera.image_size
    u = (np.arange(9) + 0.5) * width / 9 - 0.5
    v = (np.arange(6) + 0.5) * height / 6 - 0.5
    at = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    up = camera.R[:, 2]
    ray = (at - np.array([(width - 1) / 2, (height - 1) / 2])) / camera.focal_px
    towards = up[:2] - ray * up[2]
    length = np.hypot(*towards.T)
    keep = length > 1e-6
    half = 0.02 * float(np.hypot(width, height)) * towards[keep] / length[keep, None]
    stems = np.stack([at[keep] - half, at[keep] + half], axis=1)
    effects = style.halo(1.8)
    axes.add_collection(
        LineCollection(
            list(stems), colors=style.TICK, linewidths=1.0, alpha=0.85, path_effects=effects,
            zorder=2.5,
        )
    )  # fmt: skip
    style.scatter(axes, stems[:, 1], s=9, c=style.TICK, lw=0.4, edgecolors="#14181D", zorder=2.6)


def _handles(belief: Belief, camera: Camera, focal_px: float | None) -> list[Any]:
    _, band, middle = _curves(belief, camera, focal_px)
    height = camera.image_size[1]
    where = ""
    if (middle < 0).all() or (middle > height - 1).all():
        where = f": {'above' if middle[0] < 0 else 'below'} the picture"
    inside = (band[:, 1] > 0).any() and (band[:, 0] < height - 1).any()
    name = "its 95 % band" if inside else "its 95 % band: not in the picture"
    tick: dict[str, Any] = {
        "ls": "-",
        "marker": "o",
        "ms": 3.5,
        "c": "white",
        "mec": "#14181D",
        "lw": 1.2,
    }
    return [
        Line2D([], [], color="#0E9AA0", lw=1.8, label=f"horizon{where}"),
        Patch(color=style.HORIZON, alpha=0.45, label=name),
        Line2D([], [], path_effects=style.halo(2.0), label="up, the dot at its top", **tick),
    ]


def _legend(fig: Figure, axes: Axes, handles: list[Any]) -> None:
    """Below the picture, and only there: to its right are the other axes' labels."""
    place, high = axes.get_position(), float(fig.get_size_inches()[1])
    middle = (place.x0 + place.x1) / 2, min(place.y0 / 2, _STRIP_IN / 2 / high)
    fig.legend(
        handles=handles, loc="center", bbox_to_anchor=middle, ncol=3, frameon=False,
        fontsize=style.SMALL, labelcolor=style.INK, handlelength=1.8, columnspacing=1.6,
    )  # fmt: skip


def _marginals(side: list[Axes], belief: Belief, camera: Camera, focal_px: float | None) -> None:
    crop, height = crop_size(camera.image_size)[1], camera.image_size[1]

    def whole(vfov_rad: np.ndarray) -> np.ndarray:
        return 2 * np.arctan(np.tan(vfov_rad / 2) * height / crop)

    own = 2 * np.arctan(height / 2 / camera.focal_px)
    rows = (
        ("roll", ROLL_RAD, camera.roll_rad, np.array(belief.interval(0))),
        ("tilt", TILT_RAD, camera.tilt_rad, np.array(belief.interval(1))),
        ("field of view, vertical", whole(VFOV_RAD), own, whole(np.array(belief.interval(2)))),
    )
    for axis, (axes, (name, nodes, middle, interval)) in enumerate(zip(side, rows, strict=True)):
        told = axis == 2 and focal_px is not None
        _bars(axes, np.degrees(nodes), belief.marginal(axis), logarithmic=axis == 2)
        axes.axvspan(*np.degrees(interval), color=_BAND, lw=0, zorder=0)
        axes.axvline(float(np.degrees(middle)), color="#0E9AA0", lw=1.8, zorder=3)
        low, high = (number(float(x), 1) for x in np.degrees(interval))
        value = number(float(np.degrees(middle)), 1)
        label = f"{name}  {value}° (given)" if told else f"{name}  {value}°  ({low} to {high})"
        axes.set_xlabel(label, fontsize=style.NORMAL, color=style.INK, labelpad=2)


def _bars(axes: Axes, nodes: np.ndarray, p: np.ndarray, *, logarithmic: bool) -> None:
    place = np.log(nodes) if logarithmic else nodes
    middles = (place[1:] + place[:-1]) / 2
    edges = np.concatenate([[2 * place[0] - middles[0]], middles, [2 * place[-1] - middles[-1]]])
    edges = np.exp(edges) if logarithmic else edges
    axes.bar(edges[:-1], p, np.diff(edges), align="edge", color=_BAR, ec="white", lw=0.3, zorder=2)
    axes.set_xlim(float(edges[0]), float(edges[-1]))
    if logarithmic:
        axes.set_xscale("log")
        ticks = [t for t in (10, 15, 20, 30, 45, 60, 90, 120) if edges[0] < t < edges[-1]]
        axes.set_xticks(ticks, labels=[str(t) for t in ticks])
        axes.set_xticks([], minor=True)
    axes.set_ylim(0, 1.15 * float(p.max()))
    axes.set_yticks([])
    axes.tick_params(labelsize=style.SMALL, colors=style.INK, length=3)
    axes.spines[["top", "right", "left"]].set_visible(False)
    axes.spines["bottom"].set_color(style.FAINT)
    axes.set_axisbelow(True)
