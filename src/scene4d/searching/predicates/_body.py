"""What a body does, from its keypoints (Halpe 26)."""

import numpy as np
from jaxtyping import Float

from scene4d.core.body import HALPE26, MIN_KEYPOINT_SCORE, PERSON_HEIGHT_M
from scene4d.searching.predicates._gaussian import above
from scene4d.searching.predicates.stage import StageRows

_ARM_MPS, _ARM_SIGMA_MPS, _ARM_WINDOW_S = 0.4, 0.2, 0.6
"""A wrist that moves so fast for so long rises or sinks; chosen by hand: a walking arm swings less
along the body."""
_KEYPOINT_SHARE = 0.02
"""Spread of a keypoint, as a share of the body's length in the picture; chosen by hand."""
_TORSO_SHARE = 0.29
"""From the hips to the shoulders, as a share of the body's height."""
_LEG_TO_TOP_SHARE = 0.95
"""From the ankles to the top of the head, likewise."""
_MOST_ROWS = 15
"""Rows of a window that a slope is taken from: more hardly change it."""


def arm_moving_up(
    a: StageRows,
    *,
    speed_mps: float = _ARM_MPS,
    window_s: float = _ARM_WINDOW_S,
    sigma_mps: float = _ARM_SIGMA_MPS,
) -> Float[np.ndarray, "m"]:
    """P(a wrist rises): faster than ``speed_mps`` against its shoulder, along the body.

    In the picture, up is from the feet (or hips) to the head (or shoulders). The elevation of a
    wrist over its shoulder along that line, divided by the length of the body in pixels and times
    1.70 m, is in metres and knows neither the size of the person nor of the picture. Its rate is
    the slope of a line through the rows within ``window_s``; spread: 2 % of the body's length for
    each keypoint, and the word's. Of the two arms the faster counts. NaN without keypoints.

    The body's vertical plane across the line of sight is what a picture shows: a hand that is
    stretched out towards a camera that looks down by θ seems to sink by tan θ of its way.
    """
    return _arms(a, 1.0, speed_mps, window_s, sigma_mps)


def arm_moving_down(
    a: StageRows,
    *,
    speed_mps: float = _ARM_MPS,
    window_s: float = _ARM_WINDOW_S,
    sigma_mps: float = _ARM_SIGMA_MPS,
) -> Float[np.ndarray, "m"]:
    """P(a wrist sinks): :func:`arm_moving_up` with the opposite sign."""
    return _arms(a, -1.0, speed_mps, window_s, sigma_mps)


def _arms(
    a: StageRows, sign: float, speed_mps: float, window_s: float, sigma_mps: float
) -> np.ndarray:
    if a.stage.tracks.keypoint_uv.shape[1] != len(HALPE26):
        return np.full(len(a), np.nan)
    early, late = a.stage.window(a.index, window_s / 2)
    count = min(int((late - early).max(initial=0)) + 1, _MOST_ROWS)
    # At most so many rows of every window, evenly spread; NaN beyond a short one.
    share = np.arange(count) / max(count - 1, 1)
    at = np.rint(early[:, None] + share * (late - early)[:, None]).astype(int)
    again = np.append(np.zeros((len(at), 1), bool), at[:, 1:] == at[:, :-1], axis=1)
    rows, place = np.unique(at, return_inverse=True)
    height = _elevations(a.stage.rows(rows))[place.reshape(at.shape)]
    time = a.stage.tracks.time_s[at] - a.time_s[:, None]
    arms = []
    for arm in range(2):
        known = np.isfinite(height[:, :, arm]) & ~again
        rate, variance = _slope(time, np.where(known, height[:, :, arm], 0.0), known)
        arms.append(above(sign * rate, speed_mps, sigma_mps, variance))
    return np.fmax(*arms)


def _elevations(rows: StageRows) -> np.ndarray:
    """Metres (m, 2) of the left and right wrist over their shoulders; NaN where not seen."""
    uv, score = rows.keypoint_uv, rows.keypoint_score
    uv = np.where((score >= MIN_KEYPOINT_SCORE)[:, :, None], uv, np.nan)

    def point(*names: str) -> np.ndarray:
        found = uv[:, [HALPE26.index(name) for name in names]]
        return found.sum(axis=1) / len(names)

    hips, shoulders = point("left_hip", "right_hip"), point("left_shoulder", "right_shoulder")
    torso = (shoulders - hips) / _TORSO_SHARE
    feet, top = point("left_ankle", "right_ankle"), point("head_top")
    whole = (top - feet) / _LEG_TO_TOP_SHARE
    body = np.where(np.isfinite(whole).all(axis=1, keepdims=True), whole, torso)
    square = (body**2).sum(axis=1)
    square = np.where(square > 0, square, np.nan)
    arms = []
    for side in ("left", "right"):
        reach = point(f"{side}_wrist") - point(f"{side}_shoulder")
        arms.append((reach * body).sum(axis=1) / square * PERSON_HEIGHT_M)
    return np.stack(arms, axis=1)


def _slope(time: np.ndarray, value: np.ndarray, known: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Slope (m,) of the line through the known values and its variance; NaN with fewer than two."""
    n = known.sum(axis=1)
    with np.errstate(divide="ignore", invalid="ignore"):
        mean = np.where(known, time, 0.0).sum(axis=1) / n
        off = np.where(known, time - mean[:, None], 0.0)
        spread = (off**2).sum(axis=1)
        rate = (off * value).sum(axis=1) / spread
        one = 2 * (_KEYPOINT_SHARE * PERSON_HEIGHT_M) ** 2
        variance = one / spread
    bad = (n < 2) | (spread == 0)
    return np.where(bad, np.nan, rate), np.where(bad, np.nan, variance)
