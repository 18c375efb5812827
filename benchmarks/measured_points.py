"""Two measured points beside a few people: ``solve_camera`` and cameratransform.

    python -m benchmarks.measured_points [--seeds N]

Every scene has ten people and two ground points more than 5 m apart, clicked to 2 px and measured
to 5 cm. cameratransform is given all of it, as its documentation shows
(``addObjectHeightInformation``, ``addLandmarkInformation``, ``fit`` by Nelder-Mead). It begins at
the same camera as in benchmarks.peers; position and heading, which the points bring in, begin at
the true ones. Errors are those of 100 places after rigid alignment.
"""

import argparse
import contextlib
import io
import warnings
from functools import partial

import numpy as np

from benchmarks.peers import HEADING_DEG, START_HEIGHT_M, START_TILT_DEG, VISIBLE_M, _converted
from benchmarks.scenes import CAMERAS, FOOT_HEIGHT_M, PERSON_HEIGHT_M, SPREAD_M, draw_people
from scene4d import solve_camera
from scene4d.core.camera import Camera
from scene4d.core.landmarks import GroundPoint, Landmarks
from scene4d.evaluation import correspondence_error

PEOPLE, PLACES, APART_M = 10, 100, 5.0
SIGMA_PX, SIGMA_M = 2.0, 0.05
FAILED_M = 10.0


def measured(
    camera: Camera, rng: np.random.Generator
) -> tuple[np.ndarray, np.ndarray, np.ndarray, np.ndarray]:
    """Pixels and positions (2, 2) of two points; pixels and true positions of places (n, 2)."""
    _, _, xy = draw_people(camera, PLACES, rng)
    uv, _ = camera.project(np.column_stack([xy, np.zeros(len(xy))]))
    far = np.linalg.norm(xy[1:] - xy[0], axis=1) > APART_M
    rows = [0, 1 + int(np.argmax(far))]
    noise = rng.normal(0, SIGMA_PX, (2, 2)), rng.normal(0, SIGMA_M, (2, 2))
    return uv[rows] + noise[0], xy[rows] + noise[1], uv, xy


def ours(foot: np.ndarray, head: np.ndarray, camera: Camera, known: Landmarks | None) -> Camera:
    found = solve_camera(
        foot, head, image_size=camera.image_size, person_height_m=PERSON_HEIGHT_M,
        foot_height_m=FOOT_HEIGHT_M, track=np.arange(len(foot)), landmarks=known,
    )  # fmt: skip
    if found.camera is None:
        raise ValueError(found.reason)
    return found.camera


def theirs(
    foot: np.ndarray,
    head: np.ndarray,
    camera: Camera,
    uv: np.ndarray | None,
    xy: np.ndarray,
    *,
    told_focal: bool = False,
) -> Camera:
    import cameratransform as ct

    width, height = camera.image_size
    model = ct.Camera(
        ct.RectilinearProjection(
            focallength_px=camera.focal_px if told_focal else float(width),
            image=(width, height),
            center=((width - 1) / 2, (height - 1) / 2),
        ),
        ct.SpatialOrientation(heading_deg=HEADING_DEG),
    )
    model.addObjectHeightInformation(foot, head, VISIBLE_M, SPREAD_M)
    asked = [
        ct.FitParameter("elevation_m", lower=0, upper=100, value=START_HEIGHT_M),
        ct.FitParameter("tilt_deg", lower=0, upper=180, value=90 - START_TILT_DEG),
        ct.FitParameter("roll_deg", lower=-180, upper=180, value=0),
    ]
    if not told_focal:
        span = {"lower": 0.2 * width, "upper": 5.0 * width, "value": width}
        asked.append(ct.FitParameter("focallength_px", **span))
    if uv is not None:
        space = np.column_stack([xy, np.full(2, -FOOT_HEIGHT_M)])
        model.addLandmarkInformation(uv, space, [SIGMA_M] * 3)
        asked += [
            ct.FitParameter("heading_deg", lower=-180, upper=180, value=0),
            ct.FitParameter("pos_x_m", lower=-100, upper=100, value=0),
            ct.FitParameter("pos_y_m", lower=-100, upper=100, value=0),
        ]
    with contextlib.redirect_stdout(io.StringIO()), warnings.catch_warnings():
        warnings.simplefilter("ignore")
        model.fit(asked, method="Nelder-Mead")
    return _converted(model, camera.image_size)


def measure(seeds: int) -> dict[str, list[float]]:
    errors: dict[str, list[float]] = {}
    for number, camera in enumerate(CAMERAS):
        for seed in range(seeds):
            rng = np.random.default_rng([number, seed, 2])
            foot, head, _ = draw_people(camera, PEOPLE, rng)
            uv, xy, places_uv, places = measured(camera, rng)
            points = [
                GroundPoint((u, v), (x, y), sigma_m=SIGMA_M, sigma_px=SIGMA_PX)
                for (u, v), (x, y) in zip(uv.tolist(), xy.tolist(), strict=True)
            ]
            known = Landmarks(tuple(points))
            told = partial(theirs, foot, head, camera)
            for name, solve in {
                "solve_camera": partial(ours, foot, head, camera, None),
                "solve_camera, two points": partial(ours, foot, head, camera, known),
                "cameratransform": partial(told, None, xy),
                "cameratransform, two points": partial(told, uv, xy),
                "cameratransform, two points, focal length": partial(told, uv, xy, told_focal=True),
            }.items():
                try:
                    estimated = solve().locate(places_uv)[0]
                    error_m = correspondence_error(estimated, places).mean_m
                except ValueError:  # refused, or places above the horizon
                    error_m = np.inf
                errors.setdefault(name, []).append(error_m)
    return errors


def main() -> None:
    parser = argparse.ArgumentParser(description=__doc__.splitlines()[0])
    parser.add_argument("--seeds", type=int, default=4)
    errors = measure(parser.parse_args().seeds)
    print(
        "| given | scenes | error, median | 90 % | refused or above 10 m |\n" + "| --- " * 5 + "|"
    )
    for name, found in errors.items():
        median, p90 = np.quantile(found, [0.5, 0.9], method="nearest")
        far = int(np.sum(np.array(found) > FAILED_M))
        print(f"| {name} | {len(found)} | {median:.2f} m | {p90:.2f} m | {far} |")


if __name__ == "__main__":
    main()
