"""Scenes as stages: one per run, on a common clock, with what the camera's error moves."""

from collections.abc import Iterator, Mapping, Sequence
from dataclasses import dataclass

import numpy as np
from jaxtyping import Float

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
        times, first = np.unique(self.stage.tracks.time_s, return_index=True)
        return round(float(np.interp(time_s, times, self.stage.tracks.frame[first])))


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
    return Stage(
        tracks=thin,
        image_size=calibration.image_size,
        step_s=step,
        camera_factor=camera_factor(calibration, thin.xy_m),
        zones=zones or {},
        lines=lines or {},
    )


def thinned(tracks: Tracks, step_s: float) -> tuple[Tracks, float]:
    """The rows of every k-th moment, and the time between these: ``k`` times that of the tracks.

    ``k`` is the largest for which that is at most ``step_s``, 1 where the tracks are coarser. All
    tracks keep the same moments, so that pairs stay pairs: of those nearest to each multiple of the
    new time the nearest one.
    """
    times = np.unique(tracks.time_s)
    if len(times) < 2:
        return tracks, float(step_s)
    own_s = float(np.median(np.diff(times)))
    step = own_s * max(1, int(np.floor(step_s / own_s + _ROUNDING)))
    tick = np.rint(times / step)
    order = np.lexsort([np.abs(times - tick * step), tick])
    first = np.diff(tick[order], prepend=tick[order][0] - 1) > 0
    return tracks.select(np.isin(tracks.time_s, times[order][first])), step


def camera_factor(
    calibration: Calibration, xy_m: Float[np.ndarray, "n 2"]
) -> Float[np.ndarray, "n 2 k"] | None:
    """Ground Jacobian times a root of the camera's covariance; None where that is not known.

    NaN where a position is, and behind the camera. See :class:`Stage`.
    """
    camera, covariance = calibration.camera, calibration.parameter_covariance
    if camera is None or not covariance.any():
        return None
    values, vectors = np.linalg.eigh(covariance)
    used = values > _ROUNDING**2 * values.max()
    root = vectors[:, used] * np.sqrt(values[used])
    factor = np.full((len(xy_m), 2, root.shape[1]), np.nan)
    rows = np.flatnonzero(np.isfinite(xy_m).all(axis=1))
    uv, seen = camera.project(np.column_stack([xy_m[rows], np.zeros(len(rows))]))
    rows = rows[seen]
    _, jacobian, _ = calibration.ground_jacobian(camera.distort(uv[seen]))
    factor[rows] = jacobian @ root
    return factor
