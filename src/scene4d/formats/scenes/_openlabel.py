"""ASAM OpenLABEL 1.0.0 JSON: cuboids of vehicles, centroids and boxes of all, frame by frame.

``frames`` are those of the footage, from 0; ``timestamp`` is RFC 3339, or seconds from the start of
the footage where that is unknown. An object has, as far as they are known,

- ``cuboid``: centre, quaternion (x, y, z, w) that turns its X axis to the front, and length, width
  and height, in ``world``: the camera's metres, Z up, origin on the ground below it. Attributes:
  ``sigma``, the standard deviations of centre, heading and sizes, the camera's error included, and
  ``front_known``, false where it may as well be the other way round (the heading then has none:
  its sigma is -1);
- ``point3d``: the centroid, half a height above the ground, with ``sigma``;
- ``bbox``: centre, width and height in pixels of the footage;
- ``num``: ``height_m`` and ``height_sigma_m`` (of people too), ``existence_probability``;
  ``boolean``: ``observed``.
"""

from collections.abc import Iterator
from itertools import groupby
from typing import Any

import numpy as np

from scene4d.core.cuboids import centroids, cuboid_covariance
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes._contract import SceneFormat, SceneTable
from scene4d.formats.scenes._pieces import in_frame_order
from scene4d.formats.scenes._values import (
    METRES,
    PIXELS,
    SCORE,
    SECONDS,
    compact,
    rounded,
    utc_text,
)

_SUFFIX = ".json"
_WORLD = {"coordinate_system": "world"}
_NUMBERS = ("height_m", "height_sigma_m", "existence_probability")
_DECIMALS = 6
_Row = tuple[int, Any, int, str, dict[str, Any], str]
"""Frame, timestamp, track, class, data and camera."""


def _write(pieces: Iterator[SceneTable]) -> Iterator[tuple[str, bytes]]:
    spans: dict[int, tuple[str, int, int]] = {}
    camera = ""
    for frame, rows in groupby(_rows(pieces), key=lambda row: row[0]):
        seen = list(rows)
        content = {
            "frame_properties": {"timestamp": seen[0][1]},
            "objects": {str(track): {"object_data": data} for _, _, track, _, data, _ in seen},
        }
        yield (
            _SUFFIX,
            (",\n" if spans else _HEAD).encode() + f'"{frame}":{compact(content)}'.encode(),
        )
        camera = seen[0][-1]
        for _, _, track, kind, _, _ in seen:
            spans[track] = (*spans.get(track, (kind, frame))[:2], frame)
    objects = {
        str(track): {
            "name": f"{kind} {track}",
            "type": kind,
            "frame_intervals": [{"frame_start": first, "frame_end": last}],
        }
        for track, (kind, first, last) in spans.items()
    }
    streams = {camera: {"type": "camera"}}
    yield _SUFFIX, f'}},"objects":{compact(objects)},"streams":{compact(streams)}}}}}\n'.encode()


def _rows(pieces: Iterator[SceneTable]) -> Iterator[_Row]:
    for piece in in_frame_order(pieces):
        tracks = piece.tracks
        times = rounded(tracks.time_s, SECONDS).tolist()
        if piece.start_utc is not None:
            times = utc_text(piece.start_utc, tracks.time_s)
        known = zip(
            tracks.frame.tolist(),
            times,
            tracks.track.tolist(),
            tracks.class_name.tolist(),
            _data(tracks),
            [piece.camera] * len(tracks),
            strict=True,
        )
        yield from known


def _data(tracks: Tracks) -> Iterator[dict[str, Any]]:
    """What is known of each row."""
    middle, spread = centroids(tracks)
    sigma = np.sqrt(np.diagonal(cuboid_covariance(tracks), axis1=1, axis2=2))
    half = tracks.heading_rad / 2
    turn = np.column_stack([0 * half, 0 * half, np.sin(half), np.cos(half)])
    cuboid = rounded(np.hstack([middle, turn, tracks.size_m]), _DECIMALS)
    low, high = tracks.box_xyxy[:, :2], tracks.box_xyxy[:, 2:]
    box = rounded(np.hstack([(low + high) / 2, high - low]), PIXELS)
    at = np.sqrt(np.diagonal(spread, axis1=1, axis2=2))
    heights = (tracks.size_m[:, 2], tracks.size_sigma_m[:, 2])
    numbers = rounded(np.column_stack([*heights, tracks.existence_probability]), SCORE)
    for row in range(len(tracks)):
        data: dict[str, Any] = {}
        if np.isfinite(cuboid[row]).all():
            data["cuboid"] = [_cuboid(cuboid[row], sigma[row])]
        if np.isfinite(middle[row]).all():
            more = {"attributes": {"vec": [_named("sigma", rounded(at[row], METRES))]}}
            data["point3d"] = [_named("centroid", rounded(middle[row], METRES)) | _WORLD | more]
        if np.isfinite(box[row]).all():
            data["bbox"] = [_named("box", box[row])]
        data["num"] = [
            {"name": name, "val": value}
            for name, value in zip(_NUMBERS, numbers[row].tolist(), strict=True)
            if np.isfinite(value)
        ]
        data["boolean"] = [{"name": "observed", "val": bool(tracks.observed[row])}]
        yield data


def _cuboid(values: np.ndarray, sigma: np.ndarray) -> dict[str, Any]:
    known = bool(np.isfinite(sigma[3]))
    attributes = {
        "vec": [_named("sigma", rounded(np.nan_to_num(sigma, nan=-1.0), METRES))],
        "boolean": [{"name": "front_known", "val": known}],
    }
    return _named("cuboid", values) | _WORLD | {"attributes": attributes}


def _named(name: str, values: np.ndarray) -> dict[str, Any]:
    return {"name": name, "val": values.tolist()}


_HEAD = (
    '{"openlabel":{"metadata":{"schema_version":"1.0.0"},"coordinate_systems":{"world":'
    '{"type":"scene_cs","parent":"","children":[]}},"frames":{\n'
)

FORMAT = SceneFormat(
    "openlabel",
    "ASAM OpenLABEL JSON, with cuboids of vehicles and centroids of people",
    (_SUFFIX,),
    _write,
)
