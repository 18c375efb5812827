"""Changes of direction: turns left and right, turning round, driving backwards."""

import numpy as np
from jaxtyping import Float

from scene4d.searching.predicates._gaussian import angle_between, direction, wrapped
from scene4d.searching.predicates._motion import MOVING_MPS, SPEED_SIGMA_MPS, moving
from scene4d.searching.predicates.stage import Stage, StageRows

# What the words mean, chosen by hand: a bend is no turn, a half circle may be cut short.
_TURN_WINDOW_S = 2.0
_TURN_RAD = np.radians(15.0)
_TURN_SIGMA_RAD = np.radians(5.0)
_U_TURN_WINDOW_S = 12.0
_U_TURN_RAD = np.radians(130.0)
_U_TURN_SIGMA_RAD = np.radians(15.0)
_REVERSE_MPS, _REVERSE_POWER = 0.75, 3.0
"""The odds that somebody drives backwards fall with the third power of the speed: of the stretches
of motion on the tuning cameras 36 % below 1 m/s are driven backwards where nothing else says so,
12 % at 1.75 m/s, none of 238 above 2 m/s (medians: 1.0 m/s backwards, 2.8 m/s forwards)."""
_FLIP_SIGMA_RAD = np.radians(20.0)
"""How far from opposite a new direction may be that is driven in another gear; chosen by hand."""


def turning_left(
    a: StageRows,
    *,
    angle_rad: float = _TURN_RAD,
    window_s: float = _TURN_WINDOW_S,
    speed_mps: float = MOVING_MPS,
    sigma_rad: float = _TURN_SIGMA_RAD,
) -> Float[np.ndarray, "m"]:
    """P(a turns left): its direction of motion turns by more than ``angle_rad`` from +X towards +Y
    within ``window_s`` seconds about the moment, and it moves.

    The turn is the angle between the velocities at the ends of the window, or at the outermost
    moments in it at which the speed is above ``speed_mps``; it is Gaussian on the circle with
    ``n⊥ᵀ C n⊥ / |v|²`` of both ends and ``sigma_rad`` for the word. Turns of more than half a
    circle in one window are not told from their complement. Times :func:`moving` at the moment.
    """
    turn, sigma = _turn(a, window_s, speed_mps, sigma_rad)
    return angle_between(turn, sigma, angle_rad, np.pi) * moving(a, speed_mps=speed_mps)


def turning_right(
    a: StageRows,
    *,
    angle_rad: float = _TURN_RAD,
    window_s: float = _TURN_WINDOW_S,
    speed_mps: float = MOVING_MPS,
    sigma_rad: float = _TURN_SIGMA_RAD,
) -> Float[np.ndarray, "m"]:
    """P(a turns right): :func:`turning_left` seen in a mirror."""
    turn, sigma = _turn(a, window_s, speed_mps, sigma_rad)
    return angle_between(turn, sigma, -np.pi, -angle_rad) * moving(a, speed_mps=speed_mps)


def u_turning(
    a: StageRows,
    *,
    angle_rad: float = _U_TURN_RAD,
    window_s: float = _U_TURN_WINDOW_S,
    speed_mps: float = MOVING_MPS,
    sigma_rad: float = _U_TURN_SIGMA_RAD,
) -> Float[np.ndarray, "m"]:
    """P(a turns round): as :func:`turning_left`, to either side, by more than 130° in 12 s."""
    turn, sigma = _turn(a, window_s, speed_mps, sigma_rad)
    straight = angle_between(turn, sigma, -angle_rad, angle_rad)
    return (1 - straight) * moving(a, speed_mps=speed_mps)


def _turn(
    a: StageRows, window_s: float, speed_mps: float, sigma_rad: float
) -> tuple[np.ndarray, np.ndarray]:
    """Turn over the window about every row, and its standard deviation; 0 where it stood."""
    stage, index = a.stage, a.index
    tracks = stage.tracks
    early, late = stage.window(index, window_s / 2)
    v = tracks.velocity_mps
    rows = np.flatnonzero((v**2).sum(axis=1) > speed_mps**2)
    turn, sigma = np.zeros(len(index)), np.full(len(index), sigma_rad)
    if len(rows):
        first = rows[np.minimum(np.searchsorted(rows, early), len(rows) - 1)]
        last = rows[np.maximum(np.searchsorted(rows, late, side="right") - 1, 0)]
        moved = (first >= early) & (first < last) & (last <= late)
        ends = [
            direction(v[at[moved]], tracks.velocity_covariance[at[moved]]) for at in (first, last)
        ]
        turn[moved] = wrapped(ends[1][0] - ends[0][0])
        sigma[moved] = np.sqrt(ends[0][1] ** 2 + ends[1][1] ** 2 + sigma_rad**2)
    return turn, sigma


