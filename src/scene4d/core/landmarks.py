"""What somebody has measured in a scene: ground points, upright things, distances."""

import os
from collections.abc import Iterator
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core._landmark_table import is_table, table_rows
from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.core.text import in_file

SCHEMA = "scene4d/landmarks/1"
Pixel = tuple[float, float]
_POINT_SIGMA_M, _HEIGHT_SIGMA_M, _DISTANCE_SIGMA_M = 0.05, 0.02, 0.05
"""Assumed where a file does not say: of coordinates taken with a tape or from a plan, of the height
of a door, and of a distance paced out with a tape. Chosen."""
_SIGMA_PX = 2.0
"""Of a click on a picture, where a file does not say. Chosen."""
_LARGEST_M = 1e7
"""Coordinates up to this are read: national grids have seven digits."""


@dataclass(frozen=True)
class GroundPoint:
    """A point at pixel ``uv`` of the footage with position ``xy_m`` in a frame of the user's own
    (metres, any origin and heading, y to the left of x as seen from above) and ``height_m`` above
    the ground. ``sigma_m`` is the standard deviation of each of its three coordinates, ``sigma_px``
    that of each of the pixel's.
    """

    uv: Pixel
    xy_m: tuple[float, float]
    height_m: float = 0.0
    sigma_m: float = _POINT_SIGMA_M
    sigma_px: float = _SIGMA_PX
    name: str = ""


@dataclass(frozen=True)
class Upright:
    """Something that stands upright on the ground, with known height: a door, a pole, a person."""

    foot_uv: Pixel
    head_uv: Pixel
    height_m: float
    sigma_m: float = _HEIGHT_SIGMA_M
    sigma_px: float = _SIGMA_PX
    name: str = ""


@dataclass(frozen=True)
class Distance:
    """A known distance between two pixels of the ground."""

    uv: tuple[Pixel, Pixel]
    distance_m: float
    sigma_m: float = _DISTANCE_SIGMA_M
    sigma_px: float = _SIGMA_PX
    name: str = ""


@dataclass(frozen=True)
class Landmarks:
    """All that was measured in one scene. Raises :class:`InputError` if it says nothing, for values
    out of range, and for one ground point alone, which fits any camera.
    """

    points: tuple[GroundPoint, ...] = ()
    uprights: tuple[Upright, ...] = ()
    distances: tuple[Distance, ...] = ()

    def __post_init__(self) -> None:
        if not len(self):
            raise InputError(
                "there are no landmarks; give ground points, uprights or distances between points"
            )
        for field, item in self._items():
            _check(field, item)
        if len({point.xy_m for point in self.points}) == 1:
            raise InputError(
                f"points: {len(self.points)} ground point{'s' if len(self.points) > 1 else ''} at "
                "one position fit any camera; give two or more positions in the same frame"
            )

    def __len__(self) -> int:
        return len(self.points) + len(self.uprights) + len(self.distances)

    def names(self) -> tuple[str, ...]:
        """The name of every landmark, or its kind and number: points, uprights, distances."""
        return tuple(item.name or field for field, item in self._items("point 1"))

    def _items(
        self, style: str = "points[0]"
    ) -> Iterator[tuple[str, GroundPoint | Upright | Distance]]:
        for kind in ("points", "uprights", "distances"):
            for i, item in enumerate(getattr(self, kind)):
                yield (f"{kind}[{i}]" if style == "points[0]" else f"{kind[:-1]} {i + 1}"), item

    def inside(self, image_size: tuple[int, int]) -> "Landmarks":
        """These landmarks; raises :class:`InputError` where a pixel lies outside the picture."""
        width, height = image_size
        for field, item in self._items():
            for u, v in _pixels(item):
                if not (-0.5 <= u <= width - 0.5 and -0.5 <= v <= height - 0.5):
                    raise InputError(
                        f"{field}: the pixel ({u:g}, {v:g}) lies outside the picture of "
                        f"{width}x{height}; landmarks are given in pixels of the footage"
                    )
        return self

    @classmethod
    def load(cls, path: str | os.PathLike[str]) -> "Landmarks":
        """Read a JSON file with lists ``points``, ``uprights`` and ``distances``, of which each may
        be missing; their fields are those of the classes above. A table (.csv, .tsv, .txt) holds
        ground points: columns u, v, x_m, y_m, and of z_m (height above the ground), sigma_m,
        sigma_px and name those that are known.

        Raises :class:`InputError` naming the file and the field, or the line.
        """
        if is_table(Path(path)):
            return cls._of_table(Path(path))
        fields = JsonObject.read(path)
        fields.only(("schema", "points", "uprights", "distances"))
        if "schema" in fields and fields.text("schema") != SCHEMA:
            raise fields.error("schema", repr(SCHEMA))
        of_kind = {
            name: fields.objects(name) if name in fields else []
            for name in ("points", "uprights", "distances")
        }
        with in_file(path):
            return cls(
                tuple(_point(item) for item in of_kind["points"]),
                tuple(_upright(item) for item in of_kind["uprights"]),
                tuple(_distance(item) for item in of_kind["distances"]),
            )

    @classmethod
    def _of_table(cls, path: Path) -> "Landmarks":
        points = [
            GroundPoint(
                (row.pop("u"), row.pop("v")),
                (row.pop("x_m"), row.pop("y_m")),
                height_m=row.pop("z_m", 0.0),
                name=name,
                **row,
            )
            for name, row in table_rows(path)
        ]
        with in_file(path):
            return cls(tuple(points))


