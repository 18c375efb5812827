"""The camera and its lens: immutable values with the common operations."""

import os
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core import geometry
from scene4d.core.errors import InputError
from scene4d.core.files import write_json
from scene4d.core.json_object import JsonObject
from scene4d.core.points import ImageSize, PointsLike, as_image_size, as_points
from scene4d.core.text import in_file, quoted

SCHEMA = "scene4d/camera/2"
SCHEMAS = ("scene4d/camera/1", SCHEMA)
"""Schemas that are read: schema 2 adds to schema 1 the fields for errors within the scene."""
_ASPECT_TOLERANCE = 0.01
"""Largest change of the aspect ratio (share) when a lens is rescaled. Chosen: sizes rounded to
multiples of 8 or 16 are within it, a crop or another sensor mode is not."""
_COEFFICIENTS = {"pinhole": 5, "fisheye": 4}
"""Distortion models by name, and how many coefficients each has."""


def _frozen(values: Any, shape: tuple[int, ...], name: str) -> np.ndarray:
    try:
        array = np.array(values, dtype=float)
    except (TypeError, ValueError, OverflowError):
        array = np.empty(())
    if array.shape != shape or not np.isfinite(array).all():
        wanted = "x".join(map(str, shape))
        raise InputError(f"{name} must be {wanted} finite numbers, found {quoted(values)}")
    array.setflags(write=False)
    return array


def _unwrapped(
    values: np.ndarray, valid: np.ndarray, single: bool
) -> tuple[np.ndarray, np.ndarray]:
    """Values and validity, without the first axis if a single point was given."""
    return (values[0], valid.reshape(())) if single else (values, valid)