def reversing(
    a: StageRows, *, speed_mps: float = MOVING_MPS, sigma_mps: float = SPEED_SIGMA_MPS
) -> Float[np.ndarray, "m"]:
    """P(a vehicle moves against its heading).

    A heading that is taken from the motion cannot disagree with it, but a vehicle cannot turn on
    the spot either: where its direction of motion flips by more than 90° between two stretches of
    motion, it has changed gear (probability on the circle, 20° for the word). Backwards one drives
    slowly: the odds that a stretch of top speed v is driven backwards are ``(0.75 m/s / v)³``, and
    those of a whole track, of either gear at its begin, are the product over its stretches. So a
    vehicle that backs out and drives away reverses at first, and one that is only seen to drive
    one way hardly ever does. Where the track holds a heading of its own (with
    ``heading_sigma_rad``) that opposes the motion, that counts as well. Times :func:`moving`.
    """
    gear = _backwards(a, speed_mps)
    angle, sigma = direction(a.velocity_mps, a.velocity_covariance)
    known = np.isfinite(a.heading_rad) & np.isfinite(a.heading_sigma_rad)
    own = np.where(known, a.heading_sigma_rad, 1.0)
    off = np.where(known, wrapped(a.heading_rad - angle), 0.0)
    forwards = angle_between(off, np.hypot(sigma, own), -np.pi / 2, np.pi / 2)
    # Agreement proves nothing, see above.
    opposed = np.where(known & (np.abs(off) > np.pi / 2), 1 - forwards, 0.0)
    either = 1 - (1 - gear) * (1 - opposed)
    return np.asarray(either * moving(a, speed_mps=speed_mps, sigma_mps=sigma_mps))


def _backwards(a: StageRows, speed_mps: float) -> np.ndarray:
    """P(the gear of a row's stretch of motion is the reverse one); 0 in no stretch."""
    stage = a.stage
    wanted = np.zeros(len(stage.first_row), bool)
    wanted[stage.track_of_row[a.index]] = True
    v = stage.tracks.velocity_mps
    quick = (v**2).sum(axis=1) > speed_mps**2
    rows = np.flatnonzero(quick & wanted[stage.track_of_row])
    found = np.zeros(len(stage.tracks))
    if len(rows):
        found[rows] = _gears(stage, rows)
    return found[a.index]


def _gears(stage: Stage, rows: np.ndarray) -> np.ndarray:
    """As :func:`_backwards`, of the rows in motion, ordered by (track, time)."""
    track, v = stage.track_of_row[rows], stage.tracks.velocity_mps[rows]
    other = track[1:] != track[:-1]
    cut = other | (np.diff(rows) > 1) | ((v[1:] * v[:-1]).sum(axis=1) < 0)
    begin = np.flatnonzero(np.append(True, cut))
    end = np.append(begin[1:], len(rows)) - 1
    stretch = np.cumsum(np.append(False, cut))
    angle, sigma = direction(v, stage.tracks.velocity_covariance[rows])
    fastest = np.maximum.reduceat(np.hypot(v[:, 0], v[:, 1]), begin)
    turn = wrapped(angle[begin[1:]] - angle[end[:-1]])
    doubt = np.sqrt(sigma[begin[1:]] ** 2 + sigma[end[:-1]] ** 2 + _FLIP_SIGMA_RAD**2)
    flip = 1 - angle_between(turn, doubt, -np.pi / 2, np.pi / 2)
    owner = track[begin]
    fresh = np.append(True, owner[1:] != owner[:-1])
    # Expected sign of every stretch's gear, against the first one of its track.
    sign = np.ones(len(begin))
    step = np.append(1.0, 1 - 2 * flip)
    for at in np.flatnonzero(~fresh):
        sign[at] = sign[at - 1] * step[at]
    number = np.cumsum(fresh) - 1
    top = np.full((2, number[-1] + 1), _REVERSE_MPS)
    np.maximum.at(top, ((sign < 0).astype(int), number), fastest)
    with_first, against = top**_REVERSE_POWER
    first = (against / (with_first + against))[number]
    with_it = (1 + sign) / 2
    return np.asarray((with_it * first + (1 - with_it) * (1 - first))[stretch])
