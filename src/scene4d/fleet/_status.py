"""How far a fleet is, camera by camera: ``status.json``, and the table at the end."""

import time
from collections import Counter
from collections.abc import Mapping, Sequence
from dataclasses import dataclass
from datetime import UTC, datetime
from typing import Any

from scene4d.fleet._stages import Outcome
from scene4d.fleet._tasks import Task

_HOUR_S = 3600.0


@dataclass
class _Camera:
    """Tasks by how they stand, and what this run took for them."""

    tasks: int = 0
    done: int = 0
    earlier: int = 0
    quarantined: int = 0
    running: int = 0
    footage_s: float = 0.0
    cpu_s: float = 0.0


class Status:
    """Counts of tasks; footage and processor time are those of this run."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self._cameras: dict[str, _Camera] = {}
        for task in tasks:
            self._of(task).tasks += 1
        self._begun_s = time.monotonic()
        self.skipped: Mapping[str, int] = Counter()

    def began(self, task: Task) -> None:
        """A worker has it."""
        self._of(task).running += 1

    def ended(self, task: Task, outcome: Outcome, *, earlier: bool) -> None:
        """Its result is in the store, and was so before this run where it is ``earlier``."""
        camera = self._of(task)
        camera.done += 1
        camera.earlier += earlier
        camera.running -= not earlier
        camera.footage_s += outcome.footage_s
        camera.cpu_s += outcome.cpu_s

    def put_aside(self, task: Task, outcome: Outcome | None) -> None:
        """It is in quarantine, and was so before this run where there is no outcome."""
        camera = self._of(task)
        camera.quarantined += 1
        if outcome is not None:
            camera.running -= 1
            camera.cpu_s += outcome.cpu_s

    def to_dict(self) -> dict[str, Any]:
        """The content of ``status.json``; rates are null where no footage was gone through."""
        every = self._cameras.values()
        took_s = time.monotonic() - self._begun_s
        footage_s, cpu_s = sum(one.footage_s for one in every), sum(one.cpu_s for one in every)
        return {
            "updated": datetime.now(UTC).isoformat(timespec="seconds"),
            "tasks": sum(one.tasks for one in every),
            "done": sum(one.done for one in every),
            "earlier": sum(one.earlier for one in every),
            "quarantined": sum(one.quarantined for one in every),
            "skipped": sum(self.skipped.values()),
            "running": sum(one.running for one in every),
            "took_s": took_s,
            "footage_h": footage_s / _HOUR_S,
            "cpu_h": cpu_s / _HOUR_S,
            "camera_hours_per_hour": footage_s / took_s if footage_s else None,
            "cpu_h_per_camera_hour": cpu_s / footage_s if footage_s else None,
            "cameras": {name: self._told(name, one) for name, one in self._cameras.items()},
        }

    def _told(self, name: str, one: _Camera) -> dict[str, Any]:
        return {
            "state": self._state(name, one),
            "tasks": one.tasks,
            "done": one.done,
            "earlier": one.earlier,
            "quarantined": one.quarantined,
            "skipped": self.skipped.get(name, 0),
            "footage_h": one.footage_s / _HOUR_S,
            "cpu_h": one.cpu_s / _HOUR_S,
        }

    def _state(self, name: str, one: _Camera) -> str:
        if one.running:
            return "running"
        if one.done == one.tasks:
            return "complete"
        if one.done + one.quarantined + self.skipped.get(name, 0) == one.tasks:
            return "quarantine"
        return "waiting"

    def _of(self, task: Task) -> _Camera:
        return self._cameras.setdefault(task.camera, _Camera())
