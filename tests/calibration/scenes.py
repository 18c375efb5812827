"""Cameras over people whose truth is known, for the tests of the calibration."""

from dataclasses import dataclass, replace

import numpy as np

from scene4d.calibration import solve_segments
from scene4d.calibration._body import Points
from scene4d.calibration.options import POINTS
from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.people import Segments
from strategies import PeopleScene, build_camera, build_lens, people_scene

FOOT_HEIGHT_M = 0.04
LONGEST = 0.35
"""The median person is at most this fraction of the image's height, as in surveillance."""


@dataclass(frozen=True, eq=False)
class Scene:
    """A camera and the people that it sees."""

    camera: Camera
    people: PeopleScene

    @property
    def truth(self) -> np.ndarray:
        """(log f in half diagonals, tilt, roll, log height, D) of the camera."""
        return parameters_of(self.camera)


def solve_points(
    segments: Segments,
    image_size: tuple[int, int],
    *,
    edges_xyxy: np.ndarray | None = None,
    **changed: object,
) -> Calibration:
    """The solver on points that are what they are said to be, with the distortion estimated."""
    options = replace(POINTS, **({"estimate_distortion": True} | changed))
    return solve_segments(segments, image_size, options, edges_xyxy=edges_xyxy)


def half_diagonal(camera: Camera) -> float:
    return float(np.hypot(*camera.image_size) / 2)


def parameters_of(camera: Camera) -> np.ndarray:
    """The solver's parameters of a camera without tangential distortion."""
    focal = camera.K[0, 0] / half_diagonal(camera)
    corner = camera.distortion[0] / focal**2
    return np.array(
        [np.log(focal), camera.tilt_rad, camera.roll_rad, np.log(camera.height_m), corner, 0, 0]
    )


def draw_scene(
    seed: int,
    n: int = 200,
    *,
    fov_deg: float | None = None,
    tilt_deg: float | None = None,
    roll_deg: float | None = None,
    height_m: float | None = None,
    image_size: tuple[int, int] = (1920, 1080),
    **crowd: object,
) -> Scene:
    """A view drawn from ``seed`` in which ``n`` sightings of people fit; what is given stays."""
    rng = np.random.default_rng(seed)
    for _ in range(300):
        fov = rng.uniform(20, 85) if fov_deg is None else fov_deg
        camera = build_camera(
            build_lens(image_size, fov),
            rng.uniform(8, 50) if tilt_deg is None else tilt_deg,
            rng.normal(0, 4) if roll_deg is None else roll_deg,
            np.exp(rng.uniform(np.log(2.8), np.log(20))) if height_m is None else height_m,
        )
        state = rng.bit_generator.state
        try:
            people = people_scene(camera, 60, rng)
            if np.median(np.hypot(*(people.foot_uv - people.head_uv).T)) > LONGEST * image_size[1]:
                continue
            rng.bit_generator.state = state
            return Scene(camera, people_scene(camera, n, rng, **crowd))  # type: ignore[arg-type]
        except ValueError:
            continue
    raise AssertionError(f"no view of whole people at {fov_deg=}, {tilt_deg=}")


def solver_points(camera: Camera, foot_uv: np.ndarray, head_uv: np.ndarray, box: object) -> Points:
    """Pixels in the solver's frame, written out independently of :mod:`.frame`."""
    centre, unit = camera.K[:2, 2], half_diagonal(camera)
    return Points(
        np.ascontiguousarray(((foot_uv - centre) / unit).T),
        np.ascontiguousarray(((head_uv - centre) / unit).T),
        np.broadcast_to(np.asarray(box, bool), len(foot_uv)).copy(),
        FOOT_HEIGHT_M,
    )


def errors_of(scene: Scene, found: Calibration) -> np.ndarray:
    """Error of (log f, tilt, roll, log height)."""
    assert found, found.reason
    assert found.camera is not None
    return (parameters_of(found.camera) - scene.truth)[:4]


def sigmas_of(found: Calibration) -> np.ndarray:
    """Stated standard deviation of (log f, tilt, roll, log height)."""
    assert found.covariance is not None
    return np.sqrt(np.diag(found.covariance))[:4]


def correspondence_error(
    truth: Camera, found: Camera, xy_m: np.ndarray, elsewhere_m: np.ndarray | None = None
) -> np.ndarray:
    """Distances after a rigid alignment of what ``found`` makes of true ground points (n, 2): of
    these, or of others after the same alignment.
    """
    at = xy_m if elsewhere_m is None else np.vstack([xy_m, elsewhere_m])
    uv, valid = truth.project(np.column_stack([at, np.zeros(len(at))]))
    there, seen = found.locate(uv)
    assert valid.all()
    if not seen[: len(xy_m)].all():
        return np.full(len(at), np.inf)
    # Procrustes of the plane in complex numbers: no code of the package.
    a, b = (p[:, 0] + 1j * p[:, 1] for p in (there, at))
    n = len(xy_m)
    a, b = a - a[:n].mean(), b - b[:n].mean()
    turn = np.vdot(a[:n], b[:n])
    error = np.where(seen, np.abs(a * turn / abs(turn) - b), np.inf)
    return error if elsewhere_m is None else error[n:]
