"""The camera from the people who walk through its footage."""

from scene4d.calibrate.segments import person_segments
from scene4d.calibrate.solve import METHODS, solve_camera, solve_segments

__all__ = ["METHODS", "person_segments", "solve_camera", "solve_segments"]
