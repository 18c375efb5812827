"""The result of a calibration: a camera with its uncertainty, or the reason why there is none."""

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.camera import SCHEMA, Camera
from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.people import Segments
from scene4d.core.points import PointsLike, as_points

PARAMETERS: tuple[str, ...] = (
    "log_focal",
    "tilt_rad",
    "roll_rad",
    "log_height",
    "corner_distortion",
)
"""Order of the covariance's rows: log f, tilt, roll, log C_Z, and the fraction D by which the lens
displaces the image's corner: ``k1 = D (f / half diagonal)²``, so that D does not move with f."""
GIVEN = "given"
"""The method of a camera that nobody calibrated here."""
_STEP = 1e-5
_FEET = 200  # so many feet say where the scene lies, and how well it is known


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """What a calibration found; false where the camera is undetermined.

    ``covariance`` is that of :data:`PARAMETERS` (5x5, zero rows for what was held fixed).
    ``inlier`` and ``residual`` belong to the rows of ``segments``; ``residual`` is the distance
    between the seen and the predicted head, as a fraction of the person's length in the image.
    ``segments`` are in pixels of the footage as decoded.
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

    def __bool__(self) -> bool:
        return self.status == "ok"

    def __repr__(self) -> str:
        if not self or self.camera is None:
            return f"<Calibration undetermined: {self.reason}>"
        c, s = self.camera, self.sigma or dict.fromkeys(("focal_px", "tilt_deg", "height_m"), 0.0)
        return (
            f"<Calibration ({self.method}): focal {c.focal_px:.0f} ± {s['focal_px']:.0f} px, "
            f"tilt {np.degrees(c.tilt_rad):.1f} ± {s['tilt_deg']:.1f}°, "
            f"height {c.height_m:.2f} ± {s['height_m']:.2f} m, "
            f"{self.inliers} of {self.people} people>"
        )

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

    def ground_covariance(
        self,
        uv: Float[np.ndarray, "n 2"],
        *,
        from_camera: bool = False,
        aligned_over_uv: Float[np.ndarray, "m 2"] | None = None,
    ) -> tuple[Float[np.ndarray, "n 2 2"], Bool[np.ndarray, "n"]]:
        """Covariance (m²) of ground points seen at pixels ``uv`` of the footage, from the camera's.

        First-order propagation by central differences. What is common to the whole scene as a
        rigid motion is no error of the map, so it is removed, by least squares over where people
        walked (or over the pixels ``aligned_over_uv``), as the paper's evaluation does;
        ``from_camera`` keeps it and gives the error in the world of the camera (origin below it,
        heading along +Y). Invalid (NaN) at and above the horizon. Raises :class:`InputError`
        without a camera.
        """
        xy, jacobian, valid = self.ground_jacobian(uv)
        if not from_camera:
            over_uv = self._some_feet_uv() if aligned_over_uv is None else aligned_over_uv
            at, moved, _ = self.ground_jacobian(over_uv)
            jacobian = jacobian - _common_motion(at, moved, xy)
        return jacobian @ self.parameter_covariance @ np.swapaxes(jacobian, -1, -2), valid

    def walked_ground_sigma_m(
        self,
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Ground points (n, 2) of a sample of the feet, with both errors of
        :meth:`ground_sigma_m`: within the scene, and from the camera.
        """
        xy, jacobian, valid = self.ground_jacobian(self._some_feet_uv())
        xy, jacobian = xy[valid], jacobian[valid]
        within = jacobian - _common_motion(xy, jacobian, xy)
        sigma = [
            np.sqrt(
                np.trace(j @ self.parameter_covariance @ np.swapaxes(j, -1, -2), axis1=1, axis2=2)
            )
            for j in (within, jacobian)
        ]
        return xy, sigma[0], sigma[1]

    def _some_feet_uv(self) -> np.ndarray:
        if self.segments is None:
            return np.empty((0, 2))
        feet = self.segments.foot_uv
        feet = feet if self.inlier is None else feet[self.inlier]
        return feet[:: max(1, len(feet) // _FEET)]

    @property
    def parameter_covariance(self) -> Float[np.ndarray, "5 5"]:
        """``covariance``, zero where it is not known."""
        return np.zeros((5, 5)) if self.covariance is None else self.covariance

    def ground_jacobian(
        self, uv: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 5"], Bool[np.ndarray, "n"]]:
        """Ground points (n, 2) at pixels of the footage, their derivatives by :data:`PARAMETERS`,
        and validity; NaN at and above the horizon. Raises :class:`InputError` without a camera.
        """
        camera = self._camera()
        xy, valid = camera.locate(uv)
        known = np.ones(5, bool) if self.covariance is None else np.diag(self.covariance) == 0
        columns = []
        for index in range(len(PARAMETERS)):
            if known[index]:
                columns.append(np.zeros_like(xy))
                continue
            ends = []
            for sign in (-1, 1):
                step = np.zeros(5)
                step[index] = sign * _STEP
                other = camera.disturbed(step)
                there, ok = other.locate(uv)
                valid &= ok
                ends.append(there)
            columns.append((ends[1] - ends[0]) / (2 * _STEP))
        jacobian = np.stack(columns, axis=-1)
        xy[~valid] = np.nan
        jacobian[~valid] = np.nan
        return xy, jacobian, valid

    def ground_sigma_m(
        self, uv: PointsLike, *, from_camera: bool = False, undistorted: bool = False
    ) -> Float[np.ndarray, "*n"]:
        """Root-mean-square error (m) of the ground position at pixels of the footage, or NaN.

        ``uv`` and ``undistorted`` are as for :meth:`Camera.locate`, ``from_camera`` as for
        :meth:`ground_covariance`.
        """
        points, single = as_points(uv)
        if undistorted:
            points, _ = self._camera().distort(points)
        covariance, _ = self.ground_covariance(points, from_camera=from_camera)
        sigma_m: np.ndarray = np.sqrt(np.trace(covariance, axis1=1, axis2=2))
        return sigma_m.reshape(()) if single else sigma_m

    def _camera(self) -> Camera:
        if self.camera is None:
            raise InputError(f"there is no camera: {self.reason or 'calibration undetermined'}")
        return self.camera

    @classmethod
    def of_camera(cls, camera: Camera) -> "Calibration":
        """A camera that somebody gives, taken as exact."""
        return cls(
            status="ok",
            method=GIVEN,
            image_size=camera.image_size,
            person_height_m=PERSON_HEIGHT_M,
            camera=camera,
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Calibration":
        """Read the ``camera.json`` of a calibration, without the people that it was made from.

        Raises :class:`InputError` as :meth:`Camera.load`, for a covariance of another kind, and
        for a camera that no calibration made (it has no ``person_height_m``).
        """
        camera = Camera.load(path)
        values = read_json(path)
        height = values.get("person_height_m")
        if not isinstance(height, int | float):
            raise InputError(
                f'{path}: field "person_height_m" is missing: no calibration wrote this'
            )
        covariance = values.get("covariance")
        if covariance is not None:
            covariance = _covariance(covariance, path)
        return cls(
            status="ok",
            method=str(values.get("method", "unknown")),
            image_size=camera.image_size,
            person_height_m=float(height),
            camera=camera,
            covariance=covariance,
            warnings=tuple(values.get("warnings", ())),
            ground_error_m=values.get("ground_error_m"),
            frames=int(values.get("frames", 0)),
        )

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
        return values


def _covariance(field: Any, path: str | os.PathLike[str]) -> np.ndarray:
    n = len(PARAMETERS)
    try:
        matrix = np.array(field["matrix"], float)
        known = tuple(field["parameters"]) == PARAMETERS
    except (KeyError, TypeError, ValueError):
        known, matrix = False, np.empty(0)
    if not known or matrix.shape != (n, n) or not np.isfinite(matrix).all():
        raise InputError(f'{path}: field "covariance" must hold {n}x{n} numbers of {PARAMETERS}')
    return matrix


def _rigid_motions(xy: np.ndarray) -> np.ndarray:
    """Displacements (n, 2, 3) of ground points by shifts along X and Y and by a small turn."""
    motions = np.zeros((len(xy), 2, 3))
    motions[:, 0, 0] = motions[:, 1, 1] = 1.0
    motions[:, 0, 2], motions[:, 1, 2] = -xy[:, 1], xy[:, 0]
    return motions


def _common_motion(at: np.ndarray, moved: np.ndarray, xy: np.ndarray) -> np.ndarray:
    """Derivatives (n, 2, 5) at ``xy`` of the rigid motion nearest to those ``moved`` (m, 2, 5)."""
    seen = np.isfinite(moved).all(axis=(1, 2))
    if seen.sum() < 2:
        return np.zeros((len(xy), 2, moved.shape[2]))
    design, answer = _rigid_motions(at[seen]).reshape(-1, 3), moved[seen].reshape(-1, 5)
    return _rigid_motions(xy) @ np.linalg.lstsq(design, answer, rcond=None)[0]