@dataclass(frozen=True, eq=False)
class LandmarkFit:
    """How landmarks agree with a camera, in the order of :meth:`Landmarks.names`.

    ``off_sigmas`` is how far each lies from where the camera expects it, in standard deviations,
    ``off_m`` the same in metres. ``used`` is false for those that contradict all others and were
    left out. ``expected_uv`` are the pixels where the camera expects ground points and the heads of
    uprights; NaN for distances. ``camera_xy_m`` and ``heading_rad`` say where the camera stands and
    looks in the frame of the ground points (heading from x towards y); None without any.
    """

    landmarks: Landmarks
    off_sigmas: Float[np.ndarray, "n"]
    off_m: Float[np.ndarray, "n"]
    used: Bool[np.ndarray, "n"]
    expected_uv: Float[np.ndarray, "n 2"]
    camera_xy_m: tuple[float, float] | None = None
    heading_rad: float | None = None

    @property
    def ground_uv(self) -> Float[np.ndarray, "m 2"]:
        """Pixels of the ground that were measured."""
        known = self.landmarks
        found = [point.uv for point in known.points if point.height_m == 0]
        found += [upright.foot_uv for upright in known.uprights]
        found += [uv for distance in known.distances for uv in distance.uv]
        return np.array(found, float).reshape(-1, 2)


def _pixels(item: GroundPoint | Upright | Distance) -> tuple[Pixel, ...]:
    if isinstance(item, GroundPoint):
        return (item.uv,)
    return (item.foot_uv, item.head_uv) if isinstance(item, Upright) else item.uv


def _check(field: str, item: GroundPoint | Upright | Distance) -> None:
    if not np.isfinite(_pixels(item)).all():
        raise InputError(f"{field}: pixels must be finite, found {_pixels(item)}")
    for name in ("sigma_m", "sigma_px"):
        value = getattr(item, name)
        if not (np.isfinite(value) and value > 0):
            raise InputError(f"{field}.{name} must be greater than 0, found {value}")
    if isinstance(item, GroundPoint):
        if not (np.abs(item.xy_m) < _LARGEST_M).all():
            raise InputError(f"{field}.xy_m must be metres below {_LARGEST_M:g}, found {item.xy_m}")
        if not 0 <= item.height_m < 1000:
            raise InputError(f"{field}.height_m must be 0 to 1000 m, found {item.height_m}")
        return
    name = "height_m" if isinstance(item, Upright) else "distance_m"
    value, (one, other) = getattr(item, name), _pixels(item)
    if not 0 < value < 1e4:
        raise InputError(f"{field}.{name} must be greater than 0 and below 10000 m, found {value}")
    if np.hypot(one[0] - other[0], one[1] - other[1]) < 1.0:
        raise InputError(f"{field}: its two pixels must lie apart, found {one} and {other}")


def _numbers(fields: JsonObject, *optional: str) -> dict[str, float]:
    return {name: fields.number(name) for name in optional if name in fields}


def _name(fields: JsonObject) -> str:
    return fields.text("name") if "name" in fields else ""


def _pair(fields: JsonObject, name: str) -> tuple[float, float]:
    u, v = fields.array(name, 2).tolist()
    return u, v


def _point(fields: JsonObject) -> GroundPoint:
    fields.only(GroundPoint.__dataclass_fields__)
    more = _numbers(fields, "height_m", "sigma_m", "sigma_px")
    return GroundPoint(_pair(fields, "uv"), _pair(fields, "xy_m"), name=_name(fields), **more)


def _upright(fields: JsonObject) -> Upright:
    fields.only(Upright.__dataclass_fields__)
    ends = _pair(fields, "foot_uv"), _pair(fields, "head_uv")
    more = _numbers(fields, "sigma_m", "sigma_px")
    height_m = fields.number("height_m")
    return Upright(ends[0], ends[1], height_m, name=_name(fields), **more)


def _distance(fields: JsonObject) -> Distance:
    fields.only(Distance.__dataclass_fields__)
    (a, b), (c, d) = fields.array("uv", 2, 2).tolist()
    more = _numbers(fields, "sigma_m", "sigma_px")
    return Distance(((a, b), (c, d)), fields.number("distance_m"), name=_name(fields), **more)
