"""One quiet look for all figures: colours, sizes in points, and PNG bytes (no pyplot state)."""

from collections.abc import Sequence
from dataclasses import dataclass
from typing import Any

import cv2
import numpy as np
from matplotlib import patheffects
from matplotlib.axes import Axes
from matplotlib.backends.backend_agg import FigureCanvasAgg
from matplotlib.colors import to_hex
from matplotlib.figure import Figure
from matplotlib.lines import Line2D

from scene4d.core.errors import InputError

# Blue is accepted and red rejected. They stay apart under every colour blindness, and their markers
# differ as well.
INLIER, OUTLIER, SEEN = "#3A8DFF", "#E0303A", "#E69F00"
UPRIGHT, HORIZON, TICK = "#FFC845", "#5FE3E8", "#FFFFFF"
INK, FAINT, CANVAS = "#22272E", "#8A929C", "#414952"
AXIS = "#76808C"
"""Letters beside a picture: readable (4:1) on a white page and on a dark one."""
NETWORK, REGION = "#FF9BE8", "#B8F25A"
# Okabe and Ito (2008), without the reds, which mean "rejected" here.
TRACKS = ("#E69F00", "#009E73", "#CC79A7", "#F0E442", "#56B4E9")
BANDS = ("#FFFFCC", "#FEDD7F", "#FEAE45", "#F4622B", "#C9161D", "#6E0028")
"""Error bands, light to dark: their order survives greyscale."""

_DPI = 140
WIDTH_IN, MAX_HEIGHT_IN = 9.0, 8.2
SMALL, NORMAL = 7.5, 9.0
_MAX_SIDE_PX = 1920
_MOST_COLUMNS = 4  # of a legend


def halo(width: float = 2.0, colour: str = "#14181D") -> list[Any]:
    """An outline that keeps a bright line or label readable on any picture."""
    return [patheffects.withStroke(linewidth=width, foreground=colour, alpha=0.75)]


def figure(width_in: float, height_in: float) -> Figure:
    """An empty white figure on its own Agg canvas."""
    fig = Figure(figsize=(width_in, height_in), dpi=_DPI, facecolor="white")
    FigureCanvasAgg(fig)
    return fig


def png(fig: Figure) -> bytes:
    """The figure as PNG; the same figure gives the same bytes."""
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    return _coded(cv2.cvtColor(np.asarray(canvas.buffer_rgba()), cv2.COLOR_RGBA2BGR))


@dataclass(frozen=True)
class Drawn:
    """A figure: ``png`` is the file, on white and with its legend. ``page_png`` is transparent and
    without the legend, which a page writes itself, legible at every width and in the dark: labels
    with their marks as SVG.
    """

    png: bytes
    page_png: bytes
    legend: tuple[tuple[str, str], ...]


def drawn(fig: Figure, handles: Sequence[Any], middle_in: float) -> Drawn:
    """The figure with a legend below, in a strip whose middle is ``middle_in`` above the edge."""
    if handles:
        legend_below(fig, handles, middle_in)
    fig.patch.set_alpha(0.0)
    canvas = FigureCanvasAgg(fig)
    canvas.draw()
    rgba = np.asarray(canvas.buffer_rgba())
    alpha = rgba[..., 3:] / 255.0
    bgr = (rgba[..., 2::-1] * alpha + 255 * (1 - alpha)).round().astype(np.uint8)
    rows = len(rgba) - round(2 * middle_in * _DPI)
    page = cv2.cvtColor(rgba[:rows], cv2.COLOR_RGBA2BGRA)
    legend = tuple((str(handle.get_label()), _mark_svg(handle)) for handle in handles)
    return Drawn(_coded(bgr), _coded(page), legend)


def _coded(pixels: np.ndarray) -> bytes:
    return bytes(cv2.imencode(".png", pixels, [cv2.IMWRITE_PNG_COMPRESSION, 3])[1].tobytes())


_MARKERS = {
    "o": '<circle cx="16" cy="9" r="4"',
    "X": '<path d="M12 5 20 13M20 5 12 13"',
    "x": '<path d="M12 5 20 13M20 5 12 13"',
    "s": '<rect x="12" y="5" width="8" height="8"',
    "^": '<path d="M11 13 16 5 21 13Z"',
    "v": '<path d="M11 5 16 13 21 5Z"',
    "+": '<path d="M16 4V14M11 9H21"',
    "|": '<path d="M16 3V15"',
}


def _mark_svg(handle: Any) -> str:
    """The mark of a legend's entry on a dark tile, like the pictures it lies on."""
    tile = f'<rect width="32" height="18" rx="3" fill="{CANVAS}"/>'
    if not isinstance(handle, Line2D):
        colour = to_hex(handle.get_facecolor())
        return _svg(f'{tile}<rect x="5" y="4" width="22" height="10" fill="{colour}"/>')
    colour, shapes = to_hex(handle.get_color()), [tile]
    if handle.get_linestyle() not in ("None", "", " "):
        dashes = "" if handle.get_linestyle() == "-" else ' stroke-dasharray="6 3"'
        shapes.append(f'<path d="M3 9H29" stroke="{colour}" stroke-width="2"{dashes}/>')
    if handle.get_marker() in _MARKERS:
        mark = _MARKERS[str(handle.get_marker())]
        shapes.append(f'{mark} fill="{colour}" stroke="{colour}" stroke-width="2"/>')
    return _svg("".join(shapes))


