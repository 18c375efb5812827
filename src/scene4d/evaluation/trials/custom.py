"""Any calibration against any reference."""

from dataclasses import replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scene4d.calibration.writing import BACKGROUND
from scene4d.core.errors import InputError
from scene4d.evaluation import Evaluation, Outcome, Reference, Setting
from scene4d.formats.cameras import read_calibration
from scene4d.formats.homographies import read_reference
from scene4d.formats.points import read_points
from scene4d.tracking.watching import calibrated_view

_GRID = (48, 32)
"""Columns and rows of pixels that serve as points where none are given."""
_COARSEST_M = 0.25
"""Ground that one pixel of the grid may cover: farther out, no map is meant to be read."""
_FEWEST = 3
_MOST = 12


def evaluate_custom(
    camera: str | Path,
    reference: str | Path,
    *,
    points: str | Path | None = None,
    image_size: tuple[int, int] | None = None,
) -> Evaluation:
    """Score a calibration of any camera format against a camera or a ground homography.

    ``points`` is a file of ground points in pixels (:func:`.read_points`); without it a grid of
    pixels serves, as far as one pixel covers at most :data:`_COARSEST_M` of true ground. Both are
    taken for the same footage, as decoded. Raises :class:`InputError` for files that cannot be
    read, and where fewer than :data:`_FEWEST` points lie on the ground.
    """
    found = read_calibration(camera, image_size=image_size)
    truth = read_reference(reference, image_size=found.image_size)
    bare = Reference(Path(reference).name, truth, np.empty((0, 2)))
    if points is None:
        of = f"a grid of pixels that cover {_COARSEST_M:g} m of ground at most"
        uv = _grid(bare)
    else:
        of, uv = Path(points).name, read_points(points, image_size=found.image_size)
    known = replace(bare, feet_uv=uv)
    count = len(known.walked_uv)
    if count < _FEWEST:
        raise InputError(
            f"{reference}: only {count} of {len(uv)} points lie on its ground and in the picture, "
            f"and {_FEWEST} are needed: give --points FILE with pixels on the ground"
        )
    known = replace(known, n_points=min(_MOST, count))
    setting = Setting(Path(camera).name, found.method, given="")
    outcome = Outcome.scored(setting, found, known)
    note = f"The points are {known.n_points} spread over {of}."
    beside = Path(camera).with_name(BACKGROUND)
    image = calibrated_view(beside, found.image_size)
    return Evaluation("custom", known, (outcome,), image_bgr=image, notes=(note,))


def _grid(reference: Reference) -> Float[np.ndarray, "n 2"]:
    """Pixels of a regular grid at which the reference's ground is seen in useful detail."""
    width, height = reference.image_size
    columns, rows = _GRID
    u = (np.arange(columns) + 0.5) * width / columns - 0.5
    v = (np.arange(rows) + 0.5) * height / rows - 0.5
    uv = np.stack(np.meshgrid(u, v), axis=-1).reshape(-1, 2)
    here, ok = reference.locate(uv)
    below, ok_below = reference.locate(uv + np.array([0.0, 1.0]))
    fine = np.hypot(*(below - here).T) <= _COARSEST_M
    return uv[ok & ok_below & fine]
