"""Queries on a scene: checking them and turning them into SQL."""

from collections.abc import Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from pathlib import Path
from typing import Any, TypedDict

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.text import quoted
from scene4d.store.runs import Part, Run, since_1970_ns
from scene4d.store.schema import COLOURS, COLUMNS, KEYPOINT_COLUMNS

_Moment = datetime | float | int
"""A moment in UTC, or seconds from the start of a clip."""
_Rectangle = tuple[float | int, float | int, float | int, float | int]
"""x0, y0, x1, y1 on the ground, in metres."""


@dataclass(frozen=True)
class Stored:
    """A run in its folder; ``track_offset`` keeps track numbers of several folders distinct."""

    folder: Path
    run: Run
    track_offset: int


class Question(TypedDict, total=False):
    """Filters for rows; a field that is missing or None does not filter.

    ``begin`` (inclusive) and ``end`` (exclusive) are moments with a time zone, or seconds from the
    clip's start. ``classes``, ``cameras`` and ``tracks`` list the values to keep. ``within_m`` is a
    rectangle (x0, y0, x1, y1) on the ground in metres, edges included. ``observed`` selects seen
    (True) or bridged (False) rows.
    """

    begin: _Moment | None
    end: _Moment | None
    classes: Sequence[str] | None
    cameras: Sequence[str] | None
    tracks: Sequence[int] | np.ndarray | None
    within_m: _Rectangle | None
    observed: bool | None


def check_there(wanted: Sequence[str], there: Sequence[str] | dict[str, int], what: str) -> None:
    """Raise :class:`InputError` if a requested name does not exist."""
    if isinstance(wanted, str):
        raise InputError(f"{what}: found the text {wanted!r}, expected a list of names")
    if not len(wanted):
        raise InputError(f"{what}: found an empty list, expected names, or None for all")
    missing = [name for name in wanted if name not in there]
    if missing:
        raise InputError(f"{what} {missing[0]!r} is not in the scene; there: {', '.join(there)}")


def check_range(begin: _Moment | None, end: _Moment | None) -> None:
    """Raise :class:`InputError` for an invalid or empty time range."""
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


def checked_rectangle(within_m: _Rectangle) -> _Rectangle:
    """The same; raises :class:`InputError` where it has no inside."""
    x0, y0, x1, y1 = within_m
    if not (x0 <= x1 and y0 <= y1):
        raise InputError(f"within_m: found {within_m}, expected x0 <= x1 and y0 <= y1")
    return within_m


def reaches(run: Run, part: Part, begin: _Moment | None, end: _Moment | None) -> bool:
    """Whether a part can have rows in a time range."""
    first, last = (since_1970_ns(one) if isinstance(one, datetime) else one for one in (begin, end))
    in_ns = isinstance(begin, datetime) or isinstance(end, datetime)
    part_begin = run.moment_ns(part.begin_s) if in_ns else part.begin_s
    part_end = run.moment_ns(part.end_s) if in_ns else part.end_s
    return (first is None or part_end >= first) and (last is None or part_begin < last)


def conditions_of(asked: Question) -> list[str]:
    """SQL conditions of a query; all of them must hold."""
    conditions = []
    for sign, moment in ((">=", asked.get("begin")), ("<", asked.get("end"))):
        if isinstance(moment, datetime):
            utc = moment.astimezone(UTC).replace(tzinfo=None).isoformat(" ")
            conditions.append(f"time {sign} '{utc}+00'::TIMESTAMPTZ_NS")
        elif moment is not None:
            conditions.append(f"time_s {sign} {_number(moment)}")
    for name, wanted in (("class", asked.get("classes")), ("camera", asked.get("cameras"))):
        if wanted is not None:
            conditions.append(f"{name_sql(name)} IN ({', '.join(map(text_sql, wanted))})")
    tracks, within_m, observed = asked.get("tracks"), asked.get("within_m"), asked.get("observed")
    if tracks is not None:
        numbers = ", ".join(str(int(track)) for track in tracks)
        conditions.append(f"track IN ({numbers})" if numbers else "false")
    if within_m is not None:
        x0, y0, x1, y1 = checked_rectangle(within_m)
        conditions.append(f"x_m BETWEEN {_number(x0)} AND {_number(x1)}")
        conditions.append(f"y_m BETWEEN {_number(y0)} AND {_number(y1)}")
    if observed is not None:
        conditions.append("observed" if observed else "NOT observed")
    return conditions


def check_select(query: str) -> None:
    """Raise :class:`InputError` for anything but a single SELECT."""
    import duckdb

    try:
        statements = duckdb.extract_statements(query)
    except duckdb.Error as error:
        raise InputError(f"query: {error}") from error
    if [one.type for one in statements] != [duckdb.StatementType.SELECT]:
        raise InputError(f"query: found {quoted(query)}, expected one SELECT")


def source_of(parts: Sequence[tuple[Stored, Part]]) -> str:
    """SQL for all rows of these parts, in their order."""
    files: dict[tuple[int, tuple[str, ...]], list[str]] = {}
    for one, part in parts:
        files.setdefault((one.track_offset, one.run.lacks), []).append(
            text_sql(pattern_of(str((one.folder / part.path).absolute())))
        )
    return " UNION ALL ".join(
        f"SELECT * {f'REPLACE (track + {offset} AS track)' if offset else ''}{_nothing(lacks)} "
        f"FROM read_parquet([{', '.join(paths)}], hive_partitioning = false)"
        for (offset, lacks), paths in files.items()
    )


def _nothing(columns: Sequence[str]) -> str:
    """SQL of columns that the files do not have."""
    lists = {column.name for column in COLUMNS if column.type.startswith("list")}
    return "".join(
        f", NULL::{'FLOAT[]' if name in lists else 'DOUBLE'} AS {name_sql(name)}"
        for name in columns
    )


def with_nan(column: Any) -> str:
    """SQL of a column as :func:`from_table` expects it."""
    name = name_sql(column.name)
    if column.name in KEYPOINT_COLUMNS:
        return (
            f"coalesce(list_transform({name}, lambda x: coalesce(x, 'nan'::FLOAT)), []) AS {name}"
        )
    if column.name == COLOURS:
        return f"coalesce({name}, []) AS {name}"
    if column.nullable:
        return f"coalesce({name}, 'nan'::DOUBLE) AS {name}"
    return name


def name_sql(name: str) -> str:
    """A quoted column name."""
    return '"' + name.replace('"', '""') + '"'


def text_sql(value: str) -> str:
    """A quoted string."""
    return "'" + value.replace("'", "''") + "'"


def _number(value: float | int) -> str:
    """A number cast from text, because a literal 0.1 is a DECIMAL in SQL."""
    return f"'{float(value)!r}'::DOUBLE"


def pattern_of(path: str) -> str:
    """A glob pattern that matches only this path."""
    return "".join(f"[{c}]" if c in "[*?" else c for c in path)
