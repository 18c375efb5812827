"""Ground positions of vehicles: the middle of the vehicle, from its bounding box.

The middle of the box's bottom edge is the usual approximation. It lies under the nearest bumper,
one to several metres in front of the vehicle's middle. Here a vehicle of typical size is placed on
the ground so that its image fills the box; see :mod:`scene4d.tracking._vehicle_fit`.
"""

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.core.vehicle_shapes import SHAPES, VehicleShape
from scene4d.tracking._vehicle_fit import Bells, Boxes, Fits, fit

_BELLS = 8
"""Starting headings of the fit, 22.5 degrees apart over half a turn. Chosen by hand;
``python -m benchmarks.vehicle_positions`` measures the result, as for the errors below."""
BIAS_SHARE = 0.03
"""Error of a box edge that all frames share, as a share of the box's width or height: detector
bias, and this vehicle's difference from a typical outline. Chosen by hand."""
JITTER_SHARE = 0.02
"""Error of a box edge that is independent in every frame, as the same share. Chosen by hand."""
_FLOOR_PX = 1.0
"""Minimum of both errors, in pixels: boxes are rounded."""
_BORDER_SHARE = 0.0025
"""A box this close to the image border counts as cut; a share of the image's width or height."""
_LEAST_BORDER_PX = 2.0
"""Minimum of the same, in pixels: detectors clip at the border and round. Chosen by hand."""
_USELESS_HEADING_RAD = 0.8
"""A heading with a larger standard deviation does not tell front from back and is not used."""
_LIKELY_MISFIT = 6.0
"""95 % of fully visible vehicles misfit less (χ² of two degrees of freedom). Partly hidden
vehicles, or those on another level, misfit more; the covariance grows in proportion."""
_MOST_MISFIT = 200.0
"""A box with a larger misfit is not a vehicle on the ground and gets no position."""
_MOST_SPREAD = 0.5
"""A position with a standard deviation above this share of its distance is undetermined. Chosen by
hand."""
_MOST_HEADING_SIGMA = 0.7
"""Radians: an axis with a larger spread is not reported; a uniform one has π / √12 = 0.91."""
_CHUNK = 512
"""Vehicles per batch: their arrays fit in the processor's cache."""


def locate_vehicles(
    detections: Detections,
    camera: Camera,
    *,
    heading_rad: Float[np.ndarray, "n"] | None = None,
    heading_sigma_rad: Float[np.ndarray, "n"] | None = None,
    bottom_hidden: Bool[np.ndarray, "n"] | None = None,
) -> Located:
    """Ground centroids of the vehicles among ``detections``, each from its box alone.

    ``heading_rad`` with ``heading_sigma_rad`` is the known heading (from the track's motion, from
    +X to +Y); NaN where unknown. It is not used if its spread is above
    :data:`_USELESS_HEADING_RAD`. Without it the result is an axis, since a box does not tell front
    from back, or NaN where the box does not determine it.

    ``covariance_m2`` includes the errors of the box, the vehicle's dimensions and the heading; it
    grows where the box fits no vehicle well. An edge at the image border is not used as a
    measurement, nor is the bottom edge where ``bottom_hidden`` (something stands in front of it).

    Rows are NaN for classes other than car, truck, bus, motorcycle, bicycle and "vehicle" (taken
    as a car), for invalid boxes, for boxes that no vehicle on the ground explains, and for
    positions not determined within half their distance. Raises :class:`InputError` if the
    camera's image size differs or a heading comes without its spread.
    """
    if detections.image_size != camera.image_size:
        raise InputError(
            f"vehicles: the detections are for images of {detections.image_size} pixels, "
            f"the camera for {camera.image_size}; give the camera of this footage"
        )
    box = detections.box_xyxy
    proper = np.isfinite(box).all(axis=1)
    proper &= (box[:, 2:] > box[:, :2]).all(axis=1)
    box = np.where(proper[:, None], box, np.nan)
    sigma_px = np.hypot(_box_noise(box, BIAS_SHARE), _box_noise(box, JITTER_SHARE))
    heading, spread = _headings(len(detections), heading_rad, heading_sigma_rad)
    seen = _seen(box, detections.image_size)
    if bottom_hidden is not None:
        seen[:, 3] &= ~bottom_hidden
    found = Located.nowhere(len(detections))
    for name, shape in SHAPES.items():
        rows = np.flatnonzero(proper & (detections.class_name == name))
        for start in range(0, len(rows), _CHUNK):
            part = rows[start : start + _CHUNK]
            mask = np.zeros(len(box), bool)
            mask[part] = True
            boxes = Boxes(box[part], sigma_px[part], seen[part])
            fits = fit(camera, shape, boxes, _bells(heading[part], spread[part]))
            found = found.put(mask, _moments(fits, shape, np.isfinite(heading[part])))
    return found


def _box_noise(box_xyxy: np.ndarray, share: float) -> np.ndarray:
    """Standard deviation (n, 4) of the boxes' edges in pixels."""
    return np.hypot(_FLOOR_PX, share * np.tile(box_xyxy[:, 2:] - box_xyxy[:, :2], 2))


