"""People and vehicles on the ground: positions of detections, and tracks through time."""

from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from typing import Any

import numpy as np
from jaxtyping import Bool, Float, Float32, Int

from scene4d.core.body import HALPE26
from scene4d.core.columns import Columns
from scene4d.core.errors import InputError

CLASSES: tuple[str, ...] = ("person", "bicycle", "motorcycle", "car", "truck", "bus", "vehicle")
"""Classes in a scene, with COCO's names; a ``vehicle`` is one of unknown kind."""
VEHICLES: tuple[str, ...] = CLASSES[1:]
_MOST_PATHS = 500
"""Most paths shown in a notebook; more would be megabytes of SVG."""


@dataclass(frozen=True, eq=False)
class Located(Columns):
    """Ground positions of the rows of a :class:`Detections` table, (n, ...).

    ``xy_m`` is the middle of a person or the centroid of a vehicle; ``covariance_m2`` is the
    independent part of its covariance: pixels, height and shape of the object, not the calibration
    error. All NaN where a row has no ground point. ``heading_rad`` is from +X to +Y, NaN where the
    image does not show it; ``heading_sigma_rad`` is its standard deviation, and
    ``heading_is_axis`` is true where front and back cannot be distinguished.

    What a row alone shows of the logarithms of length, width and height (metres), in information
    form: the inverse of their covariance, and its product with the values. Zero along what it does
    not show, as for all of a person but the height.
    """

    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]
    heading_rad: Float[np.ndarray, "n"]
    heading_sigma_rad: Float[np.ndarray, "n"]
    heading_is_axis: Bool[np.ndarray, "n"]
    size_pull: Float[np.ndarray, "n 3"]
    size_information: Float[np.ndarray, "n 3 3"]

    @classmethod
    def nowhere(cls, n: int) -> "Located":
        """Rows without a ground point."""
        return cls(
            np.full((n, 2), np.nan),
            np.full((n, 2, 2), np.nan),
            np.full(n, np.nan),
            np.full(n, np.nan),
            np.zeros(n, bool),
            np.zeros((n, 3)),
            np.zeros((n, 3, 3)),
        )

    @property
    def known(self) -> Bool[np.ndarray, "n"]:
        """Which rows have a ground point."""
        known: np.ndarray = np.isfinite(self.xy_m).all(axis=1)
        return known

    def put(self, rows: Bool[np.ndarray, "n"], found: "Located") -> "Located":
        """These rows with other values."""
        values = {}
        for f in fields(self):
            column = getattr(self, f.name).copy()
            column[rows] = getattr(found, f.name)
            values[f.name] = column
        return replace(self, **values)


