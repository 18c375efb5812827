"""Who stands within reach of a vehicle, and at which of its sides, by its outline on the ground."""

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.searching.predicates._distance import Separation
from scene4d.searching.predicates._gaussian import ndtr
from scene4d.searching.predicates._relation import (
    AXIS_SIGMA_RAD,
    SIDES,
    outline,
)
from scene4d.searching.predicates.stage import StageRows

_REACH_M, _REACH_SIGMA_M = 1.0, 0.3
"""An arm's length (0.7 m) and half a body; its softness is chosen by hand."""
_HEADINGS = 16
"""Headings that a vehicle may have, over which a mean is taken."""
_QUANTILES = (np.arange(_HEADINGS) + 0.5) / _HEADINGS


def beside(
    a: StageRows,
    b: StageRows,
    *,
    side: str | None = None,
    tau_m: float = _REACH_M,
    sigma_m: float = _REACH_SIGMA_M,
) -> Float[np.ndarray, "m"]:
    """P(a stands within ``tau_m`` of the outline of the vehicle b, at that ``side`` of it if one is
    named): nearest to that face of a rectangle of b's length, width and heading.

    With the gap g to the outline, ``Φ((tau - g) / s)`` times the probability that no other face is
    nearer, s the error of the distance and ``sigma_m``. The mean over headings within their error,
    or over all where the heading is not known (both ways where only the axis is), each weighed by
    ``Φ(g / s)``: nobody stands where the vehicle is. NaN without two positions. Raises
    :class:`InputError` for another side.
    """
    if side is not None and side not in SIDES:
        raise InputError(f"beside: side must be one of {', '.join(SIDES)}, found {side!r}")
    way = Separation.between(a, b)
    heading = _headings(b)
    ahead = -way.vector_m[:, :1] * np.cos(heading) - way.vector_m[:, 1:] * np.sin(heading)
    left = way.vector_m[:, :1] * np.sin(heading) - way.vector_m[:, 1:] * np.cos(heading)
    length, width, size_sigma = outline(b)
    beyond = np.abs(ahead) - length[:, None] / 2, np.abs(left) - width[:, None] / 2
    gap = np.hypot(*(np.maximum(one, 0.0) for one in beyond)) + np.minimum(np.maximum(*beyond), 0.0)
    s = np.sqrt(sigma_m**2 + way.distance_sigma_m**2 + size_sigma**2)[:, None]
    p = ndtr((tau_m - gap) / s)
    if side is not None:
        at_end = ndtr((beyond[0] - beyond[1]) / (np.sqrt(2) * s))
        face, along = (at_end, ahead) if side in ("front", "back") else (1 - at_end, left)
        p = p * face * ndtr((along if side in ("front", "left") else -along) / s)
    outside = ndtr(gap / s) + 1e-6
    return np.asarray((p * outside).sum(axis=1) / outside.sum(axis=1))


def _headings(b: StageRows) -> Float[np.ndarray, "m k"]:
    """Equally likely headings of each vehicle."""
    from scipy.special import ndtri  # slow to load

    anywhere = 2 * np.pi * _QUANTILES
    only_axis = np.isnan(b.heading_sigma_rad)
    sigma = np.where(only_axis, AXIS_SIGMA_RAD, b.heading_sigma_rad)
    about = b.heading_rad[:, None] + sigma[:, None] * ndtri(_QUANTILES)
    flipped = about + np.pi * (np.arange(_HEADINGS) % 2)
    known = np.isfinite(b.heading_rad)[:, None]
    return np.where(known, np.where(only_axis[:, None], flipped, about), anywhere)
