"""Reading scenes: DuckDB filters the Parquet files, and Arrow tables come back.

Which files are read is decided by the manifests: the parts of complete runs, of the cameras and the
time that are asked for. So a month of a busy camera is never loaded for the sake of a minute.
"""

import hashlib
import os
from collections import Counter
from collections.abc import Callable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from functools import cached_property
from importlib import import_module
from pathlib import Path
from typing import Any, TypedDict, Unpack

import numpy as np
from arro3.core import DataType, Field, Table
from jaxtyping import Float

from scene4d.core.errors import InputError, UnavailableError
from scene4d.core.files import read_json
from scene4d.core.text import quoted
from scene4d.core.tracks import CLASSES, Tracks
from scene4d.store.runs import Part, Run, camera_path, complete_runs
from scene4d.store.schema import COLUMN_NAMES, COLUMNS, KEYPOINT_COLUMNS, RUN_TRACKS, from_table

_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_ALONE: dict[str, Any] = {
    # Else DuckDB fetches from the network what a query seems to need, and variables from Python.
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "python_enable_replacements": "false",
}

_Moment = datetime | float | int
"""A moment in UTC, or seconds from the start of a clip."""
_Choice = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Track and time of every row; answers the numbers of those wanted."""
_LEFT_OUT = {
    *("camera", "time", "class", "score", "shared_xx", "shared_xy", "shared_yy"),
    *KEYPOINT_COLUMNS,
}
_Rectangle = tuple[float | int, float | int, float | int, float | int]
"""x0, y0, x1, y1 on the ground, in metres."""


@dataclass(frozen=True)
class _Stored:
    """A run in its folder; ``track_offset`` keeps the tracks of several folders apart."""

    folder: Path
    run: Run
    track_offset: int


class Question(TypedDict, total=False):
    """What rows are asked for; what is left out, or None, asks for all.

    ``begin`` (included) and ``end`` (not included) are moments with a time zone, or seconds from
    the clip's start; ``classes``, ``cameras`` and ``tracks`` mean one of these; ``within_m`` is a
    rectangle (x0, y0, x1, y1) on the ground with its edges; ``observed`` says whether seen or
    bridged.
    """

    begin: _Moment | None
    end: _Moment | None
    classes: Sequence[str] | None
    cameras: Sequence[str] | None
    tracks: Sequence[int] | np.ndarray | None
    within_m: _Rectangle | None
    observed: bool | None


class Scene:
    """Who was where and when, in one folder or many; nothing is loaded before it is asked for.

    :meth:`rows` and :meth:`tracks` take the fields of :class:`Question` as keywords. They raise
    :class:`InputError` for what is not there (naming what is), for impossible ranges, and for a
    part that cannot be read or is not as it was written. Tables come as Arrow, which pandas,
    Polars, pyarrow and DuckDB take as they are; a scene itself is such a table of all its rows.
    """

    def __init__(self, stored: Sequence[_Stored], part_of: "Scene | None" = None) -> None:
        self._stored = tuple(stored)
        self._part_of = part_of

    @classmethod
    def open(cls, *scenes: "str | os.PathLike[str] | Scene") -> "Scene":
        """The complete runs in these folders, or of these scenes.

        Track numbers of the second folder and those behind it are raised, so that no two objects
        share one. Raises :class:`InputError` where there is no scene, one of another version, no
        row in all of them, or two calibrations under the name of one camera.
        """
        if not scenes:
            raise InputError("no scene is given, expected at least one")
        stored: list[_Stored] = []
        offset = 0
        for one in scenes:
            here = one._stored if isinstance(one, Scene) else _stored_in(Path(one))
            stored += [replace(run, track_offset=run.track_offset + offset) for run in here]
            offset += max(run.track_offset + run.run.track_base for run in here) + RUN_TRACKS
        folders = ", ".join(dict.fromkeys(str(run.folder) for run in stored))
        if len({(run.folder.resolve(), run.run.run) for run in stored}) < len(stored):
            raise InputError(f"{folders}: a folder is named twice")
        if not any(run.run.rows for run in stored):
            raise InputError(f"{folders}: the scene is empty: nobody was tracked")
        _check_cameras(stored)
        return cls(stored)

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras' names."""
        return tuple(sorted({one.run.camera for one in self._stored}))

    @property
    def classes(self) -> dict[str, int]:
        """The classes that are there, with their numbers of rows."""
        total: Counter[str] = Counter()
        for one in self._stored:
            total.update(one.run.classes)
        return dict(sorted(total.items()))

    @property
    def runs(self) -> tuple[Run, ...]:
        """The manifests, in the order of the rows."""
        return tuple(one.run for one in self._stored)

    def only(self, run: str) -> "Scene":
        """One of the runs, alone; raises :class:`InputError` for one that is not there."""
        _check_there([run], [one.run.run for one in self._stored], "run")
        return Scene([one for one in self._stored if one.run.run == run], self)

    def __len__(self) -> int:
        return sum(one.run.rows for one in self._stored)

    def camera_file(self, camera: str) -> Path:
        """The calibration of a camera; raises :class:`InputError` for one that is not there."""
        _check_there([camera], self.cameras, "camera")
        folder = next(one.folder for one in self._stored if one.run.camera == camera)
        return camera_path(folder, camera)

    def rows(self, *, columns: Sequence[str] | None = None, **asked: Unpack[Question]) -> Table:
        """An Arrow table of the rows, by run, then by part.

        ``columns`` names those wanted, in their order; see :mod:`scene4d.store.schema`.
        """
        names = COLUMN_NAMES if columns is None else tuple(columns)
        _check_there(names, COLUMN_NAMES, "column")
        return self._answer(asked, ", ".join(map(_name, names)))

    def tracks(self, **asked: Unpack[Question]) -> Tracks:
        """The same as :class:`Tracks`, ordered by (track, time), numbered as in the scene."""
        columns = ", ".join(map(_with_nan, COLUMNS))
        return from_table(self._answer(asked, columns, "ORDER BY track, time_s"))

    def to_pandas(self, **asked: Unpack[Question]) -> Any:
        """The same as a pandas ``DataFrame``; raises :class:`UnavailableError` without pandas."""
        try:
            pandas = import_module("pandas")
        except ImportError as error:
            raise UnavailableError("to_pandas needs pandas: pip install pandas") from error
        return pandas.DataFrame.from_arrow(self.rows(**asked))

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """All rows, for any library that speaks Arrow's C interface."""
        return self.rows().__arrow_c_stream__(requested_schema)

    def paths(self, camera: str, most: int) -> dict[int, tuple[str, Float[np.ndarray, "n 2"]]]:
        """Class and ground positions in order of time of a camera's tracks, for drawing: at most
        about ``most`` positions, evenly thinned; the first and the last of a track always.
        """
        step = max(1, -(-len(self) // most))
        found = self.sql(
            "SELECT track, class, x_m, y_m FROM scene "
            f"WHERE camera = {_text(camera)} AND x_m IS NOT NULL "
            "WINDOW w AS (PARTITION BY track ORDER BY time_s) "
            f"QUALIFY (row_number() OVER w - 1) % {step} = 0 OR lead(track) OVER w IS NULL "
            "ORDER BY track, time_s"
        )
        if not found.num_rows:
            return {}
        track = np.asarray(found["track"].to_numpy())
        xy = np.column_stack([found[name].to_numpy() for name in ("x_m", "y_m")])
        names = found["class"].to_pylist()
        starts = np.flatnonzero(np.diff(track, prepend=-1))
        return {
            int(track[start]): (names[start], part)
            for start, part in zip(starts, np.split(xy, starts[1:]), strict=True)
        }

    def track_counts(self) -> dict[str, int]:
        """Numbers of tracks by class (the one that most rows have), the most frequent first."""
        found = self.sql(
            "SELECT class, count(*) AS n FROM (SELECT mode(class) AS class FROM scene "
            "GROUP BY track) GROUP BY class ORDER BY n DESC, class"
        )
        return dict(zip(found["class"].to_pylist(), found["n"].to_pylist(), strict=True))

    def _repr_html_(self) -> str:
        from scene4d.store.notebook import scene_html

        return scene_html(self)

    def lean_tracks(self, choose: _Choice) -> Tracks:
        """All tracks without keypoints, scores and shared covariances, which take most of the room
        and time; of their rows those that ``choose`` picks, in its order, of (track, time_s).
        """
        kinds = " ".join(f"WHEN {_text(name)} THEN {code}" for code, name in enumerate(CLASSES))
        names = [_with_nan(column) for column in COLUMNS if column.name not in _LEFT_OUT]
        table = self.sql(
            f"SELECT {', '.join(names)}, (CASE class {kinds} END)::TINYINT AS class FROM scene"
        )
        track, time_s = (np.asarray(table[name].to_numpy()) for name in ("track", "time_s"))
        return from_table(table, choose(track, time_s))

    def sql(self, query: str) -> Table:
        """What DuckDB answers to a SELECT on the view ``scene``, which has all rows.

        ``scene.sql("SELECT class, count(*) FROM scene GROUP BY class")``

        A query reads nothing but the scene and writes nothing. Raises :class:`InputError` where
        DuckDB refuses it.
        """
        _check_select(query)
        parts = [(one, part) for one in self._stored for part in one.run.parts]
        with self._asking(parts) as cursor:
            cursor.execute(f"CREATE OR REPLACE TEMP VIEW scene AS {_source(parts)}")
            return _in_utc(Table.from_arrow(cursor.sql(query)))

    def _answer(self, asked: Question, columns: str, order: str = "") -> Table:
        unknown = sorted(set(asked) - Question.__annotations__.keys())
        if unknown:
            raise TypeError(
                f"unknown keyword {unknown[0]!r}; known: {', '.join(Question.__annotations__)}"
            )
        _check_range(asked.get("begin"), asked.get("end"))
        for name, there, what in (
            ("classes", self.classes, "class"),
            ("cameras", self.cameras, "camera"),
        ):
            wanted: Any = asked.get(name)
            if wanted is not None:
                _check_there(wanted, there, what)
        conditions = _conditions(asked)
        parts = self._parts(asked)
        if not parts:  # the types are those of any part
            parts = next([(one, part)] for one in self._stored for part in one.run.parts)
            conditions.append("false")
        where = " AND ".join(conditions) or "true"
        query = f"SELECT {columns} FROM ({_source(parts)}) WHERE {where} {order}"
        with self._asking(parts) as cursor:
            return _in_utc(Table.from_arrow(cursor.sql(query)))

    def _parts(self, asked: Question) -> list[tuple[_Stored, Part]]:
        """The files that can hold an answer."""
        cameras, begin, end = asked.get("cameras"), asked.get("begin"), asked.get("end")
        stored = [one for one in self._stored if cameras is None or one.run.camera in cameras]
        if any(isinstance(moment, datetime) for moment in (begin, end)):
            stored = [one for one in stored if one.run.start_known]
            if not stored:
                raise InputError(
                    "begin, end: when the footage began is not known; ask in seconds from its start"
                )
        return [
            (one, part)
            for one in stored
            for part in one.run.parts
            if _reaches(one.run, part, begin, end)
        ]

    @cached_property
    def _connection(self) -> Any:
        if self._part_of is not None:  # starting another DuckDB takes longer than a small question
            return self._part_of._connection
        import duckdb

        connection = duckdb.connect(config=_ALONE)
        folders = {str((one.folder / "tracks").absolute()) for one in self._stored}
        allowed = sorted(folders | {_pattern(folder) for folder in folders})
        connection.execute(f"SET allowed_directories = [{', '.join(map(_text, allowed))}]")
        connection.execute("SET enable_external_access = false")
        connection.execute("SET lock_configuration = true")
        return connection

    @cached_property
    def _verified(self) -> set[Path]:
        """The parts whose content was found to be what was written."""
        return set() if self._part_of is None else self._part_of._verified

    @contextmanager
    def _asking(self, parts: Sequence[tuple[_Stored, Part]]) -> Iterator[Any]:
        import duckdb

        for one, part in parts:
            path = one.folder / part.path
            _check_part(path, one.run, part, known=path in self._verified)
            self._verified.add(path)
        try:
            with self._connection.cursor() as cursor:
                yield cursor
        except (duckdb.Error, RuntimeError) as error:  # the latter where rows stop on their way
            raise InputError(f"query: {error}") from error


def _check_select(query: str) -> None:
    """Raise :class:`InputError` for anything but one SELECT."""
    import duckdb

    try:
        statements = duckdb.extract_statements(query)
    except duckdb.Error as error:
        raise InputError(f"query: {error}") from error
    if [one.type for one in statements] != [duckdb.StatementType.SELECT]:
        raise InputError(f"query: found {quoted(query)}, expected one SELECT")


def _stored_in(folder: Path) -> list[_Stored]:
    runs = complete_runs(folder)
    if not runs:
        raise InputError(f"{folder}: holds no scene: no complete run in its folder runs/")
    return [_Stored(folder, run, 0) for run in runs]


def _check_cameras(stored: Sequence[_Stored]) -> None:
    said: dict[str, tuple[Path, Any]] = {}
    for one in stored:
        path = camera_path(one.folder, one.run.camera)
        # When it was made makes it no other camera.
        told = read_json(path)
        if isinstance(told, dict):
            told = {name: value for name, value in told.items() if name != "made"}
        first, calibration = said.setdefault(one.run.camera, (path, told))
        if told != calibration:
            raise InputError(
                f"{path}: camera {one.run.camera!r} has another calibration in {first}; open these "
                "folders apart"
            )


def _check_there(wanted: Sequence[str], there: Sequence[str] | dict[str, int], what: str) -> None:
    if isinstance(wanted, str):
        raise InputError(f"{what}: found the text {wanted!r}, expected a list of names")
    if not len(wanted):
        raise InputError(f"{what}: found an empty list, expected names, or None for all")
    missing = [name for name in wanted if name not in there]
    if missing:
        raise InputError(f"{what} {missing[0]!r} is not in the scene; there: {', '.join(there)}")


def _check_range(begin: _Moment | None, end: _Moment | None) -> None:
    for name, moment in (("begin", begin), ("end", end)):
        if isinstance(moment, datetime):
            if moment.tzinfo is None:
                raise InputError(f"{name}: {moment.isoformat()} has no time zone, expected one")
        elif moment is not None and np.isnan(moment):
            raise InputError(f"{name}: is NaN, expected seconds or a moment")
    if begin is None or end is None:
        return
    if isinstance(begin, datetime) is not isinstance(end, datetime):
        raise InputError("begin, end: one is a moment, one in seconds; expected the same of both")
    if begin >= end:  # type: ignore[operator]
        raise InputError(f"begin {begin} is not before end {end}")


def _reaches(run: Run, part: Part, begin: _Moment | None, end: _Moment | None) -> bool:
    """Whether a part can have rows in a range of time."""
    first, last = (
        _ns(moment) if isinstance(moment, datetime) else moment for moment in (begin, end)
    )
    in_ns = isinstance(begin, datetime) or isinstance(end, datetime)
    part_begin = run.moment_ns(part.begin_s) if in_ns else part.begin_s
    part_end = run.moment_ns(part.end_s) if in_ns else part.end_s
    return (first is None or part_end >= first) and (last is None or part_begin < last)


def _conditions(asked: Question) -> list[str]:
    conditions = []
    for sign, moment in ((">=", asked.get("begin")), ("<", asked.get("end"))):
        if isinstance(moment, datetime):
            utc = moment.astimezone(UTC).replace(tzinfo=None).isoformat(" ")
            conditions.append(f"time {sign} '{utc}+00'::TIMESTAMPTZ_NS")
        elif moment is not None:
            conditions.append(f"time_s {sign} {_number(moment)}")
    for name, wanted in (("class", asked.get("classes")), ("camera", asked.get("cameras"))):
        if wanted is not None:
            conditions.append(f"{_name(name)} IN ({', '.join(map(_text, wanted))})")
    tracks, within_m, observed = asked.get("tracks"), asked.get("within_m"), asked.get("observed")
    if tracks is not None:
        numbers = ", ".join(str(int(track)) for track in tracks)
        conditions.append(f"track IN ({numbers})" if numbers else "false")
    if within_m is not None:
        x0, y0, x1, y1 = within_m
        if not (x0 <= x1 and y0 <= y1):
            raise InputError(f"within_m: found {within_m}, expected x0 <= x1 and y0 <= y1")
        conditions.append(f"x_m BETWEEN {_number(x0)} AND {_number(x1)}")
        conditions.append(f"y_m BETWEEN {_number(y0)} AND {_number(y1)}")
    if observed is not None:
        conditions.append("observed" if observed else "NOT observed")
    return conditions


def _source(parts: Sequence[tuple[_Stored, Part]]) -> str:
    """SQL for all rows of these parts, in their order."""
    files: dict[int, list[str]] = {}
    for one, part in parts:
        files.setdefault(one.track_offset, []).append(
            _text(_pattern(str((one.folder / part.path).absolute())))
        )
    return " UNION ALL ".join(
        f"SELECT * {f'REPLACE (track + {offset} AS track)' if offset else ''} "
        f"FROM read_parquet([{', '.join(paths)}], hive_partitioning = false)"
        for offset, paths in files.items()
    )


def _with_nan(column: Any) -> str:
    """A column as :func:`from_table` wants it."""
    name = _name(column.name)
    if column.name in KEYPOINT_COLUMNS:
        return (
            f"coalesce(list_transform({name}, lambda x: coalesce(x, 'nan'::FLOAT)), []) AS {name}"
        )
    if column.nullable:
        return f"coalesce({name}, 'nan'::DOUBLE) AS {name}"
    return name


def _check_part(path: Path, run: Run, part: Part, *, known: bool) -> None:
    """Raise :class:`InputError` where a part is not there, cannot be read or was changed; its
    content is read only where it is not ``known`` to be right.
    """
    try:
        found = path.stat().st_size
        digest = part.sha256
        if not known and found == part.bytes and digest is not None:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError as error:
        raise InputError(
            f"{path}: is not there; if run {run.run!r} was written again meanwhile, open the scene "
            "again"
        ) from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if found != part.bytes:
        raise InputError(
            f"{path}: is damaged: has {found} bytes, run {run.run!r} wrote {part.bytes}; track "
            "again"
        )
    if digest != part.sha256:
        raise InputError(
            f"{path}: is damaged: its content is not what run {run.run!r} wrote; track again"
        )


def _in_utc(table: Table) -> Table:
    """Times under the zone UTC, and not under the one of this computer."""
    utc = DataType.timestamp("ns", tz="UTC")
    for i, name in enumerate(table.column_names):
        kind = table.schema.field(name).type
        if DataType.is_timestamp(kind) and kind.tz is not None and kind != utc:
            table = table.set_column(i, Field(name, utc), table.column(i).cast(utc))
    return table


def _ns(moment: datetime) -> int:
    return (moment - _EPOCH) // timedelta(microseconds=1) * 1000


def _name(name: str) -> str:
    return '"' + name.replace('"', '""') + '"'


def _text(value: str) -> str:
    return "'" + value.replace("'", "''") + "'"


def _number(value: float | int) -> str:
    """Through text, since 0.1 is a decimal number in SQL."""
    return f"'{float(value)!r}'::DOUBLE"


def _pattern(path: str) -> str:
    """A path as the pattern that only it matches."""
    return "".join(f"[{c}]" if c in "[*?" else c for c in path)
