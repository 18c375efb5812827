"""The result of a calibration: a camera with its uncertainty, or the reason for its absence."""

import os
from dataclasses import dataclass
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core._calibration_fields import (
    errors_in,
    over_all_parameters,
    stated_sigma,
    texts,
    uncertainty,
)
from scene4d.core._ground_jacobian import (
    common_motion,
    ground_jacobian,
    propagated,
    rigid_motions,
)
from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.camera import SCHEMA, SCHEMAS, Camera
from scene4d.core.errors import InputError
from scene4d.core.files import write_json
from scene4d.core.ground_regions import GroundRegion, ground_heights
from scene4d.core.json_object import JsonObject
from scene4d.core.landmarks import LandmarkFit
from scene4d.core.people import Detections, Segments
from scene4d.core.points import ImageSize, PointsLike, as_image_size, as_points

PARAMETERS: tuple[str, ...] = (
    "log_focal",
    "tilt_rad",
    "roll_rad",
    "log_height",
    "corner_distortion",
    "principal_u",
    "principal_v",
)
"""Order of the covariance's rows: log f, tilt, roll, log C_Z, the fraction D by which the lens
displaces the image corner (``k1 = D (f / half diagonal)²``, so that D does not depend on f), and
the principal point in half diagonals. A covariance of the first five is taken as one of all, with
the principal point known."""
_FIRST = 5
GIVEN = "given"
"""The method of a camera that was not calibrated by scene4d."""
_FEET = 200
"""Number of feet that define the scene's location. Chosen: more change no digit that is shown."""
_ERRORS = ("ground_error_m", "ground_error_from_camera_m")


