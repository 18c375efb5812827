"""The rows of a run as a page needs them: by track and time, packed, and tracks in brief."""

from typing import Any

import numpy as np
from arro3.core import Table

from scene4d.app._packing import flags, integers, milliseconds, packed
from scene4d.store.query import Scene

_NUMBERS = (
    *("x_m", "y_m", "vx_mps", "vy_mps", "heading_rad"),
    *("x1", "y1", "x2", "y2"),
)
_BRIEF = (
    *("length_m", "width_m", "height_m"),
    *("length_sigma_m", "width_sigma_m", "height_sigma_m"),
    "existence_probability",
)
"""What is a track's, and repeated in its rows."""
_VARIANCES = ("xx", "xy", "yy")
_KINDS = {"own": "var_{0}", "whole": "var_{0} + COALESCE(shared_{0}, 0)"}
"""Errors of a position: what is its own, and with the camera's, which all positions share."""


def rows_of(scene: Scene, since_s: float | None = None) -> dict[str, Any]:
    """Rows of a scene of one run, from ``since_s`` on, in order of (track, time).

    Positions carry the standard deviations of their own errors, and those with the camera's.
    """
    table = scene.sql(_query(since_s))
    if not table.num_rows:
        return {"rows": 0, "tracks": []}
    track = _column(table, "track")
    starts = np.flatnonzero(np.diff(track, prepend=track[0] - 1))
    columns = {name: _column(table, name) for name in _NUMBERS}
    for kind in _KINDS:
        columns |= _spread(kind, *(_column(table, f"{kind}_{name}") for name in _VARIANCES))
    return {
        "rows": len(track),
        "starts": integers(np.append(starts, len(track))),
        "time_ms": milliseconds(_column(table, "time_s")),
        "observed": flags(_column(table, "observed")),
        "columns": packed(columns),
        "tracks": _tracks(table, track, starts),
    }


def _query(since_s: float | None) -> str:
    floats = [f"COALESCE({name}, 'NaN'::DOUBLE) AS {name}" for name in (*_NUMBERS, *_BRIEF)]
    floats += [
        f"COALESCE({sql.format(name)}, 'NaN'::DOUBLE) AS {kind}_{name}"
        for kind, sql in _KINDS.items()
        for name in _VARIANCES
    ]
    since = "" if since_s is None else f"WHERE time_s >= {float(since_s)!r}"
    names = ", ".join(["track", "class::VARCHAR AS class", "time_s", "observed", *floats])
    return f"SELECT {names} FROM scene {since} ORDER BY track, time_s"


def _column(table: Table, name: str) -> np.ndarray:
    return np.asarray(table[name].to_numpy())


def _spread(kind: str, xx: np.ndarray, xy: np.ndarray, yy: np.ndarray) -> dict[str, np.ndarray]:
    """Covariances as two standard deviations and their correlation."""
    sigma_x, sigma_y = np.sqrt(np.maximum(xx, 0)), np.sqrt(np.maximum(yy, 0))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.clip(xy / (sigma_x * sigma_y), -1, 1)
    known = np.isfinite(sigma_x)
    correlation = np.where(known & ~np.isfinite(correlation), 0.0, correlation)
    return {f"{kind}_x": sigma_x, f"{kind}_y": sigma_y, f"{kind}_correlation": correlation}


def _tracks(table: Table, track: np.ndarray, starts: np.ndarray) -> list[dict[str, Any]]:
    """Number, class and what is known of each track's size, as in its last row."""
    last = np.append(starts[1:], len(track)) - 1
    names = table["class"].to_pylist()
    brief = {name: _column(table, name)[last] for name in _BRIEF}
    return [
        {
            "track": int(track[row]),
            "class": names[row],
            **{
                name: round(float(values[number]), 4)
                for name, values in brief.items()
                if np.isfinite(values[number])
            },
        }
        for number, row in enumerate(last.tolist())
    ]
