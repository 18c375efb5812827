"""Rows of tracks from what a test is about; the rest is plain or unknown."""

import numpy as np

from scene4d.core.tracks import Tracks

_MATRIX = ("covariance_m2", "shared_covariance_m2", "velocity_covariance")
_SHAPES = dict.fromkeys(_MATRIX, (2, 2)) | {
    "velocity_mps": (2,), "box_xyxy": (4,), "keypoint_uv": (0, 2), "keypoint_score": (0,),
    "size_m": (3,), "size_sigma_m": (3,),
}  # fmt: skip


def made_tracks(track, time_s, xy_m, **columns) -> Tracks:
    """Rows at these times (n,) and positions (n, 2): people seen surely, without a box, known to
    a decimetre, of unknown velocity.

    ``track`` and the columns hold one value for all rows or one for each; one number as a
    covariance is the variance along both axes. A heading that is not given follows the velocity.
    """
    n = len(xy_m)
    values = {
        "track": track, "time_s": time_s, "xy_m": xy_m, "class_name": "person",
        "frame": np.arange(n), "covariance_m2": 0.01, "shared_covariance_m2": 0.0,
        "velocity_mps": np.nan, "velocity_covariance": 0.01, "heading_sigma_rad": np.nan,
        "box_xyxy": np.nan, "keypoint_uv": 0.0, "keypoint_score": 0.0, "score": 1.0,
        "observed": True,
    } | columns  # fmt: skip
    if "heading_rad" not in values:
        way = np.broadcast_to(values["velocity_mps"], (n, 2))
        values["heading_rad"] = np.arctan2(way[:, 1], way[:, 0])
    for name, value in values.items():
        shape = _SHAPES.get(name, ())
        column = np.asarray(value * np.eye(2) if name in _MATRIX and np.ndim(value) == 0 else value)
        whole = column.ndim > len(shape)
        values[name] = column if whole else np.broadcast_to(column, (n, *shape)).copy()
    return Tracks(**values)
