"""The true and the estimated ground, in pixels of the footage."""

import numpy as np
from jaxtyping import Float

from scene4d.core.camera import Camera
from scene4d.core.geometry import apply_homography, rigid_fit
from scene4d.core.ground_map import GroundMap
from scene4d.drawing.ground import grid_step, walked_area
from scene4d.drawing.scenery import GridLine, grid_lines, image_of, in_frame
from scene4d.evaluation import Reference
from scene4d.evaluation.pages.headline import Headline


def _true_image(reference: Reference, xy_m: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Where true ground points are seen, in pixels of the footage; NaN where they are not."""
    if isinstance(reference.truth, GroundMap):
        return apply_homography(np.linalg.inv(reference.truth.ground_from_uv), xy_m)[0]
    return image_of(reference.truth, np.column_stack([xy_m, np.zeros(len(xy_m))]))


def _located(camera: Camera, uv: Float[np.ndarray, "n 2"]) -> Float[np.ndarray, "n 2"]:
    """Ground points by a camera, of pixels of its footage; NaN above the horizon."""
    return camera.locate(uv)[0]


def both_grids(
    reference: Reference, shown: Headline
) -> tuple[list[GridLine], list[Float[np.ndarray, "n 2"]], float]:
    """The estimated ground grid where people walked, the same lines as they truly run, and their
    spacing in metres; nothing where nobody stands on the estimated ground.

    The estimated ground is moved onto the true one as for the correspondence error.
    """
    camera = shown.camera
    area = walked_area(_located(camera, reference.walked_uv), camera)
    if area is None:
        return [], [], 0.0
    step = grid_step(area)
    R, t = rigid_fit(_located(camera, reference.points_uv), shown.error.true_xy_m)
    lines = grid_lines(camera, area, step)
    true = []
    for line in lines:
        across = (area.y_min, area.y_max) if line.axis == "x" else (area.x_min, area.x_max)
        run, held = np.linspace(*across, 400), np.full(400, line.value_m)
        xy = np.column_stack((held, run) if line.axis == "x" else (run, held))
        uv = _true_image(reference, xy @ R.T + t)
        uv[~in_frame(uv, camera.image_size, 0.02 * float(max(camera.image_size)))] = np.nan
        true.append(uv)
    return lines, true, step
