"""Reading scenes: DuckDB filters the Parquet files and returns Arrow tables.

The manifests decide which files are read: the parts of complete runs for the requested cameras and
time. So a query for one minute never loads a month of a busy camera.
"""

import os
from collections import Counter
from collections.abc import Callable, Collection, Iterable, Iterator, Sequence
from contextlib import contextmanager
from dataclasses import replace
from datetime import datetime
from functools import cached_property
from pathlib import Path
from typing import Any, Unpack

import numpy as np
from arro3.core import DataType, Field, Table
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.tables import data_frame
from scene4d.core.text import quoted
from scene4d.core.tracks import CLASSES, Tracks
from scene4d.store._parts import GoneError, Parts, check_parts, check_parts_there, renewed
from scene4d.store._question import (
    Question,
    Stored,
    check_range,
    check_select,
    check_there,
    conditions_of,
    name_sql,
    pattern_of,
    reaches,
    source_of,
    text_sql,
    with_nan,
)
from scene4d.store.runs import (
    Run,
    camera_identity,
    camera_path,
    complete_runs,
    has_begun,
)
from scene4d.store.schema import (
    COLUMN_NAMES,
    COLUMNS,
    GROUPS,
    KEYPOINT_COLUMNS,
    RUN_TRACKS,
    from_table,
)

_ALONE: dict[str, Any] = {
    # Otherwise DuckDB downloads extensions that a query seems to need, and reads Python variables.
    "autoinstall_known_extensions": "false",
    "autoload_known_extensions": "false",
    "python_enable_replacements": "false",
}

_MOST_SHOWN = 4000
"""Positions in a notebook's plan; more cannot be distinguished."""
_Choice = Callable[[np.ndarray, np.ndarray], np.ndarray]
"""Takes track and time of every row, returns the numbers of the rows wanted."""
_LEAN = ("track", "time_s", "frame", "observed", "x_m", "y_m", "var_xx", "var_xy", "var_yy")


