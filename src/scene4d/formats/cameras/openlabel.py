"""ASAM OpenLABEL JSON with one camera, as TUMTraf's labels have it; read only.

``streams.NAME.stream_properties.intrinsics_pinhole`` is the lens: ``camera_matrix`` (3x4, its left
3x3 part is K), ``distortion_coeffs`` in OpenCV's order, ``width_px``, ``height_px``; version 4 of
its predecessor VCD, and TUMTraf, call them ``camera_matrix_3x4`` and ``distortion_coeffs_1xN``.
``coordinate_systems.NAME.pose_wrt_parent`` is the pose, a ``matrix4x4`` or a ``quaternion``
(x, y, z, w) with a ``translation``; those of its parents lead on to the root, whose ground must be
Z = 0, in metres with Z up. Without a pose the file is a lens.

The standard's pose maps points of the system into its parent's. TUMTraf writes the cameras' the
other way round (and the lidars' as the standard says). Both ways give the same tilt, but the wrong
one usually a camera that is rolled, or below the ground, so the other way is taken where it gives
the clearly more upright camera.
"""

import warnings
from collections.abc import Mapping
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.text import quoted
from scene4d.formats.cameras import fields
from scene4d.formats.cameras.contract import CameraFormat, ImageSize
from scene4d.formats.cameras.pinhole import five_coefficients, rotation_of_quaternion, size_for

_CLEARLY_RAD = np.radians(10)
"""Cameras hang upright within a few degrees; a wrong reading rolls by the difference of headings,
so that ten degrees leave one heading in eighteen open."""
_MOST_PARENTS = 100
_ROOTS = ("openlabel", "vcd")


def _sniff(path: Path, head: str) -> bool:
    return head.lstrip().startswith("{") and any(f'"{root}"' in head for root in _ROOTS)


def _read(path: Path, image_size: ImageSize | None) -> Camera | Lens:
    document = _object(read_json(path), "the file")
    _, root = fields.require(document, *_ROOTS)
    root = _object(root, "field 'openlabel'")
    name, pinhole = _pinhole(_object(root.get("streams", {}), "field 'streams'"))
    matrix, K = fields.require(pinhole, "camera_matrix", "camera_matrix_3x4")
    K = fields.numbers(matrix, K)
    if len(K) not in (9, 12):
        raise InputError(f"field {matrix!r}: expected 3x4 or 3x3 numbers, found {len(K)}")
    K = K.reshape(3, -1)[:, :3]
    found = fields.find(pinhole, "distortion_coeffs", "distortion_coeffs_1xN")
    distortion = five_coefficients(fields.numbers(*found)) if found else np.zeros(5)
    lens = Lens(fields.image_size(pinhole) or size_for(K, image_size), K, distortion)
    systems = _object(root.get("coordinate_systems", {}), "field 'coordinate_systems'")
    return _posed(lens, name, systems) if name in systems else lens


def _object(value: Any, where: str) -> Mapping[str, Any]:
    if not isinstance(value, Mapping):
        raise InputError(f"{where}: expected an object of named fields, found {quoted(value)}")
    return value


def _pinhole(streams: Mapping[str, Any]) -> tuple[str, Mapping[str, Any]]:
    """The only stream that is a pinhole camera, and its intrinsics."""
    cameras = {}
    for name, stream in streams.items():
        where = f"stream {quoted(name)}"
        properties = _object(_object(stream, where).get("stream_properties") or {}, where)
        if "intrinsics_pinhole" in properties:
            cameras[name] = _object(properties["intrinsics_pinhole"], where)
    if len(cameras) != 1:
        found = quoted(", ".join(cameras)) if cameras else "none"
        raise InputError(
            f"field 'streams': expected one camera with 'intrinsics_pinhole', found {found}"
            + ("; keep that of one" if cameras else "")
        )
    return next(iter(cameras.items()))


def _posed(lens: Lens, name: str, systems: Mapping[str, Any]) -> Camera | Lens:
    system = _object(systems[name], f"coordinate system {quoted(name)}")
    if not system.get("pose_wrt_parent"):
        return lens
    own = _pose(system, name)
    world_from_parent = _world_from(system.get("parent"), systems)
    standard, other = (
        _camera(lens, np.linalg.inv(world_from_parent @ pose)) for pose in (own, np.linalg.inv(own))
    )
    better_rad = _slant_rad(standard) - _slant_rad(other)
    if better_rad > _CLEARLY_RAD:
        return other
    if better_rad > -_CLEARLY_RAD:
        warnings.warn(
            f"coordinate system {quoted(name)}: its pose may be meant either way; as the standard "
            f"has it the camera is {standard.height_m:.1f} m high, the other way "
            f"{other.height_m:.1f} m",
            stacklevel=2,
        )
    return standard


def _camera(lens: Lens, cam_from_world: np.ndarray) -> Camera:
    R, t = cam_from_world[:3, :3], cam_from_world[:3, 3]
    return Camera(lens.image_size, lens.K, lens.distortion, R, t)


def _slant_rad(camera: Camera) -> float:
    """How far from upright; most for a camera below the ground."""
    return abs(camera.roll_rad) if camera.height_m > 0 else np.pi


def _world_from(name: Any, systems: Mapping[str, Any]) -> np.ndarray:
    """world_from_system, along the parents."""
    world = np.eye(4)
    for _ in range(_MOST_PARENTS):
        if not name:
            return world
        if not isinstance(name, str) or name not in systems:
            raise InputError(f"coordinate system {quoted(name)} is missing")
        system = _object(systems[name], f"coordinate system {quoted(name)}")
        if system.get("pose_wrt_parent"):
            world = _pose(system, name) @ world
        name = system.get("parent")
    raise InputError("field 'coordinate_systems': the parents go in a circle")


def _pose(system: Mapping[str, Any], name: str) -> np.ndarray:
    where = f"coordinate system {quoted(name)}"
    pose = system["pose_wrt_parent"]
    pose = _object({"matrix4x4": pose} if isinstance(pose, list) else pose, where)
    found = fields.find(pose, "matrix4x4")
    matrix = np.eye(4)
    if found:
        matrix[:3] = fields.matrix(*found, 4, 4)[:3]
        matrix[:3, :3] = _rotation(matrix[:3, :3], where)
        return matrix
    if "euler_angles" in pose:
        raise InputError(f"{where}: Euler angles are not read; give a matrix4x4 or a quaternion")
    xyzw = fields.matrix(*fields.require(pose, "quaternion"), 1, 4)[0]
    matrix[:3, :3] = rotation_of_quaternion(xyzw.tolist(), where)
    matrix[:3, 3] = fields.matrix(*fields.require(pose, "translation"), 1, 3)[0]
    return matrix


def _rotation(R: np.ndarray, where: str) -> np.ndarray:
    """The rotation nearest to a matrix of few decimals, as files have them."""
    U, singular, Vt = np.linalg.svd(R)
    if np.abs(singular - 1).max() > 1e-2 or np.linalg.det(R) < 0:
        raise InputError(f"{where}: 'matrix4x4' holds no rotation (orthonormal, determinant +1)")
    return U @ Vt


FORMAT = CameraFormat("openlabel", "ASAM OpenLABEL JSON with one camera (read only)", _sniff, _read)
