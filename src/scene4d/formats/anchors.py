"""What ties a site to the Earth, to a floor plan, or to cameras that are known.

JSON, or CSV with the same columns::

    {"points": [{"camera": "gate", "u": 420, "v": 510, "lat": 53.44012, "lon": -0.94321}, ...]}
    {"points": [{"camera": "gate", "u": 420, "v": 510, "x_m": 12.5, "y_m": 3.0}, ...]}
    {"cameras": {"gate": "gate.krtd", "yard": "yard.json"}}

or GeoJSON with lines that tracks keep to: roads, pavements, crossings (RFC 7946: longitude, then
latitude)::

    {"type": "FeatureCollection", "features": [
     {"type": "Feature", "properties": {"for": "vehicles"},
      "geometry": {"type": "LineString", "coordinates": [[-0.94321, 53.44012], ...]}}, ...]}

A line is for people and vehicles unless the property ``for`` says ``"people"`` or ``"vehicles"``.

Pixels are those of the footage, on the ground. Metres are those of a plan, right-handed: x to the
right and y up. Cameras are files of any known format, relative to the anchor's, over a ground at
Z = 0. A camera file by itself is an anchor too: its name without ending is the camera's.
"""

import csv
import io
import os
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any, Literal

import numpy as np
from jaxtyping import Float

from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.json_object import JsonObject
from scene4d.core.text import in_file, read_text
from scene4d.formats.cameras import read_camera
from scene4d.formats.scenes._geo import earth_metres

_EARTH, _PLAN = ("lat", "lon"), ("x_m", "y_m")
_WIDEST_M = 5_000.0
"""Lines reach so far at most: cameras of one site see a small part of that."""
_GEOJSON = ("FeatureCollection", "Feature", "LineString", "MultiLineString")
_KINDS: dict[str | None, tuple[int, ...]] = {None: (0, 1), "people": (0,), "vehicles": (1,)}


@dataclass(frozen=True, eq=False)
class MapLine:
    """A line (n, 2) in metres of the anchors, and who keeps to it: 0 for people, 1 for vehicles."""

    xy_m: Float[np.ndarray, "n 2"]
    kinds: tuple[int, ...]


@dataclass(frozen=True, eq=False)
class Anchors:
    """Pixels (n, 2) on the ground of the cameras of these names, and where they lie: ``xy_m`` in
    metres of the ``kind``. ``known`` are cameras whose pose in the same frame is known, ``lines``
    what tracks keep to. Of the Earth, +X is east and +Y north of ``latitude_deg``,
    ``longitude_deg``.
    """

    kind: Literal["earth", "plan", "cameras"]
    camera: tuple[str, ...] = ()
    uv: Float[np.ndarray, "n 2"] = field(default_factory=lambda: np.empty((0, 2)))
    xy_m: Float[np.ndarray, "n 2"] = field(default_factory=lambda: np.empty((0, 2)))
    known: dict[str, Camera] = field(default_factory=dict)
    lines: tuple[MapLine, ...] = ()
    latitude_deg: float | None = None
    longitude_deg: float | None = None


def read_anchors(path: str | os.PathLike[str]) -> Anchors:
    """Read a file of anchors.

    Raises :class:`InputError` naming the file, and the field or line, for what is none, for points
    of the Earth and of a plan in one file, and for cameras without a pose;
    :class:`UnavailableError` for longitudes and latitudes without pyproj.
    """
    path = Path(path)
    with in_file(path):
        if path.suffix.lower() == ".csv":
            return _of_points(_csv_points(path))
        values = read_json(path) if path.suffix.lower() in (".json", ".geojson") else None
        if isinstance(values, dict) and ("points" in values or "cameras" in values):
            return _of_json(JsonObject(values, os.fspath(path)), path)
        if isinstance(values, dict) and values.get("type") in _GEOJSON:
            return _of_lines(_lines(JsonObject(values, os.fspath(path))))
        return Anchors("cameras", known={path.stem: _known(path)})


def _of_json(said: JsonObject, path: Path) -> Anchors:
    said.only(("points", "cameras"))
    known = {}
    if "cameras" in said:
        files = said.object("cameras")
        known = {name: _known(path.parent / files.text(name)) for name in files.names()}
    points = [_point(one) for one in said.objects("points")] if "points" in said else []
    if not points:
        if not known:
            raise InputError("holds no points and no cameras")
        return Anchors("cameras", known=known)
    found = _of_points(points)
    if known and found.kind == "earth":
        raise InputError("known cameras stand in metres, not by longitude and latitude")
    return replace(found, known=known)


_Point = tuple[str, tuple[float, float], Literal["earth", "plan"], tuple[float, float]]


