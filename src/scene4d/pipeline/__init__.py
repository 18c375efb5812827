"""The one place that puts stages together: from footage to a calibration and its files."""

from scene4d.pipeline.calibrating import calibrate, run, run_detections
from scene4d.pipeline.options import Options, Run
from scene4d.pipeline.orienting import OrientationReading, read_orientation
from scene4d.pipeline.progress import Advance, Progress, Silent
from scene4d.pipeline.staging import ensure_folder
from scene4d.pipeline.watching import fetch_weights, person_px
from scene4d.pipeline.writing import people_table, write, write_orientation

__all__ = [
    "Advance",
    "Options",
    "OrientationReading",
    "Progress",
    "Run",
    "Silent",
    "calibrate",
    "ensure_folder",
    "fetch_weights",
    "people_table",
    "person_px",
    "read_orientation",
    "run",
    "run_detections",
    "write",
    "write_orientation",
]
