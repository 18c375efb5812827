"""Residuals of landmarks in the solver's frame, with derivatives and covariances.

    ground point    where the camera expects it less where it was seen       2 numbers
    upright         the same of its top, predicted from its foot             2
    distance        log of the expected over the measured distance           1

The covariance holds the error of the pixels and that of the measurement, carried to first order.
Ground points stand in a frame of their own, (X, Y) -> Rot(a) (X + s_x, Y + s_y) in the camera's
ground frame: three columns behind the seven of the camera.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._body import (
    ALL,
    CENTRE_U,
    CENTRE_V,
    CORNER,
    FOCAL,
    HEIGHT,
    N_PARAMETERS,
    ROLL,
    TILT,
    Points,
    foot_rays,
    on_footage,
    predict_heads,
    up_vector,
)
from scene4d.calibration._case import ImageFrame
from scene4d.calibration._lines import directions
from scene4d.core.errors import InputError

_MISTYPED = 0.01
"""Probability that a landmark is mistyped or clicked in the wrong place. Chosen."""
_LOST = 1e3
"""Half diagonals by which a landmark is off that the camera does not see at all."""
N_COLUMNS = N_PARAMETERS + 3
TURN, SHIFT = N_PARAMETERS, slice(N_PARAMETERS + 1, N_COLUMNS)
FRAME = slice(N_PARAMETERS, N_COLUMNS)


@dataclass(frozen=True, eq=False)
class Pixels:
    """Pixels in the solver's frame (2, n), with their covariances (n, 2, 2), taken with a
    ``fisheye`` lens or with an ordinary one.
    """

    at: Float[np.ndarray, "2 n"]
    covariance: Float[np.ndarray, "n 2 2"]
    fisheye: bool = False

    @classmethod
    def of(
        cls, frame: ImageFrame, uv: Float[np.ndarray, "n 2"], sigma_px: Float[np.ndarray, "n"]
    ) -> "Pixels":
        """Pixels of the footage and their errors, as the lens straightens them."""
        at = frame.straight(uv)
        by_u, by_v = (frame.straight(uv + d) - frame.straight(uv - d) for d in np.eye(2) / 2)
        bent = ~np.isfinite(at + by_u + by_v).all(axis=0)
        if bent.any():
            u, v = uv[np.flatnonzero(bent)[0]]
            raise InputError(
                f"landmarks: the lens has no ray at the pixel ({u:g}, {v:g}); leave it out"
            )
        jacobian = np.stack([by_u, by_v]).transpose(2, 1, 0)
        square = jacobian @ jacobian.transpose(0, 2, 1)
        return cls(at, square * (sigma_px**2)[:, None, None])

    def select(self, rows: Bool[np.ndarray, "n"]) -> "Pixels":
        """Some of them."""
        return replace(self, at=self.at[:, rows], covariance=self.covariance[rows])

    def as_feet(self) -> Points:
        """These pixels as feet on the ground."""
        return Points(self.at, self.at, np.zeros(self.at.shape[1], bool), 0.0, self.fisheye)


@dataclass(frozen=True, eq=False)
class Residuals:
    """Residuals (n, k) of one kind of landmark, derivatives (n, k, 10) by camera and frame,
    covariances (n, k, k), and the logarithm of the density, in the same units, of a mistyped one.
    """

    value: Float[np.ndarray, "n k"]
    by: Float[np.ndarray, "n k 10"]
    covariance: Float[np.ndarray, "n k k"]
    log_stray: float = 0.0

    @classmethod
    def none(cls, k: int) -> "Residuals":
        """Those of no landmarks."""
        return cls(np.zeros((0, k)), np.zeros((0, k, N_COLUMNS)), np.zeros((0, k, k)))

    @property
    def off2(self) -> Float[np.ndarray, "n"]:
        """Squared distances in sigmas."""
        solved = np.linalg.solve(self.covariance, self.value[:, :, None])[:, :, 0]
        off2: np.ndarray = (self.value * solved).sum(axis=1)
        return off2


@dataclass(frozen=True, eq=False)
class Weighed:
    """Cost (-2 log p), half gradient (10,), half second derivative (10, 10), and the probability
    of each landmark to be right.
    """

    cost: float
    gradient: Float[np.ndarray, "10"]
    hessian: Float[np.ndarray, "10 10"]
    right: Float[np.ndarray, "n"]


def weighed(residuals: Residuals, *, robust: bool) -> Weighed:
    """Residuals as Gaussian, or ``robust`` as a mixture with a uniform density.

    The gradient leaves out that the covariance changes with the camera, which moves the answer by
    less than a hundredth of its standard deviation.
    """
    k = residuals.value.shape[1]
    log_det = np.linalg.slogdet(residuals.covariance)[1]
    cost = residuals.off2 + log_det + k * np.log(2 * np.pi)
    right = np.ones(len(cost))
    if robust:
        good = np.log(1 - _MISTYPED) - 0.5 * cost
        total = np.logaddexp(good, np.log(_MISTYPED) + residuals.log_stray)
        right, cost = np.exp(good - total), -2 * total
    pulled = np.linalg.solve(residuals.covariance, residuals.by) * right[:, None, None]
    return Weighed(
        float(cost.sum()),
        np.einsum("nkp,nk->p", pulled, residuals.value),
        np.einsum("nkp,nkq->pq", pulled, residuals.by),
        right,
    )


def of_points(
    parameters: Float[np.ndarray, "7"], frame: Float[np.ndarray, "3"], seen: Pixels,
    xyz_m: Float[np.ndarray, "3 n"], sigma_m: Float[np.ndarray, "n"], log_stray: float,
) -> Residuals:  # fmt: skip
    """Of ground points at ``xyz_m`` in their frame, which is where ``frame`` says."""
    (up, along, across), d_axes = directions(parameters[TILT], parameters[ROLL], frame[0])
    focal, height = np.exp(parameters[FOCAL]), np.exp(parameters[HEIGHT])
    x, y, z = xyz_m[0] + frame[1], xyz_m[1] + frame[2], xyz_m[2] - height
    # Camera coordinates, by camera, frame, and by the point itself along the camera's axes.
    q = np.outer(along, x) + np.outer(across, y) + np.outer(up, z)
    d_q = np.zeros((N_COLUMNS + 3, 3, len(x)))
    for column in (TILT, ROLL, TURN):
        of_up, of_along, of_across = d_axes[:, column]
        d_q[column] = np.outer(of_along, x) + np.outer(of_across, y) + np.outer(of_up, z)
    d_q[HEIGHT] = -height * up[:, None]
    d_q[SHIFT] = np.stack([along, across])[:, :, None]
    d_q[N_COLUMNS:] = np.eye(3)[:, :, None]
    ahead = q[2] > 1e-6
    depth = np.where(ahead, q[2], 1.0)
    slope = q[:2] / depth
    d_uv = focal / depth * (d_q[:, :2] - slope * d_q[:, 2:3])
    uv = focal * slope
    d_uv[FOCAL] += uv
    ahead &= seen.fisheye | (1 + 3 * parameters[CORNER] * (uv * uv).sum(axis=0) > 0)
    none = np.zeros_like(uv)
    uv, d_uv, _ = on_footage(parameters, ALL, uv, d_uv, none, fisheye=seen.fisheye)
    value = np.where(ahead, uv - seen.at, _LOST).T
    d_uv = np.where(ahead, d_uv, 0.0).transpose(2, 1, 0)
    by, by_xyz = d_uv[:, :, :N_COLUMNS], d_uv[:, :, N_COLUMNS:] * sigma_m[:, None, None]
    covariance = seen.covariance + by_xyz @ by_xyz.transpose(0, 2, 1)
    return Residuals(value, by, covariance, log_stray)


def of_uprights(
    parameters: Float[np.ndarray, "7"], feet: Pixels, tops: Pixels,
    height_m: Float[np.ndarray, "n"], sigma_m: Float[np.ndarray, "n"], log_stray: float,
) -> Residuals:  # fmt: skip
    """Of upright things with known height."""
    predicted = predict_heads(parameters, feet.as_feet(), height_m)
    value = np.where(predicted.valid, predicted.head - tops.at, _LOST).T
    by = np.zeros((len(height_m), 2, N_COLUMNS))
    by[:, :, :N_PARAMETERS] = np.where(predicted.valid, predicted.by_parameter, 0.0).T
    # Moving the principal point and the foot together moves the top by the same.
    by_foot = np.eye(2) - by[:, :, CENTRE_U : CENTRE_V + 1]
    by_height = (predicted.by_height * sigma_m).T[:, :, None]
    covariance = tops.covariance + by_foot @ feet.covariance @ by_foot.transpose(0, 2, 1)
    covariance = covariance + by_height @ by_height.transpose(0, 2, 1)
    return Residuals(value, by, covariance, log_stray)


def of_distances(
    parameters: Float[np.ndarray, "7"], ends: tuple[Pixels, Pixels],
    distance_m: Float[np.ndarray, "n"], sigma_m: Float[np.ndarray, "n"], log_stray: float,
) -> Residuals:  # fmt: skip
    """Of distances between two points of the ground each: of their logarithms."""
    (a, d_a, here), (b, d_b, there) = (_on_ground(parameters, end.as_feet()) for end in ends)
    valid = here & there
    span = a - b
    length2 = np.where(valid, (span * span).sum(axis=0), 1.0)
    value = np.where(valid, 0.5 * np.log(length2) - np.log(distance_m), _LOST)[:, None]

    def of_log(d_span: np.ndarray) -> np.ndarray:
        return np.where(valid, (d_span * span).sum(axis=1) / length2, 0.0)

    by = np.zeros((len(distance_m), 1, N_COLUMNS))
    by[:, 0, :N_PARAMETERS] = of_log(d_a - d_b).T
    variance = (sigma_m / distance_m) ** 2
    for end, d_end in zip(ends, (d_a, d_b), strict=True):
        by_pixel = of_log(d_end[CENTRE_U : CENTRE_V + 1])
        variance = variance + np.einsum("in,nij,jn->n", by_pixel, end.covariance, by_pixel)
    return Residuals(value, by, variance[:, None, None], log_stray)


def _on_ground(
    parameters: np.ndarray, feet: Points
) -> tuple[Float[np.ndarray, "3 n"], Float[np.ndarray, "7 3 n"], np.ndarray]:
    """Ground points in camera coordinates, derivatives by the camera, and which there are."""
    up, d_up = up_vector(parameters[TILT], parameters[ROLL])
    rays, height = foot_rays(parameters, feet, ALL), np.exp(parameters[HEIGHT])
    ray = np.vstack([rays.points, np.ones(rays.points.shape[1])])
    down = -(up @ ray)
    valid = rays.valid & (down > 1e-6)
    down = np.where(valid, down, 1.0)
    d_ray = np.zeros((N_PARAMETERS, *ray.shape))
    for column, moved in rays.by.items():
        d_ray[column, :2] = moved
    d_down = -(np.einsum("i,pin->pn", up, d_ray) + d_up @ ray)
    at = height * ray / down
    d_at = (height * d_ray - at * d_down[:, None]) / down
    d_at[HEIGHT] += at
    return at, d_at, valid
