"""The rows of a run as a page needs them: by track and time, packed, and tracks in brief."""

from typing import Any

import numpy as np
from jaxtyping import Float, Int

from scene4d.app._packing import flags, integers, milliseconds, packed
from scene4d.core.colours import PALETTE
from scene4d.core.tracks import Tracks

_SIZES = ("length_m", "width_m", "height_m")
_SIGMAS = ("length_sigma_m", "width_sigma_m", "height_sigma_m")


def rows_of(tracks: Tracks) -> dict[str, Any]:
    """Rows in order of (track, time).

    Positions carry the standard deviations of their own errors, and those with the camera's.
    """
    if not len(tracks):
        return {"rows": 0, "tracks": []}
    starts = np.flatnonzero(np.diff(tracks.track, prepend=tracks.track[0] - 1))
    columns = _named("x_m y_m", tracks.xy_m) | _named("vx_mps vy_mps", tracks.velocity_mps)
    columns |= {"heading_rad": tracks.heading_rad} | _named("x1 y1 x2 y2", tracks.box_xyxy)
    columns |= _spread("own", tracks.covariance_m2)
    shared = np.nan_to_num(tracks.shared_covariance_m2)
    columns |= _spread("whole", tracks.covariance_m2 + shared)
    return {
        "rows": len(tracks),
        "starts": integers(np.append(starts, len(tracks))),
        "time_ms": milliseconds(tracks.time_s),
        "observed": flags(tracks.observed),
        "columns": packed(columns),
        "tracks": _brief(tracks, starts),
    }


def _named(names: str, values: Float[np.ndarray, "n k"]) -> dict[str, np.ndarray]:
    return dict(zip(names.split(), values.T, strict=True))


def _spread(kind: str, covariance: Float[np.ndarray, "n 2 2"]) -> dict[str, np.ndarray]:
    """Covariances as two standard deviations and their correlation."""
    x, y = (np.sqrt(np.maximum(covariance[:, axis, axis], 0)) for axis in (0, 1))
    with np.errstate(invalid="ignore", divide="ignore"):
        correlation = np.clip(covariance[:, 0, 1] / (x * y), -1, 1)
    correlation = np.where(np.isfinite(x) & ~np.isfinite(correlation), 0.0, correlation)
    return {f"{kind}_x": x, f"{kind}_y": y, f"{kind}_correlation": correlation}


def _colours(of_track: np.ndarray) -> list[list[Any] | None]:
    """The likeliest colour of the upper body (or a vehicle) and of the lower, with its probability;
    None for a part of which nothing is known.
    """
    found: list[list[Any] | None] = []
    for part in of_track.reshape(-1, len(PALETTE)):
        best = int(np.argmax(part))
        found.append([PALETTE[best], round(float(part[best]), 2)] if part[best] > 0 else None)
    return found


def _brief(tracks: Tracks, starts: Int[np.ndarray, "t"]) -> list[dict[str, Any]]:
    """Number, class and what is known of each track's size, as in its last row."""
    last = np.append(starts[1:], len(tracks)) - 1
    known = dict(zip(_SIZES, tracks.size_m[last].T, strict=True))
    known |= dict(zip(_SIGMAS, tracks.size_sigma_m[last].T, strict=True))
    known |= {"existence_probability": tracks.existence_probability[last]}
    return [
        {
            "track": int(tracks.track[row]),
            "class": str(tracks.class_name[row]),
            **{
                name: round(float(values[number]), 4)
                for name, values in known.items()
                if np.isfinite(values[number])
            },
            "colours": _colours(tracks.colours[row]),
        }
        for number, row in enumerate(last.tolist())
    ]
