"""Ground positions of people from feet, head and box, weighted by their information.

Each person has two ends in the image. The lower end is on the ground: both feet, else one foot,
else the bottom of the box, which touches the near rim of a cylinder around the body's axis. The
upper end is at the person's height: the top of the head, else the top of the box, which is tangent
to the head's sphere. The foot keypoints and the bottom of the same box have correlated errors (0.8
on PETS), so only the better one is used. Where keypoints show a head but no foot, the legs are
hidden and the bottom of the box is not used (on PETS it is 0.6 m off).

The two ends are combined by information weighting. Where they disagree by more than chance
(:data:`_DISAGREEMENT`), one of them is wrong: the legs are hidden, or the person stoops. Visible
feet are preferred if the contradiction is clear (:data:`_CONTRADICTION`). When only a box is seen,
either end may be the wrong one, and the covariance covers both (on PETS the bottom is right ten
times in eleven; behind parked cars it is wrong).

The error shared by both ends, because the middle of the body is not exactly above the middle of
the feet, is added to the covariance at the end (:data:`BODY_SIGMA_M`).
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

from scene4d.core.body import HEIGHT_SIGMA_M, PERSON_HEIGHT_M
from scene4d.core.camera import Camera
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.tracking._people_heading import body_headings
from scene4d.tracking._people_placing import (
    Placed,
    Seen,
    at_height,
    inverse,
    on_the_ground,
)
from scene4d.tracking._people_points import BOTH_FEET, BOX_SHARE, ONE_FOOT

BODY_SIGMA_M = 0.085
"""Spread of the body's middle about that of its feet or head, on the ground."""
_CONTRADICTION = 4.0
"""Ends farther apart than this many standard deviations (Mahalanobis) contradict each other."""
_DISAGREEMENT = 2.0
"""Ends farther apart than this (same measure) disagree; up to this limit their stated errors hold
on PETS."""
_SHORTEST_M = 0.3
"""Who seems shorter is cut, or hidden."""


@dataclass(frozen=True, eq=False)
class Explained:
    """Positions, and the names of the ends they are based on, ``""`` where none was used."""

    located: Located
    lower: np.ndarray
    upper: np.ndarray


def locate_people(
    detections: Detections,
    camera: Camera,
    *,
    height_m: float | Float[np.ndarray, "n"] = PERSON_HEIGHT_M,
    height_sigma_m: float | Float[np.ndarray, "n"] = HEIGHT_SIGMA_M,
    box_share: float = BOX_SHARE,
) -> Located:
    """Positions of people, with the independent part of their covariance, and body headings.

    ``detections`` holds only people, in pixels of the footage. ``height_m`` and its standard
    deviation are one number for everyone or one per row (a track's own height). ``box_share`` is
    the spread of box edges as a share of a person's length in the image. A row has no position
    (NaN) if neither end determines it well enough. Raises :class:`InputError` if the detections'
    image size is not the camera's.
    """
    return explain_people(
        detections,
        camera,
        height_m=height_m,
        height_sigma_m=height_sigma_m,
        box_share=box_share,
    ).located


def explain_people(
    detections: Detections,
    camera: Camera,
    *,
    height_m: float | Float[np.ndarray, "n"] = PERSON_HEIGHT_M,
    height_sigma_m: float | Float[np.ndarray, "n"] = HEIGHT_SIGMA_M,
    box_share: float = BOX_SHARE,
) -> Explained:
    """Like :func:`locate_people`, with the names of the ends each position is based on."""
    n = len(detections)
    seen = Seen.by(detections, camera, box_share)
    tall = np.broadcast_to(np.asarray(height_m, float), n)
    lower = on_the_ground(seen.below, seen.below_rays)
    upper = at_height(
        seen.above, seen.above_rays, tall, np.broadcast_to(np.asarray(height_sigma_m, float), n)
    )
    on_foot = np.isin(seen.below.by, (BOTH_FEET, ONE_FOOT))
    apart = _apart(lower, upper)
    use_lower, use_upper = lower.known, upper.known & ~(on_foot & (apart > _CONTRADICTION))
    xy, covariance = _combined(lower, upper, use_lower, use_upper)
    covariance = covariance + _either(lower, upper, xy, np.where(on_foot, 0.0, apart))
    heading, heading_sigma = body_headings(detections, camera, tall)
    known = use_lower | use_upper
    pull, information = _shown_height(seen, lower, upper, tall, height_sigma_m)
    located = Located(
        xy_m=xy,
        covariance_m2=covariance + BODY_SIGMA_M**2 * np.eye(2),
        heading_rad=np.where(known, heading, np.nan),
        heading_sigma_rad=np.where(known, heading_sigma, np.nan),
        heading_is_axis=np.zeros(n, bool),
        size_pull=pull,
        size_information=information,
    )
    return Explained(
        located, np.where(use_lower, seen.below.by, ""), np.where(use_upper, seen.above.by, "")
    )


