"""The events of all cameras as one table, best first: DuckDB merges what the partitions found."""

import tempfile
from collections.abc import Sequence
from pathlib import Path
from typing import Any

from scene4d.core.errors import OutputError
from scene4d.fleet._stages import EVENTS
from scene4d.fleet._store import Store
from scene4d.fleet._tasks import Line

_ORDER = "probability DESC NULLS LAST, score DESC, camera, run, begin_s"
_TOP = 10
"""Events told on the screen; the table holds all."""
_TOLD = ("camera", "clip", "run", "begin_s", "end_s", "begin_time", "probability", "score")


def merged(words: Sequence[str], line: Line, store: Store) -> dict[str, dict[str, Any]]:
    """Write ``events/NUMBER.parquet`` for each of the searches; where that is, how many events,
    and the best of them.
    """
    found = {}
    for number, one in enumerate(words):
        parts = [
            need.path
            for task, need in ((line.tasks[n], need) for n, need in line.results.items())
            if task.stage == "search" and task.words == one
        ]
        with tempfile.TemporaryDirectory(prefix="scene4d-events-") as name:
            found[one] = _merged(parts, f"events/{number}.parquet", store, Path(name))
    return found


def _merged(parts: Sequence[str], path: str, store: Store, scratch: Path) -> dict[str, Any]:
    import duckdb

    paths = [store.fetched(part, scratch) / EVENTS for part in parts]
    tables = [str(path) for path in paths if path.is_file()]
    if not tables:
        return {"table": None, "events": 0, "best": []}
    with duckdb.connect() as connection:
        every = connection.read_parquet(tables, union_by_name=True).order(_ORDER)
        try:
            every.write_parquet(str(scratch / EVENTS))
        except duckdb.IOException as error:
            raise OutputError(f"{scratch}: cannot be written: {error}") from error
        store.write_bytes(path, (scratch / EVENTS).read_bytes())
        table = connection.read_parquet(str(scratch / EVENTS))
        best = table.project(", ".join(_TOLD)).limit(_TOP).fetchall()
        ((count,),) = table.aggregate("count(*)").fetchall()
    return {
        "table": f"{store.address}/{path}",
        "events": count,
        "best": [dict(zip(_TOLD, row, strict=True)) for row in best],
    }
