"""A ground plane without a camera: pixels to metres by a homography."""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core import geometry
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.points import ImageSize, PointsLike, as_image_size, as_points


@dataclass(frozen=True, eq=False)
class GroundMap:
    """Pixels of the footage to ground metres by ``ground_from_uv`` (3, 3); no height, no lens.

    A bare matrix leaves two ambiguities, which are resolved here. Sign: the middle of the image's
    lowest row sees ground, so points with the other sign are above the horizon. Handedness: the
    world is right-handed, seen from above, so a map whose y axis points down, as in plans, is
    mirrored (then ``mirrored`` is true); no rigid motion could do that. The ground's origin may be
    far away (UTM). Raises :class:`InputError` if the matrix is not 3x3, finite and invertible.
    """

    image_size: ImageSize
    ground_from_uv: Float[np.ndarray, "3 3"]
    mirrored: bool = field(init=False, default=False)

    def __post_init__(self) -> None:
        object.__setattr__(self, "image_size", as_image_size(self.image_size))
        H = np.array(self.ground_from_uv, float)
        if H.shape != (3, 3) or not np.isfinite(H).all():
            raise InputError(f"homography: expected 3x3 finite numbers, found {H.tolist()}")
        width, height = self.image_size
        middle = np.array([(width - 1) / 2, height - 1, 1.0])
        depth = float(H[2] @ middle)
        if abs(depth) <= 1e-12 * float(np.abs(H[2]) @ middle):
            raise InputError("homography: the middle of the picture's lowest row sees no ground")
        H = H / depth
        # Metres per pixel there; H itself is near singular where the origin is far away.
        step = H[:2, :2] - np.outer(H[:2] @ middle, H[2, :2])
        if np.linalg.cond(step) > 1e8:
            raise InputError(
                "homography: the matrix maps the picture onto no plane (not invertible)"
            )
        mirrored = bool(np.linalg.det(step) > 0)  # v runs down in pixels, and y must not
        if mirrored:
            H[1] = -H[1]
        H.flags.writeable = False
        object.__setattr__(self, "ground_from_uv", H)
        object.__setattr__(self, "mirrored", mirrored)

    def locate(self, uv: PointsLike) -> tuple[Float[np.ndarray, "*n 2"], Bool[np.ndarray, "*n"]]:
        """Pixels of the footage to ground ``(xy_m, valid)``, given as to :meth:`Camera.locate`."""
        points, single = as_points(uv)
        xy_m, valid = geometry.apply_homography(self.ground_from_uv, points)
        return (xy_m[0], valid.reshape(())) if single else (xy_m, valid)

    def camera(self) -> Camera:
        """The camera with this ground plane, square pixels, central principal point and no
        distortion; raises :class:`InputError` if there is none.
        """
        width, height = self.image_size
        centre = np.array([(width - 1) / 2, (height - 1) / 2])
        focal, R, t = geometry.pose_from_homography(np.linalg.inv(self.ground_from_uv), centre)
        K = np.array([[focal, 0, centre[0]], [0, focal, centre[1]], [0, 0, 1.0]])
        return Camera(self.image_size, K, np.zeros(5), R, t)
