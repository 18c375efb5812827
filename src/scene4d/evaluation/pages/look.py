"""What all charts of an evaluation share: sizes that a phone can show, quiet axes, heights."""

from typing import Any, Literal

from matplotlib.axes import Axes
from matplotlib.legend import Legend

from scene4d.drawing import style

WIDTH_IN = 7.2
"""Narrower than the pictures: on a phone the letters of a chart stay larger."""
TEXT, SMALL = 10.0, 8.5
GRID = "#E7EAEE"
# From small to tall: markers that point down, to the middle and up.
_HEIGHT_LOOKS = (("#0072B2", "v"), ("#22272E", "o"), ("#E69F00", "D"), ("#CC3311", "^"))


def height_looks(heights_m: list[float]) -> dict[float, tuple[str, str]]:
    """A colour and a marker for each assumed height, in order; from the fifth they repeat."""
    return {h: _HEIGHT_LOOKS[k % len(_HEIGHT_LOOKS)] for k, h in enumerate(sorted(heights_m))}


def height_text(height_m: float) -> str:
    """``1.70`` and ``1.7018``: as given, with two digits at least."""
    return f"{height_m:.2f}" if round(height_m, 2) == height_m else f"{height_m:.4f}".rstrip("0")


def quiet(
    axes: Axes, x_label: str = "", y_label: str = "", *, grid: Literal["both", "x", "y"] = "both"
) -> None:
    """Labels, thin grid, no box."""
    axes.set_xlabel(x_label, fontsize=TEXT, color=style.INK)
    axes.set_ylabel(y_label, fontsize=TEXT, color=style.INK)
    axes.tick_params(labelsize=SMALL, colors=style.INK, length=3)
    axes.spines[["top", "right"]].set_visible(False)
    axes.spines[["left", "bottom"]].set_color(style.FAINT)
    axes.grid(axis=grid, color=GRID, lw=0.7)
    axes.set_axisbelow(True)


def heading(axes: Axes, text: str) -> None:
    """A heading at the left above a panel."""
    axes.set_title(text, loc="left", fontsize=TEXT, fontweight="bold", color=style.INK)


def legend(axes: Axes, handles: list[Any], **options: Any) -> Legend:
    """A legend without a frame."""
    values: dict[str, Any] = {"frameon": False, "fontsize": SMALL, "labelcolor": style.INK}
    return axes.legend(handles=handles, **(values | options))
