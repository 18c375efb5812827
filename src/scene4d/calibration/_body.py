"""The forward model: where the top of a person's head appears, given where the feet do.

Everything happens in camera coordinates, where the pose is one vector: ``up``, the world's up
direction, ``up = (sin ρ cos τ, -cos ρ cos τ, -sin τ)`` for tilt τ and roll ρ. The ray through the
feet is ``d``; it meets the plane ``Z = foot_height`` at depth ``(h - z_f) / (-up · d)``, and the
head stands ``H - z_f`` above. Dividing by the depth, the ray through the head is

    q = d + m [ (H - z_f - r_h) up + r_b b + r_h n ],    m = -(up · d) / (h - z_f),

with no reference to the ground coordinates. For keypoints ``r_b = r_h = 0``. A box is the outline
of a body instead: its bottom edge touches the near rim of the body (``r_b`` before its axis, along
the horizontal direction ``b`` in which the image's rows are crossed) and its top edge is tangent to
the head (a sphere of radius ``r_h``, touched in the direction ``n`` at right angles to the row).

Derivatives are carried along by the chain rule (forward mode): a quantity with n columns has a
derivative with a leading axis over the parameters (log f, tilt, roll, log h, D).

Image points are centred on the principal point and divided by half the image's diagonal, so that
the corners lie at radius 1 and f is in that unit too. The lens is ``r_d = r_u (1 + D r_u²)``: D is
the fraction by which the image's corner is displaced, and does not depend on the focal length.
OpenCV's coefficient is ``k1 = D f²`` with f in half diagonals.
"""

from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.body import BODY_RADIUS_M, HEAD_RADIUS_M

N_PARAMETERS = 5
FOCAL, TILT, ROLL, HEIGHT, CORNER = range(N_PARAMETERS)


@dataclass(frozen=True, eq=False)
class Points:
    """Image points of a set of people, centred and in half diagonals (module docstring), (2, n)."""

    foot: Float[np.ndarray, "2 n"]
    head: Float[np.ndarray, "2 n"]
    from_box: Bool[np.ndarray, "n"]
    foot_height_m: float

    @cached_property
    def has_boxes(self) -> bool:
        """Whether any of the people is a box."""
        return bool(self.from_box.any())

    @cached_property
    def seen(self) -> Float[np.ndarray, "2 n"]:
        """From the feet to the head."""
        return self.head - self.foot

    @cached_property
    def seen2(self) -> Float[np.ndarray, "n"]:
        """Squared length of the people."""
        return self.seen[0] ** 2 + self.seen[1] ** 2

    def select(self, rows: np.ndarray) -> "Points":
        """The given people, as a mask or as indices."""
        return Points(
            self.foot[:, rows], self.head[:, rows], self.from_box[rows], self.foot_height_m
        )


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted heads (2, n), centred and in half diagonals, with derivatives.

    ``by_parameter`` is (5, 2, n) over (log f, tilt, roll, log h, D); ``by_height`` (2, n) is the
    derivative by the person's height in metres; ``valid`` is false where the foot lies at or
    above the horizon or the head behind the camera.
    """

    head: Float[np.ndarray, "2 n"]
    by_parameter: Float[np.ndarray, "5 2 n"]
    by_height: Float[np.ndarray, "2 n"]
    valid: Bool[np.ndarray, "n"]


def up_vector(tilt: float, roll: float) -> tuple[np.ndarray, np.ndarray]:
    """World's up in camera coordinates (3,), and its derivatives (5, 3) by the parameters."""
    ct, st, cr, sr = np.cos(tilt), np.sin(tilt), np.cos(roll), np.sin(roll)
    derivative = np.zeros((N_PARAMETERS, 3))
    derivative[TILT] = (-sr * st, cr * st, -ct)
    derivative[ROLL] = (cr * ct, sr * ct, 0.0)
    return np.array([sr * ct, -cr * ct, -st]), derivative


def undistort(
    points: Float[np.ndarray, "2 n"], corner: float
) -> tuple[Float[np.ndarray, "2 n"], Float[np.ndarray, "2 n"], Bool[np.ndarray, "n"]]:
    """Undistorted points, their derivative by ``corner`` (D), and which points have one.

    Solves ``r (1 + D r²) = r_d`` on the branch through zero by Newton's method. With D < 0
    (barrel) the model folds back at ``r² = -1 / (3 D)``: farther points are invalid.
    """
    r2_d = (points * points).sum(axis=0)
    if corner == 0.0:
        return points, -points * r2_d, np.ones(len(r2_d), bool)
    if corner < 0:
        fold2 = -1 / (3 * corner)
        valid = r2_d < 0.95 * fold2 * 4 / 9
        r2_d = np.minimum(r2_d, 0.95 * fold2 * 4 / 9)
    else:
        valid = np.ones(len(r2_d), bool)
    # Newton on the gain g = r_u / r_d, from below the root: g (1 + D r_d² g²) = 1.
    k = corner * r2_d
    gain = np.ones_like(k)
    for _ in range(7):
        gain = gain - (gain * (1 + k * gain * gain) - 1) / (1 + 3 * k * gain * gain)
    r2_u = r2_d * gain * gain
    return points * gain, -points * (gain * r2_u / (1 + 3 * corner * r2_u)), valid


