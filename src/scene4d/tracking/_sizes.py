"""Sizes of tracked objects: length, width and height of vehicles, heights of people.

One row shows little of a size: a car seen from ahead does not show its length, a person whose feet
are hidden looks short. The rows of a track are combined, and then held against the population.
Errors of rows are alike, so a track seen a thousand times is not known a thousand times better.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.body import HEIGHT_SIGMA_M, PERSON_HEIGHT_M
from scene4d.core.calibration import Calibration
from scene4d.core.cuboids import size_jacobian
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.core.vehicle_shapes import SHAPES
from scene4d.tracking._vehicles import BIAS_SHARE, JITTER_SHARE

_ALIKE = BIAS_SHARE**2 / (BIAS_SHARE**2 + JITTER_SHARE**2)
"""Correlation of the errors of two boxes of one vehicle, seen from one side."""
_SIDES = 4
"""Sides of a vehicle from which the errors of its boxes count as independent. Chosen by hand."""
_OUTLINE_SHARE = 0.05
"""Error of a vehicle's dimensions from all sides, as a share of them: its outline is not that of
:data:`.SHAPES`. With it the sizes of four bodies that the fit does not know are covered
(tests/tracking/test_sizes.py)."""
_STEP_S = 1.0
"""Sightings of a person within a stride are alike: together they count as one. Chosen by hand."""
_WRONG = 0.2
"""Share of sightings of people in which a foot or the head is hidden, or the body bent: the height
can be anything then. Chosen by hand."""
_ALWAYS_SHARE = 0.03
"""Error of a person's height that all sightings share, as a share of it: hair, shoes, posture and
how keypoints and boxes sit on people. On PETS 2009, heights from keypoints and from drawn boxes
differ by 2.2 % on average and by 1.4 % more from person to person; two cameras agree within 2 % of
two people in a room."""
_CHILDREN, _CHILD_M, _CHILD_SIGMA_M = 0.1, 1.30, 0.20
"""Share of children among people, and their height. Chosen by hand."""
_GRID_M: Float[np.ndarray, "k"] = np.arange(0.80, 2.301, 0.02)
"""Heights of people that are told apart."""
_ANY_M = 2.0
"""Heights of sightings that show none are spread over this."""


@dataclass
class _Told:
    """What the rows of a track have said so far."""

    seen_s: float
    rows: np.ndarray = field(default_factory=lambda: np.zeros(_SIDES + 1))
    pull: np.ndarray = field(default_factory=lambda: np.zeros((_SIDES + 1, 3)))
    information: np.ndarray = field(default_factory=lambda: np.zeros((_SIDES + 1, 3, 3)))
    log_height: np.ndarray = field(default_factory=lambda: np.zeros(len(_GRID_M)))


class Sizes:
    """Sizes of tracks, row by row."""

    def __init__(self, calibration: Calibration, person_height_m: float) -> None:
        self._calibration = calibration
        self._person_height_m = person_height_m
        self._told: dict[int, _Told] = {}

    def add(self, detections: Detections, track: Int[np.ndarray, "n"], located: Located) -> None:
        """Add rows in order of time."""
        shown = located.known & (np.trace(located.size_information, axis1=1, axis2=2) > 0)
        people = detections.class_name == "person"
        likely = np.zeros((len(track), len(_GRID_M)))
        likely[shown & people] = _log_likelihood(located.select(shown & people))
        side = self._sides(located)
        for row in np.flatnonzero(shown).tolist():
            time_s = float(detections.time_s[row])
            told = self._told.setdefault(int(track[row]), _Told(time_s - _STEP_S))
            if people[row]:
                told.log_height += likely[row] * min(1.0, (time_s - told.seen_s) / _STEP_S)
            else:
                told.rows[side[row]] += 1
                told.pull[side[row]] += located.size_pull[row]
                told.information[side[row]] += located.size_information[row]
            told.seen_s = time_s

    def forget(self, until_s: float) -> None:
        """Drop the tracks that were last seen before."""
        self._told = {t: told for t, told in self._told.items() if told.seen_s >= until_s}

    def of(
        self,
        track: Int[np.ndarray, "n"],
        class_name: np.ndarray,
        xyz_m: Float[np.ndarray, "n 3"],
        heading_rad: Float[np.ndarray, "n"],
    ) -> tuple[Float[np.ndarray, "n 3"], Float[np.ndarray, "n 3"]]:
        """Sizes of the tracks of rows, and their standard deviations: those of the population
        where nothing was shown, NaN in rows without a position.
        """
        size, sigma = np.full((2, len(track), 3), np.nan)
        placed = np.flatnonzero(np.isfinite(xyz_m).all(axis=1))
        number, first, rows_of, count = np.unique(
            track[placed], return_index=True, return_inverse=True, return_counts=True
        )
        if not len(number):
            return size, sigma
        middle = placed[first + count // 2]  # rows of a track follow one another
        told = [self._told.get(int(one), _Told(0.0)) for one in number]
        names = class_name[middle].tolist()
        found = [self._of(*one, np.zeros(3)) for one in zip(told, names, strict=True)]
        rough = np.array([one for one, _ in found])
        share = self._camera_share(rough, xyz_m[middle], heading_rad[middle])
        if share.any():
            found = [self._of(*one) for one in zip(told, names, share, strict=True)]
        size[placed] = np.array([one for one, _ in found])[rows_of]
        sigma[placed] = np.array([one for _, one in found])[rows_of]
        return size, sigma

    def _of(
        self, told: _Told, name: str, camera_share: Float[np.ndarray, "3"]
    ) -> tuple[Float[np.ndarray, "3"], Float[np.ndarray, "3"]]:
        if name == "person":
            return self._person(told, float(camera_share[2]))
        return _vehicle(told, name, camera_share)

    def _camera_share(
        self,
        size_m: Float[np.ndarray, "t 3"],
        xyz_m: Float[np.ndarray, "t 3"],
        heading_rad: Float[np.ndarray, "t"],
    ) -> Float[np.ndarray, "t 3"]:
        """Standard deviations of sizes at these places due to the camera's, as shares of them."""
        covariance = self._calibration.parameter_covariance
        if not covariance.any():
            return np.zeros_like(size_m)
        by = size_jacobian(self._calibration, size_m, xyz_m, heading_rad) / size_m[:, :, None]
        share = np.sqrt(np.einsum("tip,pq,tiq->ti", by, covariance, by))
        return np.where(np.isfinite(share), np.minimum(share, 1.0), 1.0)

    def _sides(self, located: Located) -> Int[np.ndarray, "n"]:
        """From which side vehicles are seen; the last number where front and back are unknown."""
        assert self._calibration.camera is not None
        way = located.xy_m - self._calibration.camera.centre_m[:2]
        from_ahead = located.heading_rad - np.arctan2(way[:, 1], way[:, 0])
        known = np.isfinite(from_ahead) & ~located.heading_is_axis
        quarter = np.rint(np.where(known, from_ahead, 0.0) / (np.pi / 2)).astype(int)
        return np.where(known, quarter % _SIDES, _SIDES)

    def _person(self, told: _Told, camera_share: float) -> tuple[np.ndarray, np.ndarray]:
        likely = np.exp(told.log_height - told.log_height.max())
        sigma_m = np.hypot(_ALWAYS_SHARE, camera_share) * _GRID_M
        weight = (_normal(_GRID_M[:, None], _GRID_M, sigma_m) @ likely) * self._population()
        weight /= weight.sum()
        mean = weight @ _GRID_M
        spread = np.sqrt(weight @ (_GRID_M - mean) ** 2)
        return np.array([np.nan, np.nan, mean]), np.array([np.nan, np.nan, spread])

    def _population(self) -> Float[np.ndarray, "k"]:
        mean = self._person_height_m
        grown = _normal(_GRID_M, mean, HEIGHT_SIGMA_M)
        child = _normal(_GRID_M, mean * _CHILD_M / PERSON_HEIGHT_M, _CHILD_SIGMA_M)
        return (1 - _CHILDREN) * grown + _CHILDREN * child


