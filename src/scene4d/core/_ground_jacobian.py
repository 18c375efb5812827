"""How errors of a camera move points on the ground, and the part of it that is a rigid motion."""

import numpy as np

from scene4d.core import geometry
from scene4d.core.camera import Camera


def ground_jacobian(
    camera: Camera, uv: np.ndarray, height_m: np.ndarray
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Ground points (n, 2) at pixels of the footage, on planes at heights (n,), their derivatives
    (n, 2, 7) by the steps of :meth:`Camera.disturbed`, and validity; NaN where invalid.

    With the ray ``w`` in world coordinates a point is ``C + (h - C_Z) w / w_Z``.
    """
    straight, _ = camera.undistort(uv)
    xy, valid = geometry.locate(camera.P, straight, height_m)
    jacobian = np.full((len(uv), 2, 7), np.nan)
    if not valid.any():
        return xy, jacobian, valid
    K, centre = camera.K, camera.centre_m
    ray = np.linalg.solve(K, np.vstack([straight[valid].T, np.ones(valid.sum())]))
    d_world = (camera.R.T @ _ray_slopes(camera, ray)).swapaxes(0, 1)
    world = camera.R.T @ ray
    below = height_m[valid] - centre[2]
    per_height = world[:2] / world[2]
    moved = (d_world[:2] - per_height[:, None] * d_world[2]) * (below / world[2])
    moved[:, 3] = -centre[2] * per_height
    jacobian[valid] = moved.transpose(2, 0, 1)
    return xy, jacobian, valid


def _ray_slopes(camera: Camera, ray: np.ndarray) -> np.ndarray:
    """Derivatives (7, 3, n) of rays ``(x, y, 1)`` through fixed pixels, in the camera's frame.

    The camera turns by tilt about its rolled x axis and by roll about its optical axis, and what
    is fixed in the world turns the other way. The height moves no ray.
    """
    K, half_diagonal = camera.K, np.hypot(*camera.image_size) / 2
    by_x, by_y, by_first, by_focal = geometry.straightening_slopes(ray[:2].T, camera.distortion)
    c, s = np.cos(camera.roll_rad), np.sin(camera.roll_rad)
    x, y, _ = ray
    slopes = np.zeros((7, 3, ray.shape[1]))
    slopes[0, :2] = by_focal
    slopes[1] = -s + 0 * x, c + 0 * x, s * x - c * y
    slopes[2, :2] = y, -x
    slopes[4, :2] = by_first * (K[0, 0] / half_diagonal) ** 2
    slopes[5, :2] = -half_diagonal / K[0, 0] * by_x
    slopes[6, :2] = half_diagonal / K[1, 1] * (K[0, 1] / K[0, 0] * by_x - by_y)
    return slopes


def rigid_motions(xy: np.ndarray) -> np.ndarray:
    """Displacements (n, 2, 3) of ground points by shifts along X and Y and by a small turn."""
    motions = np.zeros((len(xy), 2, 3))
    motions[:, 0, 0] = motions[:, 1, 1] = 1.0
    motions[:, 0, 2], motions[:, 1, 2] = -xy[:, 1], xy[:, 0]
    return motions


def common_motion(xy: np.ndarray, jacobian: np.ndarray) -> np.ndarray:
    """Derivatives (3, 7) of the rigid motion nearest to those of ground points (n, 2, 7)."""
    if len(xy) < 2:
        return np.zeros((3, jacobian.shape[-1]))
    design, answer = rigid_motions(xy).reshape(-1, 3), jacobian.reshape(-1, jacobian.shape[-1])
    motion: np.ndarray = np.linalg.lstsq(design, answer, rcond=None)[0]
    return motion


def propagated(jacobian: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    return jacobian @ covariance @ np.swapaxes(jacobian, -1, -2)


def sigma_m(jacobian: np.ndarray, covariance: np.ndarray) -> np.ndarray:
    """Root of the trace of :func:`propagated`, for derivatives (n, 2, 7)."""
    flat = jacobian.reshape(-1, len(covariance))
    variance = np.einsum("np,np->n", flat @ covariance, flat).reshape(-1, 2).sum(axis=1)
    sigma_m: np.ndarray = np.sqrt(np.maximum(variance, 0.0))
    return sigma_m
