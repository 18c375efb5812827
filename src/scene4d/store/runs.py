"""The folder layout of a scene, and the manifest of a run.

    cameras/NAME.json                                     the camera's calibration
    tracks/camera=NAME/day=2009-06-01/RUN-00000.parquet   rows of that day (UTC), sorted by time
    runs/RUN.json                                         the manifest: which parts are this run
    runs/.RUN.claim, runs/.RUN.lock, runs/.RUN/           of a run that is being written

A run without a manifest does not exist: readers use only the parts that manifests name.
"""

import hashlib
import re
from dataclasses import asdict, dataclass
from datetime import UTC, datetime, timedelta
from pathlib import Path, PurePosixPath
from typing import Any
from urllib.parse import quote

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.json_object import JsonObject
from scene4d.store.schema import COLUMNS, LONGEST_S, SCENE_SCHEMA, time_ns

_LONGEST = 200
"""Bytes of a name in a path: file systems allow 255, and suffixes are added to it."""
_DEVICES = re.compile(r"(con|prn|aux|nul|com\d|lpt\d)(\..*)?", re.IGNORECASE)
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_MOST_NS = 2**63
Watched = tuple[float, float, int, int]
"""From when to when (s) footage was looked at, and the first and last frame."""
_SHA256 = re.compile(r"[0-9a-f]{64}")


def file_name(name: str, what: str) -> str:
    """A name as part of a path, percent-encoded like Hive partitions: ``a/b`` is ``a%2Fb``.

    A long name is shortened and gets its hash appended; the result is longer than any name that is
    not shortened, so the two never clash. Raises :class:`InputError` for an empty name or one with
    control characters.
    """
    if not name or any(ord(c) < 32 or ord(c) == 127 for c in name):
        raise InputError(f"{what} {name!r}: expected a name without control characters")
    try:
        encoded = quote(name, safe="")
    except UnicodeEncodeError as error:
        raise InputError(f"{what} {name!r}: is not Unicode text") from error
    # Hidden files, parent folders, and Windows device names; "~" is kept elsewhere.
    if encoded[0] in ".~" or _DEVICES.fullmatch(encoded):
        encoded = f"%{ord(encoded[0]):02X}{encoded[1:]}"
    if len(encoded) > _LONGEST:
        whole = re.sub(r"%[0-9A-F]?$", "", encoded[: _LONGEST - 10])
        encoded = f"{whole}~{hashlib.sha256(name.encode()).hexdigest()[:16]}"
    return encoded


@dataclass(frozen=True)
class Part:
    """One Parquet file of a run: its path below the scene's folder, and its content.

    ``sha256`` is the file's hash; None in scenes of version 0.1, whose parts are not verified.
    """

    path: str
    rows: int
    bytes: int
    begin_s: float
    end_s: float
    sha256: str | None = None

    @property
    def is_hidden(self) -> bool:
        """Whether it is a stream's newest part, which is replaced as it grows."""
        return PurePosixPath(self.path).name.startswith(".")


@dataclass(frozen=True)
class Tracked:
    """What a run held at some time: the number of its parts that change no more, and the SHA-256 of
    theirs. A stream that grows adds parts; one that is tracked again has others.
    """

    parts: int
    sha256: str

    @classmethod
    def read(cls, said: JsonObject) -> "Tracked":
        """From JSON; raises :class:`InputError` naming the field."""
        if not _SHA256.fullmatch(sha256 := said.text("sha256")):
            raise said.error("sha256", "64 hexadecimal digits")
        return cls(said.integer("parts", least=0), sha256)


