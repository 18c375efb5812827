"""Camera files in and out."""

from scene4d.formats.cameras._contract import CameraFormat
from scene4d.formats.cameras._registry import (
    camera_formats,
    read_calibration,
    read_camera,
    read_lens,
    write_camera,
)

__all__ = [
    "CameraFormat",
    "camera_formats",
    "read_calibration",
    "read_camera",
    "read_lens",
    "write_camera",
]
