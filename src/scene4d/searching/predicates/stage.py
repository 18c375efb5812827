"""The input of predicates: everything that one camera tracked, and selected rows of it."""

from collections.abc import Callable, Mapping
from dataclasses import dataclass, field
from functools import cached_property
from typing import TYPE_CHECKING

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks

if TYPE_CHECKING:
    from scene4d.searching.predicates._spots import Spots

CameraFactor = Callable[[Float[np.ndarray, "m 2"]], Float[np.ndarray, "m 2 k"]]
"""Of places on the ground (m): the ground Jacobian times a square root of the camera's covariance.
With ``D`` the difference of two places' factors, ``D Dᵀ`` is the covariance that the camera adds to
the vector between them: it misplaces near things alike, so that they hardly have one.
"""
_ROUNDING = 1e-6
"""Times are sums of steps: smaller differences, in steps or in seconds, are ignored."""


@dataclass(frozen=True, eq=False)
class Stage:
    """Everything that one camera tracked, and the named places.

    ``tracks`` are ordered by (track, time). ``image_size`` is (width, height) in pixels, ``step_s``
    the time between two rows of a track. ``camera_factor`` is None where the camera's error is not
    known. ``zones`` are polygons and ``lines`` polylines on the ground, (m, 2) metres; ``spots``
    are where others were at other times (:func:`near_spot`). ``camera``
    tells how large things are seen; None where the picture is all there is. ``everybody`` says
    whether whoever is in view is tracked as well as can be: annotators follow those of an activity,
    while it lasts, so that nobody is missed of whom there are no rows. ``watched`` are the spans in
    which the camera was watched: begin and end (s), and the frames of these; None if not known.

    Times are counted in ticks of ``step_s`` from the first of them, so that rows of different
    tracks can be of the same moment.
    """

    tracks: Tracks
    image_size: tuple[int, int]
    step_s: float
    camera_factor: CameraFactor | None = None
    zones: Mapping[str, Float[np.ndarray, "_ 2"]] = field(default_factory=dict)
    lines: Mapping[str, Float[np.ndarray, "_ 2"]] = field(default_factory=dict)
    spots: "Mapping[str, Spots]" = field(default_factory=dict)
    camera: Camera | None = None
    everybody: bool = True
    watched: Float[np.ndarray, "s 4"] | None = None

    def __post_init__(self) -> None:
        if not self.step_s > 0:
            raise InputError(f"stage: step_s must be positive, found {self.step_s}")

    def rows(self, index: Int[np.ndarray, "m"]) -> "StageRows":
        """A selection of rows, in this order; a row may occur more than once."""
        return StageRows(self, index)

    @cached_property
    def first_row(self) -> Int[np.ndarray, "t"]:
        """Row at which each track begins, in the order of the rows."""
        track = self.tracks.track
        return np.flatnonzero(np.append(True, track[1:] != track[:-1])) if len(track) else track

    @cached_property
    def last_row(self) -> Int[np.ndarray, "t"]:
        """Last row of each track."""
        return np.append(self.first_row[1:], len(self.tracks)) - 1

    @cached_property
    def track_of_row(self) -> Int[np.ndarray, "n"]:
        """Position in :attr:`first_row` of every row's track."""
        starts = np.zeros(len(self.tracks), int)
        starts[self.first_row] = 1
        return np.cumsum(starts) - 1

    @cached_property
    def tick(self) -> Int[np.ndarray, "n"]:
        """Moment of each row (:func:`ticks_of`). Raises :class:`InputError` where the rows are not
        ordered by (track, time).
        """
        time_s = self.tracks.time_s
        if not np.isfinite(time_s).all():
            raise InputError("stage: a time is not finite")
        late = np.flatnonzero((np.diff(self.track_of_row) == 0) & (np.diff(time_s) <= 0))
        if len(late):
            row = int(late[0]) + 1
            raise InputError(
                f"stage: row {row} at {time_s[row]:.3f} s is not later than the row before it, of "
                f"the same track {self.tracks.track[row]}; expected the order (track, time)"
            )
        return ticks_of(time_s, self.step_s)

    @cached_property
    def span_s(self) -> tuple[float, float]:
        """Times of the first and the last row; 0 without any."""
        times = self.tracks.time_s
        return (float(times.min()), float(times.max())) if len(times) else (0.0, 0.0)

    @cached_property
    def ticks(self) -> int:
        """Moments from the first row to the last."""
        return int(self.tick.max(initial=-1)) + 1

    @cached_property
    def used(self) -> Bool[np.ndarray, "n"]:
        """The first row of each track at each moment; rows may lie closer than the steps."""
        track, tick = self.track_of_row, self.tick
        again = (track[1:] == track[:-1]) & (tick[1:] == tick[:-1])
        return np.append(True, ~again) if len(tick) else np.zeros(0, bool)

    @cached_property
    def _key(self) -> Int[np.ndarray, "n"]:
        """One ascending number for (track, moment)."""
        return self.track_of_row * self.ticks + self.tick

    def row_at(
        self, track: Int[np.ndarray, "m"], tick: Int[np.ndarray, "m"]
    ) -> Int[np.ndarray, "m"]:
        """Row of a track (its position in :attr:`first_row`) at a moment, -1 if there is none."""
        wanted = track * self.ticks + tick
        row = np.minimum(np.searchsorted(self._key, wanted), len(self._key) - 1)
        # A moment before the first or after the last would belong to another track.
        inside = (tick >= 0) & (tick < self.ticks)
        return np.where(inside & (self._key[row] == wanted), row, -1)

    def on_line(
        self, track: Int[np.ndarray, "m"], time_s: Float[np.ndarray, "m"]
    ) -> Float[np.ndarray, "m"]:
        """Times of tracks (positions in :attr:`first_row`) on one line, on which tracks follow one
        another as rows do, so far apart that to a time within the stage's span a track's own rows
        are nearer than any other's.
        """
        first_s, last_s = self.span_s
        return (time_s - first_s) + track * (2 * (last_s - first_s) + 1.0)

    @cached_property
    def line_s(self) -> Float[np.ndarray, "n"]:
        """Every row's position on that line; ascending."""
        return self.on_line(self.track_of_row, self.tracks.time_s)

    def window(
        self, rows: Int[np.ndarray, "m"], half_s: float
    ) -> tuple[Int[np.ndarray, "m"], Int[np.ndarray, "m"]]:
        """First and last row of the same track within ``half_s`` seconds of each row."""
        line, track, half = self.line_s, self.track_of_row[rows], half_s + _ROUNDING
        early = np.searchsorted(line, line[rows] - half)
        late = np.searchsorted(line, line[rows] + half, side="right") - 1
        return np.maximum(early, self.first_row[track]), np.minimum(late, self.last_row[track])

    def px_per_m(self, rows: Int[np.ndarray, "m"]) -> Float[np.ndarray, "m"]:
        """Pixels that a metre of an upright person measures up and down in the picture (as boxes
        do), at the places of some rows; 1 without a camera, NaN without a place in view.
        """
        if self.camera is None:
            return np.ones(len(rows))
        foot, head = upright_uv(self.camera, self.tracks.xy_m[rows])
        return np.asarray(np.abs(head - foot)[:, 1] / PERSON_HEIGHT_M)

    def frame_at(self, time_s: float) -> int:
        """Footage frame at a time: interpolated between rows, outside them the nearest one's."""
        return round(float(np.interp(time_s, *self._frames)))

    @cached_property
    def _frames(self) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t"]]:
        """Every time once, and the frame of its first row, as a float: to interpolate it."""
        time_s, frame = self.tracks.time_s, self.tracks.frame
        if self.watched is not None:
            time_s = np.concatenate([time_s, self.watched[:, :2].ravel()])
            frame = np.concatenate([frame, self.watched[:, 2:].ravel()])
        times, first = np.unique(time_s, return_index=True)
        return times, frame[first].astype(float)

    @cached_property
    def factors(self) -> "Factors | None":
        """Camera factors of the rows; None if the camera's error is unknown."""
        if self.camera_factor is None:
            return None
        return Factors(self.camera_factor, self.tracks.xy_m)


