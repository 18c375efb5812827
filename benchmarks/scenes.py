"""What the solvers are given: people as points, and how far from the truth a camera is."""

from collections.abc import Callable
from dataclasses import dataclass
from typing import Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.evaluation import CorrespondenceError, Reference, correspondence_error, spread_points

PERSON_HEIGHT_M, SPREAD_M, FOOT_HEIGHT_M = 1.70, 0.09, 0.04
NOISE_PX = 2.0
CUT = (0.3, 0.85)
"""Of a truncated person so much is left, from the head down."""
PEOPLE = 100
FURTHEST_M = 45.0

CAMERAS = (
    Camera.from_pose(
        image_size=(1920, 1080), focal_px=1500.0, tilt_rad=0.4, roll_rad=0.02, height_m=6.0
    ),
    Camera.from_pose(
        image_size=(768, 576), focal_px=1100.0, tilt_rad=0.29, roll_rad=-0.05, height_m=7.0
    ),
    Camera.from_pose(
        image_size=(1280, 720), focal_px=900.0, tilt_rad=0.5, roll_rad=0.03, height_m=3.2
    ),
)
"""A wide street, a telephoto view from a roof, and an indoor camera."""


@dataclass(frozen=True, eq=False)
class Scene:
    """Feet and heads (n, 2) in undistorted pixels; ``error`` scores a camera.

    ``focal_px`` is the true one, for methods that have to be told it.
    """

    condition: str
    seed: int
    foot_uv: np.ndarray
    head_uv: np.ndarray
    image_size: tuple[int, int]
    focal_px: float
    error: Callable[[Camera], CorrespondenceError]


def draw_people(
    camera: Camera, n: int, rng: np.random.Generator, truncated: float = 0.0
) -> tuple[np.ndarray, np.ndarray, np.ndarray]:
    """Feet, heads (n, 2) and ground positions (n, 2) of people spread evenly over what is seen."""
    xy = np.empty((0, 2))
    while len(xy) < n:
        half = FURTHEST_M / 2
        drawn = rng.uniform([-half, 1.0], [half, FURTHEST_M], (4 * n + 400, 2))
        whole = _inside(camera, drawn, FOOT_HEIGHT_M) & _inside(camera, drawn, 2.1)
        xy = np.concatenate([xy, drawn[whole]])
    xy = xy[:n]
    feet = _at(camera, xy, FOOT_HEIGHT_M) + rng.normal(0, NOISE_PX, (n, 2))
    heads = _at(camera, xy, rng.normal(PERSON_HEIGHT_M, SPREAD_M, n))
    heads += rng.normal(0, NOISE_PX, (n, 2))
    cut = rng.random(n) < truncated
    feet[cut] = heads[cut] + (feet[cut] - heads[cut]) * rng.uniform(*CUT, (cut.sum(), 1))
    return feet, heads, xy


def _at(camera: Camera, xy: np.ndarray, z: Any) -> np.ndarray:
    return camera.project(np.column_stack([xy, np.broadcast_to(z, len(xy))]))[0]


def _inside(camera: Camera, xy: np.ndarray, z: float) -> np.ndarray:
    uv, valid = camera.project(np.column_stack([xy, np.full(len(xy), z)]))
    with np.errstate(invalid="ignore"):
        return valid & ((uv > 0) & (uv < camera.image_size)).all(axis=1)


def synthetic(seeds: int, truncated: float, people: int = PEOPLE) -> list[Scene]:
    """One scene for each camera and seed."""
    condition = f"{truncated:.0%} truncated" if truncated else "clean"
    found = []
    for number, camera in enumerate(CAMERAS):
        for seed in range(seeds):
            rng = np.random.default_rng([number, seed])
            feet, heads, xy = draw_people(camera, people, rng, truncated)
            error = _error_over(camera, xy[spread_points(xy)])
            size = camera.image_size
            found.append(Scene(condition, seed, feet, heads, size, camera.focal_px, error))
    return found


def _error_over(camera: Camera, xy: np.ndarray) -> Callable[[Camera], CorrespondenceError]:
    uv = _at(camera, xy, 0.0)
    return lambda estimated: correspondence_error(estimated.locate(uv)[0], xy)


def recorded(found: Calibration, reference: Reference) -> Scene:
    """The people that ``calibrate`` saw, straightened with the true lens."""
    segments, true = found.segments, reference.camera
    assert segments is not None
    feet, foot_ok = true.undistort(segments.foot_uv)
    heads, head_ok = true.undistort(segments.head_uv)
    seen = foot_ok & head_ok
    return Scene(
        "PETS 2009",
        0,
        feet[seen],
        heads[seen],
        true.image_size,
        true.focal_px,
        lambda camera: reference.score(camera, undistorted=True),
    )
