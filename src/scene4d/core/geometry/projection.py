"""Pinhole projection, ground points, horizon and vertical vanishing point.

All pixels here are undistorted; see :mod:`scene4d.core.geometry.distortion` for the lens.
Functions that can fail for a point return ``(values, valid)`` with NaN where invalid.
"""

import numpy as np
from jaxtyping import Bool, Float

MIN_DEPTH_M = 1e-9
"""Points nearer to the camera's principal plane than this have no image."""


def projection_matrix(
    K: Float[np.ndarray, "3 3"], R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]
) -> Float[np.ndarray, "3 4"]:
    """``P = K [R | t]``, world metres to undistorted pixels."""
    return K @ np.column_stack([R, t])


def project(
    P: Float[np.ndarray, "3 4"], xyz_m: Float[np.ndarray, "n 3"]
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """Pixels of world points; points on or behind the principal plane are invalid.

    ``P`` must be ``K [R | t]`` with ``K[2] = (0, 0, 1)``, so that the third homogeneous
    coordinate is the depth in metres.
    """
    with np.errstate(all="ignore"):  # points that are not finite are invalid
        homogeneous = xyz_m @ P[:, :3].T + P[:, 3]
    depth = homogeneous[:, 2]
    valid = (depth > MIN_DEPTH_M) & np.isfinite(homogeneous).all(axis=1)
    uv = np.full((len(xyz_m), 2), np.nan)
    np.divide(homogeneous[:, :2], depth[:, None], out=uv, where=valid[:, None])
    return uv, valid


def locate(
    P: Float[np.ndarray, "3 4"],
    uv: Float[np.ndarray, "n 2"],
    height_m: float | Float[np.ndarray, "n"] = 0.0,
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """World (X, Y) in metres where the pixels' rays meet the plane ``Z = height_m``.

    Rays that never meet it in front of the camera (at or above the horizon when the plane lies
    below the camera) are invalid. Cross-multiplying ``uv ~ P (X, Y, Z, 1)`` gives the 2x2
    system of Wagner et al. (2019), solved here by Cramer's rule.
    """
    u, v = uv[:, 0], uv[:, 1]
    offset = P[:, 2][:, None] * np.broadcast_to(np.asarray(height_m, float), u.shape)
    offset = offset + P[:, 3][:, None]
    with np.errstate(all="ignore"):  # pixels that are not finite are invalid
        a, b = P[0, 0] - u * P[2, 0], P[0, 1] - u * P[2, 1]
        c, d = P[1, 0] - v * P[2, 0], P[1, 1] - v * P[2, 1]
        e, f = u * offset[2] - offset[0], v * offset[2] - offset[1]
        det = a * d - b * c
        # What cancels in a, b, c, d leaves noise of this scale: on the horizon det is only that.
        size_u = np.abs(P[0, :2, None]) + np.abs(u * P[2, :2, None])
        size_v = np.abs(P[1, :2, None]) + np.abs(v * P[2, :2, None])
        scale = size_u[0] * size_v[1] + size_u[1] * size_v[0]
        solvable = np.abs(det) > 1e-12 * scale  # false where either is not a number
        xy = np.column_stack([e * d - b * f, a * f - e * c]) / det[:, None]
        depth = xy @ P[2, :2] + offset[2]
    valid = solvable & (depth > MIN_DEPTH_M)
    xy[~valid] = np.nan
    return xy, valid


def camera_centre(R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> Float[np.ndarray, "3"]:
    """Camera centre in the world, ``C = -Rᵀ t``."""
    return -R.T @ t


def horizon_line(
    K: Float[np.ndarray, "3 3"], R: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "3"]:
    """Image line ``(a, b, c)`` of the horizon, ``a u + b v + c = 0``, with ``a² + b² = 1``.

    It is the polar of the up direction, ``K⁻ᵀ R ẑ``; the sign makes it negative on the ground's
    side (below the horizon). A camera that looks straight down has none: the values are NaN.
    """
    line = np.linalg.solve(K.T, R[:, 2])
    norm = np.hypot(line[0], line[1])
    return line / norm if norm > 1e-15 else np.full(3, np.nan)


def vertical_vanishing_point(
    K: Float[np.ndarray, "3 3"], R: Float[np.ndarray, "3 3"]
) -> Float[np.ndarray, "3"]:
    """Homogeneous image point where vertical lines meet (the nadir): ``K R (0, 0, -1)``.

    Third coordinate zero: the verticals are parallel in the image (tilt 0).
    """
    return -K @ R[:, 2]
