"""Many solved scenes of one kind: errors, stated spreads, and errors on the ground."""

import functools
from dataclasses import dataclass

import numpy as np
from scenes import correspondence_error, draw_scene, errors_of, sigmas_of

from scene4d import solve_camera


@dataclass(frozen=True, eq=False)
class Trials:
    """Rows are seeds. ``error`` and ``sigma`` are of (log f, tilt, roll, log height); ``ground_m``
    is the median error where people walked, ``predicted_m`` the calibration's own guess of it.
    """

    error: np.ndarray
    sigma: np.ndarray
    ground_m: np.ndarray
    predicted_m: np.ndarray
    refused: list[str]

    @property
    def z(self) -> np.ndarray:
        return self.error / self.sigma

    @property
    def coverage(self) -> float:
        """Share of the four parameters' 95 % intervals that hold the truth, over all seeds."""
        return float((np.abs(self.z) < 1.96).mean())


@functools.cache
def trials(n: int, seeds: range, **view: object) -> Trials:
    """Solve ``draw_scene(seed, n, **view)`` for every seed."""
    error, sigma, ground, predicted, refused = [], [], [], [], []
    for seed in seeds:
        scene = draw_scene(seed, n, **view)  # type: ignore[arg-type]
        people = scene.people
        found = solve_camera(
            people.foot_uv,
            people.head_uv,
            image_size=scene.camera.image_size,
            track=people.track,
        )
        if not found:
            refused.append(str(found.reason))
            continue
        error.append(errors_of(scene, found))
        sigma.append(sigmas_of(found))
        assert found.camera is not None
        assert found.ground_error_m is not None
        ground.append(np.median(correspondence_error(scene.camera, found.camera, people.xy_m)))
        predicted.append(found.ground_error_m["median"])
    return Trials(
        np.array(error), np.array(sigma), np.array(ground), np.array(predicted), refused
    )
