"""The camera from the people who walk through its footage."""

from scene4d.calibration.case import METHODS, check_asked
from scene4d.calibration.contradiction import disagreements
from scene4d.calibration.prior import default_prior
from scene4d.calibration.segments import missing_keypoints, person_segments
from scene4d.calibration.solve import solve_camera, solve_segments

__all__ = [
    "METHODS",
    "check_asked",
    "default_prior",
    "disagreements",
    "missing_keypoints",
    "person_segments",
    "solve_camera",
    "solve_segments",
]