def _svg(shapes: str) -> str:
    return f'<svg viewBox="0 0 32 18" width="32" height="18" aria-hidden="true">{shapes}</svg>'


def checked_image(image_bgr: np.ndarray | None, image_size: tuple[int, int]) -> np.ndarray | None:
    """The frame itself, or None. Raises InputError for anything but (h, w, 3) uint8 of the size."""
    if image_bgr is None:
        return None
    width, height = image_size
    if image_bgr.dtype != np.uint8 or image_bgr.shape != (height, width, 3):
        raise InputError(
            f"report: the background frame must be uint8 of shape {(height, width, 3)} like the "
            f"calibrated footage, found {image_bgr.dtype} of shape {image_bgr.shape}; "
            "pass a frame of the same video"
        )
    return image_bgr


def shown(image_bgr: np.ndarray) -> np.ndarray:
    """The frame as RGB, shrunk to at most :data:`_MAX_SIDE_PX`: figures are not larger."""
    scale = _MAX_SIDE_PX / max(image_bgr.shape[:2])
    if scale < 1:
        image_bgr = cv2.resize(image_bgr, None, fx=scale, fy=scale, interpolation=cv2.INTER_AREA)
    return np.ascontiguousarray(image_bgr[..., ::-1])


def picture(
    image_bgr: np.ndarray | None,
    image_size: tuple[int, int],
    *,
    grey: bool = False,
    above_px: float = 0.0,
) -> tuple[Figure, Axes, float]:
    """A figure that shows the frame (or a plain canvas) in full above a strip for the legend.

    Axes are in pixels of the footage, whatever the figure's own size; ``grey`` takes the colour
    out of the frame, so that colours laid over it can be read; ``above_px`` is the height of an
    empty canvas above the frame. The third value is the middle of the strip in inches.
    """
    width, height = image_size[0], image_size[1] + above_px
    scale = min(WIDTH_IN / width, MAX_HEIGHT_IN / height)
    wide, high = width * scale, height * scale
    strip_in = 0.7 if wide > 7 else 0.95
    fig = figure(max(wide, 5.6), high + strip_in)
    full_w, full_h = fig.get_size_inches()
    left = (full_w - wide) / 2 / full_w
    axes = fig.add_axes((left, strip_in / full_h, wide / full_w, high / full_h))
    axes.set_axis_off()
    extent = (-0.5, width - 0.5, image_size[1] - 0.5, -0.5)
    axes.axhspan(-0.5 - above_px, -0.5, color=CANVAS, lw=0, zorder=0)
    if image_bgr is None:
        axes.axhspan(-0.5, image_size[1] - 0.5, color=CANVAS, zorder=0)
    else:
        rgb = shown(image_bgr)
        if grey:
            rgb = np.repeat(rgb.mean(axis=2, keepdims=True), 3, axis=2).astype(np.uint8)
        axes.imshow(rgb, extent=extent, aspect="auto", interpolation="antialiased")
    axes.set_xlim(extent[:2])
    axes.set_ylim(extent[2], -0.5 - above_px)
    axes.set_autoscale_on(False)
    return fig, axes, strip_in / 2


def legend_below(fig: Figure, handles: Sequence[Any], middle_in: float) -> None:
    """A legend below the picture, where it hides nothing: as many columns as fit the width.

    ``middle_in`` is the height of its middle above the figure's lower edge, in inches.
    """
    for number in range(min(_MOST_COLUMNS, len(handles)), 0, -1):
        legend = fig.legend(
            handles=list(handles),
            loc="center",
            bbox_to_anchor=(0.5, middle_in / float(fig.get_size_inches()[1])),
            ncol=number,
            frameon=False,
            fontsize=NORMAL,
            labelcolor=INK,
            handlelength=1.8,
            columnspacing=2.0,
        )
        if number == 1 or legend.get_window_extent().width < 0.98 * fig.bbox.width:
            return
        legend.remove()


def label(
    axes: Axes,
    text: str,
    at: np.ndarray,
    away_pt: tuple[float | int, float | int] = (0, 0),
    **look: Any,
) -> None:
    """A white small text, or as ``look`` says, so far from a place of the axes."""
    style: dict[str, Any] = {"fontsize": SMALL, "color": "white"} | look
    place = float(at[0]), float(at[1])
    axes.annotate(text, place, xytext=away_pt, textcoords="offset points", **style)


def boxed() -> dict[str, Any]:
    """The look of a bold label in a dark box."""
    box = {"boxstyle": "round,pad=0.18", "fc": INK, "ec": "none", "alpha": 0.72}
    return {"va": "center", "fontsize": NORMAL, "fontweight": "bold", "bbox": box, "zorder": 6}


def scatter(axes: Axes, uv: np.ndarray, **options: Any) -> None:
    """Markers at (n, 2) points."""
    axes.scatter(uv[:, 0], uv[:, 1], **options)
