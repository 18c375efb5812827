"""Tracked objects of one moment as solids in the picture: cuboids, and uprights of people."""

from typing import Any

import numpy as np
from jaxtyping import Float
from matplotlib.axes import Axes
from matplotlib.collections import LineCollection
from matplotlib.lines import Line2D

from scene4d.core.camera import Camera
from scene4d.core.cuboids import cuboid_corners
from scene4d.core.tracks import Tracks
from scene4d.core.vehicle_shapes import CUBOID
from scene4d.drawing import style
from scene4d.drawing.scenery import image_of

_BELOW, _ABOVE = "#FFC845", "#5FE3E8"
_PERSON = "#FF9BE8"
_EDGES = [
    (i, j)
    for i in range(8)
    for j in range(i + 1, 8)
    if np.count_nonzero(CUBOID[i] != CUBOID[j]) == 1
]
_SAMPLES = 9
"""Points along an edge, which the lens bends."""
_LEAST_SHARE = 0.08
"""Objects are labelled where they are at least this share of the picture's height."""
_ROOM = np.array([0.14, 0.03])
"""Room of a label, as shares of the picture."""
_DASHES = (0, (3, 2))


def draw_objects(camera: Camera, tracks: Tracks, image_bgr: np.ndarray) -> bytes | None:
    """PNG of the rows of one moment over its frame: vehicles as cuboids, the side that stands on
    the ground in a colour of its own and dashed where front and back are not known, people and
    vehicles of unknown heading as uprights, all with their sizes. None where nothing has a position
    and a size.
    """
    tracks = tracks.select(np.isfinite(tracks.xy_m[:, 0] + tracks.z_m + tracks.size_m[:, 2]))
    if not len(tracks):
        return None
    image = style.checked_image(image_bgr, camera.image_size)
    fig, axes, strip = style.picture(image, camera.image_size, grey=True)
    solid, person = (
        np.isfinite(cuboid_corners(tracks)).all(axis=(1, 2)),
        tracks.class_name == "person",
    )
    handles = _cuboids(axes, camera, tracks.select(solid))
    handles += _uprights(axes, camera, tracks.select(person), _PERSON, "person: height")
    rest = tracks.select(~solid & ~person)
    handles += _uprights(axes, camera, rest, _BELOW, "vehicle of unknown heading: height")
    _labels(axes, camera, tracks)
    style.legend_below(fig, handles, strip)
    return style.png(fig)


def _cuboids(axes: Axes, camera: Camera, vehicles: Tracks) -> list[Any]:
    if not len(vehicles):
        return []
    corners, axis = cuboid_corners(vehicles), np.isnan(vehicles.heading_sigma_rad)
    base = [e for e in _EDGES if CUBOID[list(e), 2].max() == 0.0]
    _lines(axes, _curves(camera, corners, [e for e in _EDGES if e not in base]), _ABOVE, 1.1)
    _lines(axes, _curves(camera, corners[~axis], base), _BELOW, 1.6)
    _lines(axes, _curves(camera, corners[axis], base), _BELOW, 1.6, _DASHES)
    handles = [_handle(_BELOW, "vehicle: on the ground")] if not axis.all() else []
    if axis.any():
        handles.append(_handle(_BELOW, "front and back not known", ls=_DASHES))
    return [*handles, _handle(_ABOVE, "above it")]


def _uprights(axes: Axes, camera: Camera, some: Tracks, colour: str, label: str) -> list[Any]:
    if not len(some):
        return []
    ends = _upright(some)
    _lines(axes, _curves(camera, ends, [(0, 1)]), colour, 1.6)
    style.scatter(axes, image_of(camera, ends[:, 0]), s=14, c=colour, ec="white", lw=0.5, zorder=6)
    return [_handle(colour, label, marker="o")]


def _upright(tracks: Tracks) -> Float[np.ndarray, "n 2 3"]:
    """From the ground under the middle to the top."""
    foot = np.column_stack([tracks.xy_m, tracks.z_m])
    return np.stack([foot, foot + tracks.size_m[:, 2:] * (0.0, 0.0, 1.0)], axis=1)


def _curves(
    camera: Camera, points: Float[np.ndarray, "n k 3"], edges: list[tuple[int, int]]
) -> list[np.ndarray]:
    """Images of straight edges between points of each object."""
    share = np.linspace(0, 1, _SAMPLES)[:, None]
    found = []
    for one in points:
        for i, j in edges:
            uv = image_of(camera, one[i] + share * (one[j] - one[i]))
            found.append(uv[np.isfinite(uv).all(axis=1)])
    return found


def _lines(axes: Axes, curves: list[np.ndarray], colour: str, width: float, ls: Any = "-") -> None:
    look: dict[str, Any] = {"colors": colour, "linewidths": width, "linestyles": [ls], "zorder": 5}
    axes.add_collection(LineCollection(curves, path_effects=style.halo(width + 1.2), **look))


def _labels(axes: Axes, camera: Camera, tracks: Tracks) -> None:
    """Sizes above objects, the largest in the picture first; those that would cover one another
    are left out.
    """
    ends = _upright(tracks)
    uv = np.stack([image_of(camera, ends[:, k]) for k in range(2)], axis=1)
    tall_px = np.nan_to_num(uv[:, 0, 1] - uv[:, 1, 1])
    taken: list[np.ndarray] = []
    for row in np.argsort(-tall_px).tolist():
        if tall_px[row] < _LEAST_SHARE * camera.image_size[1]:
            break
        if any((np.abs(uv[row, 1] - other) < _ROOM * camera.image_size).all() for other in taken):
            continue
        taken.append(uv[row, 1])
        text = _said(tracks.size_m[row], tracks.size_sigma_m[row])
        look: dict[str, Any] = {"ha": "center", "path_effects": style.halo(1.8), "zorder": 8}
        style.label(axes, text, uv[row, 1], (0, 4), **look)


def _said(size_m: Float[np.ndarray, "3"], sigma_m: Float[np.ndarray, "3"]) -> str:
    if np.isnan(size_m[0]):
        return f"{size_m[2]:.2f} ± {sigma_m[2]:.2f} m"
    return " × ".join(f"{one:.1f}" for one in size_m) + f" m, length ± {sigma_m[0]:.1f}"


def _handle(colour: str, label: str, **look: Any) -> Line2D:
    return Line2D([], [], color=colour, lw=1.6, ms=5, label=label, **look)
