"""The smoother's model as equations: motion, standing still, and errors that last.

State of a moment: position (2), velocity (2), and the lasting error of the sighting (2) in units
of its standard deviation. Errors of successive sightings of one object are alike (gait, the
detector's habits), so a share of their variance follows an Ornstein-Uhlenbeck process and does
not average out at once; the rest is new in every sighting.
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.tracking.chain import solve_chain
from scene4d.tracking.motion_model import ACCELERATION, LASTING_S, LASTING_SHARE, SPEED, transition

_STANDING_LASTING_S = 600.0
"""How long errors last while the object stands: it is then seen from one side, in one light."""

_FAR_M = 100.0  # standard deviation of a position about the first sighting: as good as unknown
_SHORTEST_S = 1e-3  # steps below this would cost digits


@dataclass(frozen=True, eq=False)
class Moments:
    """Rows of the chain, by (track, time). ``kind`` is the class number; ``xy_m`` and
    ``covariance_m2`` are NaN where nothing was measured.
    """

    track: Int[np.ndarray, "n"]
    kind: Int[np.ndarray, "n"]
    time_s: Float[np.ndarray, "n"]
    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]

    def select(self, rows: Bool[np.ndarray, "n"]) -> "Moments":
        """The given rows."""
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    @property
    def first(self) -> Bool[np.ndarray, "n"]:
        """Where a track begins."""
        return np.diff(self.track, prepend=self.track[:1] - 1) != 0


@dataclass(frozen=True, eq=False)
class Prior:
    """States (k, 6) with covariance that rows ``at`` have before their own measurement."""

    at: Int[np.ndarray, "k"]
    mean: Float[np.ndarray, "k 6"]
    covariance: Float[np.ndarray, "k 6 6"]


class Chain:
    """The equations of some moments; ``prior`` replaces ignorance at rows that begin a track."""

    def __init__(self, moments: Moments, prior: Prior) -> None:
        self._moments = moments
        self._prior = prior
        self._measured = np.isfinite(moments.xy_m[:, 0])
        first = moments.first
        # Positions count from the track's first one: large coordinates would cost digits.
        start = moments.xy_m.copy()
        start[prior.at] = prior.mean[:, :2]
        self._origin = start[np.maximum.accumulate(np.where(first, np.arange(len(first)), 0))]
        self._first = first
        root = np.linalg.cholesky(moments.covariance_m2[self._measured])
        self._white = np.zeros((len(first), 2, 2))
        self._white[self._measured] = np.linalg.inv(root)
        away = np.where(self._measured[:, None], moments.xy_m - self._origin, 0.0)
        self._seen = (self._white @ away[:, :, None])[:, :, 0]

    def solve(
        self,
        standing: Bool[np.ndarray, "n"],
        variance_factor: Float[np.ndarray, "n"],
        *,
        covariance: bool,
    ) -> tuple[Float[np.ndarray, "n 6"], Float[np.ndarray, "n 6 6"] | None]:
        """States of all moments; a sighting's variance is ``variance_factor`` times (>= 1) what
        it was said to be.
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
        """Squared Mahalanobis distance of the sightings from ``xy_m``; 0 where there is none."""
        away = np.where(self._measured[:, None], self._moments.xy_m - xy_m, 0.0)
        whitened = (self._white @ away[:, :, None])[:, :, 0]
        distance: np.ndarray = (whitened**2).sum(axis=1)
        return distance

    def _motion(self, standing: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
        """Blocks of the motion alone."""
        m, n = self._moments, len(self._first)
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
        known = self._prior.at
        fresh = self._first.copy()
        fresh[known] = False
        speed = SPEED[self._moments.kind[fresh]]
        variance = np.column_stack([np.full((len(speed), 2), _FAR_M**2), speed**2, speed**2])
        diagonal[np.flatnonzero(fresh)[:, None], range(4), range(4)] += 1 / variance
        diagonal[np.flatnonzero(fresh)[:, None], [4, 5], [4, 5]] += 1.0
        precision = np.linalg.inv(self._prior.covariance)
        mean = self._prior.mean.copy()
        mean[:, :2] -= self._origin[known]
        diagonal[known] += precision
        vector[known] += (precision @ mean[:, :, None])[:, :, 0]


def _both_axes(per_axis: np.ndarray) -> np.ndarray:
    """(n, 3, 3) of one axis as (n, 6, 6) of x and y."""
    n = len(per_axis)
    out = np.zeros((n, 3, 2, 3, 2))
    out[:, :, 0, :, 0] = out[:, :, 1, :, 1] = per_axis
    return out.reshape(n, 6, 6)
