"""The ground plane seen by a camera, as a 3x3 homography (Zhang 2000)."""

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.errors import InputError

_OUT_OF_PROPORTION = 0.2
"""How far a camera's two ground axes may be from orthogonal (cosine) and equally long (share).
Chosen: lenses off by 10 % pass, maps in feet or with one axis stretched do not."""
_STRAIGHT_DOWN = 1e-4
"""Squared sine of half a degree off the nadir; closer to it the focal length is not determined."""


def apply_homography(
    H: Float[np.ndarray, "3 3"], points: Float[np.ndarray, "n 2"]
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """Points (n, 2) mapped by H, valid where the third coordinate is positive, NaN elsewhere."""
    with np.errstate(all="ignore"):  # points that are not finite are invalid
        homogeneous = np.column_stack([points, np.ones(len(points))]) @ H.T
        mapped = homogeneous[:, :2] / homogeneous[:, 2:]
    valid = (homogeneous[:, 2] > 1e-12 * np.abs(H[2]).max()) & np.isfinite(mapped).all(axis=1)
    mapped[~valid] = np.nan
    return mapped, valid


def pose_from_homography(
    uv_from_ground: Float[np.ndarray, "3 3"], centre_uv: Float[np.ndarray, "2"]
) -> tuple[float, Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """Focal length (pixels), R and t of the camera with square pixels that maps Z = 0 like this.

    ``uv_from_ground`` maps metres to pixels, with any factor, and ``centre_uv`` is the principal
    point. The first two columns of ``K⁻¹ H`` are orthogonal and equally long (Zhang 2000, equations
    3 and 4): two linear equations for 1/f², solved by least squares. Raises :class:`InputError`
    where the camera looks straight down (within half a degree), which leaves f open, and where no
    f fulfils both within :data:`_OUT_OF_PROPORTION`. One equation is to spare, so a map that is
    stretched along or across the view may still be that of another camera.
    """
    shift = np.array([[1.0, 0, -centre_uv[0]], [0, 1, -centre_uv[1]], [0, 0, 1]])
    H = shift @ uv_from_ground
    H = H / np.linalg.norm(H)
    (x1, y1, z1), (x2, y2, z2) = H[:, 0], H[:, 1]
    by = np.array([x1 * x2 + y1 * y2, x1**2 + y1**2 - x2**2 - y2**2])
    constant = np.array([z1 * z2, z1**2 - z2**2])
    if np.hypot(*by) < _STRAIGHT_DOWN * (x1**2 + y1**2 + x2**2 + y2**2) / 2:
        raise InputError(
            "a camera that looks straight down shows the ground alike for any focal length and "
            "height: this homography determines neither"
        )
    focal = 1 / np.sqrt(max(-float(by @ constant) / float(by @ by), 1e-300))
    rays = H / np.array([[focal], [focal], [1.0]])
    length = np.linalg.norm(rays[:, :2], axis=0)
    rays = rays / np.sqrt(length[0] * length[1])
    if max(abs(rays[:, 0] @ rays[:, 1]), abs(np.log(length[0] / length[1]))) > _OUT_OF_PROPORTION:
        raise InputError(
            "no camera with square pixels and this principal point sees the ground through this "
            "homography: is it in metres, and for images of this size?"
        )
    if np.linalg.det(rays) > 0:  # = -C_Z, and cameras hang above the ground
        rays = -rays
    near = np.column_stack([rays[:, :2], np.cross(rays[:, 0], rays[:, 1])])
    U, _, Vt = np.linalg.svd(near)
    return float(focal), U @ Vt, rays[:, 2]
