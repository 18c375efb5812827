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

Derivatives are carried along by the chain rule (forward mode), for those parameters that are asked
for: a quantity with n columns has a derivative with a leading axis over them.

Image points are centred on the assumed principal point and divided by half the image's diagonal,
so that the corners lie at radius 1 and f is in that unit too; the true principal point lies at
(cu, cv) in these coordinates. The lens is ``r_d = r_u (1 + D r_u²)``: D is
the fraction by which the image's corner is displaced, and does not depend on the focal length.
OpenCV's coefficient is ``k1 = D f²`` with f in half diagonals. A fisheye lens has
``r_d = r (1 + D r²)`` with ``r = f θ`` instead (:mod:`._equidistant`).
"""

from dataclasses import dataclass, replace
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float

from scene4d.calibration._equidistant import curled, flattened
from scene4d.core.body import BODY_RADIUS_M, HEAD_RADIUS_M

N_PARAMETERS = 7
FOCAL, TILT, ROLL, HEIGHT, CORNER, CENTRE_U, CENTRE_V = range(N_PARAMETERS)
"""log f, tilt, roll, log h, D, and the principal point."""
CENTRE = slice(CENTRE_U, CENTRE_V + 1)
ALL = tuple(range(N_PARAMETERS))
_LENS = slice(CORNER, N_PARAMETERS)


@dataclass(frozen=True, eq=False)
class Points:
    """Image points of a set of people, centred and in half diagonals (module docstring), (2, n),
    taken with a ``fisheye`` lens or with an ordinary one.

    ``ground_m`` is the height of the ground on which each stands, 0 for the camera's own;
    ``ground_sigma_m`` is the standard deviation of the others', which err together.
    """

    foot: Float[np.ndarray, "2 n"]
    head: Float[np.ndarray, "2 n"]
    from_box: Bool[np.ndarray, "n"]
    foot_height_m: float
    fisheye: bool = False
    ground_m: float | Float[np.ndarray, "n"] = 0.0
    ground_sigma_m: float = 0.0

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
        ground_m = self.ground_m[rows] if isinstance(self.ground_m, np.ndarray) else self.ground_m
        return replace(
            self,
            foot=self.foot[:, rows],
            head=self.head[:, rows],
            from_box=self.from_box[rows],
            ground_m=ground_m,
        )


@dataclass(frozen=True, eq=False)
class Prediction:
    """Predicted heads (2, n), centred and in half diagonals, with derivatives.

    ``by_parameter`` is (p, 2, n) over the parameters asked for; ``by_height`` (2, n) is the
    derivative by the person's height in metres; ``valid`` is false where the foot lies at or
    above the horizon or the head behind the camera.
    """

    head: Float[np.ndarray, "2 n"]
    by_parameter: Float[np.ndarray, "p 2 n"]
    by_height: Float[np.ndarray, "2 n"]
    valid: Bool[np.ndarray, "n"]


def up_vector(tilt: float, roll: float) -> tuple[np.ndarray, np.ndarray]:
    """World's up in camera coordinates (3,), and its derivatives (7, 3) by the parameters."""
    ct, st, cr, sr = np.cos(tilt), np.sin(tilt), np.cos(roll), np.sin(roll)
    derivative = np.zeros((N_PARAMETERS, 3))
    derivative[TILT] = (-sr * st, cr * st, -ct)
    derivative[ROLL] = (cr * ct, sr * ct, 0.0)
    return np.array([sr * ct, -cr * ct, -st]), derivative


def undistort(
    points: Float[np.ndarray, "2 n"], corner: float
) -> tuple[Float[np.ndarray, "2 n"], Float[np.ndarray, "2 n"], Bool[np.ndarray, "n"]]:
    """Undistorted points, their derivative by ``corner`` (D), and which points have one.

    Solves ``r (1 + D r²) = r_d`` on the branch through zero in closed form (Viète for D < 0, its
    hyperbolic counterpart for D > 0). With D < 0 (barrel) the model folds back at
    ``r² = -1 / (3 D)``: farther points are invalid.
    """
    r2_d = (points * points).sum(axis=0)
    valid = np.ones(len(r2_d), bool)
    if corner == 0.0:
        return points, -points * r2_d, valid
    if corner < 0:
        farthest2 = -0.95 * 4 / (27 * corner)
        valid = r2_d < farthest2
        r2_d = np.minimum(r2_d, farthest2)
    s = np.sqrt(np.maximum(6.75 * abs(corner) * r2_d, 1e-60))  # 1 at the fold
    turned = np.sin(np.arcsin(s) / 3) if corner < 0 else np.sinh(np.arcsinh(s) / 3)
    gain = 3 * turned / s
    r2_u = r2_d * gain * gain
    return points * gain, -points * (gain * r2_u / (1 + 3 * corner * r2_u)), valid


