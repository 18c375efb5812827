"""The cameras of a site refined together: what each errs by, told by what the others saw.

The site's estimate has the errors of every camera among its unknowns, with the camera's own
covariance as their prior (:mod:`_graph`). Most probable errors are taken off the camera, and their
covariance is that of the new one (tests/alignment/test_joint.py compares with true cameras).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scene4d.alignment._factor import POSE
from scene4d.alignment._graph import Solution, placed_slopes
from scene4d.alignment._paths import View, corrected, covariance_root
from scene4d.core.calibration import PARAMETERS, Calibration
from scene4d.core.placement import PLACED, Placement
from scene4d.store.site_errors import TOLD, SiteErrors

_SAMPLE = 400
"""Rows of tracks over which errors on the ground are summed up."""


@dataclass(frozen=True, eq=False)
class Refined:
    """A camera refined by its site, and its placement, in metres that need no scale any more.

    ``shift`` is the largest change of an independent error, in standard deviations of what was
    known before.
    """

    calibration: Calibration
    placement: Placement
    shift: float


def refined(views: Sequence[View], solution: Solution) -> tuple[Refined | None, ...]:
    """The cameras that the site tells something of, in their order; None for those without a place,
    and for those whose file states no covariance: nothing says what may be changed of them.
    """
    return tuple(_refined(views[k], solution, k) for k in range(len(views)))


def errors_together(views: Sequence[View], solution: Solution) -> SiteErrors:
    """What the placed cameras err by, refined as :func:`refined` does, in one covariance."""
    placed = [k for k in range(len(views)) if solution.placements[k]]
    size = len(TOLD)
    slopes = np.zeros((size * len(placed), len(solution.covariance)))
    for row, number in enumerate(placed):
        view, at, here = views[number], solution.slots[number], slice(row * size, (row + 1) * size)
        slopes[here, at][: len(PLACED)] = placed_slopes(view)
        root = covariance_root(view.calibration)
        if root.any():  # its errors are told by themselves, and so is the scale that they make
            slopes[here, at][PLACED.index("log_scale")] = 0.0
            slopes[here, at][len(PLACED) :, POSE : POSE + len(PARAMETERS)] = -root
    covariance = slopes @ solution.covariance @ slopes.T
    return SiteErrors(tuple(views[k].name for k in placed), (covariance + covariance.T) / 2)


def _refined(view: View, solution: Solution, number: int) -> Refined | None:
    before = view.calibration
    if not solution.placements[number] or before.camera is None:
        return None
    root = covariance_root(before)
    if not root.any():
        return None
    at, count = solution.slots[number], len(PARAMETERS)
    own = solution.covariance[at, at]
    errors = solution.errors[number][:count]
    spread = own[POSE : POSE + count, POSE : POSE + count]
    covariance = root @ spread @ root.T
    after = replace(
        before,
        camera=corrected(before, solution.errors[number]).camera,
        covariance=(covariance + covariance.T) / 2,
        segments=None,
        inlier=None,
        residual=None,
        people=before.people,
        inliers=before.inliers,
        landmarks=None,
        vehicles=None,
    )
    return Refined(
        _summed_up(after, view), _unscaled(solution, number), float(np.abs(errors).max())
    )


def _unscaled(solution: Solution, number: int) -> Placement:
    """The placement of the refined camera: its metre is the site's."""
    found = solution.placements[number]
    parameters = found.parameters
    parameters[3] = 0.0
    return replace(Placement.from_parameters(parameters, found.covariance), drift=found.drift)


def _summed_up(found: Calibration, view: View) -> Calibration:
    """With the errors on the ground that its file states, as changed where people walked."""
    before = view.calibration
    rows = np.linspace(0, len(view) - 1, min(_SAMPLE, len(view))).astype(int)
    uv, valid = before.ground_pixels(view.xy_m[rows])
    uv = uv[valid]
    within, whole = (
        _median_m(found, uv, from_camera) / max(_median_m(before, uv, from_camera), 1e-9)
        for from_camera in (False, True)
    )
    return replace(
        found,
        ground_error_m=_changed(before.ground_error_m, within),
        ground_error_from_camera_m=_changed(before.ground_error_from_camera_m, whole),
    )


def _median_m(found: Calibration, uv: np.ndarray, from_camera: bool) -> float:
    """Median error over pixels."""
    over = None if from_camera else uv
    covariance, seen = found.ground_covariance(uv, from_camera=from_camera, aligned_over_uv=over)
    return float(np.median(np.sqrt(np.trace(covariance[seen], axis1=1, axis2=2))))


def _changed(errors: dict[str, float] | None, share: float) -> dict[str, float] | None:
    """Errors (m) times a share; how far away they hold stays."""
    if errors is None:
        return None
    return {name: m if name == "out_to_m" else m * share for name, m in errors.items()}
