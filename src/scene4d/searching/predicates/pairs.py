"""P(near) of all pairs, fast: single precision, block by block in the cache."""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float, Float32

from scene4d.core.errors import InputError
from scene4d.searching.predicates.distance import NEAR_SIGMA_M, NEAR_TAU_M

_ODDS = (
    -1.5957644032970406,
    -0.07268944113367591,
    8.984567841602662e-05,
    0.00010069782588862194,
    -6.193418783883514e-06,
    1.3260316579078562e-07,
)
"""``log(Φ(-z) / Φ(z)) = z (c₀ + c₁ z² + ...)`` within 5.2 deviations: the odd polynomial whose Φ is
off by at most 2.3e-7, the minimax fit (linear programming about the last fit, until it stays)."""
_FARTHEST = 5.2
_BLOCK = 1 << 17
_FEW_FRAMES = 64
"""With fewer, the loops that NumPy runs by itself would be too short along the frames."""
_MANTISSA = 23
"""Digits of a coordinate whose differences single precision holds exactly."""
_TINY = 1e-12


def near_pairs(
    xy_a: Float[np.ndarray, "n f 2"],
    xy_b: Float[np.ndarray, "m f 2"],
    *,
    tau_m: float = NEAR_TAU_M,
    sigma_m: float = NEAR_SIGMA_M,
    covariance_a: Float[np.ndarray, "n f 2 2"] | None = None,
    covariance_b: Float[np.ndarray, "m f 2 2"] | None = None,
) -> Float32[np.ndarray, "n m f"]:
    """P(near) of every pair of n and m objects in each of f frames, by :func:`near_probability`.

    Positions in metres, NaN where an object is not there. With covariances (m², both or neither;
    what a common camera adds hardly separates near things) the spread along the line between the
    two is added. Within 1e-6 of double precision as long as ``sigma_m`` is at least a tenth of τ:
    Φ is a logistic of a polynomial, and coordinates are split into two single-precision parts, so
    that their differences are exact however far away the origin is. Nothing of the size of the
    result is held beside it. Raises :class:`InputError` unless ``sigma_m`` is positive and τ
    finite.
    """
    if not np.isfinite(tau_m):
        raise InputError(f"near: tau_m must be a distance in metres, found {tau_m}")
    if not 0 < sigma_m < np.inf:
        raise InputError(f"near: sigma_m must be finite and positive here, found {sigma_m}")
    if (covariance_a is None) != (covariance_b is None):
        raise InputError("near: covariances are needed of both sides or of neither")
    (n, f, _), m = xy_a.shape, len(xy_b)
    out = np.empty((n, m, f), np.float32)
    if not out.size:
        return out
    a, b = _split(xy_a, xy_b, sigma_m)
    spreads = [None if c is None else _spreads(c, sigma_m) for c in (covariance_a, covariance_b)]
    size = _sizes(n, m, f)
    work = _Work.of(int(np.prod(size)))
    for i in range(0, n, size[0]):
        for j in range(0, m, size[1]):
            for k in range(0, f, size[2]):
                left = (slice(None), slice(i, i + size[0]), None, slice(k, k + size[2]))
                right = (slice(None), None, slice(j, j + size[1]), slice(k, k + size[2]))
                place = out[i : i + size[0], j : j + size[1], k : k + size[2]]
                scratch = work.shaped(place.shape)
                doubt = [
                    None if s is None else s[side]
                    for s, side in zip(spreads, (left, right), strict=True)
                ]
                _near(a[left], b[right], doubt, scratch, tau_m / sigma_m, place)
    return out


@dataclass(frozen=True, eq=False)
class _Work:
    """Scratch space of one block."""

    x: np.ndarray
    y: np.ndarray
    d: np.ndarray
    z: np.ndarray

    @classmethod
    def of(cls, size: int) -> "_Work":
        return cls(*np.empty((4, size), np.float32))

    def shaped(self, shape: tuple[int, ...]) -> "_Work":
        n = int(np.prod(shape))
        return _Work(*(w[:n].reshape(shape) for w in (self.x, self.y, self.d, self.z)))


def _near(
    a: np.ndarray,
    b: np.ndarray,
    doubt: list[np.ndarray | None],
    w: _Work,
    tau: float,
    out: np.ndarray,
) -> None:
    """One block, with all lengths in units of σ."""
    x, y, d, z = w.x, w.y, w.d, w.z
    f = np.float32
    for to, axis in ((x, 0), (y, 1)):
        np.subtract(a[axis], b[axis], out=to)
        np.subtract(a[axis + 2], b[axis + 2], out=z)
        np.add(to, z, out=to)
    if doubt[0] is None or doubt[1] is None:
        np.multiply(x, x, out=x)
        np.multiply(y, y, out=y)
        np.add(x, y, out=x)
        np.sqrt(x, out=d)
        np.subtract(f(tau), d, out=z)
    else:
        _with_spread(doubt[0], doubt[1], w, tau, out)
    _phi(z, x, y, out)


