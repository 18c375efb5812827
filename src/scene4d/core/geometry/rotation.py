"""Rotation of a fixed camera from tilt and roll, and back.

World: metres, Z up. Camera: x right, y down, z forward. ``cam_from_world`` is ``[R | t]``.
The heading is free, so the optical axis is made to project onto +Y of the ground.
"""

import numpy as np
from jaxtyping import Float

R_OVERHEAD: Float[np.ndarray, "3 3"] = np.diag([1.0, -1.0, -1.0])
"""``cam_from_world`` of a camera that looks straight down, image top towards +Y."""
R_OVERHEAD.setflags(write=False)
_TOLERANCE = 1e-4


def rotation_from_tilt_roll(tilt_rad: float, roll_rad: float = 0.0) -> Float[np.ndarray, "3 3"]:
    """``R = R_roll · R_pitch · R_overhead`` of Wagner et al. (2019), section 3.

    ``tilt_rad`` is the angle of the optical axis below the horizon, ``pitch = tilt - π/2`` the
    angle off nadir. Raises nothing: every pair of angles is a rotation.
    """
    pitch = tilt_rad - np.pi / 2
    c, s = np.cos(pitch), np.sin(pitch)
    r_pitch = np.array([[1.0, 0.0, 0.0], [0.0, c, -s], [0.0, s, c]])
    c, s = np.cos(roll_rad), np.sin(roll_rad)
    r_roll = np.array([[c, -s, 0.0], [s, c, 0.0], [0.0, 0.0, 1.0]])
    return r_roll @ r_pitch @ R_OVERHEAD


def tilt_roll_from_rotation(R: Float[np.ndarray, "3 3"]) -> tuple[float, float]:
    """Tilt and roll (radians) of ``cam_from_world`` rotation ``R``, whatever its heading.

    With ``up = R · (0, 0, 1)``: ``tilt = asin(-up_z)`` and ``roll = atan2(up_x, -up_y)``.
    """
    up = R[:, 2]
    return float(np.arcsin(np.clip(-up[2], -1.0, 1.0))), float(np.arctan2(up[0], -up[1]))


def is_rotation(R: np.ndarray) -> bool:
    """Whether ``R`` is a proper 3x3 rotation within rounding (1e-4, Frobenius)."""
    return (
        R.shape == (3, 3)
        and bool(np.all(np.abs(R) < 1 + _TOLERANCE))
        and bool(np.linalg.norm(R @ R.T - np.eye(3)) < _TOLERANCE)
        and bool(np.linalg.det(R) > 0)
    )


def rotation_from_quaternion(xyzw: Float[np.ndarray, "4"]) -> Float[np.ndarray, "3 3"]:
    """Rotation matrix of a quaternion given as (x, y, z, w); it is normalised first."""
    x, y, z, w = xyzw / np.linalg.norm(xyzw)
    return np.array(
        [
            [1 - 2 * (y * y + z * z), 2 * (x * y - z * w), 2 * (x * z + y * w)],
            [2 * (x * y + z * w), 1 - 2 * (x * x + z * z), 2 * (y * z - x * w)],
            [2 * (x * z - y * w), 2 * (y * z + x * w), 1 - 2 * (x * x + y * y)],
        ]
    )


def quaternion_from_rotation(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "4"]:
    """Unit quaternion (x, y, z, w), w >= 0, of a rotation matrix (Bar-Itzhack 2000)."""
    (xx, xy, xz), (yx, yy, yz), (zx, zy, zz) = R
    k = np.array(
        [
            [xx - yy - zz, 0.0, 0.0, 0.0],
            [yx + xy, yy - xx - zz, 0.0, 0.0],
            [zx + xz, zy + yz, zz - xx - yy, 0.0],
            [zy - yz, xz - zx, yx - xy, xx + yy + zz],
        ]
    )
    values, vectors = np.linalg.eigh(k / 3.0)
    q = vectors[:, np.argmax(values)]
    return q if q[3] >= 0 else -q


def rotation_vector(R: Float[np.ndarray, "3 3"]) -> Float[np.ndarray, "3"]:
    """Axis times angle (radians, 0 to π) of a rotation matrix, as OpenCV's ``Rodrigues``."""
    *axis, w = quaternion_from_rotation(R)
    length = float(np.linalg.norm(axis))
    return np.array(axis) * (2 * np.arctan2(length, w) / length if length > 0 else 2.0)


def rotation_from_euler_zyx(rx: float, ry: float, rz: float) -> Float[np.ndarray, "3 3"]:
    """``R = Rz(rz) · Ry(ry) · Rx(rx)`` in radians, the order of Tsai's camera files."""
    (cx, cy, cz), (sx, sy, sz) = np.cos([rx, ry, rz]), np.sin([rx, ry, rz])
    r_x = np.array([[1.0, 0.0, 0.0], [0.0, cx, -sx], [0.0, sx, cx]])
    r_y = np.array([[cy, 0.0, sy], [0.0, 1.0, 0.0], [-sy, 0.0, cy]])
    r_z = np.array([[cz, -sz, 0.0], [sz, cz, 0.0], [0.0, 0.0, 1.0]])
    return r_z @ r_y @ r_x
