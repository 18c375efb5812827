"""What a round tells: how far it is, camera by camera, and the events of all cameras."""

import tempfile
import time
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

from scene4d.core.errors import OutputError
from scene4d.fleet._plan import Plan
from scene4d.fleet._stages import EVENTS
from scene4d.fleet._store import Store
from scene4d.fleet._tasks import Line, Task

_HOUR_S = 3600.0
_COUNTS = ("tasks", "done", "earlier", "quarantined", "skipped", "running", "recording")

_ORDER = "probability DESC NULLS LAST, score DESC, camera, run, begin_s"
_TOP = 10
"""Events told on the screen; the table holds all."""
_TOLD = ("camera", "clip", "run", "begin_s", "end_s", "begin_time", "probability", "score")


class Status:
    """Counts of tasks, and of clips that are still recorded; footage and processor time are those
    of this round.
    """

    def __init__(self, plan: Plan, tasks: Sequence[Task]) -> None:
        self._cameras: dict[str, Counter] = {
            one.name: Counter(recording=one.recording)
            for one in plan.cameras
            if one.recording or not one.clips
        }
        for task in tasks:
            self.add(task, tasks=1)
        self._begun_s = time.monotonic()

    def add(self, task: Task, **more: int | float) -> None:
        """More of what is counted, and of ``footage_s`` and ``cpu_s``, for a task's camera."""
        self._cameras.setdefault(task.camera, Counter()).update(more)

    def to_dict(self) -> dict[str, Any]:
        """The content of ``status.json``; rates are null where no footage was gone through."""
        every: Counter = Counter()
        for one in self._cameras.values():
            every.update(one)
        took_s, footage_s = time.monotonic() - self._begun_s, every["footage_s"]
        return {
            "updated": datetime.now(UTC).isoformat(timespec="seconds"),
            "took_s": took_s,
            **_told(every),
            "camera_hours_per_hour": footage_s / took_s if footage_s else None,
            "cpu_h_per_camera_hour": every["cpu_s"] / footage_s if footage_s else None,
            "cameras": {
                name: {"state": _state(one), **_told(one)} for name, one in self._cameras.items()
            },
        }


def _told(one: Counter) -> dict[str, Any]:
    hours = {"footage_h": one["footage_s"] / _HOUR_S, "cpu_h": one["cpu_s"] / _HOUR_S}
    return {name: one[name] for name in _COUNTS} | hours


def _state(one: Counter) -> str:
    if one["running"]:
        return "running"
    if one["done"] == one["tasks"] > 0:
        return "complete"
    ended = one["done"] + one["quarantined"] + one["skipped"]
    return "quarantine" if ended == one["tasks"] > 0 else "waiting"


def merged(words: Sequence[str], line: Line, store: Store) -> dict[str, dict[str, Any]]:
    """Write ``events/NUMBER.parquet`` for each of the searches, best events first; where that is,
    how many events, and the best of them.
    """
    parts: dict[str, list[str]] = {one: [] for one in words}
    for number, result in line.results.items():
        if result.stage == "search":
            parts[line.tasks[number].words].append(result.path)
    return {one: _merged(parts[one], f"events/{n}.parquet", store) for n, one in enumerate(words)}


def _merged(parts: Sequence[str], path: str, store: Store) -> dict[str, Any]:
    import duckdb

    with tempfile.TemporaryDirectory(prefix="scene4d-events-") as name, duckdb.connect() as sql:
        paths = [store.fetched(part, Path(name)) / EVENTS for part in parts]
        tables = [str(path) for path in paths if path.is_file()]
        if not tables:
            return {"table": None, "events": 0, "best": []}
        made = Path(name) / EVENTS
        try:
            sql.read_parquet(tables, union_by_name=True).order(_ORDER).write_parquet(str(made))
        except duckdb.IOException as error:
            raise OutputError(f"{name}: cannot be written: {error}") from error
        store.write_bytes(path, made.read_bytes())
        table = sql.read_parquet(str(made))
        best = table.project(", ".join(_TOLD)).limit(_TOP).fetchall()
        return {
            "table": f"{store.address}/{path}",
            "events": len(table),
            "best": [dict(zip(_TOLD, row, strict=True)) for row in best],
        }
