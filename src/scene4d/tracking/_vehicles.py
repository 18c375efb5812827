"""Where vehicles stand: the middle of the vehicle on the ground, from its bounding box.

The middle of a box's bottom edge is the usual stand-in. It lies under the nearest bumper, one to
several metres before the vehicle's middle. Here a vehicle of typical size stands on the ground so
that its picture fills the box; see :mod:`scene4d.tracking._vehicle_fit`.
"""

from dataclasses import replace

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.tracking._vehicle_fit import Bells, Boxes, Fits, fit
from scene4d.tracking._vehicle_shapes import SHAPES

_BELLS = 8
"""Headings from which a vehicle is fitted, 22.5 degrees apart over half a turn. Chosen by hand;
``python -m benchmarks.vehicle_positions`` measures what comes of it, as of the errors below."""
_BIAS_SHARE = 0.03
"""Error of a box's edge that all frames have in common, as a share of the box's width or height:
the detector's habit, and how this vehicle differs from a typical outline. Chosen by hand."""
JITTER_SHARE = 0.02
"""Error of a box's edge that is new in every frame, as the same share. Chosen by hand."""
_FLOOR_PX = 1.0
"""The least of both errors, in pixels: boxes are rounded."""
_BORDER_SHARE = 0.0025
"""A box that comes as near to the picture's border, as a share of its width or height, is cut."""
_LEAST_BORDER_PX = 2.0
"""The same at least, in pixels: detectors clip at the border, and round. Chosen by hand."""
_USELESS_HEADING_RAD = 0.8
"""A heading with a larger standard deviation does not tell front from back: it is not used."""
_LIKELY_MISFIT = 6.0
"""Boxes of vehicles in full view misfit less in 95 % of cases (χ² of two degrees of freedom). Of a
half-hidden vehicle, or one that stands on another level, they misfit more: the covariance grows in
proportion."""
_MOST_MISFIT = 200.0
"""A box that misfits more is no vehicle on the ground: it has no place."""
_MOST_SPREAD = 0.5
"""Share of the distance: a position that errs by more is not determined. Chosen by hand."""
_MOST_HEADING_SIGMA = 0.7
"""Radians: an axis less sure than this is none; no knowledge at all is π / √12 = 0.91."""
_CHUNK = 512
"""Vehicles at a time: their arrays stay in the processor's cache."""


def locate_vehicles(
    detections: Detections,
    camera: Camera,
    *,
    heading_rad: Float[np.ndarray, "n"] | None = None,
    heading_sigma_rad: Float[np.ndarray, "n"] | None = None,
    bottom_hidden: Bool[np.ndarray, "n"] | None = None,
) -> Located:
    """Ground centroids of the vehicles among ``detections``, each from its box alone.

    ``heading_rad`` with ``heading_sigma_rad`` is what is known of the headings (of the track's
    motion, from +X to +Y); NaN where nothing is, and not used where its spread is above
    :data:`_USELESS_HEADING_RAD`. Without it a heading is an axis, since a box does
    not tell front from back, and NaN where the box tells nothing. ``covariance_m2`` holds the
    errors of the box, of the vehicle's dimensions and of the heading; it grows where the box fits
    no vehicle well. An edge at the picture's border is no observation, nor is the lower edge where
    ``bottom_hidden``: something stands before it. NaN are rows of other classes (than car, truck,
    bus, motorcycle, bicycle, and "vehicle", taken as a car), those without a proper box, those
    whose box no vehicle on the ground explains, and those whose
    position is not determined within half its distance. Raises :class:`InputError` where the
    camera is of another image size or a heading comes without its spread.
    """
    boxes = _proper(detections.box_xyxy)
    sigma = np.hypot(_box_noise(boxes, _BIAS_SHARE), _box_noise(boxes, JITTER_SHARE))
    headings = _headings(len(detections), heading_rad, heading_sigma_rad)
    table = replace(detections, box_xyxy=boxes)
    return _locate(table, camera, sigma, *headings, bottom_hidden)


def _proper(box_xyxy: np.ndarray) -> np.ndarray:
    """The boxes, NaN where they are none."""
    proper = np.isfinite(box_xyxy).all(axis=1)
    proper &= (box_xyxy[:, 2:] > box_xyxy[:, :2]).all(axis=1)
    return np.where(proper[:, None], box_xyxy, np.nan)


def _box_noise(box_xyxy: np.ndarray, share: float) -> np.ndarray:
    """Standard deviation (n, 4) of the boxes' edges in pixels."""
    return np.hypot(_FLOOR_PX, share * np.tile(box_xyxy[:, 2:] - box_xyxy[:, :2], 2))


