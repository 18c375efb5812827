"""How errors of a camera move points on the ground, and the part of it that is a rigid motion."""

import numpy as np


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
    sigma_m: np.ndarray = np.sqrt(np.trace(propagated(jacobian, covariance), axis1=1, axis2=2))
    return sigma_m
