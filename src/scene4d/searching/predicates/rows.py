"""What predicates look at: moments of tracked objects, with what of the camera they share."""

from collections.abc import Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import Protocol, runtime_checkable

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks


@runtime_checkable
class Factors(Protocol):
    """Camera factors of all rows: an array (n, 2, k), or what works them out for rows asked for."""

    def __len__(self) -> int: ...

    def __getitem__(self, rows: Int[np.ndarray, "m"], /) -> Float[np.ndarray, "m 2 k"]:
        """Those of these rows."""


@dataclass(frozen=True, eq=False)
class Stage:
    """Everything that one camera tracked, and the places that have names.

    ``tracks`` are ordered by (track, time). ``camera_factor`` (n, 2, k) is the ground Jacobian of
    each row times a square root of the camera's covariance: two rows' relative covariance due to
    the camera is ``D Dᵀ`` with ``D`` the difference of their factors, so that near things, which
    the camera misplaces alike, have none. ``image_size`` is width and height in pixels, ``step_s``
    the time between two rows of a track. ``zones`` are polygons and ``lines`` polylines on the
    ground, (m, 2) metres. ``camera`` tells how large things are seen; None where the picture is
    all there is. Raises :class:`InputError` where rows and factors differ in number.
    """

    tracks: Tracks
    image_size: tuple[int, int]
    step_s: float
    camera_factor: Factors | None = None
    zones: Mapping[str, Float[np.ndarray, "_ 2"]] = field(default_factory=dict)
    lines: Mapping[str, Float[np.ndarray, "_ 2"]] = field(default_factory=dict)
    camera: Camera | None = None

    def __post_init__(self) -> None:
        if self.camera_factor is not None and len(self.camera_factor) != len(self.tracks):
            raise InputError(
                f"stage: {len(self.tracks)} rows of tracks and {len(self.camera_factor)} factors"
            )
        if not self.step_s > 0:
            raise InputError(f"stage: step_s must be positive, found {self.step_s}")

    @cached_property
    def first_row(self) -> Int[np.ndarray, "t"]:
        """Row at which each track begins, in the order of the rows."""
        track = self.tracks.track
        return np.flatnonzero(np.append(True, track[1:] != track[:-1])) if len(track) else track

    @cached_property
    def track_of_row(self) -> Int[np.ndarray, "n"]:
        """Position in :attr:`first_row` of every row's track."""
        starts = np.zeros(len(self.tracks), int)
        starts[self.first_row] = 1
        return np.cumsum(starts) - 1

    @cached_property
    def last_row(self) -> Int[np.ndarray, "t"]:
        """Last row of each track."""
        return np.append(self.first_row[1:], len(self.tracks)) - 1

    def on_line(
        self, track: Int[np.ndarray, "m"], time_s: Float[np.ndarray, "m"]
    ) -> Float[np.ndarray, "m"]:
        """Times of tracks (positions in :attr:`first_row`) on one line, on which tracks follow one
        another as rows do, so far apart that to a time within the stage's span a track's own rows
        are nearer than any other's.
        """
        start, span_s = self._span_s
        return (time_s - start) + track * (2 * span_s + 1.0)

    @cached_property
    def line_s(self) -> Float[np.ndarray, "n"]:
        """Every row's place on that line; ascending."""
        return self.on_line(self.track_of_row, self.tracks.time_s)

    @cached_property
    def _span_s(self) -> tuple[float, float]:
        time_s = self.tracks.time_s
        return (float(time_s.min()), float(np.ptp(time_s))) if len(time_s) else (0.0, 0.0)

    def px_per_m(self, rows: Int[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
        """Pixels that a metre of an upright person measures up and down in the picture (as boxes
        do), at the places of some rows; 1 without a camera, NaN without a place in view.
        """
        if self.camera is None:
            return np.ones(len(rows))
        xy = self.tracks.xy_m[rows]
        foot, head = (
            self.camera.project(np.column_stack([xy, np.full(len(xy), height_m)]))[0]
            for height_m in (0.0, PERSON_HEIGHT_M)
        )
        return np.asarray(np.abs(head - foot)[:, 1] / PERSON_HEIGHT_M)

    def rows(self, index: Int[np.ndarray, "m"]) -> "Rows":
        """These rows, in this order; one may come often."""
        return Rows(self, index)


@dataclass(frozen=True, eq=False)
class Rows:
    """Some moments of a stage; a column is gathered when it is first asked for."""

    stage: Stage
    index: Int[np.ndarray, "m"]

    def __len__(self) -> int:
        return len(self.index)

    @cached_property
    def time_s(self) -> Float[np.ndarray, "m"]:
        """Seconds from the clip's start."""
        return self.stage.tracks.time_s[self.index]

    @cached_property
    def track(self) -> Int[np.ndarray, "m"]:
        """Number of the object."""
        return self.stage.tracks.track[self.index]

    @cached_property
    def xy_m(self) -> Float[np.ndarray, "m 2"]:
        """Position on the ground."""
        return self.stage.tracks.xy_m[self.index]

    @cached_property
    def covariance_m2(self) -> Float[np.ndarray, "m 2 2"]:
        """Independent part of the position's covariance."""
        return self.stage.tracks.covariance_m2[self.index]

    @cached_property
    def camera_factor(self) -> Float[np.ndarray, "m 2 k"]:
        """Shared part, see :class:`Stage`; without columns where the camera's error is unknown."""
        factor = self.stage.camera_factor
        return np.zeros((len(self), 2, 0)) if factor is None else factor[self.index]

    @cached_property
    def velocity_mps(self) -> Float[np.ndarray, "m 2"]:
        """Velocity on the ground."""
        return self.stage.tracks.velocity_mps[self.index]

    @cached_property
    def velocity_covariance(self) -> Float[np.ndarray, "m 2 2"]:
        """Covariance of the velocity, m²/s²."""
        return self.stage.tracks.velocity_covariance[self.index]

    @cached_property
    def heading_rad(self) -> Float[np.ndarray, "m"]:
        """Heading from +X to +Y; NaN where unknown."""
        return self.stage.tracks.heading_rad[self.index]

    @cached_property
    def heading_sigma_rad(self) -> Float[np.ndarray, "m"]:
        """Its standard deviation; NaN where only the axis of a vehicle is known."""
        return self.stage.tracks.heading_sigma_rad[self.index]

    @cached_property
    def box_xyxy(self) -> Float[np.ndarray, "m 4"]:
        """Box in the picture; NaN where nobody was seen."""
        return self.stage.tracks.box_xyxy[self.index]

    @cached_property
    def keypoint_uv(self) -> Float[np.ndarray, "m j 2"]:
        """Body keypoints (Halpe 26), or none."""
        return self.stage.tracks.keypoint_uv[self.index]

    @cached_property
    def keypoint_score(self) -> Float[np.ndarray, "m j"]:
        """Their scores."""
        return self.stage.tracks.keypoint_score[self.index]

    @cached_property
    def class_name(self) -> np.ndarray:
        """Kind of the object."""
        return self.stage.tracks.class_name[self.index]

    @cached_property
    def observed(self) -> Bool[np.ndarray, "m"]:
        """Whether somebody was seen; false where a gap is bridged."""
        return self.stage.tracks.observed[self.index]
