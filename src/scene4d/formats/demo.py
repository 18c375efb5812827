"""The people of the sample video as a table that comes with the package.

They are scene4d's own detections on PETS 2009 S2.L1 View_001, written by
``examples/make_demo_table.py``: numbers only, none of the footage.
"""

from importlib.resources import as_file, files

import numpy as np

from scene4d.core.body import HEAD_TOP, LEFT_FOOT, RIGHT_FOOT
from scene4d.core.people import Detections
from scene4d.core.tables import read_table

IMAGE_SIZE = (768, 576)
FILE_NAME = "demo_people.parquet"
_KEYPOINTS = (
    HEAD_TOP,
    *("left_shoulder", "right_shoulder", "left_hip", "right_hip"),
    *LEFT_FOOT,
    *RIGHT_FOOT,
)
"""Those of Halpe's keypoints that an upright segment is made from."""


def demo_columns(detections: Detections) -> dict[str, np.ndarray]:
    """The table's columns: float32, pixels to 0.1, scores to 0.001, frames and tracks int32."""
    at = [detections.keypoint_names.index(name) for name in _KEYPOINTS]
    columns: dict[str, np.ndarray] = {
        "frame": detections.frame.astype(np.int32),
        "time_s": detections.time_s.astype(np.float32),
        "track": detections.track.astype(np.int32),
        "score": detections.score.round(3).astype(np.float32),
    }
    for i, name in enumerate(("x1", "y1", "x2", "y2")):
        columns[name] = detections.box_xyxy[:, i].round(1).astype(np.float32)
    for i, name in zip(at, _KEYPOINTS, strict=True):
        for j, axis in enumerate("uv"):
            values = detections.keypoint_uv[:, i, j].round(1)
            columns[f"{name}_{axis}"] = values.astype(np.float32)
        columns[f"{name}_score"] = detections.keypoint_score[:, i].round(3).astype(np.float32)
    return columns


def demo_detections() -> Detections:
    """The embedded table."""
    with as_file(files("scene4d.formats") / "data" / FILE_NAME) as path:
        table = read_table(path)
    uv = [[table[f"{name}_{axis}"] for axis in "uv"] for name in _KEYPOINTS]
    score = [table[f"{name}_score"] for name in _KEYPOINTS]
    return Detections.from_boxes(
        IMAGE_SIZE,
        table["frame"],
        np.column_stack([table[name] for name in ("x1", "y1", "x2", "y2")]),
        time_s=table["time_s"],
        score=table["score"],
        track=table["track"],
        keypoint_uv=np.transpose(np.array(uv), (2, 0, 1)),
        keypoint_score=np.array(score).T,
        keypoint_names=_KEYPOINTS,
    )
