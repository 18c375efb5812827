"""``site.json``: where the cameras of a site stand, and which scenes they tracked.

    {"schema": "scene4d/site/1", "start": "2026-11-20T08:00:00Z", "start_ns": .., "cameras": {NAME:
     {"scene": FOLDER, "camera": FILE, "name": .., "runs": [..],
      "tracked": {RUN: {"parts": .., "sha256": ..}}, "x_m": .., "y_m": .., "heading_deg": ..,
      "scale": .., "time_offset_s": .., "sigma": {..}, "covariance": 5x5, "clock_drift": null,
      "status": "ok"}}, "anchor": null, "identities": FILE,
     "errors": {"cameras": [..], "parameters": [..], "matrix": 12n x 12n}}

Paths are relative to the site's folder where they can be. Names of ``identities`` and of refined
calibrations change with the site, so that a new one stands beside the old one until this file,
which is replaced in one step, names the new. ``name`` is the camera's in its scene. ``tracked`` is
what the runs held when the site was made, so that one that was tracked again is noticed; sites of
earlier versions lack it.
An undetermined camera has ``reason`` and no numbers. ``start`` is the zero of the site's clock,
null where no camera's is known: the clock of a camera counts from there if the start of its footage
is known, else from the beginning of its clip. ``clock_drift`` is null where the clocks run alike as
far as the footage tells, else ``{"ppm": .., "sigma_ppm": .., "at_s": ..}``: by how much the
camera's clock is slow, and the time of that clock at which the offset holds. ``anchor`` is null, or
``{"kind": .., "residual_m": [..], ..}``, or where lines of a map leave the place open
``{"kind": .., "status": "undetermined", "reason": ..}``; the site has a frame of its own then.
``errors`` is the covariance of all places and calibrations together
(:mod:`scene4d.store.site_errors`); without it cameras are taken to err independently.
"""

import os
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any, Literal

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.core.placement import PLACED, Drift, Placement
from scene4d.store.runs import Tracked
from scene4d.store.site_errors import SiteErrors

SITE_SCHEMA = "scene4d/site/1"
"""Name and version of the file, and the only one that is read."""
SITE_FILE = "site.json"
_IDENTITIES = "identities.parquet"
"""Name of that file where none is given."""
_DEGREES = 180 / np.pi
_PPM = 1e6
_KINDS = ("earth", "plan", "cameras")
_FIELDS = ("x_m", "y_m", "heading_deg", "scale", "time_offset_s")


def is_site(path: str | os.PathLike[str]) -> bool:
    """Whether this is the folder of a site."""
    return (Path(path) / SITE_FILE).is_file()


@dataclass(frozen=True)
class SiteAnchor:
    """What the site's frame is tied to.

    ``earth``: +X is east and +Y north of ``latitude_deg``, ``longitude_deg`` (WGS 84, azimuthal
    equidistant). ``plan``: metres of a floor plan. ``cameras``: the world of cameras that were
    known. ``residual_m`` says how far each point lies from where all together put it. Lines of a
    map that do not determine the frame make it false, with a ``reason``.
    """

    kind: Literal["earth", "plan", "cameras"]
    residual_m: tuple[float, ...] = ()
    latitude_deg: float | None = None
    longitude_deg: float | None = None
    reason: str | None = None

    def __bool__(self) -> bool:
        return self.reason is None

    def to_dict(self) -> dict[str, Any]:
        """The field ``anchor``."""
        if not self:
            return {"kind": self.kind, "status": "undetermined", "reason": self.reason}
        said: dict[str, Any] = {"kind": self.kind, "residual_m": list(self.residual_m)}
        if self.kind == "earth":
            said |= {"latitude_deg": self.latitude_deg, "longitude_deg": self.longitude_deg}
        return said


@dataclass(frozen=True, eq=False)
class SiteCamera:
    """A camera of a site: the folder of its scene, the name that it has there, which of its runs
    and what they held (None where that is not known), the calibration file whose ground was placed,
    and its placement.
    """

    scene: Path
    camera: Path
    name: str
    runs: tuple[str, ...]
    placement: Placement
    tracked: dict[str, Tracked] | None = None


