"""GeoJSON (RFC 7946): one feature per track, longitude and latitude in WGS 84.

The geometry is a LineString through the track's positions, a Point where it stands or has one
position only, null where it has none. Properties: ``track``, ``class``, ``camera``; ``start`` and
``end`` (RFC 3339, null where the start of the clip is unknown), ``start_s`` and ``end_s``; ``rows``
and ``observed_rows``; ``standing``; ``mean_speed_mps``, ``max_speed_mps``; ``sigma_m``, the
root-mean-square error of its positions, the camera's own included; ``length_m``, ``width_m`` and
``height_m`` with ``length_sigma_m`` and so on, null where unknown. With a LineString also, one
value for each of its points: ``times`` (null without a start), ``times_s``, ``speeds_mps``,
``sigmas_m``. Each feature is a line of the file. A track that crosses the 180th meridian is not
cut as section 3.1.9 would like.
"""

from collections.abc import Iterator
from typing import Any

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes._contract import SceneFormat, SceneTable
from scene4d.formats.scenes._geo import GeoAnchor
from scene4d.formats.scenes._pieces import gathered, main_class, track_rows
from scene4d.formats.scenes._values import (
    DEGREES,
    METRES,
    SECONDS,
    SPEED,
    compact,
    json_numbers,
    sigma_m,
    sizes,
    speed_mps,
    utc_text,
)

STANDING_M, STANDING_MPS = 0.5, 0.3
"""A track stands where its positions stay this close to their mean, as a root mean square, and the
median of its speed stays below. Parked vehicles are seen to move by 0.3 m."""
_SUFFIX = ".geojson"


def _write(pieces: Iterator[SceneTable]) -> Iterator[tuple[str, bytes]]:
    scene = gathered(pieces)
    if scene.geo is None:
        raise InputError(
            "geojson holds longitude and latitude, and where this scene lies is unknown; give an "
            "anchor of two or more ground points (u, v, latitude, longitude), or export "
            "moving-features, which takes local metres"
        )
    lonlat = scene.geo.to_lonlat(scene.tracks.xy_m)
    if not np.isfinite(lonlat).any():
        raise InputError("geojson: no row has a position on the ground")
    separator = b'{"type":"FeatureCollection","features":[\n'
    for rows in track_rows(scene.tracks):
        feature = _feature(scene, scene.geo, scene.tracks.select(rows), lonlat[rows])
        yield _SUFFIX, separator + compact(feature).encode()
        separator = b",\n"
    yield _SUFFIX, b"\n]}\n"


def _feature(
    scene: SceneTable, geo: GeoAnchor, track: Tracks, lonlat: np.ndarray
) -> dict[str, Any]:
    placed = np.isfinite(lonlat).all(axis=1)
    at = track.select(placed)
    standing = len(at) > 0 and _stands(at)
    properties = _properties(scene, track, at, standing)
    geometry = None
    if standing:
        middle = geo.to_lonlat(at.xy_m.mean(axis=0, keepdims=True))
        geometry = {"type": "Point", "coordinates": json_numbers(middle[0], DEGREES)}
    elif len(at):
        geometry = {"type": "LineString", "coordinates": json_numbers(lonlat[placed], DEGREES)}
        properties |= _along(scene, at)
    return {"type": "Feature", "geometry": geometry, "properties": properties}


def _stands(at: Tracks) -> bool:
    away = np.linalg.norm(at.xy_m - at.xy_m.mean(axis=0), axis=1)
    speed = speed_mps(at)
    speed = speed[np.isfinite(speed)]
    slow = not len(speed) or bool(np.median(speed) <= STANDING_MPS)
    return len(at) == 1 or (slow and bool(np.sqrt(np.mean(away**2)) <= STANDING_M))


def _properties(scene: SceneTable, track: Tracks, at: Tracks, standing: bool) -> dict[str, Any]:
    ends = track.time_s[[0, -1]]
    start, end = _times(scene, ends)
    start_s, end_s = json_numbers(ends, SECONDS)
    speed, sigma = speed_mps(at), sigma_m(at)
    return {
        "track": int(track.track[0]),
        "class": main_class(track),
        "camera": scene.camera,
        "start": start,
        "end": end,
        "start_s": start_s,
        "end_s": end_s,
        "rows": len(track),
        "observed_rows": int(track.observed.sum()),
        "standing": standing,
        "mean_speed_mps": _of_known(np.mean, speed, SPEED),
        "max_speed_mps": _of_known(np.max, speed, SPEED),
        "sigma_m": _of_known(lambda known: np.sqrt(np.mean(known**2)), sigma, METRES),
        **sizes(track),
    }


def _of_known(measure: Any, values: np.ndarray, decimals: int) -> float | None:
    known = values[np.isfinite(values)]
    return float(np.round(measure(known), decimals)) if len(known) else None


def _times(scene: SceneTable, time_s: np.ndarray) -> list[Any]:
    return [None] * len(time_s) if scene.start_utc is None else utc_text(scene.start_utc, time_s)


def _along(scene: SceneTable, at: Tracks) -> dict[str, Any]:
    return {
        "times": None if scene.start_utc is None else _times(scene, at.time_s),
        "times_s": json_numbers(at.time_s, SECONDS),
        "speeds_mps": json_numbers(speed_mps(at), SPEED),
        "sigmas_m": json_numbers(sigma_m(at), METRES),
    }


FORMAT = SceneFormat(
    "geojson",
    "RFC 7946, one feature per track; needs a geo-anchor",
    (_SUFFIX,),
    _write,
)
