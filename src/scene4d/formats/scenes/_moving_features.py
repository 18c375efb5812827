"""OGC Moving Features Encoding Extension - JSON 1.0 (OGC 19-045r3), part MF-JSON Prism.

A MovingFeatureCollection (clause 7.2.5) of one MovingFeature (7.2.4) per track with

- ``temporalGeometry`` of type MovingPoint (7.2.1.1), ``interpolation`` Linear, or Discrete where
  there is one position only;
- ``temporalProperties`` (7.2.2): ``speed`` (form MTS, metres per second, of UN/CEFACT
  Recommendation 20), ``sigma`` (MTR, root-mean-square error of the position, the camera's own
  included), ``azimuth`` (degrees clockwise from north) or, without a geo-anchor, ``heading`` (C81,
  radians from +X to +Y), and ``observed``, false where the position bridges a gap;
- ``properties``: ``track``, ``class``, ``camera``, ``length_m``, ``width_m``, ``height_m`` and
  their standard deviations (``length_sigma_m``, ...), null where unknown; ``geometry``
  null, as RFC 7946 wants it.

``crs`` and ``trs`` (7.2.3) stand on the collection. With a geo-anchor ``crs`` is CRS84 (longitude,
latitude in WGS 84) and ``bbox`` is given; without, it names a local system: x and y in metres on
the ground, origin below the camera. With a known start ``trs`` is ISO 8601, times are RFC 3339 and
``time`` is given; without, ``trs`` names seconds since the start of the footage, as numbers.
Readers that look at neither (MovingPandas 0.23) take metres for degrees and the year for 1970. A
collection of one feature is written as such: the standard's schema allows it, though requirement
2.39 asks for more. Each feature is a line of the file.
"""

import warnings
from collections.abc import Iterator
from typing import Any

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes._contract import SceneFormat, SceneTable
from scene4d.formats.scenes._pieces import gathered, main_class, track_rows
from scene4d.formats.scenes._values import (
    DEGREES,
    METRES,
    RADIANS,
    SECONDS,
    SPEED,
    compact,
    json_numbers,
    sigma_m,
    sizes,
    speed_mps,
    utc_text,
)

_SUFFIX = ".json"
_DEGREE = "http://www.opengis.net/def/uom/UCUM/0/deg"


def _write(pieces: Iterator[SceneTable]) -> Iterator[tuple[str, bytes]]:
    scene = gathered(pieces)
    everything = scene.tracks
    placed = np.isfinite(everything.xy_m).all(axis=1)
    if not placed.any():
        raise InputError("moving-features: no row has a position on the ground")
    tracks = everything.select(placed)
    left_out = len(np.unique(everything.track)) - len(np.unique(tracks.track))
    if left_out:
        warnings.warn(
            f"moving-features: left out {left_out} tracks without a position on the ground",
            stacklevel=2,
        )
    place = tracks.xy_m if scene.geo is None else scene.geo.to_lonlat(tracks.xy_m)
    head = compact(_collection(scene, tracks, place))
    separator = head[:-1].encode() + b',"features":[\n'
    for rows in track_rows(tracks):
        text = compact(_feature(scene, tracks.select(rows), place[rows]))
        yield _SUFFIX, separator + text.encode()
        separator = b",\n"
    yield _SUFFIX, b"\n]}\n"


def _collection(scene: SceneTable, tracks: Tracks, place: np.ndarray) -> dict[str, Any]:
    """Everything but the features."""
    head: dict[str, Any] = {"type": "FeatureCollection", "label": scene.camera}
    if scene.geo is None:
        local = f"camera {scene.camera}: x, y in metres on the ground, origin below the camera"
        head["crs"] = _named(local)
    else:
        head["crs"] = _named("urn:ogc:def:crs:OGC:1.3:CRS84")
        corners = np.concatenate([place.min(axis=0), place.max(axis=0)])
        head["bbox"] = json_numbers(corners, DEGREES)
    if scene.start_utc is None:
        head["trs"] = _named("seconds since the start of the footage")
    else:
        head["trs"] = _named("urn:ogc:data:time:iso8601")
        ends = np.array([tracks.time_s.min(), tracks.time_s.max()])
        head["time"] = utc_text(scene.start_utc, ends)
    return head


def _named(name: str) -> dict[str, Any]:
    return {"type": "Name", "properties": {"name": name}}


def _feature(scene: SceneTable, track: Tracks, place: np.ndarray) -> dict[str, Any]:
    if scene.start_utc is None:
        times = json_numbers(track.time_s, SECONDS)
    else:
        times = utc_text(scene.start_utc, track.time_s)
    number = int(track.track[0])
    said = {"track": number, "class": main_class(track), "camera": scene.camera}
    return {
        "type": "Feature",
        "id": number,
        "properties": said | sizes(track),
        "geometry": None,
        "temporalGeometry": {
            "type": "MovingPoint",
            "datetimes": times,
            "coordinates": json_numbers(place, METRES if scene.geo is None else DEGREES),
            "interpolation": _interpolation(track, "Linear"),
        },
        "temporalProperties": [{"datetimes": times, **_properties(scene, track)}],
    }


def _interpolation(track: Tracks, wanted: str) -> str:
    """Linear and Step need two instants (7.2.10.1)."""
    return wanted if len(track) > 1 else "Discrete"


def _properties(scene: SceneTable, track: Tracks) -> dict[str, Any]:
    linear = _interpolation(track, "Linear")
    # A direction has no line between 359 and 1 degrees, so it holds at its instants alone.
    if scene.geo is None:
        direction = {"heading": _measure(track.heading_rad, RADIANS, "C81", "Discrete")}
    else:
        azimuth = scene.geo.azimuth_deg(track.heading_rad)
        direction = {"azimuth": _measure(azimuth, RADIANS, _DEGREE, "Discrete")}
    return {
        "speed": _measure(speed_mps(track), SPEED, "MTS", linear),
        **direction,
        "sigma": _measure(sigma_m(track), METRES, "MTR", linear),
        "observed": {
            "type": "Text",
            "values": track.observed.tolist(),
            "interpolation": _interpolation(track, "Step"),
        },
    }


def _measure(values: np.ndarray, decimals: int, form: str, interpolation: str) -> dict[str, Any]:
    return {
        "type": "Measure",
        "form": form,
        "values": json_numbers(values, decimals),
        "interpolation": interpolation,
    }


FORMAT = SceneFormat(
    "moving-features",
    "OGC Moving Features JSON (19-045r3): on the Earth or in local metres",
    (_SUFFIX,),
    _write,
)
