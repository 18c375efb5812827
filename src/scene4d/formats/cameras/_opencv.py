"""OpenCV FileStorage, YAML and XML: what OpenCV's calibration samples and tools write.

Fields: ``camera_matrix`` 3x3, ``distortion_coefficients`` (4, 5, or more where the rest is 0; the
four of ``cv2.fisheye`` where ``fisheye_model`` is 1), ``image_width``, ``image_height``; the pose
``cam_from_world`` in metres as ``extrinsic_matrix`` (3x4 or 4x4) or as a rotation (``R``,
``rotation_matrix`` 3x3, or ``rvec``) with a translation (``T``, ``t``, ``tvec``). Without a pose
the file is a lens. ``extrinsic_parameters``, which OpenCV's sample writes, are the poses of a
chessboard and are not read. Pixel centres lie at integers, as here.
"""

from collections.abc import Mapping
from functools import partial
from pathlib import Path
from typing import Any
from xml.etree.ElementTree import Element

import numpy as np

from scene4d.core import geometry
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.text import parse_xml, read_text
from scene4d.formats.cameras import _fields as fields
from scene4d.formats.cameras._contract import CameraFormat, ImageSize
from scene4d.formats.cameras._pinhole import lens_of, size_for

_MATRIX = ("camera_matrix", "Camera_Matrix", "cameraMatrix", "K")
_DISTORTION = (
    "distortion_coefficients", "Distortion_Coefficients", "dist_coeffs", "distCoeffs", "D",
)  # fmt: skip
_ROTATION = ("R", "rotation_matrix", "rvec", "rotation_vector")
_TRANSLATION = ("T", "t", "tvec", "translation_vector")


def _rotation(name: str, value: Any) -> np.ndarray:
    data = fields.numbers(name, value)
    if len(data) == 9:
        return data.reshape(3, 3)
    if len(data) != 3:
        raise InputError(f"field {name!r}: expected 3x3 or 3 numbers, found {len(data)}")
    angle = float(np.linalg.norm(data))
    axis = data / angle if angle else data
    return geometry.rotation_from_quaternion(np.append(np.sin(angle / 2) * axis, np.cos(angle / 2)))


def _pose(values: Mapping[str, Any]) -> tuple[np.ndarray, np.ndarray] | None:
    whole = fields.find(values, "extrinsic_matrix")
    if whole:
        data = fields.numbers(*whole)
        if len(data) not in (12, 16):
            raise InputError(f"field {whole[0]!r}: expected 3x4 or 4x4, found {len(data)} numbers")
        return data[:12].reshape(3, 4)[:, :3], data[:12].reshape(3, 4)[:, 3]
    rotation, translation = fields.find(values, *_ROTATION), fields.find(values, *_TRANSLATION)
    if rotation is None and translation is None:
        return None
    if rotation is None or translation is None:
        (name, _), *_ = filter(None, (rotation, translation))
        raise InputError(
            f"field {name!r} is there without its partner: a pose needs a rotation "
            f"({', '.join(_ROTATION)}) and a translation ({', '.join(_TRANSLATION)})"
        )
    return _rotation(*rotation), fields.matrix(*translation, 1, 3)[0]


def _camera(values: Mapping[str, Any], image_size: ImageSize | None) -> Camera | Lens:
    K = fields.intrinsic_matrix(*fields.require(values, *_MATRIX))
    fisheye = fields.find(values, "fisheye_model")
    found = fields.find(values, *_DISTORTION)
    lens = lens_of(
        fields.image_size(values) or size_for(K, image_size),
        K,
        fields.numbers(*found) if found else np.zeros(4),
        fisheye=fisheye is not None and fisheye[1] not in (0, "0"),
    )
    pose = _pose(values)
    return lens if pose is None else lens.posed(*pose)


def _sniff_yaml(path: Path, head: str) -> bool:
    if head.lstrip().startswith("<"):
        return False
    own = head.startswith("%YAML:1.0") or "opencv-matrix" in head
    return own or ("camera_matrix:" in head and "distortion_model:" not in head)


def _read_yaml(path: Path, image_size: ImageSize | None) -> Camera | Lens:
    return _camera(fields.yaml_fields(read_text(path)), image_size)


def _sniff_xml(path: Path, head: str) -> bool:
    return "<opencv_storage" in head


def _xml_value(element: Element) -> object:
    tokens = (element.text or "").split()
    if element.get("type_id") == "opencv-matrix":
        data = (element.findtext("data") or "").split()
        shape = [
            int(x) if (x := element.findtext(k) or "").isdecimal() else 0 for k in ("rows", "cols")
        ]
        return {"rows": shape[0], "cols": shape[1], "data": list(data)}
    return tokens if len(tokens) > 1 else "".join(tokens) or None


def _read_xml(path: Path, image_size: ImageSize | None) -> Camera | Lens:
    root = parse_xml(read_text(path))
    return _camera({child.tag: _xml_value(child) for child in root}, image_size)


def _written(camera: Camera, form: str) -> str:
    import cv2  # slow to load, and reading does without

    mode = cv2.FILE_STORAGE_WRITE | cv2.FILE_STORAGE_MEMORY
    storage = cv2.FileStorage("", mode | getattr(cv2, f"FILE_STORAGE_FORMAT_{form}"))
    storage.writeComment("R, T: cam_from_world, metres, world Z up")
    storage.write("image_width", camera.image_size[0])
    storage.write("image_height", camera.image_size[1])
    storage.write("camera_matrix", camera.K)
    storage.write("fisheye_model", int(camera.is_fisheye))
    storage.write("distortion_coefficients", camera.distortion[:, None])
    storage.write("R", camera.R)
    storage.write("T", camera.t[:, None])
    return str(storage.releaseAndGetString())


YAML, XML = (
    CameraFormat(
        f"opencv-{form.lower()}",
        f"OpenCV FileStorage, {form}",
        sniff,
        read,
        partial(_written, form=form),
        fisheye=True,
    )
    for form, sniff, read in (("YAML", _sniff_yaml, _read_yaml), ("XML", _sniff_xml, _read_xml))
)