def _log_likelihood(people: Located) -> Float[np.ndarray, "n k"]:
    """Of heights on the grid, for the height that each row shows."""
    told = people.size_information[:, 2, 2][:, None]
    height_m = np.exp(people.size_pull[:, 2][:, None] / told)
    right = _normal(_GRID_M, height_m, height_m / np.sqrt(told))
    return np.log((1 - _WRONG) * right + _WRONG / _ANY_M)


def _normal(x: np.ndarray, mean: np.ndarray | float, sigma: np.ndarray | float) -> np.ndarray:
    density: np.ndarray = np.exp(-0.5 * ((x - mean) / sigma) ** 2) / (sigma * np.sqrt(2 * np.pi))
    return density


def _vehicle(
    told: _Told, name: str, camera_share: Float[np.ndarray, "3"]
) -> tuple[np.ndarray, np.ndarray]:
    shape = SHAPES[name]
    share = 1 / (1 + np.maximum(told.rows - 1, 0) * _ALIKE)
    information = np.einsum("s,sij->ij", share, told.information)
    # (J⁻¹ + C)⁻¹ = (1 + J C)⁻¹ J, also where the rows do not show every dimension.
    always = camera_share**2 + _OUTLINE_SHARE**2
    widened = np.linalg.inv(np.eye(3) + information * always)
    prior = np.linalg.inv(shape.log_covariance)
    covariance = np.linalg.inv(prior + widened @ information)
    log_size = covariance @ (widened @ (share @ told.pull) + prior @ np.log(shape.size_m))
    size_m = np.exp(log_size)
    return size_m, size_m * np.sqrt(np.diag(covariance))
