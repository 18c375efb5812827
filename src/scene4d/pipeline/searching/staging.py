"""Scenes as stages: one per run, on a common clock, with what the camera's error moves."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.model import Calibration, Tracks
from scene4d.predicates.rows import Stage
from scene4d.scene.query import Scene
from scene4d.scene.runs import Run

STEP_S = 0.2
"""Time between two rows of a track: people and vehicles do little in less, and a search takes time
by rows."""
Places = Mapping[str, Float[np.ndarray, "_ 2"]]
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


def stages(
    scene: Scene,
    *,
    cameras: Sequence[str] | None = None,
    step_s: float = STEP_S,
    zones: Places | None = None,
    lines: Places | None = None,
) -> Iterator[Staged]:
    """Every run of a scene that holds anybody, one after the other; runs are never mixed.

    Raises :class:`InputError` for a camera that is not in the scene, and as :meth:`Scene.tracks`
    and :meth:`Calibration.load`.
    """
    calibrations = {
        camera: Calibration.load(scene.camera_file(camera))
        for camera in (scene.cameras if cameras is None else cameras)
    }
    for run in scene.runs:
        if not run.rows or run.camera not in calibrations:
            continue
        tracks = scene.only(run.run).tracks()
        stage = stage_of(tracks, calibrations[run.camera], step_s=step_s, zones=zones, lines=lines)
        yield Staged(stage, run.camera, run)


def stage_of(
    tracks: Tracks,
    calibration: Calibration,
    *,
    step_s: float = STEP_S,
    zones: Places | None = None,
    lines: Places | None = None,
) -> Stage:
    """Tracks of one run as a stage, at most one row per ``step_s`` of each."""
    thin, step = thinned(tracks, step_s)
    return stage_of_thinned(thin, step, calibration, zones=zones, lines=lines)


def stage_of_thinned(
    tracks: Tracks,
    step_s: float,
    calibration: Calibration,
    *,
    zones: Places | None = None,
    lines: Places | None = None,
) -> Stage:
    """Tracks of one run as a stage, with rows every ``step_s`` as they are."""
    known = calibration.camera is not None and calibration.parameter_covariance.any()
    return Stage(
        tracks=tracks,
        image_size=calibration.image_size,
        step_s=step_s,
        camera_factor=FactorsWhenAsked(calibration, tracks.xy_m) if known else None,
        zones=zones or {},
        lines=lines or {},
        camera=calibration.camera,
    )


def thinned(tracks: Tracks, step_s: float) -> tuple[Tracks, float]:
    """The rows of every k-th moment, and the time between these: ``k`` times that of the tracks.

    ``k`` is the largest for which that is at most ``step_s``, 1 where the tracks are coarser. All
    tracks keep the same moments, so that pairs stay pairs: of those nearest to each multiple of the
    new time the nearest one.
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
    step = own_s * max(1, int(np.floor(step_s / own_s + _ROUNDING)))
    tick = np.rint(times / step)
    if (np.diff(tick) > 0).all():
        return None, step
    order = np.lexsort([np.abs(times - tick * step), tick])
    first = np.diff(tick[order], prepend=tick[order][0] - 1) > 0
    kept = np.zeros(len(times), bool)
    kept[order[first]] = True
    return kept[np.searchsorted(times, time_s)], step


class FactorsWhenAsked:
    """:func:`camera_factor` of a run's rows, each worked out when it is first asked for: of a day,
    a search asks for those of the few that come near one another.
    """

    def __init__(self, calibration: Calibration, xy_m: Float[np.ndarray, "n 2"]) -> None:
        self._calibration, self._xy_m = calibration, xy_m
        # Close together in memory: a search asks for few rows, strewn over the day.
        self._place = np.full(len(xy_m), -1, np.int32)
        self._values = np.zeros((0, 2, camera_root(calibration).shape[1]))

    def __len__(self) -> int:
        return len(self._xy_m)

    def __getitem__(self, rows: Int[np.ndarray, "m"]) -> Float[np.ndarray, "m 2 k"]:
        new = np.unique(rows[self._place[rows] < 0])
        if len(new):
            found = camera_factor(self._calibration, self._xy_m[new])
            self._place[new] = len(self._values) + np.arange(len(new))
            self._values = np.concatenate([self._values, found])
        return self._values[self._place[rows]]


def camera_factor(
    calibration: Calibration, xy_m: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 2 k"] | None:
    """Ground Jacobian times a root of the camera's covariance; None where that is not known.

    NaN where a position is, and behind the camera. See :class:`Stage`.
    """
    camera = calibration.camera
    if camera is None or not calibration.parameter_covariance.any():
        return None
    root = camera_root(calibration)
    factor = np.full((len(xy_m), 2, root.shape[1]), np.nan)
    rows = np.flatnonzero(np.isfinite(xy_m).all(axis=1))
    uv, seen = camera.project(np.column_stack([xy_m[rows], np.zeros(len(rows))]))
    rows = rows[seen]
    _, jacobian, _ = calibration.ground_jacobian(camera.distort(uv[seen]))
    factor[rows] = jacobian @ root
    return factor


def camera_root(calibration: Calibration) -> Float[np.ndarray, "5 k"]:
    """A square root of the covariance of the camera's parameters, of full rank."""
    values, vectors = np.linalg.eigh(calibration.parameter_covariance)
    used = values > _ROUNDING**2 * values.max()
    root: np.ndarray = vectors[:, used] * np.sqrt(values[used])
    return root