def _headings(
    n: int, heading_rad: np.ndarray | None, sigma_rad: np.ndarray | None
) -> tuple[np.ndarray, np.ndarray]:
    """Headings and spreads, NaN and infinite where unknown."""
    if (heading_rad is None) != (sigma_rad is None):
        raise InputError("vehicles: give heading_rad and heading_sigma_rad together")
    if heading_rad is None or sigma_rad is None:
        return np.full(n, np.nan), np.full(n, np.inf)
    if len(heading_rad) != n or len(sigma_rad) != n:
        raise InputError(
            f"vehicles: found {n} detections, {len(heading_rad)} headings and {len(sigma_rad)} "
            "spreads, expected as many of each"
        )
    known = np.isfinite(heading_rad) & (sigma_rad <= _USELESS_HEADING_RAD)
    if (sigma_rad[known] <= 0).any():
        row = int(np.flatnonzero(known & (sigma_rad <= 0))[0])
        raise InputError(
            f"vehicles: the spread of a heading must be positive, found {sigma_rad[row]} "
            f"in row {row}"
        )
    return np.where(known, heading_rad, np.nan), np.where(known, sigma_rad, np.inf)


def _seen(box_xyxy: np.ndarray, image_size: tuple[int, int]) -> Bool[np.ndarray, "n 4"]:
    """Which edges are not at the image border."""
    size = np.array(image_size)
    margin = np.maximum(_LEAST_BORDER_PX, _BORDER_SHARE * size)
    return np.hstack([box_xyxy[:, :2] > margin, box_xyxy[:, 2:] < size - 1 - margin])


def _bells(heading_rad: np.ndarray, sigma_rad: np.ndarray) -> Bells:
    """The heading prior as Gaussians side by side, over half a turn where nothing is known.

    With a width of about half their spacing, their sum is flat within 2 %.
    """
    known = np.isfinite(heading_rad)
    half = np.where(known, np.minimum(2.5 * sigma_rad, np.pi / 2), np.pi / 2)
    apart = 2 * half / _BELLS
    width = 0.55 * apart
    offset = (np.arange(_BELLS) - (_BELLS - 1) / 2) * apart[:, None]
    between = np.sqrt(np.maximum(sigma_rad**2 - width**2, 1e-12))[:, None]
    log_weight = -0.5 * (offset / between) ** 2
    return Bells(np.where(known, heading_rad, 0.0)[:, None] + offset, width, log_weight)


def _moments(fits: Fits, shape: VehicleShape, directed: np.ndarray) -> Located:
    """Mean and covariance of the position over all headings, of the heading itself, and what the
    box says of the size.
    """
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
    unlike = np.maximum(1.0, misfit / _LIKELY_MISFIT)[:, None, None]
    covariance *= unlike
    spread = np.sqrt(np.linalg.eigvalsh(covariance)[:, 1])
    bad = ~possible | ~(spread < _MOST_SPREAD * distance) | (misfit > _MOST_MISFIT)
    heading, sigma = _mean_heading(fits, weight, directed)
    flat = bad | ~(sigma < _MOST_HEADING_SIGMA)
    mean[bad], covariance[bad] = np.nan, np.nan
    heading[flat], sigma[flat] = np.nan, np.nan
    pull, information = _size(fits, weight, shape)
    pull = np.where(bad[:, None], 0.0, pull / unlike[:, 0])
    information = np.where(bad[:, None, None], 0.0, information / unlike)
    return Located(mean, covariance, heading, sigma, ~directed, pull, information)


def _size(
    fits: Fits, weight: np.ndarray, shape: VehicleShape
) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3 3"]]:
    """What the box says of log dimensions, over all headings: the pull towards them and its
    information, the shape's prior taken off.
    """
    sizes = np.moveaxis(fits.log_size, 0, -1)
    mean = (weight[..., None] * sizes).sum(axis=1)
    off = sizes - mean[:, None]
    covariance = np.einsum("nm,ijnm->nij", weight, fits.size_covariance)
    covariance += np.einsum("nm,nmi,nmj->nij", weight, off, off)
    # In units of the prior, whose information is then 1 along every axis.
    to_unit = np.linalg.inv(np.linalg.cholesky(shape.log_covariance))
    values, axes = np.linalg.eigh(to_unit @ covariance @ to_unit.T)
    told = 1 / np.clip(values, 1e-6, 1.0) - 1
    pull = np.einsum("nji,jk,nk->ni", axes, to_unit, mean) * (1 + told) * (told > 0)
    basis = np.einsum("ji,njk->nik", to_unit, axes)
    information = np.einsum("nik,nk,njk->nij", basis, told, basis)
    typical = information @ np.log(shape.size_m)
    return np.einsum("nik,nk->ni", basis, pull) + typical, information


def _mean_heading(
    fits: Fits, weight: np.ndarray, directed: np.ndarray
) -> tuple[np.ndarray, np.ndarray]:
    """Circular mean and standard deviation; computed on the doubled angle for an axis."""
    fold = np.where(directed, 1.0, 2.0)
    angle, variance = fits.pose[0] * fold[:, None], fits.covariance[0, 0] * fold[:, None] ** 2
    sum_ = (weight * np.exp(1j * angle - variance / 2)).sum(axis=1)
    length = np.clip(np.abs(sum_), 1e-12, 1 - 1e-12)
    return np.angle(sum_) / fold, np.sqrt(-2 * np.log(length)) / fold
