"""What the people whom two cameras have in common tell of the two, as one Gaussian factor.

With the errors e of the two cameras (in standard deviations of their modes M), a person whom both
see at one time obeys

    p_a - M_a e_a  =  Rot(heading) (p_b - M_b e_b) + (x, y) + error,

p_b being taken ``offset`` earlier on the clock of camera b. The error of a track wanders: an
Ornstein-Uhlenbeck process for what its boxes get wrong for seconds, and noise of its own at every
tick. The factor is over (x, y, heading, offset, drift, e_a, e_b), *without* any prior of e, so
that factors of one camera with several others can be added up.
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.linalg import solve_triangular

from scene4d.alignment._paths import (
    MODES,
    STEP_S,
    View,
    corrected,
    error_modes,
    interpolated,
    regrounded_points,
)
from scene4d.alignment._score import Fit, Matching, Meetings

POSE = 5
"""x, y, heading, offset and drift come first."""
_DRIFT, _DRIFT_FREEDOM = 3e-4, 3.0
"""Prior of the clocks' difference in rate, and Student's degrees of freedom: two crystals differ by
5e-5, frame rates are rounded (29.97 for 30 is 1e-3), and some recorders err by several thousandths,
which a Gaussian would pull back. Chosen."""
_WANDERS_M = (0.06, 0.09, 0.13, 0.18, 0.25, 0.35)
_WANDER_M, _WANDER_SPREAD = 0.17, 0.5
"""Standard deviation of what a track's positions in two cameras differ by for seconds (m): of those
tried, the most probable by what the pair's matches show, from a prior around the middle (m, and the
spread of its logarithm). Chosen: 0.06 m is what one stride does, 0.35 m half a body.
"""
_WANDER_S = 5.0
"""How long that stays (s). Both chosen: about one turn of a walker as two cameras see him."""
_JITTER_M = 0.08
"""Noise at every tick beside the rows' own covariance (m)."""
_OWN_S = 1.0
"""A smoothed position errs alike for this long (s)."""
_FREEDOM = 4.0
"""Student's degrees of freedom of a tick's noise: mistaken boxes do not pull."""
_MOST_TICKS = 80
"""Ticks of one match that are looked at; of longer ones every second, third, ..."""
_MOST_MATCHES = 100
_STEPS = 8
_SETTLED = 1e-3
"""Steps below this (m, rad, s) are the last: a fiftieth of what any pair is known to."""
_PRIOR_MATCHES = 8.0
"""The noise assumed counts as that of so many matches against what they show: so many tell a
standard deviation to a quarter."""


def drift_information(rate: float) -> float:
    """Of the drift's prior, where the rate is about this."""
    return (_DRIFT_FREEDOM + 1) / (_DRIFT_FREEDOM * _DRIFT**2 + rate**2)


@dataclass(frozen=True, eq=False)
class Factor:
    """Information matrix and vector, and the point at which it was linearised.

    ``matches`` went into it; ``noise`` is the variance between them over what was assumed, of which
    the information already takes account if it is above 1. ``epoch_s`` is the time on the clock of
    camera a at which the offset holds, ``wander_m`` what tracks err by for seconds.
    """

    information: Float[np.ndarray, "p p"]
    vector: Float[np.ndarray, "p"]
    at: Float[np.ndarray, "p"]
    matches: int
    noise: float
    epoch_s: float
    wander_m: float

    @property
    def prior(self) -> Float[np.ndarray, "p p"]:
        """Information of the priors: unit for the errors of the cameras, and the drift's."""
        prior = np.ones(len(self.at))
        prior[: POSE - 1] = 0.0
        prior[POSE - 1] = drift_information(float(self.at[POSE - 1]))
        return np.diag(prior)

    def alone(self) -> tuple[Float[np.ndarray, "p"], Float[np.ndarray, "p p"]]:
        """Most probable values and covariance from this factor and the priors alone."""
        covariance = np.linalg.inv(self.information + self.prior)
        return covariance @ self.vector, covariance


@dataclass(frozen=True, eq=False)
class Match:
    """Moments at which two tracks show one person: nearest rows of a, times on the clock of a,
    positions in a, and the row range of the piece of b that shows him.
    """

    row_a: Int[np.ndarray, "n"]
    xy_a: Float[np.ndarray, "n 2"]
    time_s: Float[np.ndarray, "n"]
    piece_b: int
    gain: float


