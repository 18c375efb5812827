"""Conversion of accepted inputs for points and image sizes to arrays and integers."""

from collections.abc import Sequence
from typing import TYPE_CHECKING, Any, Protocol, runtime_checkable

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.core.text import quoted

if TYPE_CHECKING:
    ImageSize = tuple[int, int]
else:
    ImageSize = Any  # lists and NumPy's numbers are taken too: see as_image_size


@runtime_checkable
class Boxes(Protocol):
    """Anything with boxes ``xyxy`` (n, 4) in pixels, such as ``supervision.Detections``."""

    xyxy: np.ndarray


PointsLike = np.ndarray | Sequence[Any] | Boxes
"""Arrays, lists or tuples of points, one point, or boxes, which stand for their bottom centres."""


def as_points(
    values: PointsLike, size: int = 2, name: str = "uv"
) -> tuple[Float[np.ndarray, "n d"], bool]:
    """Points as an (n, size) array of floats, and whether they were given as a single point.

    Boxes become the centres of their bottom edges. Raises :class:`InputError` naming ``name``.
    """
    if not isinstance(values, np.ndarray) and isinstance(values, Boxes):
        x1, _, x2, y2 = np.asarray(values.xyxy, float).reshape(-1, 4).T
        return np.column_stack([(x1 + x2) / 2, y2]), False
    try:
        found = np.asarray(values, float)
    except (TypeError, ValueError, OverflowError):
        raise InputError(
            f"{name}: expected points of {size} numbers, found {quoted(values)}"
        ) from None
    if found.shape == (0,):
        return np.empty((0, size)), False
    if found.ndim not in (1, 2) or found.shape[-1] != size:
        raise InputError(
            f"{name}: expected one point ({size},) or points (n, {size}), found {found.shape}"
        )
    return found.reshape(-1, size), found.ndim == 1


def as_image_size(values: Any, name: str = "image_size") -> tuple[int, int]:
    """(width, height) as two positive integers, from a pair of whole numbers of any type.

    Raises :class:`InputError` naming ``name``.
    """
    try:
        found = np.asarray(values, float)
    except (TypeError, ValueError, OverflowError):
        found = np.empty(0)
    if found.shape != (2,) or not (np.isfinite(found) & (found == np.round(found))).all():
        raise InputError(f"{name} must be (width, height) in whole pixels, found {quoted(values)}")
    if found.min() < 1:
        raise InputError(f"{name} must be positive, found {quoted(values)}")
    return int(found[0]), int(found[1])
