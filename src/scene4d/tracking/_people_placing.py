"""Ground positions of the body's axis, with covariances, from the visible ends of people."""

from collections.abc import Callable
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.body import FOOT_HEIGHT_M, PERSON_HEIGHT_M
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.tracking._people_points import Ends, lower_ends, upper_ends
from scene4d.tracking._rays import Level, Rays

_FLOOR_PX = 1.0
"""Smallest spread of any image point."""
_TOO_UNSURE = 0.3
"""An end with an error above this share of its distance from the camera is not used."""


@dataclass(frozen=True, eq=False)
class Seen:
    """Both ends of people, and the rays through them."""

    below: Ends
    above: Ends
    below_rays: Rays
    above_rays: Rays

    @classmethod
    def by(cls, detections: Detections, camera: Camera, box_share: float) -> "Seen":
        """The ends that detections show. Raises :class:`InputError` if the image sizes differ."""
        if detections.image_size != camera.image_size:
            (w, h), (cw, ch) = detections.image_size, camera.image_size
            raise InputError(
                f"the detections are of {w}x{h} images and the camera is for {cw}x{ch}: "
                "calibrate footage of this size"
            )
        below, above = lower_ends(detections, box_share), upper_ends(detections, box_share)
        below = replace(below, uv=below.uv + _centring(below, camera, on_the_ground))
        above = replace(above, uv=above.uv + _centring(above, camera, _at_mean_height))
        rays = Rays.through(camera, np.concatenate([below.uv, above.uv]))
        n = len(detections)
        return cls(below, above, rays.select(slice(n)), rays.select(slice(n, None)))


@dataclass(frozen=True, eq=False)
class Placed:
    """The body's axis on the ground (n, 2) from one end, with covariance; NaN where not usable."""

    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]

    @property
    def known(self) -> Bool[np.ndarray, "n"]:
        """Which rows have a position."""
        known: np.ndarray = np.isfinite(self.xy_m).all(axis=1)
        return known


def pixel_sigma(
    share: Float[np.ndarray, "n 2"], px_per_m: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 2"]:
    """Spread (px) of points: a share of the person's length in the image, plus the floor."""
    return np.hypot(_FLOOR_PX, share * (PERSON_HEIGHT_M * px_per_m)[:, None])


def on_the_ground(ends: Ends, rays: Rays) -> Placed:
    """From lower ends: the feet, or the axis behind the rim that the bottom of a box touches."""
    back = -rays.row_normal[:, :2]
    with np.errstate(all="ignore"):  # looking straight down, no side is nearest
        back = back / np.hypot(back[:, 0], back[:, 1])[:, None]
    level = rays.meet(np.where(ends.radius_m > 0, 0.0, FOOT_HEIGHT_M))
    behind = np.where(ends.radius_m[:, None] > 0, ends.radius_m[:, None] * back, 0.0)
    spread = ends.spread_m[:, None, None] ** 2 * np.eye(2)
    return _placed(ends, rays, level, behind, spread)


def at_height(
    ends: Ends, rays: Rays, height_m: Float[np.ndarray, "n"], sigma_m: Float[np.ndarray, "n"]
) -> Placed:
    """From upper ends: at the person's height, or inside the sphere that a box's top touches."""
    inwards = ends.radius_m[:, None] * rays.row_normal
    level = rays.meet(height_m - ends.radius_m - inwards[:, 2])
    moved = level.by_height * sigma_m[:, None]
    return _placed(ends, rays, level, inwards[:, :2], moved[:, :, None] * moved[:, None, :])


def _at_mean_height(ends: Ends, rays: Rays) -> Placed:
    n = len(ends.radius_m)
    return at_height(ends, rays, np.full(n, PERSON_HEIGHT_M), np.zeros(n))


def _centring(ends: Ends, camera: Camera, place: Callable[[Ends, Rays], Placed]) -> np.ndarray:
    """Shift (n, 2) of points on box edges that puts the body's middle in the box's middle.

    A box is centred on the whole body. The points that touch its edges are off-centre where
    verticals are slanted in the image or the camera is rolled. Zero for keypoints.
    """
    shift = np.zeros_like(ends.uv)
    rows = (ends.radius_m > 0) & (ends.by != "")
    if rows.any():
        boxes = ends.select(rows)
        xy = place(boxes, Rays.through(camera, boxes.uv)).xy_m
        foot, head = (
            camera.project(np.column_stack([xy, np.full(len(xy), z)]))[0]
            for z in (0.0, PERSON_HEIGHT_M)
        )
        shift[rows, 0] = np.nan_to_num(boxes.uv[:, 0] - (foot + head)[:, 0] / 2)
    return shift


def _placed(
    ends: Ends, rays: Rays, level: Level, shift: np.ndarray, covariance: np.ndarray
) -> Placed:
    by_noise = level.by_uv * pixel_sigma(ends.share, level.px_per_m)[:, None, :]
    covariance = covariance + by_noise @ np.swapaxes(by_noise, 1, 2)
    with np.errstate(all="ignore"):
        far = np.linalg.norm(level.xy_m - rays.origin_m[:2], axis=1)
        far = np.hypot(far, rays.origin_m[2])
        sure = np.sqrt(_largest_variance(covariance)) <= _TOO_UNSURE * far
    xy = np.where(sure[:, None], level.xy_m + shift, np.nan)
    return Placed(xy, np.where(sure[:, None, None], covariance, np.nan))


def _largest_variance(covariance: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n"]:
    """The larger eigenvalue of symmetric 2x2 matrices, NaN for those that hold NaN."""
    a, b, d = covariance[:, 0, 0], covariance[:, 0, 1], covariance[:, 1, 1]
    return (a + d) / 2 + np.hypot((a - d) / 2, b)


def inverse(matrix: Float[np.ndarray, "n 2 2"]) -> Float[np.ndarray, "n 2 2"]:
    """Inverses of 2x2 matrices, NaN for those that are singular or hold NaN."""
    (a, b), (c, d) = np.moveaxis(matrix, 0, 2)
    with np.errstate(all="ignore"):
        inverted = np.array([[d, -b], [-c, a]]) / (a * d - b * c)
    return np.where(np.isfinite(inverted), inverted, np.nan).transpose(2, 0, 1)