def upright_uv(
    camera: Camera, xy_m: Float[np.ndarray, "m 2"]
) -> tuple[Float[np.ndarray, "m 2"], Float[np.ndarray, "m 2"]]:
    """Pixels of the foot and the head of upright people at some places."""
    low, high = np.zeros(len(xy_m)), np.full(len(xy_m), PERSON_HEIGHT_M)
    foot, head = (camera.project(np.column_stack([xy_m, z_m]))[0] for z_m in (low, high))
    return foot, head


def ticks_of(time_s: Float[np.ndarray, "n"], step_s: float) -> Int[np.ndarray, "n"]:
    """Times as whole numbers of steps after the first of them, the nearest ones.

    Half a step counts as none, whichever way it was rounded: times a step apart are always a tick
    apart.
    """
    if len(time_s) == 0:
        return np.zeros(0, np.int64)
    return np.ceil((time_s - time_s.min()) / step_s - (0.5 + _ROUNDING)).astype(np.int64)


def all_finite(values: Float[np.ndarray, "n k"]) -> Bool[np.ndarray, "n"]:
    """Whether a row is finite throughout. Column by column: along rows of two or four, a reduction
    takes ten times as long.
    """
    found = np.isfinite(values[:, 0])
    for column in values.T[1:]:
        found &= np.isfinite(column)
    return np.asarray(found)