def _headings(
    n: int, heading_rad: np.ndarray | None, sigma_rad: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Headings and spreads, NaN and infinite where nothing is known."""
    if (heading_rad is None) != (sigma_rad is None):
        raise InputError("vehicles: headings need their spread, and a spread its heading")
    if heading_rad is None or sigma_rad is None:
        return np.full(n, np.nan), np.full(n, np.inf)
    if len(heading_rad) != n or len(sigma_rad) != n:
        raise InputError(
            f"vehicles: {n} detections, {len(heading_rad)} headings, {len(sigma_rad)} spreads"
        )
    known = np.isfinite(heading_rad) & (sigma_rad <= _USELESS_HEADING_RAD)
    if (sigma_rad[known] <= 0).any():
        row = int(np.flatnonzero(known & (sigma_rad <= 0))[0])
        raise InputError(
            f"vehicles: the spread of a heading must be positive, found {sigma_rad[row]} "
            f"in row {row}"
        )
    return np.where(known, heading_rad, np.nan), np.where(known, sigma_rad, np.inf)


def _locate(
    detections: Detections,
    camera: Camera,
    sigma_px: np.ndarray,
    heading_rad: np.ndarray,
    heading_sigma_rad: np.ndarray,
    bottom_hidden: np.ndarray | None = None,
) -> Located:
    if detections.image_size != camera.image_size:
        raise InputError(
            f"vehicles: the detections are of {detections.image_size} pixels, "
            f"the camera of {camera.image_size}; give the camera of this footage"
        )
    found = Located.nowhere(len(detections))
    box = detections.box_xyxy
    proper = np.isfinite(box).all(axis=1)
    seen = _seen(box, detections.image_size)
    if bottom_hidden is not None:
        seen[:, 3] &= ~bottom_hidden
    for name, shape in SHAPES.items():
        rows = np.flatnonzero(proper & (detections.class_name == name))
        for start in range(0, len(rows), _CHUNK):
            part = rows[start : start + _CHUNK]
            mask = np.zeros(len(box), bool)
            mask[part] = True
            fits = fit(
                camera,
                shape,
                Boxes(box[part], sigma_px[part], seen[part]),
                _bells(heading_rad[part], heading_sigma_rad[part]),
            )
            found = found.put(mask, _moments(fits, np.isfinite(heading_rad[part])))
    return found


def _seen(box_xyxy: np.ndarray, image_size: tuple[int, int]) -> Bool[np.ndarray, "n 4"]:
    """Which edges do not lie at the picture's border."""
    size = np.array(image_size)
    margin = np.maximum(_LEAST_BORDER_PX, _BORDER_SHARE * size)
    return np.hstack([box_xyxy[:, :2] > margin, box_xyxy[:, 2:] < size - 1 - margin])


def _bells(heading_rad: np.ndarray, sigma_rad: np.ndarray) -> Bells:
    """The prior of the headings as bells side by side, over half a turn where nothing is known.

    Bells of half their distance sum up to what is flat within 2 %.
    """
    known = np.isfinite(heading_rad)
    half = np.where(known, np.minimum(2.5 * sigma_rad, np.pi / 2), np.pi / 2)
    apart = 2 * half / _BELLS
    width = 0.55 * apart
    offset = (np.arange(_BELLS) - (_BELLS - 1) / 2) * apart[:, None]
    between = np.sqrt(np.maximum(sigma_rad**2 - width**2, 1e-12))[:, None]
    log_weight = -0.5 * (offset / between) ** 2
    return Bells(np.where(known, heading_rad, 0.0)[:, None] + offset, width, log_weight)


def _moments(fits: Fits, directed: np.ndarray) -> Located:
    """Mean and covariance over the headings, and the headings' own."""
    highest = fits.log_weight.max(axis=1, keepdims=True)
    possible = np.isfinite(highest[:, 0])
    with np.errstate(invalid="ignore"):
        weight = np.where(possible[:, None], np.exp(fits.log_weight - highest), 1.0)
    weight /= weight.sum(axis=1, keepdims=True)
    xy = np.moveaxis(fits.pose[1:], 0, -1)
    mean = (weight[..., None] * xy).sum(axis=1)
    off = xy - mean[:, None]
    within = np.einsum("nm,ijnm->nij", weight, fits.covariance[1:, 1:])
    covariance = within + np.einsum("nm,nmi,nmj->nij", weight, off, off)
    distance = (weight * fits.range_m).sum(axis=1)
    misfit = np.take_along_axis(fits.cost, fits.log_weight.argmax(axis=1)[:, None], axis=1)[:, 0]
    covariance *= np.maximum(1.0, misfit / _LIKELY_MISFIT)[:, None, None]
    spread = np.sqrt(np.linalg.eigvalsh(covariance)[:, 1])
    bad = ~possible | ~(spread < _MOST_SPREAD * distance) | (misfit > _MOST_MISFIT)
    heading, sigma = _mean_heading(fits, weight, directed)
    flat = bad | ~(sigma < _MOST_HEADING_SIGMA)
    mean[bad], covariance[bad] = np.nan, np.nan
    heading[flat], sigma[flat] = np.nan, np.nan
    return Located(mean, covariance, heading, sigma, ~directed)


def _mean_heading(
    fits: Fits, weight: np.ndarray, directed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Circular mean and standard deviation; of the doubled angle where it is an axis."""
    fold = np.where(directed, 1.0, 2.0)
    angle, variance = fits.pose[0] * fold[:, None], fits.covariance[0, 0] * fold[:, None] ** 2
    sum_ = (weight * np.exp(1j * angle - variance / 2)).sum(axis=1)
    length = np.clip(np.abs(sum_), 1e-12, 1 - 1e-12)
    return np.angle(sum_) / fold, np.sqrt(-2 * np.log(length)) / fold
