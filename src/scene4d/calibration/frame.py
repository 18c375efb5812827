"""The image frame in which a camera is solved: centred, square pixels, half diagonals."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.calibration.body import CORNER, FOCAL, HEIGHT, ROLL, TILT, Points
from scene4d.core import geometry
from scene4d.core.camera import Camera, Lens
from scene4d.core.people import Segments


@dataclass(frozen=True, eq=False)
class ImageFrame:
    """How pixels become the solver's numbers, and its parameters a camera.

    ``lens`` holds the known intrinsics, or None: then the principal point is the image centre,
    pixels are square, and the lens is the solver's one radial coefficient.
    """

    image_size: tuple[int, int]
    lens: Lens | None = None

    @property
    def half_diagonal_px(self) -> float:
        """Half the diagonal of the image, the solver's unit of length."""
        return float(np.hypot(*self.image_size) / 2)

    @property
    def centre_uv(self) -> Float[np.ndarray, "2"]:
        """Principal point in pixels."""
        if self.lens is not None:
            return self.lens.K[:2, 2]
        return (np.array(self.image_size, float) - 1) / 2

    @property
    def aspect(self) -> float:
        """``fy / fx``: how much taller than wide a pixel's image is."""
        return 1.0 if self.lens is None else float(self.lens.K[1, 1] / self.lens.K[0, 0])

    def normalised(self, uv: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "2 n"]:
        """Undistorted (or, without a lens, footage) pixels to the solver's frame."""
        x, y = (uv - self.centre_uv).T
        if self.lens is not None:
            x = x - self.lens.K[0, 1] / self.lens.K[1, 1] * y  # a skewed sensor made square
        return np.stack([x, y / self.aspect]) / self.half_diagonal_px

    def points(self, segments: Segments, foot_height_m: float) -> Points:
        """The solver's view of segments given in footage pixels; unseen ends become NaN."""
        lens = self.lens
        foot, head = (
            self.normalised(uv if lens is None else lens.undistort(uv)[0])
            for uv in (segments.foot_uv, segments.head_uv)
        )
        return Points(foot, head, segments.from_box, foot_height_m)

    def camera(self, parameters: Float[np.ndarray, "5"]) -> Camera:
        """The camera of a parameter vector (log f, tilt, roll, log h, D)."""
        focal = np.exp(parameters[FOCAL]) * self.half_diagonal_px
        K = np.array([[focal, 0, 0], [0, focal * self.aspect, 0], [0, 0, 1.0]])
        K[:2, 2] = self.centre_uv
        if self.lens is None:
            distortion = np.zeros(5)
            distortion[0] = parameters[CORNER] * np.exp(2 * parameters[FOCAL])
        else:
            K[0, 1] = self.lens.K[0, 1] * focal / self.lens.K[0, 0]
            stretch = float(focal / self.lens.K[0, 0])
            distortion = geometry.refocused(self.lens.distortion, stretch)
        R = geometry.rotation_from_tilt_roll(parameters[TILT], parameters[ROLL])
        t = -R @ np.array([0.0, 0.0, np.exp(parameters[HEIGHT])])
        return Camera(self.image_size, K, distortion, R, t)