@dataclass(frozen=True, eq=False, repr=False)
class Calibration:
    """The result of a calibration; false if the camera is undetermined.

    ``covariance`` is that of :data:`PARAMETERS` (7x7, zero rows for fixed parameters), None if
    unknown. Its effect on the ground is given as two errors. *Within the scene* is the error of
    distances and shapes that remains after the best rigid motion of the whole scene; *from the
    camera* is the error of positions in the world of the camera (origin below it, heading along
    +Y). ``ground_error_m`` and ``ground_error_from_camera_m`` hold the median and the 90th
    percentile ("p90") of the two over the ground in view, all places alike, from the camera to the
    distance ("out_to_m") within which people were seen; "walked_median" is the median where they
    walked. Files of older versions hold only "median" and "p90", of where people walked.

    ``segments`` (pixels of the footage) are the people used for the calibration, with ``inlier``
    and ``residual`` by row; ``residual`` is the distance between the observed and the predicted
    head, as a fraction of the person's length in the image. Files do not contain them, so a loaded
    calibration has only their number and ``scene_motion`` (3x7): the rigid motion of the scene
    (shift along X and Y in metres, rotation in radians) per unit of each parameter, which gives the
    error within the scene. ``ground_regions`` are parts of the picture whose ground lies above or
    below that of the camera (:meth:`ground_height_m`). ``landmarks`` says how what was measured
    agrees with the camera, and ``vehicles`` are the sightings of vehicles that do (not in
    files). ``made`` is the origin of the file (source, date, version, command).
    """

    status: str
    method: str
    image_size: ImageSize
    person_height_m: float
    camera: Camera | None = None
    covariance: Float[np.ndarray, "_ _"] | None = None
    reason: str | None = None
    warnings: tuple[str, ...] = ()
    segments: Segments | None = None
    inlier: Bool[np.ndarray, "n"] | None = None
    residual: Float[np.ndarray, "n"] | None = None
    ground_error_m: dict[str, float] | None = None
    ground_error_from_camera_m: dict[str, float] | None = None
    frames: int = 0
    people: int = 0
    inliers: int = 0
    scene_motion: Float[np.ndarray, "3 _"] | None = None
    made: dict[str, str] | None = None
    landmarks: LandmarkFit | None = None
    ground_regions: tuple[GroundRegion, ...] = ()
    vehicles: Detections | None = None

    def __post_init__(self) -> None:
        """Take ``people`` and ``inliers`` (numbers of detections) from the segments, if given."""
        object.__setattr__(self, "image_size", as_image_size(self.image_size))
        for name in ("covariance", "scene_motion"):
            value = getattr(self, name)
            if value is not None:
                object.__setattr__(self, name, over_all_parameters(value, _FIRST, len(PARAMETERS)))
        if self.segments is not None:
            object.__setattr__(self, "people", len(self.segments))
            inliers = 0 if self.inlier is None else int(self.inlier.sum())
            object.__setattr__(self, "inliers", inliers)

    def __bool__(self) -> bool:
        return self.status == "ok"

    def __repr__(self) -> str:
        if not self or self.camera is None:
            return f"<Calibration undetermined: {self.reason}>"
        c, s = self.camera, self.sigma

        def spread(name: str, digits: int) -> str:
            return f" ± {s[name]:.{digits}f}" if s else ""

        return (
            f"<Calibration ({self.method}): focal {c.focal_px:.0f}{spread('focal_px', 0)} px, "
            f"tilt {np.degrees(c.tilt_rad):.1f}{spread('tilt_deg', 1)}°, "
            f"height {c.height_m:.2f}{spread('height_m', 2)} m, "
            f"{self.inliers} of {self.people} people>"
        )

    def _repr_html_(self) -> str:
        from scene4d.core.notebook import beside, camera_svg

        if not self or self.camera is None:
            return beside({"Camera": "undetermined", "Reason": str(self.reason)}, "")
        c, s = self.camera, self.sigma

        def with_sigma(value: float, name: str, unit: str, digits: int) -> str:
            spread = f" ± {s[name]:.{digits}f}" if s else ""
            return f"{value:.{digits}f}{spread}{unit}"

        rows = {
            "Focal length": with_sigma(c.focal_px, "focal_px", " px", 0),
            "Tilt": with_sigma(float(np.degrees(c.tilt_rad)), "tilt_deg", "°", 1),
            "Roll": with_sigma(float(np.degrees(c.roll_rad)), "roll_deg", "°", 1),
            "Height": with_sigma(c.height_m, "height_m", " m", 2),
            "Principal point, across": with_sigma(c.K[0, 2], "principal_u_px", " px", 0),
            "Principal point, down": with_sigma(c.K[1, 2], "principal_v_px", " px", 0),
            "Sightings": f"{self.inliers} of {self.people} agree",
        }
        titles = zip(_ERRORS, ("within the scene", "from the camera"), strict=True)
        for name, title in titles:
            median = (getattr(self, name) or {}).get("median")
            if median is not None:
                rows[f"Error {title}"] = f"{median:.2f} m (median)"
        if self.warnings:
            rows["Warnings"] = " ".join(self.warnings)
        return beside(rows, camera_svg(c))

    @property
    def vehicle_count(self) -> int:
        """How many different vehicles agree with the camera."""
        return 0 if self.vehicles is None else len(np.unique(self.vehicles.track))

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviations, in the units of ``camera.json`` (pixels, degrees, metres)."""
        if self.camera is None or self.covariance is None:
            return {}
        s = np.sqrt(np.diag(self.covariance))
        return {name: float(unit * s[at]) for name, (at, unit) in _units(self.camera).items()}

    def ground_covariance(
        self,
        uv: Float[np.ndarray, "n 2"],
        *,
        from_camera: bool = False,
        aligned_over_uv: Float[np.ndarray, "m 2"] | None = None,
    ) -> tuple[Float[np.ndarray, "n 2 2"], Bool[np.ndarray, "n"]]:
        """Covariance (m²) of ground points at pixels ``uv`` of the footage, due to the camera's.

        The error within the scene, or ``from_camera`` (see the class). The rigid motion between the
        two is fitted by least squares over the area where people walked, or over the pixels
        ``aligned_over_uv``, as in the paper's evaluation. Invalid (NaN) at and above the horizon.
        Raises :class:`InputError` without a camera or a covariance, and for the error within the
        scene if the area where people walked is unknown.
        """
        if self.covariance is None:
            self._camera()
            raise InputError("the error of this camera is not known: it has no covariance")
        xy, jacobian, valid = self.ground_jacobian(uv)
        by_level = self.moved_by_ground_height(uv, xy)
        if not from_camera:
            jacobian = jacobian - rigid_motions(xy) @ self._motion(aligned_over_uv)
        covariance = propagated(jacobian, self.covariance)
        return covariance + by_level[:, :, None] * by_level[:, None, :], valid

    def ground_height_m(
        self, uv: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
        """Height (m) of the ground under feet seen at pixels of the footage, with its standard
        deviation: 0 but inside ``ground_regions``.
        """
        return ground_heights(self.ground_regions, uv)

    def ground_pixels(
        self, xy_m: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
        """Pixels of the footage at which feet on ground points are seen, and validity: on the
        ground of a region if they are seen inside it, else on Z = 0.
        """
        camera = self._camera()
        uv, valid = camera.project(np.column_stack([xy_m, np.zeros(len(xy_m))]))
        free = np.ones(len(xy_m), bool)
        for region in self.ground_regions:
            level = np.column_stack([xy_m, np.full(len(xy_m), region.height_m)])
            there, seen = camera.project(level)
            rows = free & seen & region.contains(there)
            uv[rows], valid[rows] = there[rows], True
            free &= ~rows
        return uv, valid

    def moved_by_ground_height(
        self, uv: Float[np.ndarray, "n 2"], xy_m: Float[np.ndarray, "n 2"]
    ) -> Float[np.ndarray, "n 2"]:
        """By how much (m) the ground points ``xy_m`` at pixels ``uv`` move if the ground of their
        region is one standard deviation higher: towards the camera, and not at all outside.
        """
        (height_m, sigma_m), centre = self.ground_height_m(uv), self._camera().centre_m
        return (centre[:2] - xy_m) * (sigma_m / (centre[2] - height_m))[:, None]

    def _motion(self, over_uv: np.ndarray | None = None) -> Float[np.ndarray, "3 7"]:
        """``scene_motion``, or that over other pixels."""
        if over_uv is None and self.segments is not None:
            over_uv = self.walked_uv()
        if over_uv is not None:
            xy, jacobian, valid = self.ground_jacobian(over_uv)
            return common_motion(xy[valid], jacobian[valid])
        if self.scene_motion is None:
            raise InputError(
                "the error within the scene needs to know where people walked, which this "
                "calibration does not say; calibrate again, or ask with from_camera=True"
            )
        return self.scene_motion

    def walked_uv(self) -> Float[np.ndarray, "n 2"]:
        """A sample of the feet that agree with the camera, with vehicles and landmarks."""
        feet = np.empty((0, 2)) if self.segments is None else self.segments.foot_uv
        feet = feet if self.inlier is None else feet[self.inlier]
        feet = feet[:: max(1, len(feet) // _FEET)]
        if self.vehicles is not None:
            feet = np.vstack([feet, self.vehicles.box_foot_uv])
        return feet if self.landmarks is None else np.vstack([feet, self.landmarks.ground_uv])

    @property
    def parameter_covariance(self) -> Float[np.ndarray, "7 7"]:
        """``covariance``, zero if unknown."""
        n = len(PARAMETERS)
        return np.zeros((n, n)) if self.covariance is None else self.covariance

    def ground_jacobian(
        self, uv: Float[np.ndarray, "n 2"]
    ) -> tuple[Float[np.ndarray, "n 2"], Float[np.ndarray, "n 2 7"], Bool[np.ndarray, "n"]]:
        """Ground points (n, 2) at pixels of the footage (:meth:`ground_height_m`), their
        derivatives with respect to :data:`PARAMETERS`, and validity; NaN at and above the horizon.
        Raises :class:`InputError` without a camera.
        """
        return ground_jacobian(self._camera(), uv, self.ground_height_m(uv)[0])

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
        """A given camera, taken as exact."""
        n = len(PARAMETERS)
        return cls(
            status="ok",
            method=GIVEN,
            image_size=camera.image_size,
            person_height_m=PERSON_HEIGHT_M,
            camera=camera,
            covariance=np.zeros((n, n)),
            scene_motion=np.zeros((3, n)),
        )

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Calibration":
        """Read a ``camera.json``, which holds everything except the people used.

        A file without a covariance has that of independent parameters with the deviations
        ``sigma``; one without either has ``covariance`` None: its error is unknown. Raises
        :class:`InputError` naming the file and the field, also if there is no camera.
        """
        fields = JsonObject.read(path, *SCHEMAS)
        camera = Camera.from_fields(fields)
        height = "person_height_m"
        covariance, scene_motion = uncertainty(fields, (PARAMETERS, PARAMETERS[:_FIRST]))
        covariance = stated_sigma(fields, _units(camera), covariance, len(PARAMETERS))
        within, from_camera = (errors_in(fields, name) for name in _ERRORS)
        frames, people, inliers = (
            fields.integer(name, least=0) if name in fields else 0
            for name in ("frames", "people", "inliers")
        )
        return cls(
            status="ok",
            method=fields.text("method") if "method" in fields else GIVEN,
            image_size=camera.image_size,
            person_height_m=fields.number(height, above=0.0)
            if height in fields
            else PERSON_HEIGHT_M,
            camera=camera,
            covariance=covariance,
            warnings=fields.texts("warnings") if "warnings" in fields else (),
            ground_error_m=within,
            ground_error_from_camera_m=from_camera,
            frames=frames,
            people=people,
            inliers=inliers,
            scene_motion=scene_motion,
            made=texts(fields.object("made")) if "made" in fields else None,
            ground_regions=GroundRegion.all_in(fields, camera.height_m),
        )

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a ``camera.json`` atomically; :meth:`load` reads all of it back.

        Raises :class:`~scene4d.core.errors.OutputError` if it cannot be written.
        """
        write_json(path, self.to_dict())

    def to_dict(self) -> dict[str, Any]:
        """The content of ``camera.json``."""
        values: dict[str, Any] = {"schema": SCHEMA, "image_size": list(self.image_size)}
        if self.camera is not None and self:
            values |= self.camera.to_dict()
            values["sigma"] = self.sigma
            if self.covariance is not None:
                values["covariance"] = self._covariance_fields(self.covariance)
            values |= {name: getattr(self, name) for name in _ERRORS}
            if self.ground_regions:
                values["ground_regions"] = [r.to_dict() for r in self.ground_regions]
        values |= {
            "method": self.method,
            "person_height_m": self.person_height_m,
            "people": self.people,
            "inliers": self.inliers,
            "frames": self.frames,
            "status": self.status,
            "warnings": list(self.warnings),
        }
        optional: dict[str, Any] = {"reason": self.reason, "made": self.made}
        optional["vehicles"] = self.vehicle_count or None
        return values | {name: value for name, value in optional.items() if value is not None}

    def _covariance_fields(self, covariance: np.ndarray) -> dict[str, Any]:
        fields: dict[str, Any] = {"parameters": list(PARAMETERS), "matrix": covariance.tolist()}
        if self.segments is not None or self.scene_motion is not None:
            fields["scene_motion"] = self._motion().tolist()
        return fields


def _units(camera: Camera) -> dict[str, tuple[int, float]]:
    """The parameters in the units of ``camera.json``: their numbers, and how large one is."""
    half_diagonal, degree = float(np.hypot(*camera.image_size)) / 2, 180 / np.pi
    return {
        "focal_px": (0, camera.focal_px),
        "tilt_deg": (1, degree),
        "roll_deg": (2, degree),
        "height_m": (3, camera.height_m),
        "principal_u_px": (5, half_diagonal),
        "principal_v_px": (6, half_diagonal),
    }