def undistort_jacobian(
    points: Float[np.ndarray, "2 n"], undistorted: Float[np.ndarray, "2 n"], corner: float
) -> tuple[Float[np.ndarray, "2 n"], Float[np.ndarray, "2 n"]]:
    """Derivatives of :func:`undistort` by x and by y of the distorted ``points``."""
    gain = 1 / (1 + corner * (undistorted * undistorted).sum(axis=0))
    slope = -2 * corner * gain**3 / (1 + 3 * corner * (points * points).sum(axis=0) * gain**2)
    by_x, by_y = slope * points[0] * points, slope * points[1] * points
    by_x[0] += gain
    by_y[1] += gain
    return by_x, by_y


@dataclass(frozen=True, eq=False)
class Straightened:
    """Points (2, n) as a pinhole camera shows them about the principal point, of the same focal
    length or (:func:`foot_rays`) of 1, with derivatives (2, n) by those parameters that move them.
    """

    points: Float[np.ndarray, "2 n"]
    by: dict[int, np.ndarray]
    valid: Bool[np.ndarray, "n"]


def straightened(
    points: Float[np.ndarray, "2 n"],
    parameters: Float[np.ndarray, "p"],
    columns: tuple[int, ...] = ALL,
    *,
    fisheye: bool = False,
) -> Straightened:
    """Points of the footage without principal point and lens (module docstring), with derivatives
    by at least the ``columns`` that move them.
    """
    corner, centre = parameters[CORNER], parameters[CENTRE]
    if not fisheye and _plain(parameters, columns):
        return Straightened(points, {}, np.ones(points.shape[1], bool))
    seen = points - centre[:, None] if centre.any() else points
    straight, by_corner, valid = undistort(seen, corner)
    by = {CORNER: by_corner}
    if CENTRE_U in columns or CENTRE_V in columns:
        by_x, by_y = undistort_jacobian(seen, straight, corner)
        by[CENTRE_U], by[CENTRE_V] = -by_x, -by_y
    if fisheye:
        flat = flattened(straight, np.exp(parameters[FOCAL]))
        by = {FOCAL: flat.by_log_focal} | {column: flat.carry(d) for column, d in by.items()}
        straight, valid = flat.points, valid & flat.valid
    return Straightened(straight, by, valid)


def _plain(parameters: np.ndarray, columns: tuple[int, ...]) -> bool:
    """Whether there is neither distortion nor a principal point, and neither is asked for."""
    return not parameters[_LENS].any() and max(columns, default=FOCAL) < CORNER


