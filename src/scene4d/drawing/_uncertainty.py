"""The covariance of a calibration, carried over to what is shown (first order)."""

from collections.abc import Callable

import numpy as np
from jaxtyping import Float

from scene4d.core.camera import Camera

_STEP = 1e-4
Z95 = 1.959964
"""Half width of a Gaussian's 95 % interval in standard deviations."""


def propagated(
    camera: Camera,
    covariance: Float[np.ndarray, "p p"],
    function: Callable[[Camera], Float[np.ndarray, "n"]],
) -> Float[np.ndarray, "n"]:
    """Standard deviation of ``function(camera)``: ``sqrt(J C Jᵀ)`` with central differences."""
    moves = [m for m in np.eye(len(covariance)) * _STEP if covariance[m > 0, m > 0] > 0]
    if not moves:
        return np.zeros(len(function(camera)))
    used = np.flatnonzero(np.sum(moves, axis=0))
    J = np.column_stack(
        [
            (function(camera.disturbed(m)) - function(camera.disturbed(-m))) / (2 * _STEP)
            for m in moves
        ]
    )
    variance = np.einsum("ni,ij,nj->n", J, covariance[np.ix_(used, used)], J)
    return np.sqrt(np.maximum(variance, 0.0))


def field_of_view(camera: Camera) -> Float[np.ndarray, "2"]:
    """Horizontal and vertical angle (radians) that the frame's middle row and column see.

    Through the lens: with distortion it differs from ``2 atan(w / 2f)``. NaN where the lens model
    does not reach the border.
    """
    width, height = camera.image_size
    cu, cv = (width - 1) / 2, (height - 1) / 2
    ends = np.array([[-0.5, cv], [width - 0.5, cv], [cu, -0.5], [cu, height - 0.5]])
    ray = rays(camera, ends)
    cosine = np.sum(ray[[0, 2]] * ray[[1, 3]], axis=1)
    return np.arccos(np.clip(cosine, -1, 1))


def rays(camera: Camera, uv: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 3"]:
    """Unit viewing directions, in camera coordinates, of pixels of the footage."""
    undistorted, _ = camera.undistort(uv)
    ray = np.column_stack([undistorted, np.ones(len(uv))]) @ np.linalg.inv(camera.K).T
    return ray / np.linalg.norm(ray, axis=1, keepdims=True)
