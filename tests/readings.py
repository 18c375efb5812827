"""What an orientation network might say, without a network."""

import numpy as np

from scene4d.calibration.orienting import OrientationReading
from scene4d.core.camera import Camera, Lens
from scene4d.perception.orientation import Belief, crop_size, fused

SIGMA_DEG = (1.5, 3.0)
LOG_VFOV_SIGMA = 0.15


def belief_of(
    camera: Camera, *, tilt_deg: float = 0.0, roll_deg: float = 0.0, sigma: float = 1.0
) -> Belief:
    """What a network that is right about ``camera``, but for these errors, believes."""
    crop = crop_size(camera.image_size)[1]
    vfov = 2 * np.arctan(crop / 2 / camera.focal_px)
    mean = (
        camera.roll_rad + np.radians(roll_deg), camera.tilt_rad + np.radians(tilt_deg), np.log(vfov)
    )  # fmt: skip
    spread = (np.radians(SIGMA_DEG[0]), np.radians(SIGMA_DEG[1]), LOG_VFOV_SIGMA)
    return Belief.gaussian(tuple(float(m) for m in mean), tuple(float(sigma * s) for s in spread))


def reading_of(
    *beliefs: Belief, image_size: tuple[int, int], lens: Lens | None = None
) -> OrientationReading:
    by_frame = tuple(enumerate(beliefs))
    return OrientationReading(
        fused(list(beliefs)), by_frame, image_size, lens, focal_known=lens is not None
    )
