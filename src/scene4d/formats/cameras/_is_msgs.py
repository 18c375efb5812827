"""``CameraCalibration`` messages of the Intelligent Space middleware (is-msgs) as JSON; read only.

``intrinsic`` (3x3), ``distortion`` (OpenCV's order) and ``extrinsic[0].tf`` (4x4) are tensors:
``shape.dims`` with sizes, and ``doubles`` row by row. The transformation maps points of the space's
frame ``from``, in metres with Z up and the floor at Z = 0, into the camera's. ``resolution`` is the
image size. Without an ``extrinsic`` the file is a lens.
"""

from pathlib import Path

import numpy as np

from scene4d.core.camera import Camera, Lens
from scene4d.core.json_object import JsonObject
from scene4d.formats.cameras._contract import CameraFormat, ImageSize
from scene4d.formats.cameras._pinhole import five_coefficients


def _sniff(path: Path, head: str) -> bool:
    return head.lstrip().startswith("{") and '"intrinsic"' in head and '"doubles"' in head


def _read(path: Path, image_size: ImageSize | None) -> Camera | Lens:
    said = JsonObject.read(path)
    size = said.object("resolution")
    resolution = size.integer("width", least=1), size.integer("height", least=1)
    distortion = np.zeros(5)
    if "distortion" in said:
        distortion = five_coefficients(_tensor(said.object("distortion")).ravel())
    lens = Lens(resolution, _tensor(said.object("intrinsic"), 3, 3), distortion)
    if "extrinsic" not in said or not said.value("extrinsic"):
        return lens
    cam_from_world = _tensor(said.objects("extrinsic")[0].object("tf"), 4, 4)
    return lens.posed(cam_from_world[:3, :3], cam_from_world[:3, 3])


def _tensor(said: JsonObject, *shape: int) -> np.ndarray:
    """The numbers of a tensor; of this shape if one is given."""
    sizes = [one.integer("size", least=1) for one in said.object("shape").objects("dims")]
    numbers = said.array("doubles", None)
    if len(numbers) != np.prod(sizes, initial=1) or (shape and tuple(sizes) != shape):
        wanted = "x".join(map(str, shape or sizes))
        raise said.error("doubles", f"the numbers of a {wanted} tensor, as its shape says")
    return numbers.reshape(sizes)


FORMAT = CameraFormat("is-msgs", "is-msgs CameraCalibration JSON (read only)", _sniff, _read)
