"""Zones and lines by name, read from a file: GeoJSON, or a plainer JSON, in the scene's metres.

    {"zones": {"entrance": [[2, 10], [5, 10], [5, 13], [2, 13]]},
     "lines": {"gate": {"camera": "north", "points": [[0, 8], [6, 8]]}}}

A place that names no camera is meant in the metres of every camera. Of GeoJSON (RFC 7946) a
Polygon without holes is a zone, a LineString a line; ``properties`` hold ``name`` and, if wanted,
``camera``. Its coordinates are metres on the ground, as tracks have them, and no longitudes.
"""

import math
from collections.abc import Collection, Iterator
from dataclasses import dataclass
from pathlib import Path
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.text import nearest, prefixed
from scene4d.searching.predicates.zones import check_place

_KINDS = {"Polygon": "zone", "LineString": "line"}
_KEYS = ("zones", "lines")


@dataclass(frozen=True, eq=False)
class Place:
    """A named zone or line (``kind``): its points in metres, and whose camera's metres they are."""

    kind: str
    name: str
    points: Float[np.ndarray, "m 2"]
    camera: str | None = None


@dataclass(frozen=True)
class Places:
    """Every place of a file."""

    all: tuple[Place, ...] = ()

    def names(self, kind: str) -> tuple[str, ...]:
        """The names of the zones, or of the lines."""
        return tuple(dict.fromkeys(place.name for place in self.all if place.kind == kind))

    def of(self, camera: str, kind: str) -> dict[str, Float[np.ndarray, "_ 2"]]:
        """The zones, or the lines, that a camera sees."""
        return {
            place.name: place.points
            for place in self.all
            if place.kind == kind and place.camera in (None, camera)
        }

    @property
    def shared(self) -> tuple[str, ...]:
        """Names of the places that are meant in the metres of every camera."""
        return tuple(dict.fromkeys(place.name for place in self.all if place.camera is None))


def read_places(path: Path, cameras: Collection[str]) -> Places:
    """The places of a file; ``cameras`` are those that it may speak of.

    Raises :class:`InputError`, naming file and place, for another structure, a zone that crosses
    itself, a line of one point, a name that is there twice, and an unknown camera.
    """
    values = read_json(path)
    try:
        found = tuple(_places(values))
        for place in found:
            if place.camera is not None and place.camera not in cameras:
                raise InputError(
                    f"{place.kind} {place.name!r}: no camera {place.camera!r}"
                    f"{nearest(place.camera, cameras)}"
                )
            check_place(place.kind, place.name, place.points)
        _check_names(found)
    except InputError as error:
        raise prefixed(error, path) from None
    if not found:
        raise InputError(f"{path}: holds no zone and no line")
    return Places(found)


def _places(values: Any) -> Iterator[Place]:
    if not isinstance(values, dict):
        raise InputError(f"expected an object with zones or lines, found {_kind(values)}")
    if values.get("type") in ("FeatureCollection", "Feature"):
        yield from _of_geojson(values)
        return
    unknown = [key for key in values if key not in _KEYS]
    if unknown:
        raise InputError(f"unknown key {unknown[0]!r}{nearest(unknown[0], _KEYS)}")
    for key in _KEYS:
        kind = key[:-1]
        places = values.get(key, {})
        if not isinstance(places, dict):
            raise InputError(f"{key}: expected names with their points, found {_kind(places)}")
        for name, value in places.items():
            camera = None
            if isinstance(value, dict):
                extra = [k for k in value if k not in ("camera", "points")]
                if extra:
                    raise InputError(f"{kind} {name!r}: unknown key {extra[0]!r}")
                camera, value = value.get("camera"), value.get("points")
            yield _place(kind, name, value, camera)


def _of_geojson(values: dict[str, Any]) -> Iterator[Place]:
    if "crs" in values:
        raise InputError(
            f"crs is {values['crs']!r}: coordinates are the scene's own metres; leave crs out"
        )
    features = values.get("features") if values["type"] == "FeatureCollection" else [values]
    if not isinstance(features, list):
        raise InputError(f"features: expected a list, found {_kind(features)}")
    for number, feature in enumerate(features, 1):
        where = f"feature {number}"
        geometry = feature.get("geometry") if isinstance(feature, dict) else None
        properties = (feature.get("properties") if isinstance(feature, dict) else None) or {}
        if not isinstance(geometry, dict) or not isinstance(properties, dict):
            raise InputError(f"{where}: expected a Feature with geometry and properties")
        kind = _KINDS.get(str(geometry.get("type")))
        if kind is None:
            raise InputError(
                f"{where}: geometry is {geometry.get('type')!r}, expected Polygon or LineString"
            )
        if not isinstance(properties.get("name"), str):
            raise InputError(f"{where}: properties.name is missing: what is the place called?")
        points = geometry.get("coordinates")
        if kind == "zone":
            if not isinstance(points, list) or len(points) != 1:
                raise InputError(f"{where}: expected a Polygon of one ring, without holes")
            points = points[0]
        yield _place(kind, properties["name"], points, properties.get("camera"))


def _place(kind: str, name: str, value: Any, camera: Any) -> Place:
    what = f"{kind} {name!r}"
    if not name.strip():
        raise InputError(f"{kind}: a name is empty")
    if camera is not None and not isinstance(camera, str):
        raise InputError(f"{what}: camera must be a name, found {_kind(camera)}")
    if not isinstance(value, list):
        raise InputError(f"{what}: expected a list of points [x, y], found {_kind(value)}")
    for number, point in enumerate(value, 1):
        if not isinstance(point, list) or len(point) != 2 or not all(map(_is_number, point)):
            raise InputError(f"{what}: point {number} is {point!r}, expected [x, y] in metres")
    return Place(kind, name, np.array(value, float).reshape(-1, 2), camera)


def _is_number(value: Any) -> bool:
    return isinstance(value, int | float) and not isinstance(value, bool) and math.isfinite(value)


def _check_names(places: tuple[Place, ...]) -> None:
    for number, place in enumerate(places):
        for other in places[:number]:
            if other.name.casefold() != place.name.casefold():
                continue
            if other.kind != place.kind:
                raise InputError(f"{place.name!r} is a zone and a line; expected one of them")
            if place.camera == other.camera or None in (place.camera, other.camera):
                raise InputError(f"{place.kind} {place.name!r} is there twice")


def _kind(value: Any) -> str:
    names = {dict: "an object", list: "a list", str: "a text", type(None): "nothing"}
    return names.get(type(value), repr(value))
