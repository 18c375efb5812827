"""The cameras of a site refined together: what each errs by, told by what the others saw.

The site's estimate has the errors of every camera among its unknowns, with the camera's own
covariance as their prior (:mod:`_graph`). Most probable errors are taken off the camera, and their
covariance is that of the new one. One linear step: errors are some standard deviations, within
which the ground moves in proportion (tests/alignment/test_joint.py compares with true cameras).
"""

from collections.abc import Sequence
from dataclasses import dataclass, replace

import numpy as np

from scene4d.alignment._factor import POSE
from scene4d.alignment._graph import Solution
from scene4d.alignment._paths import View, covariance_root
from scene4d.core.calibration import PARAMETERS, Calibration
from scene4d.core.placement import Placement

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
        camera=before.camera.disturbed(-root @ errors),
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
    return Placement.from_parameters(parameters, found.covariance)


def _summed_up(found: Calibration, view: View) -> Calibration:
    """With what its covariance means on the ground where people walked."""
    rows = np.linspace(0, len(view) - 1, min(_SAMPLE, len(view))).astype(int)
    uv, valid = view.calibration.ground_pixels(view.xy_m[rows])
    uv = uv[valid]
    return replace(
        found,
        ground_error_m=_over(found, uv, from_camera=False),
        ground_error_from_camera_m=_over(found, uv, from_camera=True),
    )


def _over(found: Calibration, uv: np.ndarray, *, from_camera: bool) -> dict[str, float]:
    """Median and 90th percentile (m) of an error over pixels."""
    covariance, seen = found.ground_covariance(
        uv, from_camera=from_camera, aligned_over_uv=None if from_camera else uv
    )
    spread = np.sqrt(np.trace(covariance[seen], axis1=1, axis2=2))
    median, p90 = np.quantile(spread, [0.5, 0.9]).tolist()
    return {"median": median, "p90": p90}
