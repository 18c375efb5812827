"""Sizes of vehicles and the outline points that can touch a bounding box.

Means lie between those of annotated 3-D boxes in four data sets (length x width x height in
metres):
KITTI (car 3.88 x 1.63 x 1.53, van 5.07 x 1.90 x 2.21, truck 10.1 x 2.59 x 3.25), nuScenes (car
4.61 x 1.95 x 1.72, truck 6.93 x 2.51 x 2.84, bus 11.2 x 2.94 x 3.47, motorcycle 2.11 x 0.77 x 1.47,
bicycle 1.68 x 0.60 x 1.27), Waymo (4.73 x 2.08 x 1.77) and Lyft (car 4.75 x 1.92 x 1.71, truck
10.2 x 2.84 x 3.44, bus 12.7 x 2.92 x 3.42, motorcycle 2.35 x 0.96 x 1.59, bicycle 1.76 x 0.63 x
1.44). Spreads cover the variation within and between data sets: a COCO "car" is anything from a
hatchback to a van, a COCO "truck" anything from a pickup to a lorry. Two-wheelers are lower than
in those data sets, whose boxes include the riders.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Float


@dataclass(frozen=True, eq=False)
class VehicleShape:
    """Dimensions and outline points of a vehicle class.

    ``size_m`` is the typical (length, width, height) of the upright cuboid around a vehicle,
    ``log_covariance`` the covariance of their logarithms. ``points`` are outline points as
    fractions of the cuboid: along and across from -0.5 to 0.5, up from 0 to 1; front and back are
    symmetric. ``headed`` is the outline where the front is known to be at +0.5 along.
    """

    size_m: Float[np.ndarray, "3"]
    log_covariance: Float[np.ndarray, "3 3"]
    points: Float[np.ndarray, "k 3"]
    headed: Float[np.ndarray, "m 3"]


def _mirrored(*corners: tuple[float, float, float]) -> np.ndarray:
    """The points at (± along, ± across, up), each once."""
    signs = np.array([(a, b, 1.0) for a in (-1.0, 1.0) for b in (-1.0, 1.0)])
    return np.unique(np.concatenate([signs * corner for corner in np.array(corners)]), axis=0)


def _covariance(spread: tuple[float, float, float]) -> np.ndarray:
    """Covariance of log length, width and height: long vehicles are wide, wide ones are slightly
    taller.
    """
    correlation = np.array([[1.0, 0.5, 0.2], [0.5, 1.0, 0.3], [0.2, 0.3, 1.0]])
    return correlation * np.outer(spread, spread)


CUBOID: Float[np.ndarray, "8 3"] = _mirrored((0.5, 0.5, 0.0), (0.5, 0.5, 1.0))
"""The eight corners."""
# A car does not fill its cuboid: the roof is shorter than the body, corners are round, and there is
# space between tyres and bumpers. Points: tyres, low bumper, widest body, upper ends, roof.
_CAR = _mirrored(
    (0.30, 0.46, 0.0), (0.49, 0.32, 0.13), (0.43, 0.5, 0.4), (0.5, 0.34, 0.5), (0.31, 0.37, 1.0)
)
_BOXY = _mirrored((0.32, 0.46, 0.0), (0.5, 0.46, 0.12), (0.48, 0.5, 0.4), (0.48, 0.47, 1.0))
# With the front known: the bonnet is longer than the boot, so that the windscreen ends a tenth of
# the length before the middle and the roof a third behind it, both a little below its top; in plan
# the body narrows from the wheels to the bumpers. Read off drawings of hatchbacks and saloons, by
# hand.
_HEADED_CAR = np.concatenate(
    [
        _mirrored((0.30, 0.46, 0.0), (0.49, 0.32, 0.13), (0.28, 0.5, 0.45), (0.43, 0.455, 0.4)),
        [
            (along, side * across, up)
            for along, across, up in (
                (0.5, 0.34, 0.45), (-0.49, 0.36, 0.58), (0.10, 0.33, 0.97), (-0.05, 0.36, 1.0),
                (-0.33, 0.34, 0.95),
            )
            for side in (-1, 1)
        ],
    ]
)  # fmt: skip
# Tyres touch the ground, wheels are the ends, handlebars are the widest and nearly the highest.
_TWO_WHEELS = _mirrored((0.32, 0.0, 0.0), (0.5, 0.0, 0.3), (0.25, 0.5, 0.9), (0.25, 0.0, 1.0))


def _shape(
    size_m: tuple[float, float, float], spread: tuple[float, float, float], points: np.ndarray
) -> VehicleShape:
    headed = _HEADED_CAR if points is _CAR else points
    return VehicleShape(np.array(size_m), _covariance(spread), points, headed)


SHAPES: dict[str, VehicleShape] = {
    "car": _shape((4.45, 1.85, 1.62), (0.12, 0.08, 0.10), _CAR),
    "truck": _shape((7.0, 2.4, 2.7), (0.30, 0.12, 0.18), _BOXY),
    "bus": _shape((11.3, 2.75, 3.3), (0.18, 0.08, 0.09), _BOXY),
    "motorcycle": _shape((2.1, 0.8, 1.25), (0.12, 0.15, 0.15), _TWO_WHEELS),
    "bicycle": _shape((1.72, 0.60, 1.15), (0.10, 0.15, 0.15), _TWO_WHEELS),
    # Annotations without a finer class (KPF): mostly cars, but also pickups, vans, lorries and
    # buses, so the size says little about the distance.
    "vehicle": _shape((4.8, 1.95, 1.75), (0.30, 0.15, 0.25), _CAR),
}
"""Shapes by class name."""
