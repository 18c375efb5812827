"""Motion model of people and vehicles on the ground, for association and smoothing.

Nearly constant velocity: acceleration is white noise (Bar-Shalom, Li and Kirubarajan, "Estimation
with Applications to Tracking and Navigation", 2001, section 6.2.2). Standing objects drift by
millimetres, and their velocity is independent of how they arrived.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.errors import InputError
from scene4d.core.tracks import CLASSES


@dataclass(frozen=True)
class Motion:
    """``acceleration`` is the root of the noise's spectral density (m/s^1.5, per axis): over t
    seconds the velocity changes by about ``acceleration * sqrt(t)``. ``speed`` is the standard
    deviation of an unknown velocity (m/s, per axis).
    """

    acceleration: float
    speed: float
    group: int


# People reach or lose a walking speed of 1.4 m/s within about 2 s; cars brake and pull away at
# about 2 m/s^2. Numbers of one group belong to objects that a detector may confuse.
MOTIONS = {
    "person": Motion(0.7, 1.2, 0),
    "bicycle": Motion(1.2, 3.0, 1),
    "motorcycle": Motion(1.8, 5.0, 1),
    "car": Motion(1.8, 6.0, 2),
    "truck": Motion(1.8, 6.0, 2),
    "bus": Motion(1.8, 6.0, 2),
    "vehicle": Motion(1.8, 6.0, 2),
}
PERSON_GROUP = MOTIONS["person"].group

LASTING_SHARE = 0.6
"""Share of a detection's variance that is correlated over time."""
LASTING_S = 1.2
"""Correlation time of that share, seconds. The errors of located people on PETS S2L1 have an
autocorrelation of 0.76 at 0.1 s, 0.58 at 0.5 s, 0.4 at 1 s and 0.2 at 2 s (``python -m
benchmarks.tracking``), which alone would give 0.75 and 1.6 s. Part of that is due to the drawn
boxes, so both values are lower. They were chosen knowing that the errors' 90 % quantile is 0.25 m
with them, and 0.275 m with the others.
"""

_STANDING_DRIFT = 0.003
"""Drift of the estimated position of a standing object, m per root second."""
_STANDING_SPEED = 0.02
"""Standard deviation of its velocity, m/s per axis."""


def class_numbers(class_name: np.ndarray) -> Int[np.ndarray, "n"]:
    """Indices in :data:`CLASSES`; raises :class:`InputError` for a class a scene cannot hold."""
    found = np.full(len(class_name), -1)
    for number, name in enumerate(CLASSES):
        found[class_name == name] = number
    if (found < 0).any():
        other = str(class_name[found < 0][0])
        raise InputError(f"tracks: found class {other!r}, expected one of {', '.join(CLASSES)}")
    return found


def _of_classes(field: str) -> np.ndarray:
    return np.array([getattr(MOTIONS[name], field) for name in CLASSES])


ACCELERATION: np.ndarray = _of_classes("acceleration")
SPEED: np.ndarray = _of_classes("speed")
GROUP: np.ndarray = _of_classes("group")
"""By class number."""


def moving_noise(
    dt: Float[np.ndarray, "n"], acceleration: Float[np.ndarray, "n"]
) -> Float[np.ndarray, "n 2 2"]:
    """Covariance of (position, velocity) along one axis after ``dt`` seconds."""
    corner = dt**2 / 2
    unit = np.array([[dt**3 / 3, corner], [corner, dt]])
    noise: np.ndarray = np.moveaxis(unit * acceleration**2, -1, 0)
    return noise


def transition(
    dt: Float[np.ndarray, "n"],
    acceleration: Float[np.ndarray, "n"],
    standing: Bool[np.ndarray, "n"],
) -> tuple[Float[np.ndarray, "n 2 2"], Float[np.ndarray, "n 2 2"]]:
    """Step matrix and inverse noise of (position, velocity) along one axis, over ``dt`` > 0 s."""
    step = np.broadcast_to(np.eye(2), (len(dt), 2, 2)).copy()
    step[:, 0, 1] = np.where(standing, 0.0, dt)
    step[standing, 1, 1] = 0.0
    precise = 1 / acceleration**2
    inverse = np.moveaxis(
        np.array([[12 / dt**3, -6 / dt**2], [-6 / dt**2, 4 / dt]]) * precise, -1, 0
    )
    still = np.zeros((len(dt), 2, 2))
    still[:, 0, 0] = 1 / (_STANDING_DRIFT**2 * dt)
    still[:, 1, 1] = 1 / _STANDING_SPEED**2
    return step, np.where(standing[:, None, None], still, inverse)


def repeated(dt: Float[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    """How many detections ``dt`` seconds apart carry the information of one independent detection:
    the sum of the errors' autocorrelation.
    """
    alike = np.exp(-dt / LASTING_S)
    return 1 + 2 * LASTING_SHARE * alike / -np.expm1(-dt / LASTING_S)