@dataclass(frozen=True, eq=False)
class Lens:
    """Intrinsics and distortion of a camera, without its pose.

    ``K`` 3x3 in pixels, ``image_size`` (width, height) in pixels. ``distortion`` has OpenCV's
    coefficients: (k1, k2, p1, p2, k3) if ``distortion_model`` is "pinhole", and (k1, k2, k3, k4)
    if it is "fisheye". Raises :class:`InputError` for invalid values.
    """

    image_size: ImageSize
    K: Float[np.ndarray, "3 3"]
    distortion: Float[np.ndarray, "k"] = field(default_factory=lambda: np.zeros(5))
    distortion_model: str = field(default="pinhole", kw_only=True)

    def __post_init__(self) -> None:
        object.__setattr__(self, "image_size", as_image_size(self.image_size))
        object.__setattr__(self, "K", _frozen(self.K, (3, 3), "K"))
        if self.distortion_model not in _COEFFICIENTS:
            raise InputError(
                f"distortion_model must be {' or '.join(map(repr, _COEFFICIENTS))}, "
                f"found {quoted(self.distortion_model)}"
            )
        shape = (_COEFFICIENTS[self.distortion_model],)
        object.__setattr__(self, "distortion", _frozen(self.distortion, shape, "distortion"))
        if self.K[0, 0] <= 0 or self.K[1, 1] <= 0:
            raise InputError(f"K must have positive focal lengths, found {self.K.diagonal()[:2]}")
        if np.any(self.K[[1, 2, 2], [0, 0, 1]]) or self.K[2, 2] != 1:
            raise InputError(
                "K must be upper triangular with last row 0 0 1 (pixel = K x / z), "
                f"found {self.K.tolist()}"
            )

    @property
    def is_fisheye(self) -> bool:
        """Whether the distortion model is that of a fisheye lens."""
        return self.distortion_model == "fisheye"

    @property
    def bends(self) -> bool:
        """Whether pixels of the footage differ from undistorted ones."""
        return self.is_fisheye or bool(np.any(self.distortion))

    def posed(self, R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> "Camera":
        """The camera with this lens at the pose ``cam_from_world = [R | t]`` in metres."""
        model = self.distortion_model
        return Camera(self.image_size, self.K, self.distortion, R, t, distortion_model=model)

    def refocused(self, stretch: float) -> "Lens":
        """The lens with the focal length ``stretch`` times as long, and the same distortion as a
        function of the position on the sensor.
        """
        K = self.K.copy()
        K[:2, :2] *= stretch
        return replace(self, K=K, distortion=geometry.refocused(self.distortion, stretch))

    def scaled_to(self, image_size: ImageSize) -> "Lens":
        """The same lens for frames of another size; raises :class:`InputError` if the aspect ratio
        differs by over 1 %.

        Pixel centres are at integers, so a coordinate scales as ``(u + 0.5) s - 0.5``.
        """
        image_size = as_image_size(image_size)
        if image_size == self.image_size:
            return self
        sx, sy = image_size[0] / self.image_size[0], image_size[1] / self.image_size[1]
        if abs(sx / sy - 1) > _ASPECT_TOLERANCE:
            raise InputError(
                f"the lens was measured on {self.image_size[0]}x{self.image_size[1]} images and "
                f"cannot serve {image_size[0]}x{image_size[1]}: the aspect ratio differs; "
                "give a lens file made for this image size"
            )
        scale = np.array([[sx, 0, (sx - 1) / 2], [0, sy, (sy - 1) / 2], [0, 0, 1]])
        return replace(self, image_size=image_size, K=scale @ self.K)

    def distort(self, uv: PointsLike) -> tuple[Float[np.ndarray, "*n 2"], Bool[np.ndarray, "*n"]]:
        """Undistorted pixels to pixels of the footage, and which of them the lens can show."""
        points, single = as_points(uv)
        distort = geometry.distort_fisheye if self.is_fisheye else geometry.distort
        return _unwrapped(*distort(points, self.K, self.distortion), single)

    def undistort(self, uv: PointsLike) -> tuple[Float[np.ndarray, "*n 2"], Bool[np.ndarray, "*n"]]:
        """Pixels of the footage to undistorted pixels (same K), and which have one: those that see
        90° or more away from the optical axis of a fisheye lens have none.
        """
        points, single = as_points(uv)
        undistort = geometry.undistort_fisheye if self.is_fisheye else geometry.undistort
        return _unwrapped(*undistort(points, self.K, self.distortion), single)


@dataclass(frozen=True, eq=False, repr=False)
class Camera(Lens):
    """A calibrated camera: a lens and its pose ``cam_from_world = [R | t]`` in metres.

    Raises :class:`InputError` if ``R`` is not a rotation or a value is not finite.
    """

    R: Float[np.ndarray, "3 3"] = field(default_factory=lambda: geometry.R_OVERHEAD)
    t: Float[np.ndarray, "3"] = field(default_factory=lambda: np.zeros(3))

    def __post_init__(self) -> None:
        super().__post_init__()
        object.__setattr__(self, "R", _frozen(self.R, (3, 3), "R"))
        object.__setattr__(self, "t", _frozen(self.t, (3,), "t"))
        if not geometry.is_rotation(self.R):
            raise InputError("R must be a rotation matrix (orthonormal, determinant +1)")

    def __repr__(self) -> str:
        width, height = self.image_size
        return (
            f"<Camera {width}x{height}: focal {self.focal_px:.0f} px, "
            f"tilt {np.degrees(self.tilt_rad):.2f}°, roll {np.degrees(self.roll_rad):.2f}°, "
            f"height {self.height_m:.2f} m>"
        )

    def _repr_html_(self) -> str:
        from scene4d.core.notebook import beside, camera_svg

        width, height = self.image_size
        rows = {
            "Images": f"{width} x {height} px",
            "Focal length": f"{self.focal_px:.0f} px",
            "Tilt": f"{np.degrees(self.tilt_rad):.2f}°",
            "Roll": f"{np.degrees(self.roll_rad):.2f}°",
            "Height": f"{self.height_m:.2f} m",
        }
        return beside(rows, camera_svg(self))

    @classmethod
    def from_pose(
        cls,
        *,
        image_size: ImageSize,
        focal_px: float,
        tilt_rad: float,
        roll_rad: float,
        height_m: float,
        distortion: Any = (0.0, 0.0, 0.0, 0.0, 0.0),
        distortion_model: str = "pinhole",
        centre_uv: tuple[float, float] | None = None,
    ) -> "Camera":
        """The camera of scene4d's world: above the origin, heading along +Y, ground at Z = 0.

        Raises :class:`InputError` unless ``focal_px`` and ``height_m`` are above zero.
        """
        image_size = as_image_size(image_size)
        for name, value in (("focal_px", focal_px), ("height_m", height_m)):
            if not (value > 0 and np.isfinite(value)):
                raise InputError(f"{name}: found {value}, expected a number above 0")
        cu, cv = centre_uv or ((image_size[0] - 1) / 2, (image_size[1] - 1) / 2)
        R = geometry.rotation_from_tilt_roll(tilt_rad, roll_rad)
        return cls(
            image_size=image_size,
            K=np.array([[focal_px, 0, cu], [0, focal_px, cv], [0, 0, 1.0]]),
            distortion=np.asarray(distortion, float),
            distortion_model=distortion_model,
            R=R,
            t=-R @ np.array([0.0, 0.0, height_m]),
        )

    @property
    def lens(self) -> Lens:
        """Intrinsics and distortion alone."""
        model = self.distortion_model
        return Lens(self.image_size, self.K, self.distortion, distortion_model=model)

    @property
    def P(self) -> Float[np.ndarray, "3 4"]:
        """``K [R | t]``: world metres to undistorted pixels."""
        return geometry.projection_matrix(self.K, self.R, self.t)

    @property
    def rvec(self) -> Float[np.ndarray, "3"]:
        """``R`` as OpenCV's rotation vector: its direction is the axis, its length the angle."""
        return geometry.rotation_vector(self.R)

    @property
    def tvec(self) -> Float[np.ndarray, "3"]:
        """``t``, under OpenCV's name."""
        return self.t

    @property
    def homography(self) -> Float[np.ndarray, "3 3"]:
        """Ground (x, y, 1) in metres to *undistorted* pixels (u, v, 1), up to a factor.

        ``np.linalg.inv`` gives the reverse mapping. Undistort pixels of the footage first, or use
        :meth:`locate`, which does so and handles the horizon.
        """
        return self.P[:, [0, 1, 3]]

    @property
    def focal_px(self) -> float:
        """Focal length in pixels (geometric mean of the two axes)."""
        return float(np.sqrt(self.K[0, 0] * self.K[1, 1]))

    @property
    def tilt_rad(self) -> float:
        """Angle of the optical axis below the horizon."""
        return geometry.tilt_roll_from_rotation(self.R)[0]

    @property
    def roll_rad(self) -> float:
        """Roll, ``atan2(up_x, -up_y)``: positive when the horizon falls to the right."""
        return geometry.tilt_roll_from_rotation(self.R)[1]

    @property
    def centre_m(self) -> Float[np.ndarray, "3"]:
        """Camera centre in the world."""
        return geometry.camera_centre(self.R, self.t)

    @property
    def height_m(self) -> float:
        """Height of the camera above the plane Z = 0."""
        return float(self.centre_m[2])

    def project(
        self, xyz_m: np.ndarray | Sequence[Any], *, undistorted: bool = False
    ) -> tuple[Float[np.ndarray, "*n 2"], Bool[np.ndarray, "*n"]]:
        """World points, or one, to pixels of the footage ``(uv, valid)``.

        Invalid (NaN) behind the camera (for a fisheye lens too, which might show such points) and
        outside the range of the lens model. With ``undistorted`` the pixels are undistorted ones.
        """
        points, single = as_points(xyz_m, 3, "xyz_m")
        uv, valid = geometry.project(self.P, points)
        if not undistorted:
            uv, valid = self.distort(uv)
        return _unwrapped(uv, valid, single)

    def locate(
        self,
        uv: PointsLike,
        height_m: float | np.ndarray | Sequence[float] = 0.0,
        *,
        undistorted: bool = False,
    ) -> tuple[Float[np.ndarray, "*n 2"], Bool[np.ndarray, "*n"]]:
        """Pixels of the footage to world ``(xy_m, valid)`` on the plane ``Z = height_m``.

        ``uv`` is an array or a list of points, one point, or boxes with ``xyxy`` (such as
        ``supervision.Detections``), whose bottom centres are used. Invalid (NaN) at and above the
        horizon, and outside the range of the lens model. With ``undistorted`` the pixels are
        undistorted ones.
        """
        points, single = as_points(uv)
        if not undistorted:
            points, _ = self.undistort(points)
        height = np.asarray(height_m, float)
        if height.shape not in ((), (len(points),)):
            raise InputError(
                f"height_m: expected a number or {len(points)} of them, found {height.shape}"
            )
        return _unwrapped(
            *geometry.locate(self.P, points, np.broadcast_to(height, len(points))), single
        )

    def on_ground(self, height_m: float) -> "Camera":
        """The same camera over a ground ``height_m`` above its own, which becomes Z = 0."""
        return replace(self, t=self.t + self.R @ np.array([0.0, 0.0, height_m]))

    def disturbed(self, step: Float[np.ndarray, "p"]) -> "Camera":
        """The camera changed by (log f, tilt, roll, log height, corner distortion, and the two
        coordinates of the principal point, which may be left out); heading kept.

        Distortion depends on the position on the sensor, so its coefficients scale with the focal
        length; the fifth step is the additional displacement of the image corner, as a fraction.
        The principal point is in half diagonals.
        """
        d_log_f, d_tilt, d_roll, d_log_h, d_corner = step[:5]
        lens = self.lens.refocused(float(np.exp(d_log_f)))
        half_diagonal = float(np.hypot(*self.image_size)) / 2
        K, distortion = lens.K.copy(), lens.distortion.copy()
        K[: len(step) - 5, 2] += np.asarray(step[5:]) * half_diagonal
        distortion[0] += d_corner * (K[0, 0] / half_diagonal) ** 2
        tilt, roll = self.tilt_rad, self.roll_rad
        before = geometry.rotation_from_tilt_roll(tilt, roll)
        R = geometry.rotation_from_tilt_roll(tilt + d_tilt, roll + d_roll) @ before.T @ self.R
        centre = self.centre_m
        centre[2] *= np.exp(d_log_h)
        return replace(lens, K=K, distortion=distortion).posed(R, -R @ centre)

    def to_dict(self) -> dict[str, Any]:
        """The fields of ``camera.json`` that describe the camera itself.

        Raises :class:`InputError` for a camera that :meth:`load` would refuse.
        """
        if not self.height_m > 0:
            raise InputError(
                "a camera.json holds a camera above the ground, found the height "
                f"{self.height_m:.5g} m"
            )
        with np.errstate(over="ignore", invalid="ignore"):
            finite = np.isfinite(self.P).all()
        if not finite:
            raise InputError("a camera.json holds finite numbers, found a P that is infinite")
        return {
            "schema": SCHEMA,
            "image_size": list(self.image_size),
            "K": self.K.tolist(),
            **({"distortion_model": self.distortion_model} if self.is_fisheye else {}),
            "distortion": self.distortion.tolist(),
            "R": self.R.tolist(),
            "t": self.t.tolist(),
            "P": self.P.tolist(),
            **self._derived(),
        }

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Camera":
        """Read a ``camera.json``. Raises :class:`InputError` naming the file and the field."""
        return cls.from_fields(JsonObject.read(path, *SCHEMAS))

    @classmethod
    def from_fields(cls, fields: JsonObject) -> "Camera":
        """The camera in the fields of a ``camera.json``; raises :class:`InputError` as ``load``."""
        if "status" in fields and fields.text("status") != "ok":
            reason = fields.text("reason") if "reason" in fields else "undetermined"
            raise InputError(f"{fields.where}: holds no camera: {reason}")
        model = fields.text("distortion_model") if "distortion_model" in fields else "pinhole"
        if model not in _COEFFICIENTS:
            raise fields.error("distortion_model", "'fisheye', or absent for the pinhole model")
        size = fields.array("image_size", 2)
        shapes = {"K": (3, 3), "distortion": (_COEFFICIENTS[model],), "R": (3, 3), "t": (3,)}
        values = {name: fields.array(name, *shape) for name, shape in shapes.items()}
        with in_file(fields.where):
            camera = cls(image_size=as_image_size(size), distortion_model=model, **values)
        if camera.height_m <= 0:
            raise fields.error("t", "that of a camera above the ground (height_m greater than 0)")
        camera._check_derived(fields)
        return camera

    def _check_derived(self, fields: JsonObject) -> None:
        """Reject a file whose readable fields contradict its matrices."""
        for name, value in self._derived().items():
            if name in fields and not np.isclose(fields.number(name), value, rtol=1e-3, atol=1e-2):
                raise fields.error(name, f"{value:.6g}, as K, R and t say")

    def _derived(self) -> dict[str, float]:
        return {
            "focal_px": self.focal_px,
            "tilt_deg": float(np.degrees(self.tilt_rad)),
            "roll_deg": float(np.degrees(self.roll_rad)),
            "height_m": self.height_m,
        }

    def save(self, path: str | os.PathLike[str]) -> None:
        """Write a ``camera.json`` atomically. Raises :class:`OutputError` if it cannot."""
        write_json(path, self.to_dict())
