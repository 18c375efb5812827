"""Lens distortion: OpenCV's radial-tangential model both ways, and Tsai's model as OpenCV's.

Coefficients are in OpenCV's order ``(k1, k2, p1, p2, k3)``; undistorted pixels keep the same K.
"""

import numpy as np
from jaxtyping import Bool, Float

NO_DISTORTION: Float[np.ndarray, "5"] = np.zeros(5)
NO_DISTORTION.setflags(write=False)

_ITERATIONS = 60
"""Most steps of Newton's method, and of its bracket: enough to halve an interval to rounding."""
_TOLERANCE = 1e-12
"""A smaller step (in focal lengths) ends it: 1e-9 px at a focal length of 1000."""


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
    """Radius at which the radial map stops growing; infinity where it never does.

    With w = 1 / r² the slope's zeros are those of ``w³ + 3 k1 w² + 5 k2 w + 7 k3``, and the
    largest positive one is the first fold.
    """
    roots = np.roots([1.0, 3 * d[0], 5 * d[1], 7 * d[4]])
    real = roots[np.abs(roots.imag) <= 1e-9 * np.abs(roots)].real
    largest = float(real.max(initial=0.0))
    return float(1 / np.sqrt(largest)) if largest > 0 else np.inf


def _radial_inverse(r_d: np.ndarray, d: np.ndarray, fold: float) -> np.ndarray:
    """Radii whose radial image is ``r_d``, or ``fold`` where it is out of reach.

    Up to the fold the map grows, so Newton's method kept inside a bracket cannot miss.
    """

    def radial(r: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        r2 = r * r
        value = r * (1 + r2 * (d[0] + r2 * (d[1] + r2 * d[4])))
        return value, 1 + r2 * (3 * d[0] + r2 * (5 * d[1] + r2 * 7 * d[4]))

    low, high = np.zeros_like(r_d), np.minimum(r_d, fold)
    for _ in range(_ITERATIONS):
        short = (radial(high)[0] < r_d) & (high < fold)
        if not short.any():
            break
        high = np.where(short, np.minimum(2 * high, fold), high)
    r = high
    for _ in range(_ITERATIONS):
        value, slope = radial(r)
        far = value > r_d
        low, high = np.where(far, low, r), np.where(far, r, high)
        newton = r - (value - r_d) / slope
        inside = (newton > low) & (newton < high)
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
        for _ in range(_ITERATIONS):
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


def refocused(distortion: Float[np.ndarray, "5"], stretch: float) -> Float[np.ndarray, "5"]:
    """Coefficients of the same lens when its focal length is given ``stretch`` times as long.

    A lens bends by position on the sensor, and coefficients apply to position over focal length.
    """
    return distortion * stretch ** np.array([2, 4, 1, 1, 6])


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
