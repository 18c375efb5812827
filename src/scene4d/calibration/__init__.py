"""The camera from the people who walk through its footage."""

from scene4d.calibration._segments import person_segments
from scene4d.calibration._solve import solve_camera, solve_segments
from scene4d.calibration.options import METHODS, CalibrateOptions

__all__ = [
    "METHODS",
    "CalibrateOptions",
    "person_segments",
    "solve_camera",
    "solve_segments",
]