def _shown_height(
    seen: Seen,
    lower: Placed,
    upper: Placed,
    tall: Float[np.ndarray, "n"],
    sigma_m: float | Float[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """What both ends say of the height (:class:`.Located`): where the ray through the head is
    nearest to the upright on the feet. By ``w`` it moves along the ground per metre of height.
    """
    d = seen.above_rays.direction
    with np.errstate(all="ignore"):
        w = d[:, :2] / d[:, 2:]
        along = w / (w**2).sum(axis=1)[:, None]
        height_m = tall + (along * (lower.xy_m - upper.xy_m)).sum(axis=1)
        noise = lower.covariance_m2 + upper.covariance_m2 + BODY_SIGMA_M**2 * np.eye(2)
        variance = np.einsum("ni,nij,nj->n", along, noise, along) - np.square(sigma_m)
        told = height_m**2 / variance
    told = np.where((height_m > _SHORTEST_M) & (variance > 0), told, 0.0)
    pull, information = np.zeros((len(tall), 3)), np.zeros((len(tall), 3, 3))
    information[:, 2, 2] = told
    pull[:, 2] = told * np.log(np.maximum(height_m, _SHORTEST_M))
    pull[told == 0] = 0.0
    return pull, information


def _apart(lower: Placed, upper: Placed) -> Float[np.ndarray, "n"]:
    """Mahalanobis distance of the two ends; 0 where either is missing."""
    gap = upper.xy_m - lower.xy_m
    total = lower.covariance_m2 + upper.covariance_m2
    with np.errstate(all="ignore"):
        apart = np.sqrt(np.einsum("ni,nij,nj->n", gap, inverse(total), gap))
    return np.nan_to_num(apart)


def _either(
    lower: Placed, upper: Placed, xy_m: Float[np.ndarray, "n 2"], apart: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 2 2"]:
    """Covariance to add where either end may be the right one: the mean square of their offsets
    from the position, as far as they exceed chance.
    """
    share = 1 - np.minimum(1.0, _DISAGREEMENT / np.maximum(apart, 1e-9)) ** 2
    added = np.zeros((len(apart), 2, 2))
    for end in (lower, upper):
        way = np.where(share[:, None] > 0, end.xy_m - xy_m, 0.0)
        added += 0.5 * share[:, None, None] * way[:, :, None] * way[:, None, :]
    return added


def _combined(
    lower: Placed, upper: Placed, use_lower: np.ndarray, use_upper: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Information-weighted mean of the ends used and its covariance; NaN where none is used."""
    information, pull = np.zeros((len(use_lower), 2, 2)), np.zeros((len(use_lower), 2))
    for end, used in ((lower, use_lower), (upper, use_upper)):
        weight = np.where(used[:, None, None], inverse(end.covariance_m2), 0.0)
        information += weight
        pull += np.einsum("nij,nj->ni", weight, np.where(used[:, None], end.xy_m, 0.0))
    with np.errstate(all="ignore"):  # zero where neither is used
        covariance = inverse(information)
    return np.einsum("nij,nj->ni", covariance, pull), covariance
