"""Zones and lines by name, read from a file: GeoJSON, or a plainer JSON, in the scene's metres.

    {"zones": {"entrance": [[2, 10], [5, 10], [5, 13], [2, 13]]},
     "lines": {"gate": {"camera": "north", "points": [[0, 8], [6, 8]]}}}

A place that names no camera is meant in the metres of every camera, or of the site if one is
searched. Of GeoJSON (RFC 7946) a Polygon without holes is a zone, a LineString a line;
``properties`` hold ``name`` and, if wanted, ``camera``. Its coordinates are metres on the ground,
as tracks have them, and no longitudes.
"""

from collections.abc import Collection, Iterator
from dataclasses import dataclass, replace
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.core.text import in_file, nearest, quoted
from scene4d.searching.predicates._zones import check_place
from scene4d.store.site import Site

_KINDS = {"Polygon": "zone", "LineString": "line"}
_LONGEST_NAME = 80
"""Characters: a name is said in a search, and shown in plans."""


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


def in_cameras(places: Places, site: Site) -> Places:
    """Places of a site in the metres of each camera that has a place there, under the camera's name
    in its scene: those of which no camera is named are in the site's metres.
    """
    found = [
        replace(place, camera=site.placed(place.camera).name)
        for place in places.all
        if place.camera is not None
    ]
    for place in places.all:
        for name in site.cameras if place.camera is None else ():
            points = site.placements[name].inverse().points(place.points)
            found.append(replace(place, camera=site.placed(name).name, points=points))
    return Places(tuple(found))


def in_site(places: Places, kind: str, site: Site) -> dict[str, Float[np.ndarray, "_ 2"]]:
    """The same in the site's metres, by name; without those of cameras that have no place."""
    found = {}
    for place in places.all:
        if place.kind == kind and place.camera is None:
            found[place.name] = place.points
        elif place.kind == kind and place.camera in site.cameras:
            found[place.name] = site.placements[str(place.camera)].points(place.points)
    return found


def read_places(path: Path, cameras: Collection[str] | None) -> Places:
    """The places of a file; ``cameras`` are those that it may speak of (None: any).

    Raises :class:`InputError`, naming file and place, for another structure, a zone that crosses
    itself, a line of one point, a name that is there twice, and an unknown camera.
    """
    values = JsonObject.read(path)
    is_geojson = values.value("type") in ("FeatureCollection", "Feature")
    with in_file(path):
        found = tuple(_of_geojson(values) if is_geojson else _of_plain(values))
        for place in found:
            _check(place, cameras)
        _check_names(found)
    if not found:
        raise InputError(f"{path}: holds no zone and no line")
    return Places(found)


def _of_plain(values: JsonObject) -> Iterator[Place]:
    values.only(("zones", "lines"))
    for key in values.names():
        places = values.object(key)
        for name in values.value(key):
            if isinstance(places.value(name), dict):
                place = places.object(name)
                place.only(("camera", "points"))
                yield Place(key[:-1], name, place.array("points", None, 2), _camera(place))
            else:
                yield Place(key[:-1], name, places.array(name, None, 2))


def _of_geojson(values: JsonObject) -> Iterator[Place]:
    if "crs" in values:
        raise values.error("crs", "left out: coordinates are the scene's own metres")
    is_collection = values.value("type") == "FeatureCollection"
    for feature in values.objects("features") if is_collection else [values]:
        geometry, properties = feature.object("geometry"), feature.object("properties")
        kind = _KINDS.get(geometry.text("type"))
        name, camera = properties.text("name"), _camera(properties)
        if kind is None:
            raise geometry.error("type", "Polygon or LineString")
        if kind == "line":
            yield Place(kind, name, geometry.array("coordinates", None, 2), camera)
            continue
        rings = geometry.value("coordinates")
        if not isinstance(rings, list) or len(rings) != 1:
            raise geometry.error("coordinates", "one ring, without holes")
        yield Place(kind, name, geometry.array("coordinates", 1, None, 2)[0], camera)


def _camera(values: JsonObject) -> str | None:
    return values.text("camera") if "camera" in values else None


def _check(place: Place, cameras: Collection[str] | None) -> None:
    if not place.name.strip() or len(place.name) > _LONGEST_NAME:
        raise InputError(
            f"{place.kind} {quoted(place.name)}: a name has 1 to {_LONGEST_NAME} characters"
        )
    if place.camera is not None and cameras is not None and place.camera not in cameras:
        raise InputError(
            f"{place.kind} {place.name!r}: no camera {quoted(place.camera)}"
            f"{nearest(place.camera, cameras)}"
        )
    check_place(place.kind, place.name, place.points)


def _check_names(places: tuple[Place, ...]) -> None:
    for number, place in enumerate(places):
        for other in places[:number]:
            if other.name.casefold() != place.name.casefold():
                continue
            if other.kind != place.kind:
                raise InputError(f"{place.name!r} is a zone and a line; expected one of them")
            if place.camera == other.camera or None in (place.camera, other.camera):
                raise InputError(f"{place.kind} {place.name!r} is there twice")
