"""The lines that are drawn over the frame, as pixels of the footage: pure functions of arrays.

Each curve is an (n, 2) array with NaN where it cannot be seen.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core import geometry
from scene4d.core.camera import Camera
from scene4d.drawing._uncertainty import Z95, propagated, rays
from scene4d.drawing.ground import Area, grid_values, spread


@dataclass(frozen=True, eq=False)
class GridLine:
    """One line of the ground grid: ``axis`` "x" or "y" is held at ``value_m``."""

    axis: str
    value_m: float
    uv: Float[np.ndarray, "n 2"]


def in_frame(
    uv: Float[np.ndarray, "n 2"], image_size: tuple[int, int], margin_px: float = 0.0
) -> Bool[np.ndarray, "n"]:
    """Which pixels lie inside the image, or at most ``margin_px`` outside."""
    low, high = -0.5 - margin_px, np.array(image_size) - 0.5 + margin_px
    with np.errstate(invalid="ignore"):
        return np.all((uv >= low) & (uv <= high), axis=1)


def image_of(camera: Camera, xyz_m: Float[np.ndarray, "n 3"]) -> Float[np.ndarray, "n 2"]:
    """Pixels of the footage that show these world points; NaN where none does."""
    return camera.project(xyz_m)[0]


def horizon_curve(camera: Camera, samples: int = 801) -> Float[np.ndarray, "n 2"]:
    """The horizon in the footage (bent by the lens), from left to right.

    Its points are the images of ``forward + s · right`` on the ground at infinity, at equal angles
    from the optical axis. Empty for a camera that looks straight down; NaN further than one image
    size outside the frame.
    """
    forward = camera.R[2] * np.array([1.0, 1.0, 0.0])
    length = float(np.linalg.norm(forward))
    if length < 1e-6:
        return np.empty((0, 2))
    forward = forward / length
    right = np.array([forward[1], -forward[0], 0.0])
    reach_rad = np.arctan(4 * max(1.0, float(np.hypot(*camera.image_size)) / camera.focal_px))
    if camera.is_fisheye:
        reach_rad = np.radians(89.9)
    s = length * np.tan(np.linspace(-reach_rad, reach_rad, samples))[:, None]
    homogeneous = (forward + s * right) @ (camera.K @ camera.R).T
    frame, _ = camera.distort(homogeneous[:, :2] / homogeneous[:, 2:])
    frame[~in_frame(frame, camera.image_size, float(max(camera.image_size)))] = np.nan
    return frame


def horizon_band(
    camera: Camera, covariance: Float[np.ndarray, "p p"], uv: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2"]]:
    """The 95 % band around horizon points ``uv`` of the footage: its upper and lower rim.

    The angle of a pixel above the horizon has a standard deviation by the camera's covariance;
    divided by the angle's slope over the image it is a displacement across the horizon.
    """

    def elevation(c: Camera, at: np.ndarray) -> np.ndarray:
        return np.arcsin(np.clip(rays(c, at) @ c.R[:, 2], -1, 1))

    sigma = propagated(camera, covariance, lambda c: elevation(c, uv))
    du, dv = np.array([0.5, 0.0]), np.array([0.0, 0.5])
    slope = np.column_stack(
        [elevation(camera, uv + d) - elevation(camera, uv - d) for d in (du, dv)]
    )
    shift = Z95 * sigma[:, None] * slope / np.sum(slope**2, axis=1, keepdims=True)
    return uv + shift, uv - shift


def vertical_ticks(
    camera: Camera, columns: int = 9, rows: int = 6, length: float = 0.03
) -> Float[np.ndarray, "m k 2"]:
    """Short lines towards the vertical vanishing point, on a lattice over the frame.

    ``length`` is a fraction of the image diagonal. Ticks at the vanishing point itself and
    beyond the lens model are left out.
    """
    width, height = camera.image_size
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    at, valid = camera.undistort(np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2))
    at = at[valid]
    x, y, w = geometry.vertical_vanishing_point(camera.K, camera.R)
    towards = np.column_stack([x - w * at[:, 0], y - w * at[:, 1]])
    reach = np.linalg.norm(towards, axis=1)
    direction = towards / np.where(reach > 0, reach, np.nan)[:, None]
    # Half a tick in undistorted pixels; a pixel of it is ``shown`` pixels of the footage.
    ends = camera.distort(at + direction)[0] - camera.distort(at - direction)[0]
    shown = np.linalg.norm(ends, axis=1) / 2
    half = 0.5 * length * float(np.hypot(width, height)) / shown
    with np.errstate(invalid="ignore"):
        keep = reach > 2 * half * abs(w)
    step = direction[keep] * half[keep, None]
    fraction = np.linspace(-1, 1, 7)[:, None]
    curves = at[keep][:, None] + step[:, None] * fraction
    return camera.distort(curves.reshape(-1, 2))[0].reshape(curves.shape)


def nadir_pixel(camera: Camera) -> Float[np.ndarray, "2"] | None:
    """Where verticals meet, in the footage; None where that is outside the frame."""
    x, y, w = geometry.vertical_vanishing_point(camera.K, camera.R)
    if w <= 1e-9:
        return None
    uv, _ = camera.distort([[x / w, y / w]])
    return uv[0] if in_frame(uv, camera.image_size)[0] else None


def upright_curves(
    camera: Camera, xy_m: Float[np.ndarray, "n 2"], height_m: float, samples: int = 9
) -> Float[np.ndarray, "n k 2"]:
    """Images of uprights that stand at ``xy_m``, from the ground to ``height_m``."""
    z = np.linspace(0, height_m, samples)
    xyz = np.empty((len(xy_m), samples, 3))
    xyz[..., :2], xyz[..., 2] = xy_m[:, None], z
    return image_of(camera, xyz.reshape(-1, 3)).reshape(len(xy_m), samples, 2)


def ground_circle(
    camera: Camera, xy_m: Float[np.ndarray, "2"], radius_m: float
) -> Float[np.ndarray, "n 2"]:
    """Image of a circle on the ground, closed."""
    angle = np.linspace(0, 2 * np.pi, 49)
    ring = xy_m + radius_m * np.column_stack([np.cos(angle), np.sin(angle)])
    return image_of(camera, np.column_stack([ring, np.zeros(len(ring))]))


def upright_rows(
    camera: Camera, xy_m: Float[np.ndarray, "n 2"], height_m: float, count: int = 7
) -> Int[np.ndarray, "m"]:
    """Rows of ``xy_m`` at which to stand uprights, spread over the ground.

    Farthest-point sampling from the footprint nearest to the camera; an upright that leaves the
    frame, or whose label would meet another's in the image, is passed over.
    """
    curves = upright_curves(camera, xy_m, height_m, samples=3)
    inset = -0.02 * max(camera.image_size)
    ends = [in_frame(curves[:, k], camera.image_size, inset) for k in (0, 1, 2)]
    usable = np.flatnonzero(np.all(ends, axis=0))
    if len(usable) == 0:
        return usable
    xy = xy_m[usable]
    nearest = int(np.argmin(np.hypot(*(xy - camera.centre_m[:2]).T)))
    room = np.array(camera.image_size) * (0.09, 0.075)
    chosen: list[int] = []
    for row in usable[spread(xy, 6 * count, nearest)]:
        head, foot = curves[row, 2], curves[row, 0]
        clash = any(
            (np.abs(head - curves[other, end]) < room).all()
            or (np.abs(foot - curves[other, end]) < room).all()
            for other in chosen
            for end in (0, 1, 2)
        )
        if not clash:
            chosen.append(int(row))
        if len(chosen) == count:
            break
    return np.array(chosen, np.int64)


def grid_lines(camera: Camera, area: Area, step_m: float, samples: int = 400) -> list[GridLine]:
    """The ground grid over ``area`` as seen in the footage: NaN outside the frame.

    Lines of which fewer than two points are seen are left out.
    """
    lines = []
    for axis, low, high in (("x", area.x_min, area.x_max), ("y", area.y_min, area.y_max)):
        across = (area.y_min, area.y_max) if axis == "x" else (area.x_min, area.x_max)
        run = np.linspace(*across, samples)
        for value in grid_values(low, high, step_m):
            held = np.full(samples, value)
            xy = (held, run) if axis == "x" else (run, held)
            uv = image_of(camera, np.column_stack([*xy, np.zeros(samples)]))
            uv[~in_frame(uv, camera.image_size, 0.02 * float(max(camera.image_size)))] = np.nan
            if np.isfinite(uv[:, 0]).sum() >= 2:
                lines.append(GridLine(axis, float(value), uv))
    return lines
