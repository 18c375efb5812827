"""The result of a calibration: a camera with its uncertainty, or the reason why there is none."""

from dataclasses import dataclass, field
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from scene4d.model.camera import SCHEMA, Camera
from scene4d.model.people import Segments

PARAMETERS: tuple[str, ...] = ("log_focal", "tilt_rad", "roll_rad", "log_height", "k1")
"""Order of the covariance's rows: log f, tilt, roll, log C_Z, first radial coefficient."""


@dataclass(frozen=True, eq=False)
class Calibration:
    """What a calibration found; false where the camera is undetermined.

    ``covariance`` is that of :data:`PARAMETERS` (5x5, zero rows for what was held fixed).
    ``inlier`` and ``residual`` belong to the rows of ``segments``; ``residual`` is the distance
    between the seen and the predicted head, as a fraction of the person's length in the image.
    """

    status: str
    method: str
    image_size: tuple[int, int]
    person_height_m: float
    camera: Camera | None = None
    covariance: Float[np.ndarray, "5 5"] | None = None
    reason: str | None = None
    warnings: tuple[str, ...] = ()
    segments: Segments | None = None
    inlier: Bool[np.ndarray, "n"] | None = None
    residual: Float[np.ndarray, "n"] | None = None
    ground_error_m: dict[str, float] | None = None
    frames: int = 0
    extra: dict[str, Any] = field(default_factory=dict)

    def __bool__(self) -> bool:
        return self.status == "ok"

    @property
    def people(self) -> int:
        """Number of person segments that entered the calibration."""
        return 0 if self.segments is None else len(self.segments)

    @property
    def inliers(self) -> int:
        """Number of segments that agree with the camera."""
        return 0 if self.inlier is None else int(self.inlier.sum())

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviations, in the units of ``camera.json`` (pixels, degrees, metres)."""
        if self.camera is None or self.covariance is None:
            return {}
        s = np.sqrt(np.diag(self.covariance))
        return {
            "focal_px": float(self.camera.focal_px * s[0]),
            "tilt_deg": float(np.degrees(s[1])),
            "roll_deg": float(np.degrees(s[2])),
            "height_m": float(self.camera.height_m * s[3]),
        }

    def to_dict(self) -> dict[str, Any]:
        """The content of ``camera.json``."""
        values: dict[str, Any] = {"schema": SCHEMA, "image_size": list(self.image_size)}
        if self.camera is not None and self:
            values |= self.camera.to_dict()
            values["sigma"] = self.sigma
            values["ground_error_m"] = self.ground_error_m
            if self.covariance is not None:
                values["covariance"] = {
                    "parameters": list(PARAMETERS),
                    "matrix": self.covariance.tolist(),
                }
        values |= {
            "method": self.method,
            "person_height_m": self.person_height_m,
            "people": self.people,
            "inliers": self.inliers,
            "frames": self.frames,
            "status": self.status,
            "warnings": list(self.warnings),
        }
        if self.reason is not None:
            values["reason"] = self.reason
        return values | self.extra
