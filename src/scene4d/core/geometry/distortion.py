"""Lens distortion: OpenCV's two models both ways, and Tsai's model as one of them.

The pinhole model has OpenCV's radial and tangential coefficients ``(k1, k2, p1, p2, k3)``. The
fisheye model is that of ``cv2.fisheye`` (Kannala and Brandt 2006): a ray at the angle θ from the
optical axis appears ``θ (1 + k1 θ² + k2 θ⁴ + k3 θ⁶ + k4 θ⁸)`` focal lengths from the principal
point. Undistorted pixels are those of a pinhole camera with the same K, so that a ray at 90° or
more from the axis has none.
"""

from collections.abc import Callable

import numpy as np
from jaxtyping import Bool, Float

NO_DISTORTION: Float[np.ndarray, "5"] = np.zeros(5)
NO_DISTORTION.setflags(write=False)

_ITERATIONS = 60
"""Most steps of Newton's method, and of its bracket: enough to halve an interval to rounding."""
_TOLERANCE = 1e-12
"""A smaller step (in focal lengths) ends it: 1e-9 px at a focal length of 1000."""
_WIDEST_RAD = np.pi / 2 - 1e-6
"""Rays further from the axis have no undistorted pixel: it would be a million focal lengths off."""


def _normalise(uv: np.ndarray, K: np.ndarray) -> np.ndarray:
    y = (uv[:, 1] - K[1, 2]) / K[1, 1]
    x = (uv[:, 0] - K[0, 2] - K[0, 1] * y) / K[0, 0]
    return np.column_stack([x, y])


def _pixels(xy: np.ndarray, K: np.ndarray) -> np.ndarray:
    return xy @ K[:2, :2].T + K[:2, 2]


