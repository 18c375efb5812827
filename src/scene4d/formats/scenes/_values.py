"""What several formats say in the same way: numbers, times, errors."""

import io
import json
from collections.abc import Iterator
from datetime import UTC, datetime
from typing import Any

import numpy as np
from arro3.core import Array, DataType, Table
from arro3.io import write_csv
from jaxtyping import Float

from scene4d.core.tracks import Tracks

METRES, DEGREES, RADIANS, SECONDS, PIXELS = 4, 9, 6, 9, 3
"""Decimals: a tenth of a millimetre (on the ground and on the Earth), a nanosecond, 1/1000 px."""
SPEED, SCORE, VARIANCE = 4, 4, 8
ROWS_AT_ONCE = 65_536


def utc_ns(start: datetime, time_s: Float[np.ndarray, "n"]) -> np.ndarray:
    """Moments (datetime64, ns, UTC) of seconds after ``start``."""
    base = np.datetime64(start.astimezone(UTC).replace(tzinfo=None), "ns")
    moments: np.ndarray = base + np.round(time_s * 1e9).astype("timedelta64[ns]")
    return moments


def utc_text(start: datetime, time_s: Float[np.ndarray, "n"]) -> list[str]:
    """Moments as RFC 3339 in UTC, with 0, 3, 6 or 9 decimals of the second, as needed."""
    texts = np.datetime_as_string(utc_ns(start, time_s), unit="ns").tolist()
    for _ in range(3):
        texts = [text.removesuffix("000") for text in texts]
    return [f"{text.removesuffix('.')}Z" for text in texts]


def rounded(values: np.ndarray, decimals: int) -> np.ndarray:
    """Rounded, and without the negative zero."""
    short: np.ndarray = np.round(values, decimals) + 0.0
    return short


def compact(values: dict[str, Any]) -> str:
    """JSON without spaces."""
    return json.dumps(values, ensure_ascii=False, allow_nan=False, separators=(",", ":"))


def json_numbers(values: np.ndarray, decimals: int) -> list[Any]:
    """Rounded numbers as a (nested) list, None where they are not finite."""
    short = rounded(values, decimals)
    unknown = ~np.isfinite(short)
    if not unknown.any():
        return short.tolist()
    objects = short.astype(object)
    objects[unknown] = None
    return objects.tolist()


def speed_mps(tracks: Tracks) -> Float[np.ndarray, "n"]:
    """Speed on the ground, NaN where unknown."""
    return np.hypot(*tracks.velocity_mps.T)


def sigma_m(tracks: Tracks) -> Float[np.ndarray, "n"]:
    """Root-mean-square error of the positions, the camera's own included; NaN where unknown."""
    total = tracks.covariance_m2 + tracks.shared_covariance_m2
    sigma: np.ndarray = np.sqrt(np.trace(total, axis1=1, axis2=2))
    return sigma


def sizes(track: Tracks) -> dict[str, float | None]:
    """Length, width and height of a track in metres, and their standard deviations, as last known;
    None where they are not.
    """
    known = np.isfinite(track.size_m[:, 2])
    last = track.select(np.flatnonzero(known)[-1:] if known.any() else np.array([0]))
    found = np.stack([last.size_m[0], last.size_sigma_m[0]], axis=1)
    names = ("length_m", "length_sigma_m", "width_m", "width_sigma_m", "height_m", "height_sigma_m")
    return dict(zip(names, json_numbers(found.ravel(), METRES), strict=True))


def column(values: np.ndarray, decimals: int) -> Array:
    """A column of numbers for :func:`csv_lines`; what is not finite becomes empty."""
    short = rounded(values, decimals)
    unknown = ~np.isfinite(short)
    if not unknown.any():
        return Array.from_numpy(np.ascontiguousarray(short))
    objects = short.astype(object)
    objects[unknown] = None
    return Array(objects.tolist(), DataType.float64())


def csv_lines(columns: dict[str, Array], *, header: bool) -> bytes:
    """Lines of comma-separated values, quoted where needed (RFC 4180, ended by a line feed)."""
    buffer = io.BytesIO()
    write_csv(Table.from_pydict(columns), buffer, header=header)
    return buffer.getvalue()


def chunks(tracks: Tracks) -> Iterator[Tracks]:
    """The rows in pieces that fit into memory as text."""
    for first in range(0, len(tracks), ROWS_AT_ONCE):
        yield tracks.select(np.arange(first, min(first + ROWS_AT_ONCE, len(tracks))))