@dataclass(frozen=True, eq=False)
class Tracks(Columns):
    """Objects through time, one row per object and moment, ordered by (track, time).

    World of the camera: metres, Z up. ``time_s`` counts from the clip's start; ``frame`` from 0.
    ``covariance_m2`` is the independent part of a position's covariance, ``shared_covariance_m2``
    the part due to calibration error, which all objects of the scene share.
    ``velocity_mps`` and ``velocity_covariance`` (m²/s²) come from smoothing, ``heading_rad`` (from
    +X to +Y) from the motion, or from the shape of a standing vehicle. Where ``observed`` is false
    the row bridges a gap, and its box and score are NaN. Positions are NaN where a detection has no
    ground point. ``existence_probability`` is that of the whole track: that it shows an object of
    its kind and not a mistake of the detector; NaN where unknown (the default).

    ``z_m`` is the height of the ground under the object and ``z_sigma_m`` its standard deviation.
    ``size_m`` is length, width and height of the whole track as known when a row became final, with
    standard deviations that include the camera's error; people have only a height. All four are NaN
    where unknown (the default).

    ``colours`` are probabilities of the names in :data:`.colours.PALETTE`, of the upper body or a
    vehicle's and then of the lower, of the whole track likewise; a half of zeros says nothing, and
    no column (the default) that nothing was read.
    """

    track: Int[np.ndarray, "n"]
    class_name: np.ndarray
    time_s: Float[np.ndarray, "n"]
    frame: Int[np.ndarray, "n"]
    xy_m: Float[np.ndarray, "n 2"]
    covariance_m2: Float[np.ndarray, "n 2 2"]
    shared_covariance_m2: Float[np.ndarray, "n 2 2"]
    velocity_mps: Float[np.ndarray, "n 2"]
    velocity_covariance: Float[np.ndarray, "n 2 2"]
    heading_rad: Float[np.ndarray, "n"]
    heading_sigma_rad: Float[np.ndarray, "n"]
    box_xyxy: Float[np.ndarray, "n 4"]
    keypoint_uv: Float[np.ndarray, "n k 2"]
    keypoint_score: Float[np.ndarray, "n k"]
    score: Float[np.ndarray, "n"]
    observed: Bool[np.ndarray, "n"]
    existence_probability: Float[np.ndarray, "n"] = None  # type: ignore[assignment]
    z_m: Float[np.ndarray, "n"] = None  # type: ignore[assignment]
    z_sigma_m: Float[np.ndarray, "n"] = None  # type: ignore[assignment]
    size_m: Float[np.ndarray, "n 3"] = None  # type: ignore[assignment]
    size_sigma_m: Float[np.ndarray, "n 3"] = None  # type: ignore[assignment]
    colours: Float[np.ndarray, "n c"] | Float32[np.ndarray, "n c"] = None  # type: ignore[assignment]

    def __post_init__(self) -> None:
        for name in ("existence_probability", "z_m", "z_sigma_m", "size_m", "size_sigma_m"):
            if getattr(self, name) is None:
                shape = (len(self.track), 3) if "size" in name else (len(self.track),)
                object.__setattr__(self, name, np.full(shape, np.nan))
        if self.colours is None:
            object.__setattr__(self, "colours", np.zeros((len(self.track), 0), np.float32))
        self.check_rows("tracks")

    @property
    def keypoint_names(self) -> tuple[str, ...]:
        """Names of the keypoints: the first of Halpe's 26, as many as there are."""
        return HALPE26[: self.keypoint_uv.shape[1]]

    def columns(self) -> dict[str, np.ndarray]:
        """1-D columns (n,) with the names used in scene files; keypoints are left out."""
        flat = {
            "track": self.track,
            "class": self.class_name.astype(str),
            "time_s": self.time_s,
            "frame": self.frame,
        }
        flat |= zip(("x_m", "y_m"), self.xy_m.T, strict=True)
        flat |= _symmetric("var_", self.covariance_m2)
        flat |= _symmetric("shared_", self.shared_covariance_m2)
        flat |= zip(("vx_mps", "vy_mps"), self.velocity_mps.T, strict=True)
        flat |= _symmetric("var_v", self.velocity_covariance)
        flat |= {"heading_rad": self.heading_rad, "heading_sigma_rad": self.heading_sigma_rad}
        flat |= zip(("x1", "y1", "x2", "y2"), self.box_xyxy.T, strict=True)
        flat |= {"score": self.score, "observed": self.observed}
        flat |= {"existence_probability": self.existence_probability}
        flat |= {"z_m": self.z_m, "z_sigma_m": self.z_sigma_m}
        flat |= zip(("length_m", "width_m", "height_m"), self.size_m.T, strict=True)
        sigmas = ("length_sigma_m", "width_sigma_m", "height_sigma_m")
        return flat | dict(zip(sigmas, self.size_sigma_m.T, strict=True))

    def to_pandas(self) -> Any:
        """The columns as a pandas DataFrame; needs pandas."""
        from scene4d.core.tables import data_frame

        return data_frame(self.columns())

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        from scene4d.core.tables import arrow_table

        return arrow_table(self.columns()).__arrow_c_stream__(requested_schema)

    def _repr_html_(self) -> str:
        from scene4d.core.notebook import beside, plan_svg

        tracks, first = np.unique(self.track, return_index=True)
        classes, counts = np.unique(self.class_name[first], return_counts=True)
        span_s = float(np.ptp(self.time_s)) if len(self) else 0.0
        rows = {"Tracks": ", ".join(f"{n} x {c}" for c, n in zip(classes, counts, strict=True))}
        rows |= {"Rows": f"{len(self):,}", "Time": f"{span_s:.1f} s"}
        names = self.class_name[first].tolist()
        shown = zip(names[:_MOST_PATHS], tracks[:_MOST_PATHS], strict=True)
        return beside(rows, plan_svg((name, self.xy_m[self.track == t]) for name, t in shown))

    @classmethod
    def concatenate(cls, parts: Sequence["Tracks"]) -> "Tracks":
        """One table from several; raises on an empty list or if the skeletons differ."""
        if not parts:
            raise InputError("tracks: nothing to concatenate")
        if len({part.keypoint_uv.shape[1] for part in parts}) > 1:
            raise InputError("tracks: the parts differ in their keypoints")
        most = max(part.colours.shape[1] for part in parts)
        return cls.joined([_with_colours(part, most) for part in parts])


def _with_colours(tracks: Tracks, columns: int) -> Tracks:
    """Zeros where nothing was read."""
    if tracks.colours.shape[1] == columns:
        return tracks
    return replace(tracks, colours=np.zeros((len(tracks), columns), np.float32))


def _symmetric(prefix: str, matrix: Float[np.ndarray, "n 2 2"]) -> dict[str, np.ndarray]:
    entries = {"xx": (0, 0), "xy": (0, 1), "yy": (1, 1)}
    return {f"{prefix}{name}": matrix[:, i, j] for name, (i, j) in entries.items()}