@dataclass(frozen=True)
class Run:
    """The manifest of one run over one camera's footage.

    ``start_ns`` is nanoseconds since 1970 in UTC, 0 if ``start_known`` is false. The parts' times
    are seconds from that start, end included. Track numbers begin at ``track_base``. ``classes``
    counts rows per class, ``keypoints`` is the number of keypoints per row. ``watched`` are the
    spans in which footage was looked at, also where nobody was there: begin and end (s), and their
    frames; None where it is not known. ``lacks`` names columns that its parts were written without,
    by an earlier version.
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
    lacks: tuple[str, ...] = ()
    watched: tuple[Watched, ...] | None = None

    @property
    def start(self) -> datetime | None:
        """When the clip began, UTC; None if unknown."""
        return moment(self.start_ns) if self.start_known else None

    @property
    def span_s(self) -> tuple[float, float] | None:
        """Times of the first and last row; None if there are none."""
        if not self.parts:
            return None
        return min(part.begin_s for part in self.parts), max(part.end_s for part in self.parts)

    def tracked(self, parts: int | None = None) -> Tracked:
        """What it holds by now, or held when it had so many parts."""
        held = [one for one in self.parts if not one.is_hidden][:parts]
        said = "".join(f"{one.rows} {one.sha256}\n" for one in held)
        return Tracked(len(held), hashlib.sha256(said.encode()).hexdigest())

    def to_dict(self) -> dict[str, Any]:
        """The manifest's content for JSON."""
        begin, end = (_iso(self.moment_ns(s)) for s in self.span_s) if self.span_s else (None, None)
        readable = {
            "schema": SCENE_SCHEMA,
            "start": _iso(self.start_ns),
            "begin": begin,
            "end": end,
            "columns": [asdict(column) for column in COLUMNS if column.name not in self.lacks],
        }
        said = readable | asdict(self)
        del said["lacks"]
        return said

    def moment(self, time_s: float) -> datetime | None:
        """The time of day of a time in this run, UTC; None if its start is not known."""
        return moment(self.moment_ns(time_s)) if self.start_known else None

    def moment_ns(self, time_s: float) -> int:
        """Nanoseconds since 1970 of a time in this run."""
        return int(time_ns(np.array([time_s]), self.start_ns)[0])

    @classmethod
    def load(cls, path: Path) -> "Run":
        """Read a manifest; raises :class:`InputError` naming a missing or wrong field."""
        said = JsonObject.read(path, SCENE_SCHEMA)
        classes = said.object("classes")
        start_ns = said.value("start_ns")
        if type(start_ns) is not int or not -_MOST_NS < start_ns < _MOST_NS:
            raise said.error("start_ns", "nanoseconds since 1970 in 64 bits")
        said.object("provenance")
        columns = [one.text("name") for one in said.objects("columns")]
        return cls(
            run=said.text("run"),
            camera=said.text("camera"),
            start_ns=start_ns,
            start_known=said.flag("start_known"),
            track_base=said.integer("track_base", least=0),
            keypoints=said.integer("keypoints", least=0),
            rows=said.integer("rows", least=0),
            classes={name: classes.integer(name, least=0) for name in classes.names()},
            parts=tuple(map(_part, said.objects("parts"))),
            software=said.text("software"),
            provenance=said.value("provenance"),
            watched=_watched(said)
            if "watched" in said and said.value("watched") is not None
            else None,
            lacks=tuple(one.name for one in COLUMNS if one.nullable and one.name not in columns),
        )


def _watched(said: JsonObject) -> tuple[Watched, ...]:
    """Spans in which footage was looked at, one after the other."""
    spans = said.array("watched", None, 4)
    times = spans[:, :2].ravel()
    if not (np.isfinite(spans).all() and (np.diff(times) >= 0).all()):
        raise said.error("watched", "spans of times and frames, in their order")
    return tuple((float(a), float(b), int(c), int(d)) for a, b, c, d in spans)


def _part(said: JsonObject) -> Part:
    """One part; its path stays below the scene's ``tracks``."""
    path = said.text("path")
    steps = PurePosixPath(path).parts
    if "\\" in path or ":" in path or ".." in steps or steps[:1] != ("tracks",):
        raise said.error("path", "a path below the scene's folder tracks/")
    sha256 = said.text("sha256") if "sha256" in said else None
    if sha256 is not None and not _SHA256.fullmatch(sha256):
        raise said.error("sha256", "64 hexadecimal digits")
    begin_s = said.number("begin_s", least=-LONGEST_S, most=LONGEST_S)
    return Part(
        path=path,
        rows=said.integer("rows", least=0),
        bytes=said.integer("bytes", least=0),
        begin_s=begin_s,
        end_s=said.number("end_s", least=begin_s, most=LONGEST_S),
        sha256=sha256,
    )


def moment(ns: int) -> datetime:
    """The moment (UTC) of nanoseconds since 1970, to the microsecond."""
    return _EPOCH + timedelta(microseconds=round(ns / 1000))


def since_1970_ns(when: datetime) -> int:
    """The opposite of :func:`moment`."""
    return (when - _EPOCH) // timedelta(microseconds=1) * 1000


def iso_ms(when: datetime) -> str:
    """A moment of UTC as RFC 3339, to the millisecond."""
    return when.isoformat(timespec="milliseconds").replace("+00:00", "Z")


def manifest_path(folder: Path, run: str) -> Path:
    """Path of a run's manifest."""
    return folder / "runs" / f"{file_name(run, 'run')}.json"


def camera_path(folder: Path, camera: str) -> Path:
    """Path of a camera's calibration."""
    return folder / "cameras" / f"{file_name(camera, 'camera')}.json"


def camera_identity(calibration: Any) -> Any:
    """What makes a stored calibration this one; when and by what it was made does not."""
    if not isinstance(calibration, dict):
        return calibration
    return {name: value for name, value in calibration.items() if name != "made"}


def rows_folder(folder: Path, camera: str) -> Path:
    """Folder of a camera's rows; ``tracks`` contains only Parquet files."""
    return folder / "tracks" / f"camera={file_name(camera, 'camera')}"


def complete_runs(folder: Path) -> tuple[Run, ...]:
    """The runs of a scene, in the order of their track numbers; none if there is no scene."""
    try:
        paths = [path for path in (folder / "runs").iterdir() if path.suffix == ".json"]
    except (FileNotFoundError, NotADirectoryError):
        return ()
    return tuple(sorted((Run.load(path) for path in paths), key=lambda run: run.track_base))


def has_begun(folder: Path) -> bool:
    """Whether a folder without a complete run may become a scene: it is empty, or somebody writes
    there.
    """
    begun = any((folder / name).is_dir() for name in ("runs", "status", "alerts"))
    return begun or (folder.is_dir() and not any(folder.iterdir()))


def _iso(ns: int) -> str:
    return f"{np.datetime64(ns, 'ns')}Z"
