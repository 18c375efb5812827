"""How far a fleet is, camera by camera: ``status.json``, and the table at the end."""

import time
from collections import Counter
from collections.abc import Sequence
from datetime import UTC, datetime
from typing import Any

from scene4d.fleet._plan import Plan
from scene4d.fleet._tasks import Task

_HOUR_S = 3600.0
_COUNTS = ("tasks", "done", "earlier", "quarantined", "skipped", "running", "recording")


class Status:
    """Counts of tasks, and of clips that are still recorded; footage and processor time are those
    of this round.
    """

    def __init__(self, plan: Plan, tasks: Sequence[Task]) -> None:
        self._cameras: dict[str, Counter] = {
            one.name: Counter(recording=one.recording) for one in plan.cameras if one.recording
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
