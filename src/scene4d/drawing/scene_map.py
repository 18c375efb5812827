"""Where everybody went, seen from straight above."""

from collections.abc import Mapping
from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from scene4d.core.camera import Camera
from scene4d.drawing import style
from scene4d.drawing.birdseye import camera_mark, ground_axes, rectify, show_ground, viewed
from scene4d.drawing.birdseye import with_camera as around_camera
from scene4d.drawing.ground import walked_area

_PEOPLE, _WHEELS, _VEHICLES = "#0072B2", "#009E73", "#D55E00"
_LOOKS = {"person": (_PEOPLE, "people"), "bicycle": (_WHEELS, "bicycles and motorcycles")}
_LOOKS["motorcycle"] = _LOOKS["bicycle"]
_OTHER = (_VEHICLES, "cars, trucks and buses")
_GROUND_PX = 700
"""Longer side of the ground behind the paths: projecting its pixels takes most of the time."""
_STANDING_M = 1.0
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
    image = style.checked_image(image_bgr, camera.image_size)
    view = rectify(camera, area, image, _GROUND_PX)
    fig, axes = ground_axes(area)
    show_ground(axes, view)
    handles = viewed(axes, camera, view)
    for look, group in _by_look(paths).items():
        _draw(axes, group, look[0])
        handles.append(_handle(look[0], f"{len(group)} {look[1]}"))
    handles += camera_mark(axes, camera, area)
    style.legend_below(fig, handles, 0.28)
    return style.png(fig)


def _by_look(
    paths: Mapping[int, tuple[str, np.ndarray]],
) -> dict[tuple[str, str], list[np.ndarray]]:
    groups: dict[tuple[str, str], list[np.ndarray]] = {}
    for name, xy in paths.values():
        if len(xy):
            groups.setdefault(_LOOKS.get(name, _OTHER), []).append(xy)
    return groups


def _draw(axes: Axes, group: list[np.ndarray], colour: str) -> None:
    """Lines that end in dots; dots alone for what stands."""
    moving = [xy for xy in group if np.ptp(xy, axis=0).max() > _STANDING_M]
    axes.add_collection(LineCollection(moving, colors="white", linewidths=2.6, zorder=3))
    axes.add_collection(LineCollection(moving, colors=colour, linewidths=1.3, zorder=3))
    ends = np.array([xy[-1] for xy in group])
    style.scatter(axes, ends, s=26, c=colour, ec="white", lw=0.8, zorder=4)


def _handle(colour: str, label: str) -> Any:
    return Line2D([], [], color=colour, lw=1.6, marker="o", ms=5, mec="white", label=label)
