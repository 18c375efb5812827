"""Where everybody went, seen from straight above."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.lines import Line2D

from scene4d.model import Camera
from scene4d.report import style
from scene4d.report.birdseye import camera_mark, ground_axes, rectify, show_ground, viewed
from scene4d.report.birdseye import with_camera as around_camera
from scene4d.report.ground import walked_area

_PEOPLE, _WHEELS, _VEHICLES = "#0072B2", "#009E73", "#D55E00"
_LOOKS = {"person": (_PEOPLE, "people"), "bicycle": (_WHEELS, "bicycles and motorcycles")}
_LOOKS["motorcycle"] = _LOOKS["bicycle"]
_OTHER = (_VEHICLES, "cars, trucks and buses")
STANDING_M = 1.0
"""What stays within so much is drawn as a dot."""


def draw_scene_map(
    camera: Camera,
    paths: Mapping[int, tuple[str, Float[np.ndarray, "n 2"]]],
    image_bgr: np.ndarray | None = None,
) -> bytes | None:
    """PNG of the paths (class and ground positions in order of time) by track; None where nobody
    has a position. ``image_bgr`` is a picture of the scene, as decoded.
    """
    everything = [xy for _, xy in paths.values() if len(xy)]
    area = walked_area(np.concatenate(everything), camera) if everything else None
    if area is None:
        return None
    area = around_camera(area, camera)
    view = rectify(camera, area, style.checked_image(image_bgr, camera.image_size))
    fig, axes = ground_axes(area)
    show_ground(axes, view)
    handles = viewed(axes, camera, view)
    counted: dict[tuple[str, str], int] = {}
    for name, xy in paths.values():
        if len(xy):
            look = _LOOKS.get(name, _OTHER)
            _path(axes, xy, look[0])
            counted[look] = counted.get(look, 0) + 1
    handles += [_handle(colour, f"{count} {label}") for (colour, label), count in counted.items()]
    handles += camera_mark(axes, camera, area)
    style.legend_below(fig, handles, 0.28)
    return style.png(fig)


def _path(axes: Axes, xy: Float[np.ndarray, "n 2"], colour: str) -> None:
    """A line that ends in a dot; a dot alone for what stands."""
    if np.ptp(xy, axis=0).max() > STANDING_M:
        axes.plot(
            xy[:, 0], xy[:, 1], color=colour, lw=1.3, alpha=0.85, zorder=3,
            path_effects=style.halo(2.2, "#FFFFFF"),
        )  # fmt: skip
    style.scatter(axes, xy[-1:], s=26, c=colour, ec="white", lw=0.8, zorder=4)


def _handle(colour: str, label: str) -> Any:
    return Line2D([], [], color=colour, lw=1.6, marker="o", ms=5, mec="white", label=label)
