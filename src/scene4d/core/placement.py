"""Where the ground and the clock of one camera lie in those of a site.

A point p of a camera's ground (metres, :mod:`scene4d.core.camera`) is
``scale * Rot(heading) p + (x, y)`` in the site's, and a time t of its clock ``t + time_offset_s``,
plus ``rate * (t - at_s)`` where its clock drifts.
"""

from dataclasses import dataclass, field
from typing import Literal

import numpy as np
from jaxtyping import Float

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError

PLACED: tuple[str, ...] = ("x_m", "y_m", "heading_rad", "log_scale", "time_offset_s")
"""Order of the rows of a placement's covariance."""
_QUARTER = np.array([[0.0, -1.0], [1.0, 0.0]])
"""Rotation by a quarter turn: the derivative of a rotation is this times the rotation."""


@dataclass(frozen=True)
class Drift:
    """By which fraction a camera's clock runs slower than its site's, with its standard deviation,
    and the time of the camera's clock at which the placement's offset holds.
    """

    rate: float
    sigma: float
    at_s: float


@dataclass(frozen=True, eq=False)
class Placement:
    """A camera's frame in that of its site; false if it is undetermined.

    ``heading_rad`` turns from +X to +Y and is kept within ±π; ``scale`` is metres of the site per
    metre of the camera. ``covariance`` is that of :data:`PLACED`, symmetric. ``drift`` is None
    where the footage does not show one: both clocks run alike then. A placement that is
    ``"undetermined"`` has a ``reason`` and NaN for its numbers, so nothing can be put by it.
    Raises :class:`InputError` for numbers that are not finite or a scale that is not positive.
    """

    x_m: float
    y_m: float
    heading_rad: float
    scale: float
    time_offset_s: float
    covariance: Float[np.ndarray, "5 5"] = field(default_factory=lambda: np.zeros((5, 5)))
    status: Literal["ok", "undetermined"] = "ok"
    reason: str | None = None
    drift: Drift | None = None

    def __post_init__(self) -> None:
        if self.status == "ok":
            if not self.scale > 0:
                raise InputError(f"placement: scale must be positive, found {self.scale}")
            if not (np.isfinite(self.parameters).all() and np.isfinite(self.covariance).all()):
                raise InputError(f"placement: expected finite numbers, found {self}")
            object.__setattr__(self, "heading_rad", float(_wrapped(np.array(self.heading_rad))))
        elif self.reason is None:
            raise InputError("placement: an undetermined one needs a reason")

    def __bool__(self) -> bool:
        return self.status == "ok"

    @classmethod
    def identity(cls) -> "Placement":
        """The frame of the site itself, exactly."""
        return cls(0.0, 0.0, 0.0, 1.0, 0.0)

    @classmethod
    def undetermined(cls, reason: str) -> "Placement":
        """No place, and why."""
        nan = float("nan")
        nothing = np.full((5, 5), nan)
        return cls(nan, nan, nan, nan, nan, nothing, "undetermined", reason)

    @classmethod
    def from_parameters(
        cls, parameters: Float[np.ndarray, "5"], covariance: Float[np.ndarray, "5 5"]
    ) -> "Placement":
        """The placement with these values of :data:`PLACED`."""
        x, y, heading, log_scale, offset = map(float, parameters)
        return cls(x, y, heading, float(np.exp(log_scale)), offset, covariance)

    @property
    def parameters(self) -> Float[np.ndarray, "5"]:
        """The values of :data:`PLACED`."""
        log_scale = float(np.log(self.scale))
        return np.array([self.x_m, self.y_m, self.heading_rad, log_scale, self.time_offset_s])

    @property
    def sigma(self) -> dict[str, float]:
        """Standard deviations of the fields by name."""
        x, y, heading, log_scale, offset = np.sqrt(np.diag(self.covariance)).tolist()
        return {
            "x_m": x,
            "y_m": y,
            "heading_rad": heading,
            "scale": self.scale * log_scale,
            "time_offset_s": offset,
        }

    @property
    def linear(self) -> Float[np.ndarray, "2 2"]:
        """``scale * Rot(heading)``: metres of the camera to metres of the site."""
        c, s = np.cos(self.heading_rad), np.sin(self.heading_rad)
        return self.scale * np.array([[c, -s], [s, c]])

    def points(self, xy_m: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Ground points of the camera in the site's frame."""
        return xy_m @ self.linear.T + np.array([self.x_m, self.y_m])

    def velocities(self, velocity_mps: Float[np.ndarray, "*n 2"]) -> Float[np.ndarray, "*n 2"]:
        """Velocities in the site's frame."""
        return velocity_mps @ self.linear.T

    def headings(self, heading_rad: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Headings in the site's frame, within ±π."""
        return _wrapped(heading_rad + self.heading_rad)

    def times(self, time_s: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Times of the camera's clock in the site's."""
        if self.drift is None:
            return time_s + self.time_offset_s
        return time_s + self.time_offset_s + self.drift.rate * (time_s - self.drift.at_s)

    def own_covariances(
        self, covariance: Float[np.ndarray, "*n 2 2"]
    ) -> Float[np.ndarray, "*n 2 2"]:
        """Covariances of points (m²) or of velocities (m²/s²), turned and scaled into the site's
        frame, without what the placement is not sure of.
        """
        return self.linear @ covariance @ self.linear.T

    def point_jacobian(
        self,
        xy_m: Float[np.ndarray, "n 2"],
        velocity_mps: Float[np.ndarray, "n 2"] | None = None,
    ) -> Float[np.ndarray, "n 2 5"]:
        """Derivatives of points in the site's frame with respect to :data:`PLACED`.

        With ``velocity_mps`` the points are those of moving things at a time of the *site's* clock:
        one second more of offset means that the camera saw them one second of way ago.
        """
        moved = xy_m @ self.linear.T
        jacobian = np.zeros((len(xy_m), 2, 5))
        jacobian[:, :, :2] = np.eye(2)
        jacobian[:, :, 2] = moved @ _QUARTER.T
        jacobian[:, :, 3] = moved
        if velocity_mps is not None:
            jacobian[:, :, 4] = -self.velocities(velocity_mps)
        return jacobian

    def point_covariances(
        self,
        xy_m: Float[np.ndarray, "n 2"],
        velocity_mps: Float[np.ndarray, "n 2"] | None = None,
    ) -> Float[np.ndarray, "n 2 2"]:
        """Covariance (m²) of points in the site's frame that is due to the placement: an error that
        all points of the camera share. ``velocity_mps`` as for :meth:`point_jacobian`.
        """
        jacobian = self.point_jacobian(xy_m, velocity_mps)
        return jacobian @ self.covariance @ jacobian.swapaxes(1, 2)

    def drifting_covariances(
        self, velocity_mps: Float[np.ndarray, "n 2"], time_s: Float[np.ndarray, "n"]
    ) -> Float[np.ndarray, "n 2 2"]:
        """The same that is due to the drift of the clock; ``time_s`` is the camera's."""
        if self.drift is None:
            return np.zeros((len(time_s), 2, 2))
        away_s = self.drift.sigma * (time_s - self.drift.at_s)
        late = self.velocities(velocity_mps) * away_s[:, None]
        return late[:, :, None] * late[:, None, :]

    def velocity_covariances(
        self, velocity_mps: Float[np.ndarray, "n 2"]
    ) -> Float[np.ndarray, "n 2 2"]:
        """The same of velocities (m²/s²)."""
        jacobian = self.point_jacobian(velocity_mps)[:, :, 2:4]
        return jacobian @ self.covariance[2:4, 2:4] @ jacobian.swapaxes(1, 2)

    def heading_sigmas(self, sigma_rad: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Standard deviations of headings in the site's frame, with the placement's."""
        return np.hypot(sigma_rad, np.sqrt(self.covariance[2, 2]))

    def inverse(self) -> "Placement":
        """The site's frame in the camera's."""
        if not self:
            return self
        back = np.linalg.inv(self.linear)
        xy = -back @ np.array([self.x_m, self.y_m])
        jacobian = -np.eye(5)
        jacobian[:2, :2] = -back
        jacobian[:2, 2] = -_QUARTER @ xy
        jacobian[:2, 3] = -xy
        covariance = _symmetric(jacobian @ self.covariance @ jacobian.T)
        offset, heading = -self.time_offset_s, -self.heading_rad
        back_drift = self.drift and Drift(
            -self.drift.rate / (1 + self.drift.rate),
            self.drift.sigma / (1 + self.drift.rate) ** 2,
            self.drift.at_s + self.time_offset_s,
        )
        x, y = xy.tolist()
        return Placement(x, y, heading, 1 / self.scale, offset, covariance, drift=back_drift)

    def then(self, outer: "Placement") -> "Placement":
        """This frame in the frame that ``outer`` puts its site into; the two err independently.

        Undetermined, with its reason, if either is.
        """
        if not (self and outer):
            return self if not self else outer
        at = np.array([[self.x_m, self.y_m]])
        inner = np.eye(5)
        inner[:2, :2] = outer.linear
        by_outer = np.eye(5)
        by_outer[:2] = outer.point_jacobian(at)[0]
        covariance = inner @ self.covariance @ inner.T + by_outer @ outer.covariance @ by_outer.T
        (x, y), scale = outer.points(at)[0].tolist(), outer.scale * self.scale
        heading = self.heading_rad + outer.heading_rad
        drift = _drifts(self, outer)
        offset = self.time_offset_s + outer.time_offset_s
        if drift is not None and outer.drift is not None:
            at_s = drift.at_s + self.time_offset_s
            offset = float(outer.times(np.array([at_s]))[0]) - drift.at_s
        return Placement(x, y, heading, scale, offset, _symmetric(covariance), drift=drift)

    def camera(self, camera: Camera) -> Camera:
        """The camera in the site's frame: the same picture of the same things, in metres of the
        site. Raises :class:`InputError` if the placement is undetermined.
        """
        if not self:
            raise InputError(f"a camera without a place cannot be put into the site: {self.reason}")
        turn = np.eye(3)
        turn[:2, :2] = self.linear / self.scale
        R = camera.R @ turn.T
        centre = self.scale * turn @ camera.centre_m + np.array([self.x_m, self.y_m, 0.0])
        return camera.lens.posed(R, -R @ centre)


def _drifts(inner: Placement, outer: Placement) -> Drift | None:
    """The drift of a clock against that of the outer site."""
    if outer.drift is None:
        return inner.drift
    own = inner.drift or Drift(0.0, 0.0, outer.drift.at_s - inner.time_offset_s)
    rate = (1 + own.rate) * (1 + outer.drift.rate) - 1
    return Drift(rate, float(np.hypot(own.sigma, outer.drift.sigma)), own.at_s)


def _wrapped(angle_rad: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
    """Angles within (-π, π]."""
    wrapped: np.ndarray = np.asarray(np.pi - (np.pi - angle_rad) % (2 * np.pi))
    return wrapped


def _symmetric(matrix: np.ndarray) -> np.ndarray:
    return (matrix + matrix.T) / 2
