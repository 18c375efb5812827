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
from pathlib import Path

import numpy as np

from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.core.text import quoted
from scene4d.formats.cameras import _fields as fields
from scene4d.formats.cameras._contract import CameraFormat, ImageSize
from scene4d.formats.cameras._pinhole import five_coefficients, rotation_of_quaternion, size_for

_CLEARLY_RAD = np.radians(10)
"""Cameras hang upright within a few degrees; a wrong reading rolls by the difference of headings,
so that ten degrees leave one heading in eighteen open."""
_ROOTS = ("openlabel", "vcd")


def _sniff(path: Path, head: str) -> bool:
    return head.lstrip().startswith("{") and any(f'"{root}"' in head for root in _ROOTS)


def _read(path: Path, image_size: ImageSize | None) -> Camera | Lens:
    document = JsonObject.read(path)
    root = document.object("vcd" if "vcd" in document else "openlabel")
    name, pinhole = _pinhole(root.object("streams"))
    values = {field: pinhole.value(field) for field in pinhole.names()}
    field, matrix = fields.require(values, "camera_matrix", "camera_matrix_3x4")
    numbers = fields.numbers(field, matrix)
    if len(numbers) not in (9, 12):
        raise pinhole.error(field, "3x4 or 3x3 numbers")
    K = numbers.reshape(3, -1)[:, :3]
    found = fields.find(values, "distortion_coeffs", "distortion_coeffs_1xN")
    distortion = five_coefficients(fields.numbers(*found)) if found else np.zeros(5)
    lens = Lens(fields.image_size(values) or size_for(K, image_size), K, distortion)
    if "coordinate_systems" not in root or name not in root.object("coordinate_systems"):
        return lens
    return _posed(lens, name, root.object("coordinate_systems"))


def _pinhole(streams: JsonObject) -> tuple[str, JsonObject]:
    """The only stream that is a pinhole camera, and its intrinsics."""
    cameras, fisheyes = {}, list[str]()
    for name in streams.names():
        stream = streams.object(name)
        if "stream_properties" in stream:
            properties = stream.object("stream_properties")
            if "intrinsics_pinhole" in properties:
                cameras[name] = properties.object("intrinsics_pinhole")
            elif "intrinsics_fisheye" in properties:
                fisheyes.append(name)
    if len(cameras) != 1:
        found = f"{quoted(', '.join(cameras))}; keep that of one" if cameras else "none"
        if fisheyes:
            found += f" ('intrinsics_fisheye' of {quoted(', '.join(fisheyes))} is not read)"
        raise InputError(
            f"field 'streams': expected one camera with 'intrinsics_pinhole', found {found}"
        )
    return next(iter(cameras.items()))


def _posed(lens: Lens, name: str, systems: JsonObject) -> Camera | Lens:
    own = _pose(systems.object(name))
    if own is None:
        return lens
    world_from_parent = _world_from_parent(name, systems)
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
    return lens.posed(R, t)


def _slant_rad(camera: Camera) -> float:
    """How far from upright; most for a camera below the ground."""
    return abs(camera.roll_rad) if camera.height_m > 0 else np.pi


def _world_from_parent(name: str, systems: JsonObject) -> np.ndarray:
    """From the parent of a system to the root, which has none."""
    world, passed = np.eye(4), {name}
    while systems.object(name).value("parent"):
        name = systems.object(name).text("parent")
        if name in passed:
            raise systems.error(name, "no parent of its own")
        passed.add(name)
        pose = _pose(systems.object(name))
        world = world if pose is None else pose @ world
    return world


def _pose(system: JsonObject) -> np.ndarray | None:
    """parent_from_system as the standard has it; None where the system has none."""
    if not system.value("pose_wrt_parent"):
        return None
    if isinstance(system.value("pose_wrt_parent"), list):  # as VCD 4 has it
        return _rigid(system, "pose_wrt_parent")
    pose = system.object("pose_wrt_parent")
    if "matrix4x4" in pose:
        return _rigid(pose, "matrix4x4")
    if "euler_angles" in pose:
        raise pose.error("euler_angles", "replaced by a matrix4x4 or a quaternion")
    matrix = np.eye(4)
    xyzw = pose.array("quaternion", 4)
    matrix[:3, :3] = rotation_of_quaternion(xyzw.tolist(), "field 'quaternion'")
    matrix[:3, 3] = pose.array("translation", 3)
    return matrix


def _rigid(values: JsonObject, field: str) -> np.ndarray:
    """A 4x4 matrix with the rotation nearest to the one in the file, which has few decimals."""
    matrix = fields.matrix(field, values.value(field), 4, 4)
    U, singular, Vt = np.linalg.svd(matrix[:3, :3])
    if np.abs(singular - 1).max() > 1e-2 or np.linalg.det(matrix[:3, :3]) < 0:
        raise values.error(field, "a rotation (orthonormal, determinant +1) and a shift")
    matrix[:3, :3], matrix[3] = U @ Vt, (0, 0, 0, 1)
    return matrix


FORMAT = CameraFormat("openlabel", "ASAM OpenLABEL JSON with one camera (read only)", _sniff, _read)
