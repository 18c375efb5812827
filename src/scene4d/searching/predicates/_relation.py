"""How two things move and stand to one another."""

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.searching.predicates._distance import Separation, near
from scene4d.searching.predicates._gaussian import (
    above,
    angle_between,
    form,
    in_wedge,
    ndtr,
    turned,
    wrapped,
)
from scene4d.searching.predicates._motion import speed
from scene4d.searching.predicates.stage import StageRows

SIDES = ("front", "back", "left", "right")
"""Sides of a vehicle, as its driver names them."""
# What the words mean, chosen by hand: towards is within an eighth of a turn and faster than people
# sway; who follows is some steps behind.
_TOWARDS_MPS = 0.3
_TOWARDS_RAD = np.pi / 4
_TOWARDS_SIGMA_MPS = 0.2
_FOLLOWING_M = 8.0
_FOLLOWING_SIGMA_M = 2.0
_TOGETHER_M = 2.0
_TOGETHER_SIGMA_M = 0.5
_TOGETHER_MPS = 0.7
"""Who goes with another is at arm's length or two, and half as fast as people walk against him at
most. The length of a conversation's "social distance" (Hall 1966: 1.2 to 3.7 m) has its middle
there; the speed was chosen by hand."""
_FACING_RAD = np.pi / 4
_FACING_SIGMA_RAD = np.radians(15.0)
_SIDE_SIGMA_M = 0.3
_LENGTH_M = 4.6
_WIDTH_M = 1.85
"""A common car, for vehicles of unknown size; only the difference of the two counts."""
AXIS_SIGMA_RAD = np.radians(10.0)
"""Of a heading without a spread of its own, as of a vehicle of which only the axis is known; chosen
by hand."""


def moving_towards(
    a: StageRows,
    b: StageRows,
    *,
    speed_mps: float = _TOWARDS_MPS,
    angle_rad: float = _TOWARDS_RAD,
    sigma_mps: float = _TOWARDS_SIGMA_MPS,
) -> Float[np.ndarray, "m"]:
    """P(a moves towards b): its velocity lies in the wedge about the direction to b.

    With u from a to b, the wedge holds the velocities that deviate from u by less than
    ``angle_rad`` once ``speed_mps`` along u is taken off (:func:`gaussian.in_wedge`). Spread: the
    covariance of a's velocity, that of the direction to b, and the word's softness ``sigma_mps``.
    Says nothing of what b does. NaN without two positions and a's velocity.
    """
    way = Separation.between(a, b)
    return _heads_along(a, way.unit, way.direction_sigma_rad, speed_mps, angle_rad, sigma_mps)


def moving_away(
    a: StageRows,
    b: StageRows,
    *,
    speed_mps: float = _TOWARDS_MPS,
    angle_rad: float = _TOWARDS_RAD,
    sigma_mps: float = _TOWARDS_SIGMA_MPS,
) -> Float[np.ndarray, "m"]:
    """P(a moves away from b): :func:`moving_towards` with the opposite direction."""
    way = Separation.between(a, b)
    return _heads_along(a, -way.unit, way.direction_sigma_rad, speed_mps, angle_rad, sigma_mps)


def _heads_along(
    a: StageRows,
    unit: np.ndarray,
    sigma_rad: np.ndarray,
    speed_mps: float,
    angle_rad: float,
    sigma_mps: float,
) -> np.ndarray:
    return in_wedge(
        a.velocity_mps,
        a.velocity_covariance,
        unit,
        apex=speed_mps,
        half_angle_rad=angle_rad,
        axis_sigma_rad=sigma_rad,
        sigma=sigma_mps,
    )


def following(
    a: StageRows,
    b: StageRows,
    *,
    tau_m: float = _FOLLOWING_M,
    sigma_m: float = _FOLLOWING_SIGMA_M,
    speed_mps: float = _TOWARDS_MPS,
    angle_rad: float = _TOWARDS_RAD,
    sigma_mps: float = _TOWARDS_SIGMA_MPS,
) -> Float[np.ndarray, "m"]:
    """P(a follows b): a moves towards b, b moves away from a, and they are near.

    The product of :func:`moving_towards` (a, b), :func:`moving_away` (b, a) and ``near`` within
    ``tau_m`` ± ``sigma_m`` metres, whose errors are taken as independent. Two who walk side by
    side do not follow one another.
    """
    how = {"speed_mps": speed_mps, "angle_rad": angle_rad, "sigma_mps": sigma_mps}
    behind = moving_towards(a, b, **how) * moving_away(b, a, **how)
    return np.asarray(behind * near(a, b, tau_m=tau_m, sigma_m=sigma_m))