def _with_spread(one: np.ndarray, two: np.ndarray, w: _Work, tau: float, part: np.ndarray) -> None:
    """z = (τ - d) / √(1 + s²), ``s² d² = x² c_xx + 2 x y c_xy + y² c_yy``; ``part`` is scratch."""
    x, y, d, z = w.x, w.y, w.d, w.z
    f = np.float32
    np.multiply(x, y, out=z)
    np.add(one[1], two[1], out=part)
    np.multiply(z, part, out=z)
    np.multiply(x, x, out=x)
    np.multiply(y, y, out=y)
    # Where the two coincide there is no line: a tiny length is taken, along both axes.
    np.add(x, f(_TINY), out=x)
    np.add(y, f(_TINY), out=y)
    np.add(x, y, out=d)
    np.add(one[0], two[0], out=part)
    np.multiply(x, part, out=x)
    np.add(z, x, out=z)
    np.add(one[2], two[2], out=part)
    np.multiply(y, part, out=y)
    np.add(z, y, out=z)
    np.divide(z, d, out=z)
    np.add(z, f(1), out=z)
    np.sqrt(z, out=z)
    np.sqrt(d, out=d)
    np.subtract(f(tau), d, out=d)
    np.divide(d, z, out=z)


def _phi(z: np.ndarray, square: np.ndarray, odds: np.ndarray, out: np.ndarray) -> None:
    f = np.float32
    np.clip(z, f(-_FARTHEST), f(_FARTHEST), out=z)
    np.multiply(z, z, out=square)
    np.multiply(square, f(_ODDS[-1]), out=odds)
    for coefficient in _ODDS[-2:0:-1]:
        np.add(odds, f(coefficient), out=odds)
        np.multiply(odds, square, out=odds)
    np.add(odds, f(_ODDS[0]), out=odds)
    np.multiply(odds, z, out=odds)
    np.exp(odds, out=odds)
    np.add(odds, f(1), out=odds)
    np.divide(f(1), odds, out=out)


def _sizes(n: int, m: int, f: int) -> tuple[int, int, int]:
    """Objects, objects and frames of one block, whose inputs fit the nearest cache."""
    frames = 1 if f < _FEW_FRAMES else min(f, _BLOCK >> 4)
    others = min(m, (_BLOCK >> 4) // frames)
    return min(n, _BLOCK // (frames * others)), others, frames


def _split(xy_a: np.ndarray, xy_b: np.ndarray, sigma_m: float) -> tuple[np.ndarray, np.ndarray]:
    """Coordinates as (4, objects, frames): coarse x and y, whose differences are exact, and what is
    left of them, in units of σ.
    """
    # fmin and fmax pass over NaN.
    low, high = (
        np.array(
            [op(*(op.reduce(xy[..., axis], axis=None) for xy in (xy_a, xy_b))) for axis in (0, 1)]
        )
        for op in (np.fmin, np.fmax)
    )
    middle, reach = (low + high) / 2, np.fmax(np.fmax(*(high - low)) / (2 * sigma_m), 1.0)
    if np.isinf(reach):
        raise InputError("near: positions must be finite, or NaN where an object is not there")
    grid = 2.0 ** (np.ceil(np.log2(reach)) - _MANTISSA)
    parts = []
    for xy in (xy_a, xy_b):
        flat, out = xy.reshape(-1, 2), np.empty((4, *xy.shape[:2]), np.float32)
        into = out.reshape(4, -1)
        for begin in range(0, len(flat), _BLOCK >> 3):
            part = slice(begin, begin + (_BLOCK >> 3))
            for axis in (0, 1):
                whole = (flat[part, axis] - middle[axis]) * (1 / (sigma_m * grid))
                coarse = np.rint(whole)
                into[axis, part] = coarse * grid
                into[axis + 2, part] = (whole - coarse) * grid
        parts.append(_laid_out(out))
    return parts[0], parts[1]


def _spreads(covariance: np.ndarray, sigma_m: float) -> np.ndarray:
    """c_xx, 2 c_xy and c_yy as (3, objects, frames), in units of σ²."""
    out = np.empty((3, *covariance.shape[:2]), np.float32)
    unit = 1 / sigma_m**2
    for to, place in zip(out, ((0, 0), (0, 1), (1, 1)), strict=True):
        np.multiply(covariance[(..., *place)], unit, out=to, casting="same_kind")
    np.multiply(out[1], np.float32(2), out=out[1])
    return _laid_out(out)


def _laid_out(values: np.ndarray) -> np.ndarray:
    """In single precision, with that axis last in memory along which blocks are long."""
    if values.shape[2] >= _FEW_FRAMES:
        return np.asarray(values.astype(np.float32, order="C", copy=False))
    return np.asarray(values.swapaxes(1, 2).astype(np.float32, order="C").swapaxes(1, 2))