def _point(said: JsonObject) -> _Point:
    said.only(("camera", "u", "v", *_EARTH, *_PLAN))
    uv = said.number("u"), said.number("v")
    if "lat" in said or "lon" in said:
        lat = said.number("lat", least=-90.0, most=90.0)
        return said.text("camera"), uv, "earth", (lat, said.number("lon", least=-180.0, most=180.0))
    return said.text("camera"), uv, "plan", (said.number("x_m"), said.number("y_m"))


def _csv_points(path: Path) -> list[_Point]:
    rows = list(csv.DictReader(io.StringIO(read_text(path)), restkey="more", skipinitialspace=True))
    if not rows:
        raise InputError("expected a header camera,u,v,lat,lon or camera,u,v,x_m,y_m, and points")
    return [
        _point(JsonObject(_numbers(row), f"line {number}")) for number, row in enumerate(rows, 2)
    ]


def _numbers(row: dict[str, Any]) -> dict[str, Any]:
    """The cells of a line as JSON would have them; empty ones are left out."""
    found: dict[str, Any] = {}
    for name, cell in row.items():
        if name != "camera" and isinstance(cell, str):
            try:
                found[name.strip()] = float(cell) if cell.strip() else None
            except ValueError:
                found[name.strip()] = cell
        else:
            found[name] = cell
    return {name: value for name, value in found.items() if value is not None}


def _of_points(points: list[_Point]) -> Anchors:
    cameras, uv, kinds, at = zip(*points, strict=True)
    if len(set(kinds)) > 1:
        raise InputError(
            "some points have longitude and latitude, others metres; expected one of the two"
        )
    there = np.array(at, float)
    if kinds[0] == "plan":
        return Anchors("plan", cameras, np.array(uv, float), there)
    xy, (latitude, longitude) = earth_metres(there[:, 0], there[:, 1])
    return Anchors(
        "earth", cameras, np.array(uv, float), xy, latitude_deg=latitude, longitude_deg=longitude
    )


def _known(path: Path) -> Camera:
    camera = read_camera(path)
    if not isinstance(camera, Camera):
        raise InputError(f"{path}: holds a lens without a pose, and cannot anchor a site")
    return camera


_Line = tuple[Float[np.ndarray, "_n 2"], tuple[int, ...]]


def _lines(said: JsonObject, kinds: tuple[int, ...] = (0, 1)) -> list[_Line]:
    """Longitudes and latitudes of the lines of a GeoJSON object, each with who keeps to it."""
    kind = said.text("type")
    if kind == "FeatureCollection":
        return [line for one in said.objects("features") for line in _lines(one)]
    if kind == "Feature":
        about = said.object("properties") if "properties" in said else JsonObject({}, said.where)
        who = about.text("for") if "for" in about else None
        if who not in _KINDS:
            raise about.error("for", "'people' or 'vehicles'")
        return _lines(said.object("geometry"), _KINDS[who])
    if kind == "LineString":
        parts = [said.value("coordinates")]
    elif kind == "MultiLineString" and isinstance(said.value("coordinates"), list):
        parts = said.value("coordinates")
    else:
        raise said.error("type", "'LineString' or 'MultiLineString'; leave anything else out")
    return [(_lonlat(said, part), kinds) for part in parts]


def _lonlat(said: JsonObject, part: Any) -> Float[np.ndarray, "n 2"]:
    try:
        found = JsonObject({"part": part}, "").array("part", None, None)
    except InputError:
        found = np.empty((0, 0))
    if len(found) < 2 or found.shape[1] not in (2, 3):
        raise said.error("coordinates", "two or more pairs of longitude, latitude in degrees")
    if (np.abs(found[:, :2]) > (180.0, 90.0)).any():
        raise said.error(
            "coordinates", "degrees: longitude (-180 to 180), then latitude (-90 to 90)"
        )
    return found[:, :2]


def _of_lines(lines: list[_Line]) -> Anchors:
    if not lines:
        raise InputError("holds no lines; expected LineStrings that tracks keep to")
    lon, lat = np.concatenate([line for line, _ in lines]).T
    xy, (latitude, longitude) = earth_metres(lat, lon)
    wide_m = float(np.ptp(xy, axis=0).max())
    if not wide_m <= _WIDEST_M:
        raise InputError(
            f"its lines reach over {wide_m / 1000:.0f} km; keep those around the cameras, within "
            f"{_WIDEST_M / 1000:.0f} km"
        )
    cuts = np.cumsum([len(line) for line, _ in lines])[:-1]
    found = tuple(
        MapLine(part, kinds) for part, (_, kinds) in zip(np.split(xy, cuts), lines, strict=True)
    )
    return Anchors("earth", lines=found, latitude_deg=latitude, longitude_deg=longitude)
