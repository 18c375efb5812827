"""Immutable values that the stages exchange."""

from scene4d.model.calibration import GIVEN, PARAMETERS, Calibration
from scene4d.model.camera import SCHEMA, Camera, Lens
from scene4d.model.files import read_json, write_bytes, write_json
from scene4d.model.ground_map import GroundMap
from scene4d.model.orientation import Orientation
from scene4d.model.people import COCO17, HALPE26, PERSON_HEIGHT_M, Detections, Segments
from scene4d.model.tracks import CLASSES, VEHICLES, Located, Tracks

__all__ = [
    "CLASSES",
    "COCO17",
    "GIVEN",
    "HALPE26",
    "PARAMETERS",
    "PERSON_HEIGHT_M",
    "SCHEMA",
    "VEHICLES",
    "Calibration",
    "Camera",
    "Detections",
    "GroundMap",
    "Lens",
    "Located",
    "Orientation",
    "Segments",
    "Tracks",
    "read_json",
    "write_bytes",
    "write_json",
]
