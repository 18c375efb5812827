"""CSV: a header that names the units, one line per row, empty where a value is unknown.

Columns: ``camera``, ``track``, ``class``, ``time_utc`` (RFC 3339, empty where the start is
unknown), ``time_s`` and ``frame`` of the clip, ``observed``; ``x_m``, ``y_m``; with a geo-anchor
``lon_deg``, ``lat_deg`` (WGS 84) and ``azimuth_deg`` (clockwise from north); the position's
covariance, its independent and its shared part; velocity and its covariance; ``heading_rad`` (from
+X to +Y) and its standard deviation; the box in pixels of the footage; ``score`` and
``existence_probability``; ``z_m`` of the ground, and length, width and height of the object, with
standard deviations; three columns for each keypoint. RFC 4180, UTF-8, lines end with a line feed.
"""

from collections.abc import Iterator

import numpy as np
from arro3.core import Array, DataType

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes._contract import SceneFormat, SceneTable
from scene4d.formats.scenes._geo import GeoAnchor
from scene4d.formats.scenes._pieces import agreeing, by_frame
from scene4d.formats.scenes._values import (
    DEGREES,
    METRES,
    PIXELS,
    RADIANS,
    SCORE,
    SECONDS,
    SPEED,
    VARIANCE,
    chunks,
    column,
    csv_lines,
    utc_ns,
)

_SUFFIX = ".csv"


def _write(pieces: Iterator[SceneTable]) -> Iterator[tuple[str, bytes]]:
    header, anchored = True, None
    for piece in agreeing(pieces, ("keypoint_names",)):
        if anchored not in (None, piece.geo is not None):
            raise InputError(
                "some of its cameras have a geo-anchor and some have not, so the columns differ; "
                "export them to files of their own"
            )
        anchored = piece.geo is not None
        for tracks in chunks(by_frame(piece.tracks)):
            yield _SUFFIX, csv_lines(_columns(piece, tracks), header=header)
            header = False


def _columns(piece: SceneTable, tracks: Tracks) -> dict[str, Array]:
    columns = _identity(piece, tracks)
    columns |= {"x_m": column(tracks.xy_m[:, 0], METRES), "y_m": column(tracks.xy_m[:, 1], METRES)}
    if piece.geo is not None:
        columns |= _on_earth(piece.geo, tracks)
    columns |= _covariance(tracks.covariance_m2, "var_{}_m2", ("x", "y"))
    columns |= _covariance(tracks.shared_covariance_m2, "shared_var_{}_m2", ("x", "y"))
    columns["vx_mps"] = column(tracks.velocity_mps[:, 0], SPEED)
    columns["vy_mps"] = column(tracks.velocity_mps[:, 1], SPEED)
    columns |= _covariance(tracks.velocity_covariance, "var_{}_m2ps2", ("vx", "vy"))
    columns["heading_rad"] = column(tracks.heading_rad, RADIANS)
    columns["heading_sigma_rad"] = column(tracks.heading_sigma_rad, RADIANS)
    for i, name in enumerate(("x1_px", "y1_px", "x2_px", "y2_px")):
        columns[name] = column(tracks.box_xyxy[:, i], PIXELS)
    columns["score"] = column(tracks.score, SCORE)
    columns["existence_probability"] = column(tracks.existence_probability, SCORE)
    columns["z_m"] = column(tracks.z_m, METRES)
    columns["z_sigma_m"] = column(tracks.z_sigma_m, METRES)
    for i, name in enumerate(("length", "width", "height")):
        columns[f"{name}_m"] = column(tracks.size_m[:, i], METRES)
        columns[f"{name}_sigma_m"] = column(tracks.size_sigma_m[:, i], METRES)
    for i, name in enumerate(piece.keypoint_names):
        columns[f"{name}_u_px"] = column(tracks.keypoint_uv[:, i, 0], PIXELS)
        columns[f"{name}_v_px"] = column(tracks.keypoint_uv[:, i, 1], PIXELS)
        columns[f"{name}_score"] = column(tracks.keypoint_score[:, i], SCORE)
    return columns


def _identity(piece: SceneTable, tracks: Tracks) -> dict[str, Array]:
    n = len(tracks)
    if piece.start_utc is None:
        moments = Array([None] * n, DataType.utf8())
    else:
        ns = utc_ns(piece.start_utc, tracks.time_s).astype(np.int64)
        moments = Array.from_numpy(ns).cast(DataType.timestamp("ns", tz="UTC"))
    return {
        "camera": Array([piece.camera] * n, DataType.utf8()),
        "track": Array.from_numpy(np.ascontiguousarray(tracks.track)),
        "class": Array(tracks.class_name.tolist(), DataType.utf8()),
        "time_utc": moments,
        "time_s": column(tracks.time_s, SECONDS),
        "frame": Array.from_numpy(np.ascontiguousarray(tracks.frame)),
        "observed": Array.from_numpy(np.ascontiguousarray(tracks.observed)),
    }


def _on_earth(geo: GeoAnchor, tracks: Tracks) -> dict[str, Array]:
    lonlat = geo.to_lonlat(tracks.xy_m)
    return {
        "lon_deg": column(lonlat[:, 0], DEGREES),
        "lat_deg": column(lonlat[:, 1], DEGREES),
        "azimuth_deg": column(geo.azimuth_deg(tracks.heading_rad), RADIANS),
    }


def _covariance(values: np.ndarray, name: str, axes: tuple[str, str]) -> dict[str, Array]:
    return {
        name.format(axes[i] + axes[j]): column(values[:, i, j], VARIANCE)
        for i, j in ((0, 0), (0, 1), (1, 1))
    }


FORMAT = SceneFormat("csv", "one line per row, units in the header", (_SUFFIX,), _write)