def _unit(v: np.ndarray, dv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``v / |v|`` over the first axis of (3, n), and its derivative from (p, 3, n)."""
    length = np.sqrt((v * v).sum(axis=0))
    unit = v / length
    return unit, (dv - unit * (dv * unit).sum(axis=1, keepdims=True)) / length


def predict_heads(
    parameters: Float[np.ndarray, "5"],
    points: Points,
    height_m: float | Float[np.ndarray, "n"],
) -> Prediction:
    """Heads predicted from the feet, with analytic derivatives (module docstring)."""
    log_f, tilt, roll, log_h, corner = parameters
    focal, camera_height = np.exp(log_f), np.exp(log_h)
    up, d_up = up_vector(tilt, roll)
    n = points.foot.shape[1]
    foot, foot_by_corner, valid = undistort(points.foot, corner)
    xy = foot / focal
    d_xy = np.stack([-xy, foot_by_corner / focal])  # by log f and by D

    down = -(up[0] * xy[0] + up[1] * xy[1] + up[2])  # -(up · d), positive below the horizon
    valid = valid & (down > 1e-9)
    d_down = -(d_up[:, 0, None] * xy[0] + d_up[:, 1, None] * xy[1] + d_up[:, 2, None])
    d_down[FOCAL] -= up[0] * d_xy[0, 0] + up[1] * d_xy[0, 1]
    d_down[CORNER] -= up[0] * d_xy[1, 0] + up[1] * d_xy[1, 1]

    foot_z: float | np.ndarray = points.foot_height_m
    top: float | np.ndarray = height_m
    if points.has_boxes:
        foot_z = np.where(points.from_box, 0.0, points.foot_height_m)
        top = height_m - np.where(points.from_box, HEAD_RADIUS_M, 0.0)
    clearance = camera_height - foot_z
    scale = down / clearance  # m of the module docstring
    d_scale = d_down / clearance
    d_scale[HEIGHT] -= scale * camera_height / clearance

    q = np.empty((3, n))
    d_q = np.empty((N_PARAMETERS, 3, n))
    rise = scale * (top - foot_z)
    d_rise = d_scale * (top - foot_z)
    for axis in range(3):
        q[axis] = rise * up[axis]
        d_q[:, axis] = d_rise * up[axis] + rise * d_up[:, axis, None]
    q[:2] += xy
    q[2] += 1.0
    d_q[FOCAL, :2] += d_xy[0]
    d_q[CORNER, :2] += d_xy[1]
    by_height = scale * up[:, None]
    if points.has_boxes:
        _add_outline(
            q, d_q, by_height, points.from_box, xy[1], d_xy[:, 1], up, d_up, scale, d_scale
        )

    valid = valid & (q[2] > 1e-6)
    depth = np.where(valid, q[2], 1.0)
    uv = q[:2] / depth
    d_uv = (d_q[:, :2] - uv * d_q[:, 2:3]) * (focal / depth)
    h_uv = (by_height[:2] - uv * by_height[2]) * (focal / depth)
    uv = uv * focal
    d_uv[FOCAL] += uv
    if corner == 0.0:
        d_uv[CORNER] += uv * (uv * uv).sum(axis=0)
    else:
        uv, d_uv, h_uv = _distort(uv, d_uv, h_uv, corner)
    return Prediction(uv, d_uv, h_uv, valid)


def _add_outline(
    q: np.ndarray, d_q: np.ndarray, by_height: np.ndarray, rows: np.ndarray, y: np.ndarray,
    d_y: np.ndarray, up: np.ndarray, d_up: np.ndarray, scale: np.ndarray, d_scale: np.ndarray,
) -> None:  # fmt: skip
    """Add ``m (r_b b + r_h n)`` and its derivatives to the people that are boxes, in place.

    ``y`` (n,) is the image row of the feet, ``d_y`` (2, n) its derivatives by log f and D.
    """
    m, d_m, y = scale[rows], d_scale[:, rows], y[rows]
    # The plane of sight of the row has the normal (0, 1, -y); the lowest point of the rim lies
    # where it points, as far as that is horizontal.
    d_row = np.zeros((N_PARAMETERS, 3, len(m)))
    d_row[FOCAL, 2], d_row[CORNER, 2] = -d_y[0][rows], -d_y[1][rows]
    row = np.stack([np.zeros_like(y), np.ones_like(y), -y])
    along = up @ row
    d_along = np.einsum("pi,in->pn", d_up, row) + up[2] * d_row[:, 2]
    b, d_b = _unit(
        up[:, None] * along - row,
        d_up[:, :, None] * along + up[:, None] * d_along[:, None] - d_row,
    )
    centre = q[:, rows] + BODY_RADIUS_M * m * b
    d_centre = np.empty((N_PARAMETERS + 1, 3, len(m)))  # the last by the person's height
    d_centre[:-1] = d_q[:, :, rows] + BODY_RADIUS_M * (d_m[:, None] * b + m * d_b)
    d_centre[-1] = by_height[:, rows]

    # A row is a plane through the x axis: it touches the sphere at right angles to (c_y, c_z).
    c = np.stack([np.zeros_like(m), -centre[2], centre[1]])
    d_c = np.zeros_like(d_centre)
    d_c[:, 1], d_c[:, 2] = -d_centre[:, 2], d_centre[:, 1]
    n, d_n = _unit(c, d_c)
    q[:, rows] = centre + HEAD_RADIUS_M * m * n
    d_q[:, :, rows] = d_centre[:-1] + HEAD_RADIUS_M * (d_m[:, None] * n + m * d_n[:-1])
    by_height[:, rows] = d_centre[-1] + HEAD_RADIUS_M * m * d_n[-1]


def _distort(
    uv: np.ndarray, d_uv: np.ndarray, h_uv: np.ndarray, corner: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Apply ``x (1 + D r²)`` to points and to their derivatives."""
    r2 = (uv * uv).sum(axis=0)
    gain = 1 + corner * r2
    d_out = d_uv * gain + uv * (2 * corner) * (d_uv * uv).sum(axis=1, keepdims=True)
    d_out[CORNER] += uv * r2
    h_out = h_uv * gain + uv * (2 * corner) * (h_uv * uv).sum(axis=0)
    return uv * gain, d_out, h_out
