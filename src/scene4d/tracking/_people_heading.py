"""Body headings of people, from the shoulder line and the direction of the feet.

The vector from the right to the left shoulder, turned by a right angle, and the vectors from the
heels to the toes all point forwards. Divided by their lengths on an average body they are noisy
measurements of one unit vector. Their joint likelihood over a circle of directions gives the
distribution of the heading, whose mean and circular standard deviation are reported. This is the
heading of the body, which usually but not always faces the direction of walking.

Lengths and spreads are measured on PETS 2009 by ``benchmarks/people_positions.py``, against the
direction of walking.
"""

import numpy as np
from jaxtyping import Float

from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.tracking._people_placing import inverse, pixel_sigma
from scene4d.tracking._people_points import body_point
from scene4d.tracking._rays import Rays

_SHOULDER_HEIGHT = 0.82
"""Height of the shoulders as a share of the person's."""
_SHOULDERS_M = 0.33
"""Distance between the shoulders' keypoints on the ground plan."""
_FOOT_M = 0.16
"""From the heel to the middle of the two toes' keypoints."""
_SHOULDER_SHARE = 0.03
_FOOT_SHARE = 0.03
"""Spread of a difference of two points, as a share of the person's length in the image."""
_TURN_M = 0.08
"""Additional spread on the ground, because bodies twist and feet turn."""
_WRONG = 0.04
"""Share of headings that can be anything because left and right are confused."""
_TOO_WIDE_RAD = np.radians(75.0)
"""A heading with a larger standard deviation is not reported."""
_DIRECTIONS = 48


def body_headings(
    detections: Detections, camera: Camera, height_m: Float[np.ndarray, "n"]
) -> tuple[Float[np.ndarray, "n"], Float[np.ndarray, "n"]]:
    """Headings (n,) from +X to +Y and their standard deviations, radians; NaN where unknown."""
    n = len(detections)
    heading = sigma = np.full(n, np.nan)
    information, pull = np.zeros((n, 2, 2)), np.zeros((n, 2))
    for forwards, covariance in _sightings(detections, camera, height_m):
        weight = inverse(covariance)
        seen = np.isfinite(weight).all(axis=(1, 2)) & np.isfinite(forwards).all(axis=1)
        information[seen] += weight[seen]
        pull[seen] += np.einsum("nij,nj->ni", weight[seen], forwards[seen])
    angle = np.arange(_DIRECTIONS) * (2 * np.pi / _DIRECTIONS)
    unit = np.column_stack([np.cos(angle), np.sin(angle)])
    # log of N(forwards; unit, covariance), up to a constant
    log = pull @ unit.T - np.einsum("ki,nij,kj->nk", unit, information, unit) / 2
    weight = np.exp(log - log.max(axis=1, keepdims=True))
    mean = (weight @ unit) / weight.sum(axis=1, keepdims=True) * (1 - _WRONG)
    with np.errstate(divide="ignore"):  # nothing seen: all directions are alike
        sigma = np.sqrt(-2 * np.log(np.hypot(mean[:, 0], mean[:, 1])))
    heading = np.arctan2(mean[:, 1], mean[:, 0])
    sure = sigma < _TOO_WIDE_RAD
    return np.where(sure, heading, np.nan), np.where(sure, sigma, np.nan)


def _sightings(
    detections: Detections, camera: Camera, height_m: np.ndarray
) -> list[tuple[np.ndarray, np.ndarray]]:
    """Noisy forward unit vectors (n, 2) and their covariances; NaN where not seen."""
    shoulders, covariance = _vector(
        detections,
        camera,
        ("right_shoulder",),
        ("left_shoulder",),
        _SHOULDER_HEIGHT * height_m,
        _SHOULDER_SHARE,
    )
    forwards = np.column_stack([shoulders[:, 1], -shoulders[:, 0]])
    # turned by a right angle: x' = y, y' = -x
    turned = covariance[:, ::-1, ::-1] * np.array([[1, -1], [-1, 1]])
    found = [(forwards / _SHOULDERS_M, turned / _SHOULDERS_M**2)]
    ground = np.zeros(len(detections))
    for side in ("left", "right"):
        toes = (f"{side}_big_toe", f"{side}_small_toe")
        foot, covariance = _vector(detections, camera, (f"{side}_heel",), toes, ground, _FOOT_SHARE)
        found.append((foot / _FOOT_M, covariance / _FOOT_M**2))
    return found


def _vector(
    detections: Detections,
    camera: Camera,
    tail: tuple[str, ...],
    tip: tuple[str, ...],
    level_m: np.ndarray,
    share: float,
) -> tuple[np.ndarray, np.ndarray]:
    """From one body point to another on the plane at ``level_m``, and its covariance."""
    n = len(detections)
    (from_uv, from_seen), (to_uv, to_seen) = (
        body_point(detections, tail),
        body_point(detections, tip),
    )
    rays = Rays.through(camera, np.concatenate([from_uv, to_uv]))
    start, end = (rays.select(half).meet(level_m) for half in (slice(n), slice(n, None)))
    noise = end.by_uv * pixel_sigma(np.full((n, 2), share), end.px_per_m)[:, None, :]
    covariance = noise @ np.swapaxes(noise, 1, 2) + _TURN_M**2 * np.eye(2)
    seen = from_seen & to_seen
    return (
        np.where(seen[:, None], end.xy_m - start.xy_m, np.nan),
        np.where(seen[:, None, None], covariance, np.nan),
    )
