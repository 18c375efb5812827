"""Points of one camera drawn into the picture of another: whether the two lie as was found."""

from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from scene4d.drawing import style
from scene4d.drawing.scenery import in_frame

_OWN, _OTHER, _APART = "#3A8DFF", "#FFC845", "#FFFFFF"
_MOST = 160


@dataclass(frozen=True, eq=False)
class Matched:
    """Feet of the same people at the same moments, in pixels of this camera: as it saw them, and
    where the other camera puts them.
    """

    own_uv: Float[np.ndarray, "n 2"]
    other_uv: Float[np.ndarray, "n 2"]

    def __post_init__(self) -> None:
        assert self.own_uv.shape == self.other_uv.shape


def draw_other_view(
    image_bgr: np.ndarray | None,
    image_size: tuple[int, int],
    matched: Matched,
    names: tuple[str, str],
) -> style.Drawn:
    """The picture of the first camera with its own points, those of the second, and the way
    between the two of each pair.
    """
    seen = in_frame(matched.own_uv, image_size) & in_frame(matched.other_uv, image_size)
    rows = np.flatnonzero(seen)
    rows = rows[:: max(1, -(-len(rows) // _MOST))]
    own, other = matched.own_uv[rows], matched.other_uv[rows]
    image = style.checked_image(image_bgr, image_size)
    fig, axes, middle_in = style.picture(image, image_size, grey=True)
    lines = np.stack([own, other], axis=1)
    axes.add_collection(LineCollection(list(lines), colors=_APART, linewidths=0.9, zorder=3))
    for uv, colour, marker in ((own, _OWN, "o"), (other, _OTHER, "X")):
        style.scatter(axes, uv, s=26, c=colour, marker=marker, ec="black", lw=0.4, zorder=4)
    handles: list[Any] = [
        _mark(_OWN, "o", f"as {names[0]} saw them"),
        _mark(_OTHER, "X", f"the same people by {names[1]}"),
    ]
    return style.drawn(fig, handles, middle_in)


def _mark(colour: str, marker: str, label: str) -> Line2D:
    return Line2D([], [], ls="", marker=marker, ms=7, c=colour, mec="black", label=label)
