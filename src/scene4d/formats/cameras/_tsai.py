"""Tsai camera XML, as PETS 2009 gives it; read only.

Lengths in millimetres, angles in radians, ``R = Rz Ry Rx`` is cam_from_world. A pixel on the
sensor is ``dpx / sx`` by ``dpy``, hence fx = sx focal / dpx and fy = focal / dpy. The radial
model runs from distorted to undistorted, opposite to OpenCV's, and is inverted by a fit.
"""

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from scene4d.core import geometry
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.text import floats, parse_xml, read_text
from scene4d.formats.cameras._contract import CameraFormat, ImageSize

_FIELDS = {
    "Geometry": ("width", "height", "dpx", "dpy"),
    "Intrinsic": ("focal", "kappa1", "cx", "cy", "sx"),
    "Extrinsic": ("tx", "ty", "tz", "rx", "ry", "rz"),
}
_POSITIVE = ("width", "height", "dpx", "dpy", "focal", "sx")
_MM = 1e-3


def _sniff(path: Path, head: str) -> bool:
    return "<Intrinsic" in head and "kappa1" in head


def _fields(root: Element) -> dict[str, float]:
    values = {}
    for name, attributes in _FIELDS.items():
        element = root if root.tag == name else root.find(f".//{name}")
        if element is None:
            raise InputError(f"element <{name}> is missing")
        for attribute in attributes:
            text = element.get(attribute)
            if text is None:
                raise InputError(f"element <{name}>: attribute {attribute!r} is missing")
            values[attribute] = float(floats([text], f"element <{name}>, {attribute!r}")[0])
    for attribute in _POSITIVE:
        if values[attribute] <= 0:
            raise InputError(f"attribute {attribute!r} must be positive, found {values[attribute]}")
    return values


def _read(path: Path, image_size: ImageSize | None) -> Camera:
    v = _fields(parse_xml(read_text(path)))
    pixel_mm = np.array([v["dpx"] / v["sx"], v["dpy"]])
    centre, size = np.array([v["cx"], v["cy"]]), np.array([v["width"], v["height"]])
    focal = v["focal"] / pixel_mm
    corner_mm = float(np.linalg.norm(np.maximum(centre, size - centre) * pixel_mm))
    return Camera(
        image_size=(int(v["width"]), int(v["height"])),
        K=np.array([[focal[0], 0.0, centre[0]], [0.0, focal[1], centre[1]], [0.0, 0.0, 1.0]]),
        distortion=geometry.opencv_from_tsai(v["kappa1"], v["focal"], corner_mm),
        R=geometry.rotation_from_euler_zyx(v["rx"], v["ry"], v["rz"]),
        t=_MM * np.array([v["tx"], v["ty"], v["tz"]]),
    )


FORMAT = CameraFormat("tsai", "Tsai camera XML (PETS 2009; read only)", _sniff, _read)
