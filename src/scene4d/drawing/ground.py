"""Where people walked, in metres, and what follows from it: pure functions of arrays.

Segments here are in pixels of the footage (distorted), as in ``Calibration.segments``.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.camera import Camera
from scene4d.core.people import Segments

_COARSEST_PIXEL_M = 1.0
"""Ground where one pixel spans more depth than this is not worth a picture."""
_STEPS_M = (0.5, 1.0, 2.0, 5.0, 10.0, 20.0, 50.0, 100.0, 200.0, 500.0)


@dataclass(frozen=True)
class Area:
    """A rectangle of the ground in metres."""

    x_min: float
    x_max: float
    y_min: float
    y_max: float

    @property
    def width(self) -> float:
        """Extent along X."""
        return self.x_max - self.x_min

    @property
    def depth(self) -> float:
        """Extent along Y."""
        return self.y_max - self.y_min

    def shaped(self, wide: float, deep: float) -> "Area":
        """As wide as so much of its depth, and as deep as so much of its width, at least."""
        widen = max(0.0, wide * self.depth - self.width) / 2
        deepen = max(0.0, deep * self.width - self.depth) / 2
        x, y = (self.x_min - widen, self.x_max + widen), (self.y_min - deepen, self.y_max + deepen)
        return Area(*x, *y)


def footprints(
    camera: Camera, segments: Segments, ground_m: float | Float[np.ndarray, "n"] = 0.0
) -> Float[np.ndarray, "n 2"]:
    """Ground position of every segment's foot, on a ground of this height; NaN where its ray meets
    no ground.
    """
    return camera.locate(segments.foot_uv, segments.foot_height_m + ground_m)[0]


def implied_heights(
    camera: Camera, segments: Segments, ground_m: float | Float[np.ndarray, "n"] = 0.0
) -> Float[np.ndarray, "n"]:
    """Height in metres of every person: the upright on its footprint that best meets its head.

    ``head ~ P (X, Y, h, 1)``, cross-multiplied, is two equations linear in ``h``; their least
    squares solution is closed. NaN where the foot meets no ground.
    """
    P = camera.P
    xy = footprints(camera, segments, ground_m)
    uv, _ = camera.undistort(segments.head_uv)
    base = xy @ P[:, :2].T + P[:, 3] + np.multiply.outer(ground_m, P[:, 2])
    slope = P[:2, 2] - uv * P[2, 2]
    gap = uv * base[:, 2:] - base[:, :2]
    norm = np.sum(slope**2, axis=1)
    height = np.full(len(uv), np.nan)
    np.divide(np.sum(slope * gap, axis=1), norm, out=height, where=norm > 0)
    return height


def track_medians(
    height_m: Float[np.ndarray, "n"], track: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "m"]:
    """Median height of every known track (id >= 0); empty where no track is known."""
    rows = (track >= 0) & np.isfinite(height_m)
    order = np.argsort(track[rows], kind="stable")
    starts = np.unique(track[rows], return_counts=True)[1].cumsum()[:-1]
    groups = np.split(height_m[rows][order], starts)
    return np.array([np.median(g) for g in groups if len(g)])


def walked_area(xy_m: Float[np.ndarray, "n 2"], camera: Camera) -> Area | None:
    """The ground where people walked, with a margin; None where no footprint is finite.

    The rim of the cloud (0.5 % on each side) is left out, and ground further away than
    :func:`sane_distance`: near the horizon a pixel covers metres, and one bad footprint would
    stretch the picture without end.
    """
    xy = xy_m[np.isfinite(xy_m).all(axis=1)]
    if len(xy) == 0:
        return None
    distance = np.hypot(*(xy - camera.centre_m[:2]).T)
    reach = max(sane_distance(camera), 1.25 * float(np.median(distance)))
    xy = xy[distance <= reach]
    low, high = np.percentile(xy, [0.5, 99.5], axis=0)
    margin = np.maximum(1.5, 0.12 * (high - low))
    margin = np.maximum(margin, (6.0 - (high - low)) / 2)
    (x0, y0), (x1, y1) = low - margin, high + margin
    return Area(float(x0), float(x1), float(y0), float(y1))


def sane_distance(camera: Camera) -> float:
    """Ground distance at which one pixel spans :data:`_COARSEST_PIXEL_M` metres of depth.

    From ``d(distance)/d(angle) = (D² + C_Z²) / C_Z`` and a pixel's angle of ``1 / f``.
    """
    square = _COARSEST_PIXEL_M * camera.focal_px * camera.height_m - camera.height_m**2
    return float(np.sqrt(max(square, (2 * camera.height_m) ** 2)))


def spread(xy_m: Float[np.ndarray, "n 2"], count: int, first: int = 0) -> Int[np.ndarray, "m"]:
    """Rows spread over the ground by farthest-point sampling (Gonzalez 1985) from row ``first``.

    Fewer than ``count`` where fewer places differ.
    """
    if len(xy_m) == 0:
        return np.empty(0, np.int64)
    rows = [first]
    gap = np.hypot(*(xy_m - xy_m[first]).T)
    while len(rows) < count:
        row = int(np.argmax(gap))
        if gap[row] <= 1e-6:
            break
        rows.append(row)
        gap = np.minimum(gap, np.hypot(*(xy_m - xy_m[row]).T))
    return np.array(rows, np.int64)


def thinned(rows: Bool[np.ndarray, "n"], limit: int, of: int) -> Int[np.ndarray, "m"]:
    """The rows that are true, evenly thinned by the share that leaves ``limit`` of ``of`` rows.

    So a group keeps its share of the picture: few outliers stay few among many inliers.
    """
    index = np.flatnonzero(rows)
    if of <= limit:
        return index
    keep = -(-len(index) * limit // of)
    return index[np.linspace(0, len(index) - 1, keep).round().astype(np.int64)]


def grid_step(area: Area, lines: int = 9) -> float:
    """Spacing (0.5, 1, 2, 5, 10, ... m) that puts about ``lines`` lines across the longer side."""
    wanted = max(area.width, area.depth) / lines
    return next((s for s in _STEPS_M if s >= wanted), _STEPS_M[-1])


def grid_values(low: float, high: float, step: float) -> Float[np.ndarray, "n"]:
    """Multiples of ``step`` inside ``[low, high]``."""
    return step * np.arange(np.ceil(low / step - 1e-9), np.floor(high / step + 1e-9) + 1)
