"""What is exported, and what a scene format is."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime

from scene4d.core.camera import Camera
from scene4d.core.tracks import Tracks
from scene4d.formats._choosing import Format
from scene4d.formats.scenes._geo import GeoAnchor


@dataclass(frozen=True, eq=False)
class SceneTable:
    """The tracks of one camera, or a piece of them, with what an export says about them.

    ``start_utc`` is the moment at which ``tracks.time_s`` is 0, with its time zone; None where
    nobody knows it. ``image_size`` is (width, height) of the footage, ``keypoint_names`` has one
    name for each keypoint of the tracks, ``geo`` says where the scene lies on the Earth, and
    ``calibrated`` is the camera itself, on the ground of the tracks.
    """

    tracks: Tracks
    camera: str
    image_size: tuple[int, int]
    start_utc: datetime | None = None
    keypoint_names: tuple[str, ...] = ()
    geo: GeoAnchor | None = None
    calibrated: Camera | None = None


@dataclass(frozen=True)
class SceneFormat(Format):
    """One scene format; an instance of it in the registry is all that a format needs.

    ``write(pieces)`` turns one or more pieces, none of them empty, into the contents of the files:
    it yields (which of ``suffixes``, bytes that follow in that file). A format of one file has the
    suffix of that file and takes the path as it is; one of several adds each suffix to the path.
    It opens nothing: the registry writes. Raises :class:`~scene4d.core.errors.InputError` for
    what the format cannot hold.
    """

    suffixes: tuple[str, ...]
    write: Callable[[Iterator[SceneTable]], Iterator[tuple[str, bytes]]]
