"""Scenes as stages: one per run, on a common clock, with what the camera's error moves."""

from collections.abc import Mapping
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.tracks import Tracks
from scene4d.searching.activities.meeting import ticks_of
from scene4d.searching.predicates.rows import Stage
from scene4d.store.runs import Run

STEP_S = 0.2
"""Time between two rows of a track, as near to it as theirs permits: people and vehicles do little
in less, and a search takes time by rows."""
_Places = Mapping[str, Float[np.ndarray, "_ 2"]]
"""Zones or lines by their names, on the ground in metres."""
_ROUNDING = 1e-6


@dataclass(frozen=True, eq=False)
class Staged:
    """A stage with where it comes from. ``run`` is its manifest, None where there is no scene."""

    stage: Stage
    camera: str
    run: Run | None = None

    def frame_at(self, time_s: float) -> int:
        """Frame at a time: that of the nearest row, and between rows by their rate."""
        return round(float(np.interp(time_s, *self._clock)))

    @cached_property
    def _clock(self) -> tuple[Float[np.ndarray, "t"], Float[np.ndarray, "t"]]:
        """Every moment once, and the frame of its first row, as a float: to interpolate it."""
        times, first = np.unique(self.stage.tracks.time_s, return_index=True)
        return times, self.stage.tracks.frame[first].astype(float)


def stage_of(
    tracks: Tracks,
    calibration: Calibration,
    *,
    step_s: float = STEP_S,
    zones: _Places | None = None,
    lines: _Places | None = None,
) -> Stage:
    """Tracks of one run as a stage, with about a row per ``step_s`` of each (:func:`thinned`)."""
    thin, step = thinned(tracks, step_s)
    return stage_of_thinned(thin, step, calibration, zones=zones, lines=lines)


def stage_of_thinned(
    tracks: Tracks,
    step_s: float,
    calibration: Calibration,
    *,
    zones: _Places | None = None,
    lines: _Places | None = None,
) -> Stage:
    """Tracks of one run as a stage, with rows every ``step_s`` as they are."""
    return Stage(
        tracks=tracks,
        image_size=calibration.image_size,
        step_s=step_s,
        camera_factor=factors_of(calibration, tracks.xy_m),
        zones=zones or {},
        lines=lines or {},
        camera=calibration.camera,
    )


def thinned(tracks: Tracks, step_s: float) -> tuple[Tracks, float]:
    """The rows of every k-th moment, and the time between these: ``k`` times that of the tracks.

    ``k`` is that for which it is nearest to ``step_s``, the smaller of two, and at least 1. All
    tracks keep the same moments, so that pairs stay pairs: of those of each tick
    (:func:`ticks_of`) the one nearest to it.
    """
    kept, step = kept_moments(tracks.time_s, step_s)
    return tracks if kept is None else tracks.select(kept), step


def kept_moments(
    time_s: Float[np.ndarray, "n"], step_s: float
) -> tuple[Bool[np.ndarray, "n"] | None, float]:
    """The rows that :func:`thinned` keeps (None: all of them), and the time between these."""
    times = np.unique(time_s)
    if len(times) < 2:
        return None, float(step_s)
    own_s = float(np.median(np.diff(times)))
    step = own_s * max(1, int(np.ceil(step_s / own_s - 0.5 - _ROUNDING)))
    tick = ticks_of(times, step)
    if (np.diff(tick) > 0).all():
        return None, step
    order = np.lexsort([np.abs(times - times[0] - tick * step), tick])
    first = np.diff(tick[order], prepend=-1) > 0
    kept = np.zeros(len(times), bool)
    kept[order[first]] = True
    return kept[np.searchsorted(times, time_s)], step


def factors_of(
    calibration: Calibration, xy_m: Float[np.ndarray, "n 2"]
) -> "FactorsWhenAsked | None":
    """Camera factors of places; None where the camera, or its error, is not known."""
    if calibration.camera is None or not calibration.parameter_covariance.any():
        return None
    return FactorsWhenAsked(calibration, calibration.camera, xy_m)


class FactorsWhenAsked:
    """Ground Jacobian times a root of the camera's covariance at the places of a run's rows, each
    worked out when it is first asked for: of a day, a search asks for those of the few that come
    near one another.

    NaN where a position is, and behind the camera. See :class:`Stage`.
    """

    def __init__(
        self, calibration: Calibration, camera: Camera, xy_m: Float[np.ndarray, "n 2"]
    ) -> None:
        self._calibration, self._camera, self._xy_m = calibration, camera, xy_m
        self._root = _root(calibration.parameter_covariance)
        # Close together in memory: a search asks for few rows, strewn over the day.
        self._place = np.full(len(xy_m), -1, np.int32)
        self._values = np.zeros((0, 2, self._root.shape[1]))

    def __len__(self) -> int:
        return len(self._xy_m)

    def __getitem__(self, rows: Int[np.ndarray, "m"]) -> Float[np.ndarray, "m 2 k"]:
        new = np.unique(rows[self._place[rows] < 0])
        if len(new):
            found = self._worked_out(self._xy_m[new])
            self._place[new] = len(self._values) + np.arange(len(new))
            self._values = np.concatenate([self._values, found])
        return self._values[self._place[rows]]

    def _worked_out(self, xy_m: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 2 k"]:
        factor = np.full((len(xy_m), 2, self._root.shape[1]), np.nan)
        rows = np.flatnonzero(np.isfinite(xy_m).all(axis=1))
        uv, seen = self._camera.project(np.column_stack([xy_m[rows], np.zeros(len(rows))]))
        rows = rows[seen]
        _, jacobian, _ = self._calibration.ground_jacobian(uv[seen])
        factor[rows] = jacobian @ self._root
        return factor


def _root(covariance: Float[np.ndarray, "5 5"]) -> Float[np.ndarray, "5 k"]:
    """A square root of a covariance, of full rank."""
    values, vectors = np.linalg.eigh(covariance)
    used = values > _ROUNDING**2 * values.max()
    root: np.ndarray = vectors[:, used] * np.sqrt(values[used])
    return root
