"""Tracks of one run as a stage: on a common clock, with what the camera's error moves."""

from collections.abc import Mapping

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.calibration import Calibration
from scene4d.core.tracks import Tracks
from scene4d.searching.predicates.stage import CameraFactor, Stage, ticks_of

STEP_S = 0.2
"""Time between two rows of a track, as near to it as theirs permits: people and vehicles do little
in less, and a search takes time by rows."""
_ROUNDING = 1e-6


def stage_of(
    tracks: Tracks,
    calibration: Calibration,
    *,
    step_s: float | None = None,
    zones: Mapping[str, Float[np.ndarray, "_ 2"]] | None = None,
    lines: Mapping[str, Float[np.ndarray, "_ 2"]] | None = None,
    everybody: bool = True,
    watched: Float[np.ndarray, "s 4"] | None = None,
) -> Stage:
    """Tracks of one run as a stage: with rows every ``step_s`` as they are, or else with about a
    row of each track per :data:`STEP_S` (:func:`thinned`). ``everybody`` and ``watched`` are those
    of the stage.
    """
    if step_s is None:
        tracks, step_s = thinned(tracks, STEP_S)
    return Stage(
        tracks=tracks,
        image_size=calibration.image_size,
        step_s=step_s,
        camera_factor=camera_factor_of(calibration),
        zones=zones or {},
        lines=lines or {},
        camera=calibration.camera,
        everybody=everybody,
        watched=watched,
    )


def thinned(tracks: Tracks, step_s: float) -> tuple[Tracks, float]:
    """The rows of every k-th moment, and the time between these: ``k`` times that of the tracks.

    ``k`` is at least 1, and else the one for which that time is nearest to ``step_s``, the smaller
    of two. All tracks keep the same moments, so that pairs stay pairs: of those of each tick
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


def camera_factor_of(calibration: Calibration) -> CameraFactor | None:
    """What the camera's error moves places by (:data:`CameraFactor`); NaN where a place is not
    known, and behind the camera. None where the camera, or its error, is not known.
    """
    covariance = calibration.parameter_covariance
    if calibration.camera is None or not covariance.any():
        return None
    root = _root(covariance)
    columns = root.shape[1] + bool(calibration.ground_regions)

    def factor(xy_m: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 2 k"]:
        found = np.full((len(xy_m), 2, columns), np.nan)
        rows = np.flatnonzero(np.isfinite(xy_m).all(axis=1))
        uv, seen = calibration.ground_pixels(xy_m[rows])
        _, jacobian, _ = calibration.ground_jacobian(uv[seen])
        found[rows[seen], :, : root.shape[1]] = jacobian @ root
        if calibration.ground_regions:
            found[rows[seen], :, -1] = calibration.moved_by_ground_height(
                uv[seen], xy_m[rows[seen]]
            )
        return found

    return factor


def _root(covariance: Float[np.ndarray, "p p"]) -> Float[np.ndarray, "p k"]:
    """A square root of a covariance, of full rank."""
    values, vectors = np.linalg.eigh(covariance)
    used = values > _ROUNDING**2 * values.max()
    root: np.ndarray = vectors[:, used] * np.sqrt(values[used])
    return root
