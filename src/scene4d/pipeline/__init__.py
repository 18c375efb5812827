"""The one place that puts stages together: from footage to a calibration and its files."""

from scene4d.pipeline.calibrating import calibrate, run, run_detections
from scene4d.pipeline.options import Options, Run
from scene4d.pipeline.progress import Advance, Progress, Silent
from scene4d.pipeline.staging import ensure_folder
from scene4d.pipeline.watching import fetch_weights, person_px
from scene4d.pipeline.writing import people_table, write

__all__ = [
    "Advance",
    "Options",
    "Progress",
    "Run",
    "Silent",
    "calibrate",
    "ensure_folder",
    "fetch_weights",
    "people_table",
    "person_px",
    "run",
    "run_detections",
    "write",
]
