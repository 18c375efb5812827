"""How a scene lies in its folder, and what the manifest of a run says.

    cameras/NAME.json                                     the camera's calibration
    tracks/camera=NAME/day=2009-06-01/RUN-00000.parquet   rows of that day (UTC), sorted by time
    runs/RUN.json                                   the manifest: which parts are this run
    runs/.RUN.claim, runs/.RUN/                     of a run that is being written, or was killed

A run without a manifest is not there: readers take the parts that manifests name, and no others.
"""

import re
from dataclasses import asdict, dataclass
from pathlib import Path
from typing import Any
from urllib.parse import quote

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.store.schema import COLUMNS, SCENE_SCHEMA, time_ns

_LONGEST = 200  # bytes: file systems take 255, and something is added to it
_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)


def file_name(name: str, what: str) -> str:
    """A name as part of a path, percent-encoded as Hive partitions are: ``a/b`` is ``a%2Fb``.

    Raises :class:`InputError` for an empty name, one with control characters, or one too long.
    """
    if not name or any(ord(c) < 32 or ord(c) == 127 for c in name):
        raise InputError(f"{what} {name!r}: expected a name without control characters")
    try:
        encoded = quote(name, safe="")
    except UnicodeEncodeError as error:
        raise InputError(f"{what} {name!r}: is no Unicode text") from error
    # Hidden files, parents, and the devices of Windows; "~" stays as it is anywhere else.
    if encoded[0] in ".~" or _DEVICES.fullmatch(encoded):
        encoded = f"%{ord(encoded[0]):02X}{encoded[1:]}"
    if len(encoded) > _LONGEST:
        raise InputError(
            f"{what} {name[:20]!r}...: takes {len(encoded)} bytes as a file name, expected at most "
            f"{_LONGEST}"
        )
    return encoded


@dataclass(frozen=True)
class Part:
    """One Parquet file of a run: its path below the scene's folder, and what is in it."""

    path: str
    rows: int
    bytes: int
    begin_s: float
    end_s: float


@dataclass(frozen=True)
class Run:
    """The manifest of one run over one camera's footage.

    ``start_ns`` counts from 1970 in UTC, 0 where ``start_known`` is false; the parts' times are
    seconds from that start, the last one included. Track numbers begin at ``track_base``.
    ``classes`` counts rows.
    """

    run: str
    camera: str
    start_ns: int
    start_known: bool
    track_base: int
    keypoints: int
    rows: int
    classes: dict[str, int]
    parts: tuple[Part, ...]
    software: str
    provenance: dict[str, Any]

    def to_dict(self) -> dict[str, Any]:
        """What the manifest says, as JSON."""
        readable = {
            "schema": SCENE_SCHEMA,
            "start": _iso(self.start_ns),
            "begin": _iso(self.moment_ns(min(part.begin_s for part in self.parts)))
            if self.parts
            else None,
            "end": _iso(self.moment_ns(max(part.end_s for part in self.parts)))
            if self.parts
            else None,
            "columns": [asdict(column) for column in COLUMNS],
        }
        return readable | asdict(self)

    def moment_ns(self, time_s: float) -> int:
        """Nanoseconds since 1970 of a time in this run."""
        return int(time_ns(np.array([time_s]), self.start_ns)[0])

    @classmethod
    def load(cls, path: Path) -> "Run":
        """A manifest; raises :class:`InputError` for another schema and for missing fields."""
        values = read_json(path)
        found = values.get("schema") if isinstance(values, dict) else None
        if found != SCENE_SCHEMA:
            raise InputError(
                f"{path}: schema is {found!r}, expected {SCENE_SCHEMA!r}; a newer version of "
                "scene4d may read it"
            )
        try:
            known = {name: values[name] for name in cls.__dataclass_fields__}
            known["parts"] = tuple(Part(**part) for part in known["parts"])
            return cls(**known)
        except KeyError as error:
            raise InputError(f"{path}: has no field {error}") from error
        except TypeError as error:
            raise InputError(f"{path}: parts: expected a list of parts: {error}") from error


def manifest_path(folder: Path, run: str) -> Path:
    """Where the manifest of a run lies."""
    return folder / "runs" / f"{file_name(run, 'run')}.json"


def camera_path(folder: Path, camera: str) -> Path:
    """Where the calibration of a camera lies."""
    return folder / "cameras" / f"{file_name(camera, 'camera')}.json"


def rows_folder(folder: Path, camera: str) -> Path:
    """Where the rows of a camera lie: nothing but Parquet files is below ``tracks``."""
    return folder / "tracks" / f"camera={file_name(camera, 'camera')}"


def complete_runs(folder: Path) -> tuple[Run, ...]:
    """The runs of a scene, in the order of their track numbers; none where there is no scene."""
    try:
        paths = [path for path in (folder / "runs").iterdir() if path.suffix == ".json"]
    except (FileNotFoundError, NotADirectoryError):
        return ()
    return tuple(sorted((Run.load(path) for path in paths), key=lambda run: run.track_base))


def _iso(ns: int) -> str:
    return f"{np.datetime64(ns, 'ns')}Z"
