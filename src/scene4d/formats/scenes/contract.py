"""What is exported, and what a scene format is."""

from collections.abc import Callable, Iterator
from dataclasses import dataclass
from datetime import datetime

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes.geo import GeoAnchor

_FIRST_YEAR, _LAST_YEAR = 1678, 2261
"""Nanoseconds in 64 bits reach no further."""


@dataclass(frozen=True, eq=False)
class SceneTable:
    """The tracks of one camera, or a piece of them, with what an export says about them.

    ``start_utc`` is the moment at which ``tracks.time_s`` is 0, with its time zone; None where
    nobody knows it. ``image_size`` is (width, height) of the footage, ``geo`` where the scene lies
    on the Earth. Raises :class:`InputError` for values that no format could write.
    """

    tracks: Tracks
    camera: str
    image_size: tuple[int, int]
    start_utc: datetime | None = None
    fps: float | None = None
    keypoint_names: tuple[str, ...] = ()
    geo: GeoAnchor | None = None

    def __post_init__(self) -> None:
        start, fps = self.start_utc, self.fps
        if start is not None and start.tzinfo is None:
            raise InputError(f"scene: start_utc {start} has no time zone; expected UTC")
        if start is not None and not _FIRST_YEAR <= start.year <= _LAST_YEAR:
            raise InputError(f"scene: start_utc must lie in 1678 to 2261, found {start.year}")
        if fps is not None and not (np.isfinite(fps) and fps > 0):
            raise InputError(f"scene: fps must be positive, found {fps}")
        if min(self.image_size) < 1:
            raise InputError(f"scene: image_size must be positive, found {self.image_size}")
        keypoints = self.tracks.keypoint_uv.shape[1]
        if keypoints != len(self.keypoint_names):
            raise InputError(
                f"scene: the tracks hold {keypoints} keypoints, "
                f"keypoint_names {len(self.keypoint_names)}"
            )
        self._check_rows()

    def _check_rows(self) -> None:
        tracks = self.tracks
        rules = (
            ("track", tracks.track >= 0, "0 or more"),
            ("frame", tracks.frame >= 0, "0 or more"),
            ("time_s", np.isfinite(tracks.time_s), "a finite number of seconds"),
        )
        for name, good, expected in rules:
            if not good.all():
                row = int(np.argmin(good))
                found = getattr(tracks, name)[row]
                raise InputError(f"scene: row {row}: {name} must be {expected}, found {found}")


@dataclass(frozen=True)
class SceneFormat:
    """One scene format; an instance of it in the registry is all that a format needs.

    ``write(pieces)`` turns one or more pieces, none of them empty, into the contents of the files:
    it yields (which of ``suffixes``, bytes that follow in that file). A format of one file has the
    suffix of that file and takes the path as it is; one of several adds each suffix to the path.
    It opens nothing: the registry writes. ``streams`` says that memory does not grow with the
    number of pieces. Raises :class:`InputError` for what the format cannot hold.
    """

    name: str
    description: str
    suffixes: tuple[str, ...]
    write: Callable[[Iterator[SceneTable]], Iterator[tuple[str, bytes]]]
    streams: bool