def _unit(v: np.ndarray, dv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """``v / |v|`` over the first axis of (3, n), and its derivative from (p, 3, n)."""
    length = np.sqrt((v * v).sum(axis=0))
    unit = v / length
    return unit, (dv - unit * (dv * unit).sum(axis=1, keepdims=True)) / length


def foot_rays(parameters: np.ndarray, points: Points, columns: tuple[int, ...]) -> Straightened:
    """Rays ``(x, y, 1)`` through the feet, with derivatives by the ``columns`` that move them."""
    focal = np.exp(parameters[FOCAL])
    straight = straightened(points.foot, parameters, columns, fisheye=points.fisheye)
    xy = straight.points / focal
    by = {column: d / focal for column, d in straight.by.items()}
    by[FOCAL] = by[FOCAL] - xy if FOCAL in by else -xy
    by = {column: d for column, d in by.items() if column in columns}
    return Straightened(xy, by, straight.valid)


def predict_heads(
    parameters: Float[np.ndarray, "7"],
    points: Points,
    height_m: float | Float[np.ndarray, "n"],
    columns: tuple[int, ...] = ALL,
) -> Prediction:
    """Heads predicted from the feet, with derivatives by the parameters ``columns``."""
    focal, camera_height = np.exp(parameters[FOCAL]), np.exp(parameters[HEIGHT])
    up, d_up = up_vector(parameters[TILT], parameters[ROLL])
    rays = foot_rays(parameters, points, columns)
    xy = rays.points
    down = -(up[0] * xy[0] + up[1] * xy[1] + up[2])  # -(up · d), positive below the horizon
    valid = rays.valid & (down > 1e-9)

    foot_z: float | np.ndarray = points.foot_height_m
    top: float | np.ndarray = height_m
    if points.has_boxes:
        foot_z = np.where(points.from_box, 0.0, points.foot_height_m)
        top = height_m - np.where(points.from_box, HEAD_RADIUS_M, 0.0)
    clearance = camera_height - points.ground_m - foot_z
    scale = down / clearance  # m of the module docstring
    turned = d_up[list(columns)]
    d_down = turned[:, :2] @ xy + turned[:, 2:]
    for column, d_xy in rays.by.items():
        d_down[columns.index(column)] += up[0] * d_xy[0] + up[1] * d_xy[1]
    d_scale = -d_down / clearance
    if HEIGHT in columns:
        d_scale[columns.index(HEIGHT)] = -scale * camera_height / clearance

    span = np.broadcast_to(top - foot_z, down.shape)
    q = (scale * span) * up[:, None]
    q[:2] += xy
    q[2] += 1.0
    d_outline = None
    if points.has_boxes:
        q[:, points.from_box], d_outline = _outline(
            q, points.from_box, span, rays, columns, up, d_up, scale, d_scale
        )
    valid = valid & (q[2] > 1e-6) & (clearance > 0)
    depth = np.where(valid, q[2], 1.0)
    uv = q[:2] / depth
    zoom = focal / depth

    by_scale = zoom * (up[:2, None] - uv * up[2])
    d_uv = (span * by_scale) * d_scale[:, None]
    for column, d_xy in rays.by.items():
        d_uv[columns.index(column)] += zoom * d_xy
    for column in (TILT, ROLL):
        if column in columns:
            by_up = d_up[column, :2, None] - uv * d_up[column, 2]
            d_uv[columns.index(column)] += (scale * span * zoom) * by_up
    h_uv = scale * by_scale
    if d_outline is not None:
        rows = points.from_box
        away = d_outline[:, :2] - uv[:, rows] * d_outline[:, 2:3]
        d_uv[:, :, rows], h_uv[:, rows] = zoom[rows] * away[:-1], zoom[rows] * away[-1]
    uv = uv * focal
    if FOCAL in columns:
        d_uv[columns.index(FOCAL)] += uv
    uv, d_uv, h_uv = on_footage(parameters, columns, uv, d_uv, h_uv, fisheye=points.fisheye)
    return Prediction(uv, d_uv, h_uv, valid)


def _outline(
    q: np.ndarray, rows: np.ndarray, span: np.ndarray, rays: Straightened,
    columns: tuple[int, ...], up: np.ndarray, d_up: np.ndarray, scale: np.ndarray,
    d_scale: np.ndarray,
) -> tuple[np.ndarray, np.ndarray]:  # fmt: skip
    """Where the top edges of the people that are boxes touch, ``q + m (r_b b + r_h n)`` (3, b)
    (module docstring), and its derivatives (p + 1, 3, b), the last one by the person's height.
    """
    m, d_m, y = scale[rows], d_scale[:, rows], rays.points[1, rows]
    d_row = np.zeros((len(columns), 3, len(m)))
    turned = d_up[list(columns)]
    d_q = span[rows] * (up[:, None] * d_m[:, None] + turned[:, :, None] * m)
    for row, column in enumerate(columns):
        if column in rays.by:
            d_q[row, :2] += rays.by[column][:, rows]
            d_row[row, 2] = -rays.by[column][1, rows]
    # The plane of sight of the row has the normal (0, 1, -y); the lowest point of the rim lies
    # where it points, as far as that is horizontal.
    normal = np.stack([np.zeros_like(y), np.ones_like(y), -y])
    along = up @ normal
    d_along = turned @ normal + up[2] * d_row[:, 2]
    b, d_b = _unit(
        up[:, None] * along - normal,
        turned[:, :, None] * along + up[:, None] * d_along[:, None] - d_row,
    )
    centre = q[:, rows] + BODY_RADIUS_M * m * b
    d_centre = np.empty((len(columns) + 1, 3, len(m)))
    d_centre[:-1] = d_q + BODY_RADIUS_M * (d_m[:, None] * b + m * d_b)
    d_centre[-1] = m * up[:, None]

    # A row is a plane through the x axis: it touches the sphere at right angles to (c_y, c_z).
    c = np.stack([np.zeros_like(m), -centre[2], centre[1]])
    d_c = np.zeros_like(d_centre)
    d_c[:, 1], d_c[:, 2] = -d_centre[:, 2], d_centre[:, 1]
    n, d_n = _unit(c, d_c)
    d_top = d_centre + HEAD_RADIUS_M * m * d_n
    d_top[:-1] += HEAD_RADIUS_M * d_m[:, None] * n
    return centre + HEAD_RADIUS_M * m * n, d_top


def on_footage(
    parameters: np.ndarray, columns: tuple[int, ...], uv: np.ndarray, d_uv: np.ndarray,
    h_uv: np.ndarray, *, fisheye: bool,
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:  # fmt: skip
    """Points of a pinhole camera, with derivatives in rows by ``columns`` and more, as the lens and
    the principal point show them.
    """
    if fisheye:
        curl = curled(uv, np.exp(parameters[FOCAL]))
        uv, d_uv, h_uv = curl.points, curl.carry(d_uv), curl.carry(h_uv)
        if FOCAL in columns:
            d_uv[columns.index(FOCAL)] += curl.by_log_focal
    if _plain(parameters, columns):
        return uv, d_uv, h_uv
    corner, centre = parameters[CORNER], parameters[CENTRE]
    r2 = (uv * uv).sum(axis=0)
    by_corner = uv * r2
    if corner != 0.0:
        gain = 1 + corner * r2
        d_uv = d_uv * gain + uv * (2 * corner) * (d_uv * uv).sum(axis=1, keepdims=True)
        h_uv = h_uv * gain + uv * (2 * corner) * (h_uv * uv).sum(axis=0)
        uv = uv * gain
    if CORNER in columns:
        d_uv[columns.index(CORNER)] += by_corner
    for axis, column in enumerate((CENTRE_U, CENTRE_V)):
        if column in columns:
            d_uv[columns.index(column), axis] += 1.0
    return uv + centre[:, None] if centre.any() else uv, d_uv, h_uv
