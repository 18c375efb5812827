"""The predicted error of ground positions, as a map over the frame."""

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.colors import ListedColormap, to_rgb
from matplotlib.lines import Line2D
from matplotlib.patches import Patch

from scene4d.core.calibration import Calibration
from scene4d.drawing import style
from scene4d.drawing.ground import thinned
from scene4d.drawing.overlay import people_of

_LEVELS_M = (0.25, 0.5, 1.0, 2.0, 5.0)
_OPACITY = 0.5
_CAP_M = 1e6


def draw_error_map(calibration: Calibration, image_bgr: np.ndarray | None = None) -> style.Drawn:
    """The frame under colour bands of the predicted error within the scene."""
    if calibration.camera is None:
        raise ValueError("an error map needs a camera")
    fig, axes, strip = style.picture(image_bgr, calibration.image_size, grey=True)
    u, v, sigma = error_grid(calibration)
    handles = _bands(axes, u, v, sigma)
    segments, used = people_of(calibration)
    dots = segments.foot_uv[thinned(used, 800, len(used))]
    style.scatter(axes, dots, s=6, c=style.INK, alpha=0.7, lw=0.3, edgecolors="white", zorder=4)
    handles.append(
        Line2D([], [], ls="", marker="o", ms=3, c=style.INK, label="where people walked")
    )
    return style.drawn(fig, handles, strip)


def error_grid(
    calibration: Calibration, columns: int = 320
) -> tuple[Float[np.ndarray, "w"], Float[np.ndarray, "h"], Float[np.ndarray, "h w"]]:
    """Predicted error on a lattice of footage pixels ``(u, v, sigma_m)``; NaN without ground."""
    width, height = calibration.image_size
    rows = max(round(columns * height / width), 2)
    u, v = np.linspace(-0.5, width - 0.5, columns), np.linspace(-0.5, height - 0.5, rows)
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    sigma = np.minimum(calibration.ground_sigma_m(uv), _CAP_M)
    return u, v, sigma.reshape(rows, columns)


def _bands(
    axes: Axes,
    u: Float[np.ndarray, "w"],
    v: Float[np.ndarray, "h"],
    sigma: Float[np.ndarray, "h w"],
) -> list[Patch | Line2D]:
    # Indices of bands instead of contours fill right up to the horizon, where the error explodes.
    index = np.where(np.isnan(sigma), np.nan, np.digitize(sigma, _LEVELS_M))
    mesh = axes.pcolormesh(
        u,
        v,
        np.ma.masked_invalid(index),
        cmap=ListedColormap(style.BANDS),
        vmin=-0.5,
        vmax=len(_LEVELS_M) + 0.5,
        shading="nearest",
        alpha=_OPACITY,
        rasterized=True,
    )
    mesh.set_edgecolor("none")
    finite = sigma[np.isfinite(sigma)]
    inside = [x for x in _LEVELS_M if len(finite) and finite.min() < x < finite.max()]
    if inside:
        masked = np.ma.masked_invalid(sigma)
        lines = axes.contour(u, v, masked, levels=inside, colors=style.INK, linewidths=1.1)
        labels = axes.clabel(lines, fmt=lambda x: f"{x:g} m", fontsize=style.NORMAL)
        for text in labels or []:
            text.set_path_effects(style.halo(2.4, "white"))
    names = ["below 0.25 m", "0.25 to 0.5 m", "0.5 to 1 m", "1 to 2 m", "2 to 5 m", "above 5 m"]
    present = set(index[np.isfinite(index)].astype(int))
    return [
        Patch(fc=_over_grey(colour), ec=style.FAINT, lw=0.5, label=name)
        for k, (colour, name) in enumerate(zip(style.BANDS, names, strict=True))
        if k in present
    ]


def _over_grey(colour: str) -> tuple[float, float, float]:
    """How a band's colour looks on the grey picture, for the legend."""
    red, green, blue = to_rgb(colour)
    rest = 0.6 * (1 - _OPACITY)
    return red * _OPACITY + rest, green * _OPACITY + rest, blue * _OPACITY + rest
