"""The ground plane seen by a camera, as a 3x3 homography (Zhang 2000)."""

import numpy as np
from jaxtyping import Bool, Float

from scene4d.errors import InputError


def apply_homography(
    H: Float[np.ndarray, "3 3"], points: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """Points (n, 2) mapped by H, valid where the third coordinate is positive, NaN elsewhere."""
    homogeneous = np.column_stack([points, np.ones(len(points))]) @ H.T
    valid = homogeneous[:, 2] > 1e-12 * np.abs(H[2]).max()
    with np.errstate(divide="ignore", invalid="ignore"):
        mapped = homogeneous[:, :2] / homogeneous[:, 2:]
    mapped[~valid] = np.nan
    return mapped, valid


def pose_from_homography(
    uv_from_ground: Float[np.ndarray, "3 3"], centre_uv: Float[np.ndarray, "2"]
) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Focal length (pixels), R and t of the camera with square pixels that maps Z = 0 like this.

    ``uv_from_ground`` maps metres to pixels and ``centre_uv`` is the principal point. The first two
    columns of ``K⁻¹ H`` are orthogonal and equally long (Zhang 2000, equations 3 and 4): two linear
    equations for 1/f², solved by least squares. Raises :class:`InputError` where they have no
    solution: a camera that looks straight down, or a map that is not in proportion.
    """
    shift = np.array([[1.0, 0, -centre_uv[0]], [0, 1, -centre_uv[1]], [0, 0, 1]])
    H = shift @ uv_from_ground
    H = H / np.linalg.norm(H)
    (x1, y1, z1), (x2, y2, z2) = H[:, 0], H[:, 1]
    by = np.array([x1 * x2 + y1 * y2, x1**2 + y1**2 - x2**2 - y2**2])
    constant = np.array([z1 * z2, z1**2 - z2**2])
    inverse_f2 = -float(by @ constant) / max(float(by @ by), 1e-300)
    if not inverse_f2 > 0 or np.hypot(z1, z2) < 1e-12 * np.hypot(x1, y1):
        raise InputError(
            "no camera with square pixels and this principal point sees the ground through this "
            "homography: is it in metres, and for images of this size?"
        )
    focal = 1 / np.sqrt(inverse_f2)
    rays = H / np.array([[focal], [focal], [1.0]])
    scale = np.sqrt(np.linalg.norm(rays[:, 0]) * np.linalg.norm(rays[:, 1]))
    rays = rays / scale
    if np.linalg.det(rays) > 0:  # = -C_Z, and cameras hang above the ground
        rays = -rays
    near = np.column_stack([rays[:, :2], np.cross(rays[:, 0], rays[:, 1])])
    U, _, Vt = np.linalg.svd(near)
    return float(focal), U @ Vt, rays[:, 2]
