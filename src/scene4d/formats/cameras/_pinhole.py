"""From matrices to cameras: decomposition of P, image sizes, and what distortion can be held."""

from collections.abc import Sequence

import numpy as np
from jaxtyping import Float

from scene4d.core import geometry
from scene4d.core.camera import Camera, Lens
from scene4d.core.errors import InputError
from scene4d.formats.cameras._contract import ImageSize

_MIN_SIZE, _MAX_ASPECT = 16, 4.0
"""Pixels and ratio of the sides of a plausible image; chosen generously: a thumbnail, and four
pictures side by side."""
_CENTRAL = 0.25
"""A principal point in the outer quarter of the image belongs to another image size; chosen so
that halves and doubles are told, and lenses off the middle are not."""


def five_coefficients(values: Float[np.ndarray, "n"]) -> Float[np.ndarray, "5"]:
    """OpenCV's distortion vector as (k1, k2, p1, p2, k3).

    Shorter ones are padded with zeros, longer ones (rational, thin prism, tilted sensor) are
    accepted only where the rest is zero; otherwise :class:`InputError` names the model.
    """
    if np.any(values[5:]):
        model = {8: "rational", 12: "thin prism", 14: "tilted sensor"}.get(len(values), "unknown")
        raise InputError(
            f"distortion: {len(values)} coefficients of the {model} model, of which those after "
            "k3 are not zero; scene4d holds k1 k2 p1 p2 k3: calibrate the lens with that model"
        )
    out = np.zeros(5)
    out[: min(5, len(values))] = values[:5]
    return out


def fisheye_coefficients(values: Float[np.ndarray, "n"]) -> Float[np.ndarray, "4"]:
    """OpenCV's fisheye distortion vector (k1, k2, k3, k4), padded with zeros; raises
    :class:`InputError` for a longer one.
    """
    if np.any(values[4:]):
        raise InputError(
            f"distortion: a fisheye lens has the four coefficients k1 k2 k3 k4, found {len(values)}"
        )
    out = np.zeros(4)
    out[: min(4, len(values))] = values[:4]
    return out


def lens_of(
    size: ImageSize, K: Float[np.ndarray, "3 3"], values: Float[np.ndarray, "n"], *, fisheye: bool
) -> Lens:
    """The lens with OpenCV's coefficients of one of its two models."""
    if fisheye:
        return Lens(size, K, fisheye_coefficients(values), distortion_model="fisheye")
    return Lens(size, K, five_coefficients(values))


def rotation_of_quaternion(xyzw: Sequence[float], where: str) -> Float[np.ndarray, "3 3"]:
    """The rotation of a quaternion of any length but 0, for which :class:`InputError` is raised."""
    if not np.any(xyzw):
        raise InputError(f"{where}: the quaternion is zero")
    return geometry.rotation_from_quaternion(np.asarray(xyzw, float))


def size_for(K: Float[np.ndarray, "3 3"], image_size: ImageSize | None) -> ImageSize:
    """The image size for a file that carries none: as given, or twice the principal point.

    With pixel centres at integers the centre of w pixels is ``(w - 1) / 2``; an odd result means
    that the file counts the centre as ``w / 2``, since frames have even sizes. Raises
    :class:`InputError` where the principal point is near no image centre, or where it does not
    belong to the size that was given.
    """
    cx, cy = float(K[0, 2]), float(K[1, 2])
    if image_size is not None:
        fractions = np.array([(cx + 0.5) / image_size[0], (cy + 0.5) / image_size[1]])
        if np.any(np.abs(fractions - 0.5) > 0.5 - _CENTRAL):
            raise InputError(
                f"the principal point ({cx:.6g}, {cy:.6g}) is far from the centre of "
                f"{image_size[0]}x{image_size[1]} images: the file was made for another image "
                "size; give the size it was made for"
            )
        return image_size
    width, height = (2 * (round(2 * c + 1) // 2) for c in (cx, cy))
    if min(width, height) < _MIN_SIZE or not 1 / _MAX_ASPECT <= width / height <= _MAX_ASPECT:
        raise InputError(
            f"the file carries no image size, and its principal point ({cx:.6g}, {cy:.6g}) is "
            "not the centre of a plausible image; give image_size"
        )
    return width, height


def decompose(
    P: Float[np.ndarray, "3 4"],
) -> tuple[Float[np.ndarray, "3 3"], Float[np.ndarray, "3 3"], Float[np.ndarray, "3"]]:
    """``K, R, t`` with ``P ∝ K [R | t]``, K[2, 2] = 1 and positive focal lengths.

    RQ decomposition (Hartley and Zisserman 2004, section 6.2.4). P is known up to a factor; its
    sign is the one that makes R a rotation, and the third row then is the depth. Raises
    :class:`InputError` for a matrix that is no perspective camera, and for a left-handed world.
    """
    rows = np.linalg.norm(P[:, :3], axis=1)
    degenerate = not np.isfinite(P).all() or not rows.all()
    if degenerate or abs(np.linalg.det(P[:, :3] / rows[:, None])) < 1e-9:
        raise InputError("the 3x4 matrix is no perspective camera: its left 3x3 part is singular")
    if np.linalg.det(P[:, :3] / rows[:, None]) < 0:
        P = -P
    q, r = np.linalg.qr(P[::-1, :3].T)
    K, R = r.T[::-1, ::-1], q.T[::-1]
    sign = np.sign(np.diag(K))
    K, R = K * sign, sign[:, None] * R
    t = np.linalg.solve(K, P[:, 3])
    _require_z_up(R, t)
    return K / K[2, 2], R, t


def _require_z_up(R: Float[np.ndarray, "3 3"], t: Float[np.ndarray, "3"]) -> None:
    """Refuse a world that is left-handed, which a bare P can hide.

    P is known up to its sign, and R is made a rotation; for a left-handed world that puts the
    scene behind the camera: it stands above the ground, upside down, and looks at the sky.
    """
    tilt, _ = geometry.tilt_roll_from_rotation(R)
    if geometry.camera_centre(R, t)[2] > 0 and tilt < 0 and R[1, 2] > 0:
        raise InputError(
            "the projection matrix is of a left-handed world (or its Z axis is not up); scene4d's "
            "is right-handed with Z up: negate the first number of each row, and the X of "
            "every world point with it"
        )


def camera_from_projection(P: Float[np.ndarray, "3 4"], image_size: ImageSize | None) -> Camera:
    """The camera of a bare projection matrix into pixels, without distortion."""
    K, R, t = decompose(P)
    return Camera(image_size=size_for(K, image_size), K=K, R=R, t=t)
