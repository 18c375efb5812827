"""People and vehicles on the ground: where detections stand, and tracks through time."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.columns import Columns
from scene4d.core.errors import InputError

CLASSES: tuple[str, ...] = ("person", "bicycle", "motorcycle", "car", "truck", "bus", "vehicle")
"""What a scene holds, under the names of COCO; a ``vehicle`` is one of unknown kind."""
VEHICLES: tuple[str, ...] = CLASSES[1:]


@dataclass(frozen=True, eq=False)
class Located(Columns):
    """Where the rows of a :class:`Detections` table stand on the ground, (n, ...).

    ``xy_m`` is the middle of a person, the centroid of a vehicle; ``covariance_m2`` its
    independent part: pixels, height and shape of the object, not the camera's own error. All NaN
    where a row has no ground point. ``heading_rad`` counts from +X to +Y, NaN where the picture
    does not tell; ``heading_sigma_rad`` is its standard deviation, and ``heading_is_axis`` says
    that front and back cannot be told apart.
    """

    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]
    heading_rad: Float[np.ndarray, "n"]
    heading_sigma_rad: Float[np.ndarray, "n"]
    heading_is_axis: Bool[np.ndarray, "n"]

    @classmethod
    def nowhere(cls, n: int) -> "Located":
        """Rows without a ground point."""
        return cls(
            np.full((n, 2), np.nan),
            np.full((n, 2, 2), np.nan),
            np.full(n, np.nan),
            np.full(n, np.nan),
            np.zeros(n, bool),
        )

    @property
    def known(self) -> Bool[np.ndarray, "n"]:
        """Which rows have a ground point."""
        known: np.ndarray = np.isfinite(self.xy_m).all(axis=1)
        return known

    def put(self, rows: Bool[np.ndarray, "n"], found: "Located") -> "Located":
        """These rows with other values."""
        values = {}
        for f in fields(self):
            column = getattr(self, f.name).copy()
            column[rows] = getattr(found, f.name)
            values[f.name] = column
        return replace(self, **values)


@dataclass(frozen=True, eq=False)
class Tracks(Columns):
    """Objects through time, one row per object and moment, ordered by (track, time).

    World of the camera: metres, Z up. ``time_s`` counts from the clip's start; ``frame`` from 0.
    ``covariance_m2`` is the independent part of a position's covariance, ``shared_covariance_m2``
    what the camera's own error adds, which all objects of the scene have in common.
    ``velocity_mps`` and ``velocity_covariance`` (m²/s²) come from smoothing, ``heading_rad`` (from
    +X to +Y) from the motion, or from the shape of a vehicle that stands. Where ``observed`` is
    false nobody was seen: the row bridges a gap, its box and score are NaN. Positions are NaN where
    a sighting has no ground point.
    """

    track: Int[np.ndarray, "n"]
    class_name: np.ndarray
    time_s: Float[np.ndarray, "n"]
    frame: Int[np.ndarray, "n"]
    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]
    shared_covariance_m2: Float[np.ndarray, "n 2 2"]
    velocity_mps: Float[np.ndarray, "n 2"]
    velocity_covariance: Float[np.ndarray, "n 2 2"]
    heading_rad: Float[np.ndarray, "n"]
    heading_sigma_rad: Float[np.ndarray, "n"]
    box_xyxy: Float[np.ndarray, "n 4"]
    keypoint_uv: Float[np.ndarray, "n k 2"]
    keypoint_score: Float[np.ndarray, "n k"]
    score: Float[np.ndarray, "n"]
    observed: Bool[np.ndarray, "n"]

    def __post_init__(self) -> None:
        self.check_rows("tracks")

    @classmethod
    def concatenate(cls, parts: Sequence["Tracks"]) -> "Tracks":
        """One table of several; raises on an empty list and where the skeletons differ."""
        if not parts:
            raise InputError("tracks: nothing to concatenate")
        if len({part.keypoint_uv.shape[1] for part in parts}) > 1:
            raise InputError("tracks: the parts differ in their keypoints")
        return cls.joined(parts)