class Scene:
    """The tracks in one or more scene folders; rows are loaded only when requested.

    :meth:`rows` and :meth:`tracks` take the fields of :class:`Question` as keywords. They raise
    :class:`InputError` for a name that does not exist (listing those that do), an impossible
    range, or a part that is unreadable or damaged. Tables are Arrow, which pandas, Polars, pyarrow
    and DuckDB accept directly; a scene itself can be passed as the Arrow table of all its rows.
    """

    def __init__(self, stored: Sequence[Stored], part_of: "Scene | None" = None) -> None:
        self._stored = tuple(stored)
        self._part_of = part_of

    @classmethod
    def open(cls, *scenes: "str | os.PathLike[str] | Scene") -> "Scene":
        """The complete runs in these folders, or of these scenes.

        Track numbers of the second and later folders are offset, so that no two objects share a
        number. Raises :class:`InputError` if there is no scene, a scene has another version, all
        are empty, or one camera name has two calibrations.
        """
        stored = _stored_of(scenes)
        if not any(run.run.rows for run in stored):
            folders = ", ".join(dict.fromkeys(str(run.folder) for run in stored))
            raise InputError(f"{folders}: the scene is empty: nobody was tracked")
        return cls(stored)

    @classmethod
    def growing(cls, *scenes: str | os.PathLike[str]) -> "Scene":
        """As :meth:`open`, of folders that may still fill: those that are empty, and those in which
        a run has begun, are scenes too. Its rows can be asked for once there are any.
        """
        return cls(_stored_of(scenes, growing=True))

    @property
    def cameras(self) -> tuple[str, ...]:
        """The cameras' names."""
        return tuple(sorted({one.run.camera for one in self._stored}))

    @property
    def classes(self) -> dict[str, int]:
        """The classes in the scene, with their numbers of rows."""
        total: Counter[str] = Counter()
        for one in self._stored:
            total.update(one.run.classes)
        return dict(sorted(total.items()))

    @property
    def runs(self) -> tuple[Run, ...]:
        """The manifests, in the order of the rows."""
        return tuple(one.run for one in self._stored)

    @property
    def numbers(self) -> int:
        """How many track numbers are reserved for the scene's runs."""
        bases = (one.track_offset + one.run.track_base for one in self._stored)
        return max(bases, default=-RUN_TRACKS) + RUN_TRACKS

    def only(self, *runs: str) -> "Scene":
        """A scene of one or more of the runs; raises :class:`InputError` for an unknown run."""
        check_there(runs, [one.run.run for one in self._stored], "run")
        return Scene([one for one in self._stored if one.run.run in runs], self)

    def __len__(self) -> int:
        return sum(one.run.rows for one in self._stored)

    def camera_file(self, camera: str) -> Path:
        """The calibration file of a camera; raises :class:`InputError` for an unknown camera."""
        check_there([camera], self.cameras, "camera")
        folder = next(one.folder for one in self._stored if one.run.camera == camera)
        return camera_path(folder, camera)

    def rows(self, *, columns: Sequence[str] | None = None, **asked: Unpack[Question]) -> Table:
        """An Arrow table of the matching rows, ordered by run, then by part.

        ``columns`` names the columns wanted, in order; see :mod:`scene4d.store.schema`.
        """
        names = COLUMN_NAMES if columns is None else tuple(columns)
        check_there(names, COLUMN_NAMES, "column")
        return self._answer(asked, ", ".join(map(name_sql, names)))

    def tracks(self, *, keypoints: bool = True, **asked: Unpack[Question]) -> Tracks:
        """The same as :class:`Tracks`, ordered by (track, time), numbered as in the scene; without
        ``keypoints``, which are most of what is read, where they are not wanted.
        """
        wanted = [one for one in COLUMNS if keypoints or one.name not in KEYPOINT_COLUMNS]
        columns = ", ".join(map(with_nan, wanted))
        return from_table(self._answer(asked, columns, "ORDER BY track, time_s"))

    def to_pandas(self, **asked: Unpack[Question]) -> Any:
        """The same as a pandas ``DataFrame``; raises :class:`UnavailableError` without pandas."""
        return data_frame(self.rows(**asked))

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        """All rows, for any library that supports Arrow's C stream interface."""
        return self.rows().__arrow_c_stream__(requested_schema)

    def paths(self, camera: str, most: int) -> dict[int, tuple[str, Float[np.ndarray, "n 2"]]]:
        """Class and ground positions (m), in order of time, of a camera's tracks, for drawing.

        Thinned evenly to about ``most`` positions; the first and last of each track are kept.
        """
        step = max(1, -(-len(self) // most))
        found = self.sql(
            "SELECT track, class, x_m, y_m FROM scene "
            f"WHERE camera = {text_sql(camera)} AND x_m IS NOT NULL "
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
        """Numbers of tracks by class (a track's most frequent one), the most frequent first."""
        found = self.sql(
            "SELECT class, count(*) AS n FROM (SELECT mode(class) AS class FROM scene "
            "GROUP BY track) GROUP BY class ORDER BY n DESC, class"
        )
        return dict(zip(found["class"].to_pylist(), found["n"].to_pylist(), strict=True))

    def _repr_html_(self) -> str:
        from scene4d.core.notebook import beside, plan_svg

        length_s = sum(end - begin for begin, end in (r.span_s for r in self.runs if r.span_s))
        said = {
            "Cameras": ", ".join(self.cameras),
            "Runs": str(len(self.runs)),
            "Rows": ", ".join(f"{rows:,} x {name}" for name, rows in self.classes.items()),
            "Footage": f"{length_s:.1f} s",
        }
        plans = [plan_svg(self.paths(one, _MOST_SHOWN).values()) for one in self.cameras[:1]]
        return beside(said, "".join(plans))

    def lean_tracks(self, choose: _Choice, groups: Collection[str]) -> Tracks:
        """All tracks with times and positions, and of the other columns only some
        :data:`~scene4d.store.schema.GROUPS`: most memory and time goes into those. Only the rows
        that ``choose(track, time_s)`` returns, in its order.
        """
        wanted = {*_LEAN, *(name for group in groups for name in GROUPS[group])}
        kinds = " ".join(f"WHEN {text_sql(name)} THEN {code}" for code, name in enumerate(CLASSES))
        names = [with_nan(column) for column in COLUMNS if column.name in wanted]
        table = self.sql(
            f"SELECT {', '.join(names)}, (CASE class {kinds} END)::TINYINT AS class FROM scene"
        )
        track, time_s = (np.asarray(table[name].to_numpy()) for name in ("track", "time_s"))
        return from_table(table, choose(track, time_s))

    def sql(self, query: str) -> Table:
        """The result of a DuckDB SELECT on the view ``scene``, which has all rows.

        ``scene.sql("SELECT class, count(*) FROM scene GROUP BY class")``

        A query reads only the scene and writes nothing. Raises :class:`InputError` if DuckDB
        rejects it.
        """
        check_select(query)

        def answer(cursor: Any, parts: Parts) -> Any:
            cursor.execute(f"CREATE OR REPLACE TEMP VIEW scene AS {source_of(parts)}")
            return cursor.sql(query)

        return self._ask(lambda: _all_parts(self._stored), answer)

    def _answer(self, asked: Question, columns: str, order: str = "") -> Table:
        unknown = sorted(set(asked) - Question.__annotations__.keys())
        if unknown:
            raise TypeError(
                f"unknown keyword {unknown[0]!r}; known: {', '.join(Question.__annotations__)}"
            )
        check_range(asked.get("begin"), asked.get("end"))
        for name, there, what in (
            ("classes", self.classes, "class"),
            ("cameras", self.cameras, "camera"),
        ):
            wanted: Any = asked.get(name)
            if wanted is not None:
                check_there(wanted, there, what)
        where = " AND ".join(conditions_of(asked)) or "true"

        def answer(cursor: Any, parts: Parts) -> Any:
            return cursor.sql(f"SELECT {columns} FROM ({source_of(parts)}) WHERE {where} {order}")

        return self._ask(lambda: self._parts(asked), answer)

    def _ask(self, parts_of: Callable[[], Parts], answer: Callable[[Any, Parts], Any]) -> Table:
        """What DuckDB answers of the parts. A stream replaces its newest parts: where one is gone,
        the newer manifest is read, and all of it asked again.
        """
        for more in (True, True, False):
            parts = parts_of()
            try:
                with self._asking(parts) as cursor:
                    return _in_utc(Table.from_arrow(answer(cursor, parts)))
            except GoneError:
                if not (more and self._renew()):
                    raise
        raise AssertionError

    def _renew(self) -> bool:
        """Take the newer manifests of streams; false if there are none."""
        before = self._stored
        self._stored = tuple(map(renewed, before))
        return self._stored != before

    def _parts(self, asked: Question) -> Parts:
        """The files that can contain matching rows; any one where none can, for the types."""
        cameras, begin, end = asked.get("cameras"), asked.get("begin"), asked.get("end")
        stored = [one for one in self._stored if cameras is None or one.run.camera in cameras]
        if any(isinstance(moment, datetime) for moment in (begin, end)):
            stored = [one for one in stored if one.run.start_known]
            if not stored:
                raise InputError(
                    "begin, end: when the footage began is not known; ask in seconds from its start"
                )
        found = [(o, part) for o, part in _all_parts(stored) if reaches(o.run, part, begin, end)]
        return found or _all_parts(self._stored)[:1]

    @cached_property
    def _connection(self) -> Any:
        if self._part_of is not None:  # starting DuckDB takes longer than a small query
            return self._part_of._connection
        import duckdb

        connection = duckdb.connect(config=_ALONE)
        folders = {str((one.folder / "tracks").absolute()) for one in self._stored}
        allowed = sorted(folders | {pattern_of(folder) for folder in folders})
        connection.execute(f"SET allowed_directories = [{', '.join(map(text_sql, allowed))}]")
        connection.execute("SET enable_external_access = false")
        connection.execute("SET lock_configuration = true")
        return connection

    @cached_property
    def _verified(self) -> set[Path]:
        """The parts whose content has been verified."""
        return set() if self._part_of is None else self._part_of._verified

    @contextmanager
    def _asking(self, parts: Parts) -> Iterator[Any]:
        import duckdb

        check_parts(parts, self._verified)
        try:
            with self._connection.cursor() as cursor:
                yield cursor
        except (duckdb.Error, RuntimeError) as error:  # the latter if reading stops midway
            check_parts_there(parts)
            self._check_readable(one.folder / part.path for one, part in parts)
            folders = ", ".join(dict.fromkeys(str(one.folder) for one, _ in parts))
            raise InputError(f"{folders}: query: {error}") from error

    def _check_readable(self, paths: Iterable[Path]) -> None:
        """Raise :class:`InputError` naming the first of these parts that is damaged."""
        import duckdb

        for path in paths:
            try:
                with self._connection.cursor() as cursor:
                    rows = f"SELECT * FROM read_parquet({text_sql(str(path.absolute()))})"
                    cursor.execute(rows).fetchnumpy()
            except (duckdb.Error, RuntimeError) as error:
                raise InputError(
                    f"{path}: is damaged: {quoted(str(error))}; remove the run and track again"
                ) from None


def _stored_of(
    scenes: "Sequence[str | os.PathLike[str] | Scene]", *, growing: bool = False
) -> list[Stored]:
    if not scenes:
        raise InputError("no scene is given, expected at least one")
    stored: list[Stored] = []
    offset = 0
    for one in scenes:
        here = one._stored if isinstance(one, Scene) else _stored_in(Path(one), growing=growing)
        stored += [replace(run, track_offset=run.track_offset + offset) for run in here]
        offset += Scene(here).numbers
    if len({(run.folder.resolve(), run.run.run) for run in stored}) < len(stored):
        folders = ", ".join(dict.fromkeys(str(run.folder) for run in stored))
        raise InputError(f"{folders}: a folder is named twice")
    _check_cameras(stored)
    return stored


def _stored_in(folder: Path, *, growing: bool) -> list[Stored]:
    runs = complete_runs(folder)
    if not (runs or (growing and has_begun(folder))):
        raise InputError(f"{folder}: holds no scene: no complete run in its folder runs/")
    return [Stored(folder, run, 0) for run in runs]


def _all_parts(stored: Sequence[Stored]) -> Parts:
    return [(one, part) for one in stored for part in one.run.parts]


def _check_cameras(stored: Sequence[Stored]) -> None:
    said: dict[str, tuple[Path, Any]] = {}
    for one in stored:
        path = camera_path(one.folder, one.run.camera)
        told = camera_identity(read_json(path))
        first, calibration = said.setdefault(one.run.camera, (path, told))
        if told != calibration:
            raise InputError(
                f"{path}: camera {one.run.camera!r} has another calibration in {first}; open these "
                "folders separately"
            )


def _in_utc(table: Table) -> Table:
    """Times in UTC, not in this computer's time zone."""
    utc = DataType.timestamp("ns", tz="UTC")
    for i, name in enumerate(table.column_names):
        kind = table.schema.field(name).type
        if DataType.is_timestamp(kind) and kind.tz is not None and kind != utc:
            table = table.set_column(i, Field(name, utc), table.column(i).cast(utc))
    return table
