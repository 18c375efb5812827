"""Who is compared: each takes a scene's feet and heads and returns a camera.

All peers begin at the same camera (START). Their ground is the plane of the foot points, so that
people are as tall for them as for ``solve_camera``; the camera's height is put right afterwards.
"""

import contextlib
import io
import warnings
from collections.abc import Callable
from dataclasses import dataclass, replace
from typing import Any

import numpy as np
from scipy.optimize import least_squares

from benchmarks.scenes import FOOT_HEIGHT_M, PERSON_HEIGHT_M, SPREAD_M, Scene
from scene4d import solve_camera
from scene4d.calibration import solve_segments
from scene4d.calibration.options import POINTS
from scene4d.core.camera import Camera, Lens
from scene4d.core.geometry import rotation_from_tilt_roll
from scene4d.core.people import Segments

START_TILT_DEG, START_HEIGHT_M = 20.0, 5.0
"""The other values: a focal length of the image's width, no roll."""
VISIBLE_M = PERSON_HEIGHT_M - FOOT_HEIGHT_M
OUTLIER_PX = 10.0
ITERATIONS = 10_000
HEADING_DEG = 45.0
"""cameratransform reads a head's height off at the foot's X and at its Y and takes the mean. Where
a person stands straight ahead, X is almost 0 and says nothing, and noise fills the mean. At 45
degrees both say something; the heading is free, so it gets that one."""


@dataclass(frozen=True)
class Method:
    """``solve`` returns None for a refusal. ``seeds``: no more scenes than these of each camera."""

    name: str
    solve: Callable[[Scene], Camera | None]
    told_focal: bool = False
    seeds: int | None = None


def ours(scene: Scene) -> Camera | None:
    found = solve_camera(
        scene.foot_uv,
        scene.head_uv,
        image_size=scene.image_size,
        person_height_m=PERSON_HEIGHT_M,
        foot_height_m=FOOT_HEIGHT_M,
    )
    return found.camera if found else None


def ours_told(scene: Scene) -> Camera | None:
    """The solver behind ``solve_camera`` with a lens file's focal length."""
    K = np.diag([scene.focal_px, scene.focal_px, 1.0])
    K[:2, 2] = (np.array(scene.image_size) - 1) / 2
    options = replace(
        POINTS,
        person_height_m=PERSON_HEIGHT_M,
        foot_height_m=FOOT_HEIGHT_M,
        lens=Lens(scene.image_size, K),
    )
    segments = Segments.from_points(scene.foot_uv, scene.head_uv)
    found = solve_segments(segments, scene.image_size, options)
    return found.camera if found else None


def scipy_baseline(scene: Scene) -> Camera:
    """Robust least squares over (log f, tilt, roll, log height), as one would write it at first:
    where the head should be against where it is, in pixels, numeric derivatives.
    """
    centre = (np.array(scene.image_size) - 1) / 2

    def off_px(parameters: np.ndarray) -> np.ndarray:
        f, height = np.exp(parameters[[0, 3]])
        up = rotation_from_tilt_roll(parameters[1], parameters[2])[:, 2]
        ray = np.column_stack([(scene.foot_uv - centre) / f, np.ones(len(scene.foot_uv))])
        below = np.maximum(-(ray @ up), 1e-3)  # feet above the horizon: far away
        head = ray * (height / below)[:, None] + VISIBLE_M * up
        predicted = head[:, :2] / np.maximum(head[:, 2:], 1e-2) * f + centre
        return (predicted - scene.head_uv).ravel()

    start = [np.log(scene.image_size[0]), np.radians(START_TILT_DEG), 0.0, np.log(START_HEIGHT_M)]
    log_f, tilt, roll, log_h = least_squares(off_px, start, loss="soft_l1", f_scale=OUTLIER_PX).x
    return Camera.from_pose(
        image_size=scene.image_size,
        focal_px=float(np.exp(log_f)),
        tilt_rad=float(tilt),
        roll_rad=float(roll),
        height_m=float(np.exp(log_h)) + FOOT_HEIGHT_M,
    )


def cameratransform(scene: Scene, *, told_focal: bool, **how: Any) -> Camera:
    """``metropolis`` where ``how`` names iterations, else ``fit``, as its documentation shows."""
    import cameratransform as ct

    width, height = scene.image_size
    focal = scene.focal_px if told_focal else float(width)
    camera = ct.Camera(
        ct.RectilinearProjection(
            focallength_px=focal, image=(width, height), center=((width - 1) / 2, (height - 1) / 2)
        ),
        ct.SpatialOrientation(heading_deg=HEADING_DEG),
    )
    camera.addObjectHeightInformation(scene.foot_uv, scene.head_uv, VISIBLE_M, SPREAD_M)
    asked = [
        ct.FitParameter("elevation_m", lower=0, upper=100, value=START_HEIGHT_M),
        ct.FitParameter("tilt_deg", lower=0, upper=180, value=90 - START_TILT_DEG),
        ct.FitParameter("roll_deg", lower=-180, upper=180, value=0),
    ]
    if not told_focal:
        # With its default step of one pixel 10,000 iterations do not reach it.
        span = {"lower": 0.2 * width, "upper": 5.0 * width, "step": 0.03 * width}
        asked.append(ct.FitParameter("focallength_px", value=focal, **span))
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        if "iterations" in how:
            np.random.seed(scene.seed)  # noqa: NPY002 - it draws from the global generator
            camera.metropolis(asked, disable_bar=True, print_trace=False, **how)
        else:
            camera.fit(asked, **how)
    return _converted(camera, scene.image_size)


def _converted(theirs: Any, image_size: tuple[int, int]) -> Camera:
    """Their camera looks along -Z with Y up. Checked against their own projection."""
    K = np.diag([theirs.focallength_x_px, theirs.focallength_y_px, 1.0])
    K[:2, 2] = theirs.center_x_px, theirs.center_y_px
    R, centre = np.diag([1.0, -1.0, -1.0]) @ theirs.orientation.R, theirs.orientation.t
    same = Camera(image_size=image_size, K=K, R=R, t=-R @ centre)
    ahead = centre + R[2] * 10 + np.array([[0, 0, 0], [1, 2, 0], [2, -1, 1.0]])
    np.testing.assert_allclose(same.project(ahead)[0], theirs.imageFromSpace(ahead), atol=1e-6)
    return Camera(
        image_size=image_size, K=K, R=R, t=-R @ (centre + np.array([0, 0, FOOT_HEIGHT_M]))
    )


def own_methods() -> list[Method]:
    return [
        Method("solve_camera", ours),
        Method("solve_camera, lens", ours_told, told_focal=True),
        Method("SciPy baseline", scipy_baseline),
    ]


def cameratransform_methods(iterations: int = ITERATIONS) -> list[Method]:
    """The default of ``fit`` (L-BFGS-B), a better one, and the sampler; then told the truth."""

    def method(title: str, told: bool, seeds: int | None, **how: Any) -> Method:
        name = f"cameratransform {title}"
        return Method(
            name, lambda scene: cameratransform(scene, told_focal=told, **how), told, seeds
        )

    simplex: dict[str, Any] = {"method": "Nelder-Mead"}
    return [
        method("fit", False, None),
        method("fit, Nelder-Mead", False, None, **simplex),
        method("metropolis", False, 2, iterations=iterations),
        method("fit, Nelder-Mead", True, None, **simplex),
        method("metropolis", True, 1, iterations=iterations),
    ]