class Factors:
    """Camera factors of rows, each worked out when it is first asked for: of a day, a search asks
    for those of the few rows that come near one another. NaN without a place.
    """

    def __init__(self, at: CameraFactor, xy_m: Float[np.ndarray, "n 2"]) -> None:
        self._at, self._xy_m = at, xy_m
        # Contiguous in memory: a search needs few rows, spread over the day.
        self._place = np.full(len(xy_m), -1, np.int32)
        self._values: np.ndarray | None = None

    def __getitem__(self, rows: Int[np.ndarray, "m"]) -> Float[np.ndarray, "m 2 k"]:
        new = np.unique(rows[self._place[rows] < 0])
        if self._values is None:
            self._place[new] = np.arange(len(new))
            self._values = self._at(self._xy_m[new])
        elif len(new):
            self._place[new] = len(self._values) + np.arange(len(new))
            self._values = np.concatenate([self._values, self._at(self._xy_m[new])])
        return self._values[self._place[rows]]


@dataclass(frozen=True, eq=False)
class StageRows:
    """Some rows of a stage; a column is gathered on first use."""

    stage: Stage
    index: Int[np.ndarray, "m"]

    def __len__(self) -> int:
        return len(self.index)

    @cached_property
    def time_s(self) -> Float[np.ndarray, "m"]:
        """Seconds from the clip's start."""
        return self.stage.tracks.time_s[self.index]

    @cached_property
    def xy_m(self) -> Float[np.ndarray, "m 2"]:
        """Position on the ground."""
        return self.stage.tracks.xy_m[self.index]

    @cached_property
    def covariance_m2(self) -> Float[np.ndarray, "m 2 2"]:
        """Independent part of the position's covariance."""
        return self.stage.tracks.covariance_m2[self.index]

    @cached_property
    def camera_factor(self) -> Float[np.ndarray, "m 2 k"] | None:
        """Shared part (:data:`CameraFactor`); None where the camera's error is not known."""
        factors = self.stage.factors
        return None if factors is None else factors[self.index]

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
    def size_m(self) -> Float[np.ndarray, "m 3"]:
        """Length, width and height; NaN where unknown, as length and width of people are."""
        return self.stage.tracks.size_m[self.index]

    @cached_property
    def size_sigma_m(self) -> Float[np.ndarray, "m 3"]:
        """Their standard deviations."""
        return self.stage.tracks.size_sigma_m[self.index]

    @cached_property
    def box_xyxy(self) -> Float[np.ndarray, "m 4"]:
        """Box in the image; NaN where nobody was detected."""
        return self.stage.tracks.box_xyxy[self.index]

    @cached_property
    def keypoint_uv(self) -> Float[np.ndarray, "m j 2"]:
        """Body keypoints (Halpe 26), or none."""
        return self.stage.tracks.keypoint_uv[self.index]

    @cached_property
    def keypoint_score(self) -> Float[np.ndarray, "m j"]:
        """Their scores."""
        return self.stage.tracks.keypoint_score[self.index]