def _distort_normalised(xy: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distorted points and the (n, 2, 2) Jacobian of the map, OpenCV's equations."""
    k1, k2, p1, p2, k3 = d
    x, y = xy[:, 0], xy[:, 1]
    r2 = x * x + y * y
    radial = 1 + r2 * (k1 + r2 * (k2 + r2 * k3))
    slope = k1 + r2 * (2 * k2 + 3 * k3 * r2)  # d radial / d r2
    out = np.column_stack(
        [
            x * radial + 2 * p1 * x * y + p2 * (r2 + 2 * x * x),
            y * radial + p1 * (r2 + 2 * y * y) + 2 * p2 * x * y,
        ]
    )
    jacobian = np.empty((len(xy), 2, 2))
    jacobian[:, 0, 0] = radial + 2 * x * x * slope + 2 * p1 * y + 6 * p2 * x
    jacobian[:, 1, 1] = radial + 2 * y * y * slope + 6 * p1 * y + 2 * p2 * x
    jacobian[:, 0, 1] = jacobian[:, 1, 0] = 2 * x * y * slope + 2 * p1 * x + 2 * p2 * y
    return out, jacobian


def distort(
    uv: Float[np.ndarray, "n 2"], K: Float[np.ndarray, "3 3"], distortion: Float[np.ndarray, "5"]
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """Undistorted pixels to the pixels where the lens shows them, and which of them it can show.

    A barrel polynomial folds: from some radius on it throws points back into the image. Those
    points are invalid.
    """
    if not np.any(distortion):
        return _where_finite(uv)
    with np.errstate(all="ignore"):  # pixels that are not finite are invalid
        xy = _normalise(uv, K)
        bent, jacobian = _distort_normalised(xy, distortion)
        valid = _before_fold(xy, jacobian, _fold_radius(distortion))
    bent[~valid] = np.nan
    return _pixels(bent, K), valid


def _where_finite(uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    valid = np.isfinite(uv).all(axis=1)
    return np.where(valid[:, None], uv, np.nan), valid


def _before_fold(xy: np.ndarray, jacobian: np.ndarray, fold: float) -> np.ndarray:
    """Where the map is still on its first branch: there it keeps its orientation, so that its
    Jacobian's determinant is positive. False where a value is not finite.
    """
    j = jacobian
    det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
    return (np.hypot(xy[:, 0], xy[:, 1]) < fold) & (det > 0) & np.isfinite(det)


def _fold_radius(d: np.ndarray) -> float:
    """Radius at which the radial map stops growing; infinity where it never does."""
    return _first_fold(np.array([3 * d[0], 5 * d[1], 7 * d[4]]))


def _first_fold(slope: np.ndarray) -> float:
    """The least r > 0 at which ``1 + s₁ r² + s₂ r⁴ + …`` is zero; infinity where there is none.

    With w = 1 / r² it is the largest positive zero of ``wⁿ + s₁ wⁿ⁻¹ + s₂ wⁿ⁻² + …``.
    """
    roots = np.roots([1.0, *slope])
    real = roots[np.abs(roots.imag) <= 1e-9 * np.abs(roots)].real
    largest = float(real.max(initial=0.0))
    return float(1 / np.sqrt(largest)) if largest > 0 else np.inf


def _radial_inverse(r_d: np.ndarray, d: np.ndarray, fold: float) -> np.ndarray:
    """Radii whose radial image is ``r_d``, or ``fold`` where it is out of reach."""

    def radial(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r2 = r * r
        value = r * (1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4])))
        return value, 1 + r2 * (3 * d[0] + r2 * (5 * d[1] + r2 * 7 * d[4]))

    return _inverse(radial, r_d, fold)


def _inverse(
    curve: Callable[[np.ndarray], tuple[np.ndarray, np.ndarray]], target: np.ndarray, top: float
) -> np.ndarray:
    """Where a curve through zero, given with its slope, has the values ``target``; ``top`` where
    they are out of reach.

    Up to ``top`` the curve grows, so Newton's method kept inside a bracket cannot miss.
    """
    low, high = np.zeros_like(target), np.minimum(target, top)
    for _ in range(_ITERATIONS):
        short = (curve(high)[0] < target) & (high < top)
        if not short.any():
            break
        high = np.where(short, np.minimum(2 * high, top), high)
    r, step = np.minimum(target, high), high  # most lenses bend by little
    for _ in range(_ITERATIONS):
        value, slope = curve(r)
        far = value > target
        low, high = np.where(far, low, r), np.where(far, r, high)
        newton = r - (value - target) / slope
        inside = (newton > low - _TOLERANCE) & (newton < high + _TOLERANCE)
        inside &= np.abs(newton - r) <= np.maximum(np.abs(step) / 2, _TOLERANCE)  # no creeping
        step = np.where(inside, newton, (low + high) / 2) - r
        r = r + step
        if not np.any(np.abs(step) > _TOLERANCE):
            break
    return r


def undistort(
    uv: Float[np.ndarray, "n 2"], K: Float[np.ndarray, "3 3"], distortion: Float[np.ndarray, "5"]
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """Pixels of the real lens to undistorted pixels, by Newton's method from the radial inverse.

    A pixel outside the range that the lens model can reach (beyond the fold of a strong barrel)
    has no undistorted position: it is invalid, also where the polynomial rises again behind the
    fold and has a solution there.
    """
    if not np.any(distortion):
        return _where_finite(uv)
    fold = _fold_radius(distortion)
    with np.errstate(all="ignore"):  # pixels that are not finite are invalid
        target = _normalise(uv, K)
        r_d = np.hypot(target[:, 0], target[:, 1])
        gain = _radial_inverse(r_d, distortion, fold) / r_d
        xy = target * np.where(r_d > 0, gain, 1.0)[:, None]
        for _ in range(_ITERATIONS if distortion[2:4].any() else 0):  # else xy is the answer
            value, j = _distort_normalised(xy, distortion)
            gap = value - target
            det = j[:, 0, 0] * j[:, 1, 1] - j[:, 0, 1] * j[:, 1, 0]
            step_x = (j[:, 1, 1] * gap[:, 0] - j[:, 0, 1] * gap[:, 1]) / det
            step_y = (j[:, 0, 0] * gap[:, 1] - j[:, 1, 0] * gap[:, 0]) / det
            xy = xy - np.column_stack([step_x, step_y])
            if not np.any(np.hypot(step_x, step_y) > _TOLERANCE):
                break
        value, j = _distort_normalised(xy, distortion)
        valid = _before_fold(xy, j, fold) & (np.abs(value - target).max(axis=1) < 1e-9)
    xy[~valid] = np.nan
    return _pixels(xy, K), valid


def distort_fisheye(
    uv: Float[np.ndarray, "n 2"], K: Float[np.ndarray, "3 3"], distortion: Float[np.ndarray, "4"]
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """As :func:`distort`, for a fisheye lens with the coefficients (k1, k2, k3, k4)."""
    with np.errstate(all="ignore"):  # pixels that are not finite are invalid
        xy = _normalise(uv, K)
        r = np.hypot(xy[:, 0], xy[:, 1])
        angle = np.arctan(r)
        gain = np.where(r > 0, _fisheye_curve(angle, distortion)[0] / r, 1.0)
        valid = (angle < _fisheye_reach_rad(distortion)) & np.isfinite(r)
        bent = xy * gain[:, None]
    bent[~valid] = np.nan
    return _pixels(bent, K), valid


def undistort_fisheye(
    uv: Float[np.ndarray, "n 2"], K: Float[np.ndarray, "3 3"], distortion: Float[np.ndarray, "4"]
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """As :func:`undistort`, for a fisheye lens with the coefficients (k1, k2, k3, k4).

    Pixels that see 90° or more away from the optical axis are invalid.
    """
    reach = min(_fisheye_reach_rad(distortion), _WIDEST_RAD)
    with np.errstate(all="ignore"):  # pixels that are not finite are invalid
        target = _normalise(uv, K)
        r_d = np.hypot(target[:, 0], target[:, 1])
        valid = r_d < _fisheye_curve(np.full(1, reach), distortion)[0]
        angle = _inverse(lambda a: _fisheye_curve(a, distortion), r_d, reach)
        gain = np.where(r_d > 0, np.tan(angle) / r_d, 1.0)
        xy = target * gain[:, None]
    xy[~valid] = np.nan
    return _pixels(xy, K), valid


def _fisheye_curve(angle_rad: np.ndarray, d: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Distance from the principal point in focal lengths, and its slope over the angle."""
    a2 = angle_rad * angle_rad
    value = angle_rad * (1 + a2 * (d[0] + a2 * (d[1] + a2 * (d[2] + a2 * d[3]))))
    slope = 1 + a2 * (3 * d[0] + a2 * (5 * d[1] + a2 * (7 * d[2] + a2 * 9 * d[3])))
    return value, slope


def _fisheye_reach_rad(d: np.ndarray) -> float:
    """Angle from the axis up to which a fisheye curve grows, at most 90°."""
    return min(_first_fold(np.array([3, 5, 7, 9]) * d), np.pi / 2)


def straightening_slopes(
    xy: Float[np.ndarray, "n 2"], distortion: Float[np.ndarray, "k"]
) -> Float[np.ndarray, "4 2 n"]:
    """Derivatives of undistorted points ``xy``, in focal lengths, that the lens shows at fixed
    places: by the two coordinates of these places, by the first coefficient, and by log f at
    :func:`refocused` coefficients (the three other lengths stay as they are).

    They follow from those of the distortion, which is the inverse map. Points have to be valid.
    """
    x, y = xy.T
    r2 = x * x + y * y
    if len(distortion) == 5:
        forward = _distort_normalised(xy, distortion)[1].T
        growth, shrinking = r2, np.ones_like(r2)
    else:
        r = np.sqrt(r2)
        near = r < 1e-6  # where the limits at the principal point hold to rounding
        safe = np.where(near, 1.0, r)
        angle = np.arctan(r)
        value, slope = _fisheye_curve(angle, distortion)
        gain, along = np.where(near, 1.0, value / safe), slope / (1 + r2)
        bend = np.where(near, 0.0, (along - gain) / safe**2)
        forward = np.array(
            [[gain + bend * x * x, bend * x * y], [bend * x * y, gain + bend * y * y]]
        )
        growth = np.where(near, 0.0, angle**3 / safe)
        shrinking = np.where(near, 1.0, angle * (1 + r2) / safe)
    (a, b), (c, d) = forward
    by_place = np.array([[d, -c], [-b, a]]) / (a * d - b * c)
    by_first = -growth * (by_place[0] * x + by_place[1] * y)
    return np.concatenate([by_place, [by_first, -shrinking * xy.T]])


def refocused(distortion: Float[np.ndarray, "k"], stretch: float) -> Float[np.ndarray, "k"]:
    """Coefficients of the same lens when its focal length is given ``stretch`` times as long: the
    pinhole model's five, or the fisheye model's four.

    A lens bends by position on the sensor, and coefficients apply to position over focal length.
    """
    powers = (2, 4, 6, 8) if len(distortion) == 4 else (2, 4, 1, 1, 6)
    return distortion * stretch ** np.array(powers)


def opencv_from_tsai(
    kappa1_per_mm2: float, focal_mm: float, radius_mm: float
) -> Float[np.ndarray, "5"]:
    """OpenCV coefficients that undo Tsai's radial model, out to ``radius_mm`` on the sensor.

    The two models run in opposite directions, so this is a least-squares fit of k1, k2, k3 over
    the undistorted radius; for PETS View_001 it is exact to 3e-4 px over the image.
    """
    r_d = np.linspace(0.0, radius_mm, 400)[1:]
    r_u = r_d * (1 + kappa1_per_mm2 * r_d**2)
    x = r_u / focal_mm
    design = np.column_stack([x**3, x**5, x**7])
    scale = np.abs(design).max(axis=0)
    k, *_ = np.linalg.lstsq(design / scale, r_d / focal_mm - x, rcond=None)
    k1, k2, k3 = k / scale
    return np.array([k1, k2, 0.0, 0.0, k3])
