"""Many solved scenes of one kind: errors, stated spreads, and errors on the ground."""

import functools
from dataclasses import dataclass

import numpy as np
from scenes import correspondence_error, draw_scene, errors_of

from scene4d import Camera, solve_camera
from type_checks import unchecked


@dataclass(frozen=True, eq=False)
class Trials:
    """Rows are seeds. ``error`` and ``covariance`` are of (log f, tilt, roll, log height);
    ``ground_m`` is the median error where people walked, ``predicted_m`` the calibration's own
    guess of it; ``view_m`` and ``predicted_view_m`` are those over the ground in view.
    """

    error: np.ndarray
    covariance: np.ndarray
    ground_m: np.ndarray
    predicted_m: np.ndarray
    view_m: np.ndarray
    predicted_view_m: np.ndarray
    refused: list[str]

    @property
    def z(self) -> np.ndarray:
        """Errors in stated standard deviations."""
        return self.error / np.sqrt(np.diagonal(self.covariance, axis1=1, axis2=2))

    @property
    def coverage(self) -> float:
        """Share of the four parameters' 95 % intervals that hold the truth, over all seeds."""
        return float((np.abs(self.z) < 1.96).mean())


@functools.cache
def trials(n: int, seeds: int, **view: object) -> Trials:
    """Solve ``draw_scene(seed, n, **view)`` for ``seeds`` seeds."""
    with unchecked():  # a thousand calibrations; every other test checks the types
        return _solved(n, seeds, view)


def _solved(n: int, seeds: int, view: dict) -> Trials:
    error, covariance, ground, refused = [], [], [], []
    for seed in range(seeds):
        scene = draw_scene(seed, n, **view)
        people = scene.people
        found = solve_camera(
            people.foot_uv, people.head_uv, image_size=scene.camera.image_size, track=people.track
        )
        if not found:
            refused.append(f"{seed}: {found.reason}")
            continue
        error.append(errors_of(scene, found))
        covariance.append(found.covariance[:4, :4])
        predicted = found.ground_error_m
        in_view = ground_in_view(scene.camera, predicted["out_to_m"], np.random.default_rng(seed))
        by_place = [
            correspondence_error(scene.camera, found.camera, people.xy_m, elsewhere)
            for elsewhere in (None, in_view)
        ]
        walked, seen = (np.median(errors) for errors in by_place)
        ground.append([walked, predicted["walked_median"], seen, predicted["median"]])
    return Trials(np.array(error), np.array(covariance), *np.array(ground).T, refused)


def ground_in_view(camera: Camera, reach_m: float, rng: np.random.Generator) -> np.ndarray:
    """Ground points (n, 2) drawn alike from all that the camera at the origin sees within reach."""
    xy = rng.uniform(-reach_m, reach_m, (5_000, 2))
    xy = xy[np.hypot(*xy.T) < reach_m]
    uv, valid = camera.project(np.column_stack([xy, np.zeros(len(xy))]))
    return xy[valid & ((uv >= 0) & (uv <= np.array(camera.image_size) - 1)).all(axis=1)]
