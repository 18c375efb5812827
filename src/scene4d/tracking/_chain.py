"""The smoother's model as equations, and their solution.

State per row: position (2), velocity (2), and the correlated error of the detection (2) in units
of its standard deviation. Errors of successive detections of one object are correlated (gait,
detector bias), so a share of their variance follows an Ornstein-Uhlenbeck process and averages out
slowly; the rest is independent in every detection.
"""

import numpy as np
from jaxtyping import Bool, Float

from scene4d.tracking._motion_model import ACCELERATION, LASTING_S, LASTING_SHARE, SPEED, transition
from scene4d.tracking._sightings import REMEMBERED, Memory, TrackRows

_STANDING_LASTING_S = 600.0
"""Correlation time of errors while the object stands: view and light stay the same."""

_FAR_M = 100.0  # standard deviation of a position about the first sighting: as good as unknown
_SHORTEST_S = 1e-3  # steps below this would cost digits


class Chain:
    """The equations of some rows; remembered rows have the states of ``memory``, in order, as
    priors.
    """

    def __init__(self, rows: TrackRows, memory: Memory) -> None:
        self._rows = rows
        self._memory = memory
        self._known = rows.source == REMEMBERED
        self._measured = np.isfinite(rows.xy_m[:, 0])
        first = rows.first
        # Positions count from the track's first one: large coordinates would cost digits.
        start = rows.xy_m.copy()
        start[self._known] = memory.mean[:, :2]
        self._origin = start[np.maximum.accumulate(np.where(first, np.arange(len(first)), 0))]
        self._first = first
        root = np.linalg.cholesky(rows.covariance_m2[self._measured])
        self._white = np.zeros((len(first), 2, 2))
        self._white[self._measured] = np.linalg.inv(root)
        away = np.where(self._measured[:, None], rows.xy_m - self._origin, 0.0)
        self._seen = (self._white @ away[:, :, None])[:, :, 0]

    def solve(
        self,
        standing: Bool[np.ndarray, "n"],
        variance_factor: Float[np.ndarray, "n"],
        *,
        covariance: bool,
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None]:
        """States of all rows; a detection's stated variance is multiplied by ``variance_factor``
        (>= 1).
        """
        diagonal, coupling = self._motion(standing)
        vector = np.zeros((len(diagonal), 6))
        self._begin(diagonal, vector)
        look = np.zeros((len(diagonal), 2, 6))
        look[:, :, :2] = self._white
        look[:, [0, 1], [4, 5]] = np.sqrt(LASTING_SHARE)
        weight = np.where(self._measured, 1 / (variance_factor - LASTING_SHARE), 0.0)
        weighted = look.swapaxes(1, 2) * weight[:, None, None]
        diagonal += weighted @ look
        vector += (weighted @ self._seen[:, :, None])[:, :, 0]
        mean, cov = solve_chain(diagonal, coupling, vector, covariance=covariance)
        mean[:, :2] += self._origin
        return mean, cov

    def misfit(self, xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n"]:
        """Squared Mahalanobis distance of the detections from ``xy_m``; 0 where there is none."""
        away = np.where(self._measured[:, None], self._rows.xy_m - xy_m, 0.0)
        whitened = (self._white @ away[:, :, None])[:, :, 0]
        distance: np.ndarray = (whitened**2).sum(axis=1)
        return distance

    def _motion(self, standing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Precision blocks of the motion model alone."""
        m, n = self._rows, len(self._first)
        linked = ~self._first[1:]
        dt = np.where(linked, np.maximum(np.diff(m.time_s), _SHORTEST_S), 1.0)
        still = standing[:-1] & standing[1:]
        step, inverse = np.zeros((2, len(dt), 3, 3))
        step[:, :2, :2], inverse[:, :2, :2] = transition(dt, ACCELERATION[m.kind[1:]], still)
        lasts = np.where(still, _STANDING_LASTING_S, LASTING_S)
        step[:, 2, 2] = np.exp(-dt / lasts)
        inverse[:, 2, 2] = -1 / np.expm1(-2 * dt / lasts)
        inverse[~linked] = 0.0
        forward = step.swapaxes(1, 2) @ inverse
        per_axis = np.zeros((n, 3, 3))
        per_axis[:-1] += forward @ step
        per_axis[1:] += inverse
        return _both_axes(per_axis), _both_axes(-forward)

    def _begin(self, diagonal: np.ndarray, vector: np.ndarray) -> None:
        known = self._known
        fresh = self._first & ~known
        speed = SPEED[self._rows.kind[fresh]]
        variance = np.column_stack([np.full((len(speed), 2), _FAR_M**2), speed**2, speed**2])
        diagonal[np.flatnonzero(fresh)[:, None], range(4), range(4)] += 1 / variance
        diagonal[np.flatnonzero(fresh)[:, None], [4, 5], [4, 5]] += 1.0
        precision = np.linalg.inv(self._memory.covariance)
        mean = self._memory.mean.copy()
        mean[:, :2] -= self._origin[known]
        diagonal[known] += precision
        vector[known] += (precision @ mean[:, :, None])[:, :, 0]


def _both_axes(per_axis: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of one axis as (n, 6, 6) of x and y."""
    n = len(per_axis)
    out = np.zeros((n, 3, 2, 3, 2))
    out[:, :, 0, :, 0] = out[:, :, 1, :, 1] = per_axis
    return out.reshape(n, 6, 6)


def solve_chain(
    diagonal: Float[np.ndarray, "n s s"],
    coupling: Float[np.ndarray, "m s s"],
    vector: Float[np.ndarray, "n s"],
    *,
    covariance: bool = True,
) -> tuple[Float[np.ndarray, "n s"], Float[np.ndarray, "n s s"] | None]:
    """Means (n, s), and on request covariances (n, s, s), of a chain in information form.

    The precision matrix has ``diagonal`` blocks and, right of the k-th, ``coupling[k]``
    (m = n - 1); mean = precision⁻¹ ``vector``. Chains of several objects are concatenated, with
    zero coupling between them.

    Eliminating every second row at a time (cyclic reduction: Buzbee, Golub and Nielson, "On direct
    methods for solving Poisson's equations", 1970) takes log2(n) array operations instead of a
    loop of n steps; back substitution gives the blocks of the inverse by Takahashi's equations.
    The result equals that of the Rauch-Tung-Striebel smoother.
    """
    mean, cov, _ = _solve(diagonal, coupling, vector[:, :, None], covariance)
    return mean[:, :, 0], cov


def _t(a: np.ndarray) -> np.ndarray:
    return a.swapaxes(-1, -2)


def _solve(
    d: np.ndarray, u: np.ndarray, y: np.ndarray, covariance: bool
) -> tuple[np.ndarray, np.ndarray | None, np.ndarray | None]:
    """Mean, covariances, and covariances of neighbours (n - 1, s, s)."""
    n, s = y.shape[:2]
    if n <= 1:
        inverse = np.linalg.inv(d)
        return inverse @ y, inverse if covariance else None, np.empty((0, s, s))
    # Odd rows are eliminated; each has a row to the left, and all but perhaps the last one to the
    # right, for which zeros stand in.
    inverse = np.linalg.inv(d[1::2])
    odd = len(inverse)
    to_left, to_right = _t(u[0::2]), np.zeros((odd, s, s))
    to_right[: len(u[1::2])] = u[1::2]
    from_left, from_right, own = inverse @ to_left, inverse @ to_right, inverse @ y[1::2]
    right = n - odd - 1  # so many even rows have an odd row on their left
    d_even, y_even = d[0::2].copy(), y[0::2].copy()
    d_even[:odd] -= _t(to_left) @ from_left
    y_even[:odd] -= _t(to_left) @ own
    d_even[1:] -= (_t(to_right) @ from_right)[:right]
    y_even[1:] -= (_t(to_right) @ own)[:right]
    between = -(_t(to_left) @ from_right)[:right]
    mean_even, cov_even, cov_between = _solve(d_even, between, y_even, covariance)

    def beyond(values: np.ndarray) -> np.ndarray:
        """The even row right of every odd one."""
        out = np.zeros((odd, *values.shape[1:]))
        out[:right] = values[1:]
        return out

    mean = np.empty_like(y)
    mean[0::2] = mean_even
    mean[1::2] = own - from_left @ mean_even[:odd] - from_right @ beyond(mean_even)
    if cov_even is None or cov_between is None:
        return mean, None, None
    cross = np.zeros((odd, s, s))
    cross[:right] = cov_between
    with_left = -(from_left @ cov_even[:odd] + from_right @ _t(cross))
    with_right = -(from_left @ cross + from_right @ beyond(cov_even))
    cov, neighbours = np.empty((n, s, s)), np.empty((n - 1, s, s))
    cov[0::2] = cov_even
    cov[1::2] = inverse - with_left @ _t(from_left) - with_right @ _t(from_right)
    neighbours[0::2] = _t(with_left)
    neighbours[1::2] = with_right[: len(u[1::2])]
    return mean, cov, neighbours
