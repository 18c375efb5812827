"""Tsai camera XML, as PETS 2009 gives it; read only.

Lengths in millimetres, angles in radians, ``R = Rz Ry Rx`` is cam_from_world. A pixel on the
sensor is ``dpx / sx`` by ``dpy``, hence fx = sx focal / dpx and fy = focal / dpy. The radial
model runs from distorted to undistorted, opposite to OpenCV's, and is turned around by a fit.
"""

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from scene4d.core import geometry
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.text import floats, parse_xml, read_text
from scene4d.formats.cameras.contract import CameraFormat, ImageSize

_FIELDS = {
    "Geometry": ("width", "height", "dpx", "dpy"),
    "Intrinsic": ("focal", "kappa1", "cx", "cy", "sx"),
    "Extrinsic": ("tx", "ty", "tz", "rx", "ry", "rz"),
}
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
    for attribute in ("width", "height", "dpx", "dpy", "focal", "sx"):
        if values[attribute] <= 0:
            raise InputError(f"attribute {attribute!r} must be positive, found {values[attribute]}")
    return values


def _read(path: Path, image_size: ImageSize | None) -> Camera:
    v = _fields(parse_xml(read_text(path)))
    pixel_mm = np.array([v["dpx"] / v["sx"], v["dpy"]])
    far = np.maximum([v["cx"], v["cy"]], [v["width"] - v["cx"], v["height"] - v["cy"]])
    K = np.array(
        [
            [v["focal"] / pixel_mm[0], 0.0, v["cx"]],
            [0.0, v["focal"] / pixel_mm[1], v["cy"]],
            [0.0, 0.0, 1.0],
        ]
    )
    return Camera(
        image_size=(int(v["width"]), int(v["height"])),
        K=K,
        distortion=geometry.opencv_from_tsai(
            v["kappa1"], v["focal"], float(np.linalg.norm(far * pixel_mm))
        ),
        R=geometry.rotation_from_euler_zyx(v["rx"], v["ry"], v["rz"]),
        t=_MM * np.array([v["tx"], v["ty"], v["tz"]]),
    )


FORMAT = CameraFormat(
    name="tsai",
    description="Tsai camera XML (PETS 2009; read only)",
    patterns=("*.xml",),
    sniff=_sniff,
    read=_read,
)