def matches(meetings: Meetings, matching: Matching) -> list[Match]:
    """The matches of a matching, one for every pair of pieces of tracks, best first."""
    a, b = meetings.a.paths, meetings.b.paths
    key = np.column_stack([matching.pair, a.piece[matching.row_a], b.piece[matching.row_b]])
    _, of = np.unique(key, axis=0, return_inverse=True)
    found = []
    for rows in np.split(np.argsort(of, kind="stable"), np.cumsum(np.bincount(of))[:-1]):
        rows = rows[:: max(1, -(-len(rows) // _MOST_TICKS))]
        i, j = matching.row_a[rows], matching.row_b[rows]
        gain = float(matching.gain[matching.pair[rows[0]]])
        found.append(Match(a.row[i], a.xy_m[i], a.tick[i] * STEP_S, int(b.piece[j[0]]), gain))
    found.sort(key=lambda match: -match.gain)
    return found[:_MOST_MATCHES]


@dataclass(frozen=True, eq=False)
class _Moments:
    """Times on a's clock at which two tracks show one person, nearest rows, and positions."""

    match: np.ndarray
    time_s: np.ndarray
    row_a: np.ndarray
    row_b: np.ndarray
    xy_a: np.ndarray
    xy_b: np.ndarray

    @classmethod
    def of(cls, b: View, found: list[Match], point: np.ndarray, epoch: float) -> "_Moments":
        """Those of the matches at which camera b saw the person too."""
        match = np.repeat(np.arange(len(found)), [len(one.time_s) for one in found])
        row_a = np.concatenate([one.row_a for one in found])
        xy_a = np.concatenate([one.xy_a for one in found])
        time_s = np.concatenate([one.time_s for one in found])
        of = np.array([one.piece_b for one in found])[match]
        when = time_s - point[3] - point[4] * (time_s - epoch)
        first, last = b.ends
        kept = (when >= b.time_s[first[of]]) & (when <= b.time_s[last[of]])
        row_b, xy_b = interpolated(b, of[kept], when[kept])
        return cls(match[kept], time_s[kept], row_a[kept], row_b, xy_a[kept], xy_b)


def factor_of(a: View, b: View, found: list[Match], fit: Fit) -> Factor:
    """The factor at the most probable values under the priors, by Gauss-Newton.

    A match whose differences are far beyond what is assumed loses its weight. What remains is held
    against the assumed noise match by match (the sandwich estimate, one number over the pose's
    directions), and the information shrinks if they scatter more.
    """
    x, y, heading, _, offset = fit.parameters
    point = np.concatenate([[x, y, heading, offset, 0.0], np.zeros(2 * MODES)])
    epoch = float(np.mean([match.time_s.mean() for match in found]))
    point = _settled(a, b, found, point, epoch, _WANDER_M)
    wander_m = _wander(a, b, found, point, epoch)
    point = _settled(a, b, found, point, epoch, wander_m)
    return linearised(a, b, found, point, epoch, wander_m)


def _settled(
    a: View, b: View, found: list[Match], point: np.ndarray, epoch: float, wander_m: float
) -> np.ndarray:
    """The most probable point, from one nearby."""
    for _ in range(_STEPS):
        moved = linearised(a, b, found, point, epoch, wander_m).alone()[0] - point
        moved[3] = np.clip(moved[3], -0.5, 0.5)
        point = point + moved
        if np.abs(moved[:POSE]).max() < _SETTLED:
            break
    return point


def _wander(a: View, b: View, found: list[Match], point: np.ndarray, epoch: float) -> float:
    """The most probable size of what tracks err by for seconds."""
    moments = _Moments.of(b, found, point, epoch)
    step, _, own = _differences(a, b, moments, point, epoch)
    tried = np.array(_WANDERS_M)
    score = -0.5 * (np.log(tried / _WANDER_M) / _WANDER_SPREAD) ** 2
    for rows in _by_match(moments):
        r, facts = step[rows].ravel(), 2.0 * len(rows)
        spreads = _spreads(own[:, rows], moments.time_s[rows])
        for k, wander_m in enumerate(tried):
            root = _root(spreads, wander_m)
            white = solve_triangular(root, r, lower=True, check_finite=False)
            # Student's t over the whole match: a mistaken one says nothing of the others.
            spread = np.log1p(float(white @ white) / _FREEDOM) * (_FREEDOM + facts) / 2
            score[k] -= spread + np.log(np.diag(root)).sum()
    return float(tried[np.argmax(score)])


def _by_match(moments: _Moments) -> list[np.ndarray]:
    """Rows of every match that has any."""
    cuts = np.flatnonzero(np.diff(moments.match)) + 1
    return [rows for rows in np.split(np.arange(len(moments.match)), cuts) if len(rows)]


def linearised(
    a: View, b: View, found: list[Match], point: np.ndarray, epoch: float, wander_m: float
) -> Factor:
    """The factor of matches, linearised at a point."""
    size = len(point)
    information, vector = np.zeros((size, size)), np.zeros(size)
    forces = []
    moments = _Moments.of(b, found, point, epoch)
    step, slopes, own = _differences(a, b, moments, point, epoch)
    for rows in _by_match(moments):
        root = _root(_spreads(own[:, rows], moments.time_s[rows]), wander_m)
        both = np.column_stack([step[rows].ravel(), slopes[rows].reshape(2 * len(rows), size)])
        flat = solve_triangular(root, both, lower=True, check_finite=False)
        white, by = flat[:, 0], flat[:, 1:]
        weight = min(1.0, (_FREEDOM + len(white)) / (_FREEDOM + float(white @ white)))
        force = by.T @ white
        information += weight * by.T @ by
        vector += weight * (force + by.T @ (by @ point))
        forces.append(weight * force)
    factor = Factor(information, vector, point, len(forces), 1.0, epoch, wander_m)
    noise = _scatter(factor, np.array(forces).reshape(-1, size))
    wide = max(noise, 1.0)
    return replace(factor, information=information / wide, vector=vector / wide, noise=noise)


def _scatter(factor: Factor, forces: Float[np.ndarray, "m p"]) -> float:
    """Variance between matches over that assumed, over x, y, heading and offset."""
    _, covariance = factor.alone()
    pose = covariance[: POSE - 1]
    assumed = pose @ factor.information @ pose.T
    steps = forces @ pose.T
    try:
        ratio = np.trace(np.linalg.solve(assumed, steps.T @ steps)) / (POSE - 1)
    except np.linalg.LinAlgError:
        return 1.0
    m = len(forces)
    return float((_PRIOR_MATCHES + max(ratio, 0.0) * m) / (_PRIOR_MATCHES + m))


def _differences(
    a: View, b: View, moments: _Moments, point: np.ndarray, epoch: float
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Differences (n, 2) of the two cameras' positions, their derivatives by the unknowns, and
    roots (2, n, 2, 2) of the covariances of the two.

    What the cameras err by is taken where both put a person together, and not where each does: a
    position's own noise in its mode would let a common scale shrink all differences to nothing.
    """
    e_a, e_b = point[POSE : POSE + MODES], point[POSE + MODES :]
    camera_a, camera_b = corrected(a.calibration, e_a), corrected(b.calibration, e_b)
    seen_a = regrounded_points(a.calibration, camera_a, moments.xy_a)
    seen_b = regrounded_points(b.calibration, camera_b, moments.xy_b)
    c, s = np.cos(point[2]), np.sin(point[2])
    turn = np.array([[c, -s], [s, c]])
    middle = (seen_a + seen_b @ turn.T + point[:2]) / 2
    modes_a = error_modes(camera_a, middle)
    modes_b = error_modes(camera_b, (middle - point[:2]) @ turn)
    true_a = seen_a - modes_a[:, :, -1] * e_a[-1]
    true_b = (seen_b - modes_b[:, :, -1] * e_b[-1]) @ turn.T
    step = true_a - true_b - point[:2]
    lever = middle - point[:2]
    moving = b.velocity_mps[moments.row_b] @ turn.T
    slopes = np.zeros((len(step), 2, len(point)))
    slopes[:, 0, 0] = slopes[:, 1, 1] = 1.0
    slopes[:, 0, 2], slopes[:, 1, 2] = -lever[:, 1], lever[:, 0]
    slopes[:, :, 3] = -moving
    slopes[:, :, 4] = -moving * (moments.time_s - epoch)[:, None]
    slopes[:, :, POSE : POSE + MODES] = modes_a
    slopes[:, :, POSE + MODES :] = -turn @ modes_b
    own = np.stack([a.covariance_m2[moments.row_a], b.covariance_m2[moments.row_b]])
    own[1] = turn @ own[1] @ turn.T
    return step, slopes, np.linalg.cholesky(own + 1e-8 * np.eye(2))


def _spreads(
    own: Float[np.ndarray, "2 n 2 2"], time_s: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "2 2*n 2*n"]:
    """Covariances of a match's differences: what the rows err by and the noise of every tick, and
    what wanders, for a wander of one metre.
    """
    n = len(time_s)
    apart = np.abs(time_s[:, None] - time_s[None])
    flat = own.reshape(2, 2 * n, 2)
    of_rows = (flat @ flat.swapaxes(1, 2)).sum(axis=0)
    found = np.zeros((2, n, 2, n, 2))
    found[0] = of_rows.reshape(n, 2, n, 2) * np.exp(-apart / _OWN_S)[:, None, :, None]
    found[0] += _JITTER_M**2 * np.eye(2 * n).reshape(n, 2, n, 2)
    found[1, :, 0, :, 0] = found[1, :, 1, :, 1] = np.exp(-apart / _WANDER_S)
    return found.reshape(2, 2 * n, 2 * n)


def _root(spreads: Float[np.ndarray, "2 m m"], wander_m: float) -> Float[np.ndarray, "m m"]:
    """Cholesky root of the covariance of a match's differences."""
    root: np.ndarray = np.linalg.cholesky(spreads[0] + wander_m**2 * spreads[1])
    return root
