"""Immutable values that the stages exchange."""

from scene4d.model.calibration import PARAMETERS, Calibration
from scene4d.model.camera import SCHEMA, Camera, Lens
from scene4d.model.files import read_json, write_bytes, write_json
from scene4d.model.ground_map import GroundMap
from scene4d.model.orientation import Orientation
from scene4d.model.people import COCO17, HALPE26, PERSON_HEIGHT_M, Detections, Segments

__all__ = [
    "COCO17",
    "HALPE26",
    "PARAMETERS",
    "PERSON_HEIGHT_M",
    "SCHEMA",
    "Calibration",
    "Camera",
    "Detections",
    "GroundMap",
    "Lens",
    "Orientation",
    "Segments",
    "read_json",
    "write_bytes",
    "write_json",
]