@dataclass(frozen=True, eq=False)
class SiteFile:
    """The content of ``site.json``; ``start_ns`` is None where no clock is known, ``errors`` where
    it is not told what the cameras err by together. ``identities`` is the name of their file.
    """

    cameras: dict[str, SiteCamera]
    start_ns: int | None = None
    anchor: SiteAnchor | None = None
    errors: SiteErrors | None = None
    identities: str = _IDENTITIES

    def to_dict(self, folder: Path) -> dict[str, Any]:
        """For JSON in ``folder``."""
        start = None if self.start_ns is None else f"{np.datetime64(self.start_ns, 'ns')}Z"
        return {
            "schema": SITE_SCHEMA,
            "start": start,
            "start_ns": self.start_ns,
            "cameras": {name: _told(one, folder) for name, one in self.cameras.items()},
            "anchor": None if self.anchor is None else self.anchor.to_dict(),
            "errors": None if self.errors is None else self.errors.to_dict(),
            "identities": self.identities,
        }

    @classmethod
    def load(cls, folder: Path) -> "SiteFile":
        """Read a site's file; raises :class:`InputError` naming the file and the field."""
        if not (folder / SITE_FILE).exists():
            raise InputError(f"{folder}: holds no site: no {SITE_FILE}; make one with align")
        said = JsonObject.read(folder / SITE_FILE, SITE_SCHEMA)
        start_ns = said.value("start_ns")
        if start_ns is not None and not (type(start_ns) is int and abs(start_ns) < 2**63):
            raise said.error("start_ns", "nanoseconds since 1970 in 64 bits, or null")
        told = said.object("cameras")
        cameras = {name: _camera(told.object(name), folder) for name in told.names()}
        if not cameras:
            raise said.error("cameras", "one camera or more")
        identities = said.text("identities") if "identities" in said else _IDENTITIES
        if not identities.endswith(".parquet") or {*"/\\:"} & {*identities}:
            raise said.error("identities", "a file in this folder, such as identities.parquet")
        anchor = _anchor(said.object("anchor")) if "anchor" in said else None
        placed = [name for name, one in cameras.items() if one.placement]
        errors = SiteErrors.read(said.object("errors"), placed) if "errors" in said else None
        return cls(cameras, start_ns, anchor, errors, identities)


def _told(one: SiteCamera, folder: Path) -> dict[str, Any]:
    said: dict[str, Any] = {
        "scene": _relative(one.scene, folder),
        "camera": _relative(one.camera, folder),
        "name": one.name,
        "runs": list(one.runs),
    }
    if one.tracked is not None:
        said["tracked"] = {run: asdict(held) for run, held in one.tracked.items()}
    placed = one.placement
    if not placed:
        return said | {"status": placed.status, "reason": placed.reason}
    heading_deg = placed.heading_rad * _DEGREES
    numbers = (placed.x_m, placed.y_m, heading_deg, placed.scale, placed.time_offset_s)
    sigma = placed.sigma
    sigma["heading_deg"] = sigma.pop("heading_rad") * _DEGREES
    return said | {
        **dict(zip(_FIELDS, numbers, strict=True)),
        "sigma": {name: sigma[name] for name in _FIELDS},
        "covariance": {"parameters": list(PLACED), "matrix": placed.covariance.tolist()},
        "clock_drift": None
        if placed.drift is None
        else {
            "ppm": placed.drift.rate * _PPM,
            "sigma_ppm": placed.drift.sigma * _PPM,
            "at_s": placed.drift.at_s,
        },
        "status": placed.status,
    }


def _camera(said: JsonObject, folder: Path) -> SiteCamera:
    runs = said.texts("runs")
    if len(set(runs)) < len(runs):
        raise said.error("runs", "names that differ")
    tracked = said.object("tracked") if "tracked" in said else None
    return SiteCamera(
        scene=folder / said.text("scene"),
        camera=folder / said.text("camera"),
        name=said.text("name"),
        runs=runs,
        placement=_placement(said),
        tracked=None
        if tracked is None
        else {run: Tracked.read(tracked.object(run)) for run in runs},
    )


def _placement(said: JsonObject) -> Placement:
    status = said.text("status")
    if status == "undetermined":
        return Placement.undetermined(said.text("reason"))
    if status != "ok":
        raise said.error("status", "'ok' or 'undetermined'")
    x_m, y_m, heading_deg = (said.number(name) for name in _FIELDS[:3])
    scale, offset_s = said.number("scale", above=0.0), said.number("time_offset_s")
    told = said.object("covariance")
    if told.texts("parameters") != PLACED:
        raise told.error("parameters", f"{', '.join(PLACED)}")
    covariance = told.array("matrix", 5, 5)
    if not np.allclose(covariance, covariance.T) or np.linalg.eigvalsh(covariance)[0] < -1e-6:
        raise told.error("matrix", "that of a covariance: symmetric, and no negative variance")
    drift = _drift(said.object("clock_drift")) if "clock_drift" in said else None
    heading_rad = heading_deg / _DEGREES
    return Placement(x_m, y_m, heading_rad, scale, offset_s, covariance, drift=drift)


def _drift(said: JsonObject) -> Drift:
    ppm, sigma = said.number("ppm", above=-_PPM), said.number("sigma_ppm", least=0.0)
    return Drift(ppm / _PPM, sigma / _PPM, said.number("at_s"))


def _anchor(said: JsonObject) -> SiteAnchor:
    kind = said.text("kind")
    if kind not in _KINDS:
        raise said.error("kind", " or ".join(map(repr, _KINDS)))
    if "reason" in said:
        return SiteAnchor(kind, reason=said.text("reason"))  # type: ignore[arg-type]
    residual_m = tuple(said.array("residual_m", None).tolist())
    if kind != "earth":
        return SiteAnchor(kind, residual_m)  # type: ignore[arg-type]
    latitude = said.number("latitude_deg", least=-90.0, most=90.0)
    return SiteAnchor("earth", residual_m, latitude, said.number("longitude_deg"))


def _relative(path: Path, folder: Path) -> str:
    """The way from the site to a path; the whole path where there is none (another drive)."""
    try:
        return Path(os.path.relpath(path.resolve(), folder.resolve())).as_posix()
    except ValueError:
        return path.resolve().as_posix()