def together(
    a: StageRows,
    b: StageRows,
    *,
    tau_m: float = _TOGETHER_M,
    sigma_m: float = _TOGETHER_SIGMA_M,
    speed_mps: float = _TOGETHER_MPS,
    sigma_mps: float = _TOWARDS_SIGMA_MPS,
) -> Float[np.ndarray, "m"]:
    """P(a and b are together): near within ``tau_m``, and one moves as the other does.

    P(near) times the probability that the difference of their velocities, Gaussian with the sum of
    their covariances, is shorter than ``speed_mps`` (:func:`motion.speed`). Who stands beside
    another is together with him, who passes him is not. NaN without positions and velocities.
    """
    covariance = a.velocity_covariance + b.velocity_covariance
    mean, variance = speed(a.velocity_mps - b.velocity_mps, covariance)
    alike = 1 - above(mean, speed_mps, sigma_mps, variance)
    return np.asarray(alike * near(a, b, tau_m=tau_m, sigma_m=sigma_m))


def facing(
    a: StageRows,
    b: StageRows,
    *,
    side: str | None = None,
    angle_rad: float = _FACING_RAD,
    sigma_rad: float = _FACING_SIGMA_RAD,
    sigma_m: float = _SIDE_SIGMA_M,
) -> Float[np.ndarray, "m"]:
    """P(a faces b): its heading points to b within ``angle_rad``. With ``side``: P(a stands at
    that side of the vehicle b), whichever way a looks.

    The angle between a's heading and the direction to b is Gaussian on the circle with the
    variances of both and ``sigma_rad`` for the word. The heading is what the track holds: from
    keypoints or motion. NaN where it is unknown.

    The ground about a vehicle belongs to the side whose face is nearest: a point (x, y) in the
    vehicle's own frame is before it where ``x - |y| > (length - width) / 2`` (a wedge, see
    :func:`gaussian.in_wedge`), behind it likewise, else left or right; the four probabilities sum
    to one. Spread: both positions, b's heading and size, ``sigma_m`` for the word. Where b's
    ``heading_sigma_rad`` is NaN only its axis is known: front and back, left and right then share
    their probability alike. NaN where b's heading is unknown. Raises :class:`InputError` for
    another side.
    """
    if side is not None and side not in SIDES:
        raise InputError(f"facing: side must be one of {', '.join(SIDES)}, found {side!r}")
    way = Separation.between(a, b)
    if side is not None:
        return _at_side(way, b, side, sigma_m)
    bearing = np.arctan2(way.unit[:, 1], way.unit[:, 0])
    only_axis = np.isnan(a.heading_sigma_rad)
    own = np.where(only_axis, AXIS_SIGMA_RAD, a.heading_sigma_rad)
    sigma = np.sqrt(own**2 + way.direction_sigma_rad**2 + sigma_rad**2)
    off = wrapped(a.heading_rad - bearing)
    ahead = angle_between(off, sigma, -angle_rad, angle_rad)
    behind = angle_between(wrapped(off + np.pi), sigma, -angle_rad, angle_rad)
    return np.where(only_axis, (ahead + behind) / 2, ahead)


def _at_side(way: Separation, b: StageRows, side: str, sigma_m: float) -> np.ndarray:
    only_axis = np.isnan(b.heading_sigma_rad)
    own = np.where(only_axis, AXIS_SIGMA_RAD, b.heading_sigma_rad)
    forwards = np.stack([np.cos(b.heading_rad), np.sin(b.heading_rad)], axis=1)
    place = -way.vector_m
    length, width, apex_sigma = outline(b)
    along = apex_sigma[:, None] * forwards

    def beyond(axis: np.ndarray) -> np.ndarray:
        return in_wedge(
            place,
            way.covariance_m2 + along[:, :, None] * along[:, None, :],
            axis,
            apex=(length - width) / 2,
            half_angle_rad=np.pi / 4,
            axis_sigma_rad=own,
            sigma=sigma_m,
        )

    ends = beyond(forwards), beyond(-forwards)
    beside = np.clip(1 - ends[0] - ends[1], 0.0, 1.0)
    if side in ("front", "back"):
        known = ends[SIDES.index(side)]
        return np.where(only_axis, (ends[0] + ends[1]) / 2, known)
    leftwards = turned(forwards)
    off = (place * leftwards).sum(axis=1)
    turn = np.minimum(own, 1.0) * (place * forwards).sum(axis=1)
    spread = np.sqrt(form(leftwards, way.covariance_m2) + turn**2 + sigma_m**2)
    left = ndtr(off / spread)
    share = left if side == "left" else 1 - left
    return np.where(only_axis, beside / 2, beside * share)


def outline(b: StageRows) -> tuple[Float[np.ndarray, "m"], ...]:
    """Length, width and the error of half of them; those of a common car where they are unknown."""
    (length, width), (by_length, by_width) = b.size_m[:, :2].T, b.size_sigma_m[:, :2].T
    sigma = np.hypot(by_length, by_width) / 2
    known = np.isfinite(length + width + sigma)
    return (
        np.where(known, length, _LENGTH_M),
        np.where(known, width, _WIDTH_M),
        np.where(known, sigma, 0.0),
    )
