"""A plan as a list of tasks, and what each is called: pure functions."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from datetime import datetime
from heapq import heappop, heappush
from pathlib import Path
from typing import Any, NamedTuple

from scene4d.fleet._plan import Footage, Plan
from scene4d.store.runs import file_name
from scene4d.store.schema import SCENE_SCHEMA

_KEYS = f"scene4d/fleet/1 {SCENE_SCHEMA}"
"""Results of another version have other keys."""
SITE = "site"
"""The name under which the alignment of all cameras is kept."""


@dataclass(frozen=True)
class Task:
    """One stage for one clip of a camera, or for all clips of one or more (``clip`` is None).

    ``needs`` are the numbers of earlier tasks in the list. Where it is ``strict``, it cannot be
    done without each of them; else it takes those that came to a result, one at least.
    """

    stage: str
    camera: str
    options: Any
    clip: Path | None = None
    begins: datetime | None = None
    boxes: bool = False
    calibration: Path | None = None
    words: str = ""
    needs: tuple[int, ...] = ()
    strict: bool = True

    @property
    def shown(self) -> str:
        """For messages."""
        return f"{self.stage} {self.camera}{'' if self.clip is None else f' {self.clip.name}'}"


class Need(NamedTuple):
    """A result that a task stands on: whose, and under which key."""

    stage: str
    camera: str
    key: str

    @property
    def path(self) -> str:
        """Its folder in the store."""
        return result_path(self.stage, self.camera, self.key)


@dataclass(frozen=True)
class Job:
    """A task that can be done now: its key, and the results that it stands on."""

    task: Task
    key: str
    needs: tuple[Need, ...]

    @property
    def path(self) -> str:
        """The folder of its result in the store."""
        return result_path(self.task.stage, self.task.camera, self.key)


def result_path(stage: str, camera: str, key: str) -> str:
    """STAGE/CAMERA/key=KEY, as Hive partitions are called."""
    return f"{stage}/{file_name(camera, 'camera')}/key={key}"


def tasks_of(plan: Plan) -> list[Task]:
    """All that is to be done, each after what it needs: cameras, clips, the site, searches."""
    tasks: list[Task] = []

    def add(task: Task) -> int:
        tasks.append(task)
        return len(tasks) - 1

    solved: dict[str, int] = {}
    for one in plan.cameras:
        if plan.calibrate is not None and one.camera is None and one.clips:
            solved[one.name] = add(_of_clip("calibrate", plan.calibrate, one, one.clips[0]))
    tracked: dict[str, tuple[int, ...]] = {}
    if plan.track is not None:
        for one in plan.cameras:
            needs = tuple(solved[name] for name in (one.name,) if name in solved)
            made = (_of_clip("track", plan.track, one, clip) for clip in one.clips)
            if one.clips:
                tracked[one.name] = tuple(add(replace(task, needs=needs)) for task in made)
    if plan.align is not None and tracked:
        everything = tuple(number for numbers in tracked.values() for number in numbers)
        add(Task("align", SITE, plan.align, needs=everything, strict=False))
    if plan.search is not None:
        for words in plan.words:
            for camera, needs in tracked.items():
                options = plan.search
                add(Task("search", camera, options, words=words, needs=needs, strict=False))
    return tasks


def _of_clip(stage: str, options: Any, of: Footage, clip: Path) -> Task:
    return Task(stage, of.name, options, clip, of.begins(clip), of.boxes, of.camera)


def key_of(task: Task, clip_sha256: str | None, needs: Sequence[Need]) -> str:
    """What a task's result is called: 32 digits that follow from the version of the format, the
    stage, the options (files in them by their content), the clip's content, and what it needs.
    """
    said = {
        "made by": _KEYS,
        "stage": task.stage,
        "camera": task.camera,
        "options": {
            one.name: _told(getattr(task.options, one.name)) for one in fields(task.options)
        },
        "clip": clip_sha256,
        "begins": None if task.begins is None else task.begins.isoformat(),
        "boxes": task.boxes,
        "calibration": _told(task.calibration),
        "words": task.words,
        "needs": sorted(need.key for need in needs),
    }
    return hashlib.sha256(json.dumps(said, sort_keys=True).encode()).hexdigest()[:32]


def _told(value: Any) -> Any:
    if isinstance(value, Path):
        return hashlib.sha256(value.read_bytes()).hexdigest()
    return [_told(one) for one in value] if isinstance(value, list | tuple) else value


class Line:
    """Which tasks can be done now: those whose needs have come to an end, in the plan's order."""

    def __init__(self, tasks: Sequence[Task]) -> None:
        self.tasks = tasks
        self.results: dict[int, Need] = {}
        self._open = [len(set(task.needs)) for task in tasks]
        self._after: dict[int, list[int]] = {}
        for number, task in enumerate(tasks):
            for need in set(task.needs):
                self._after.setdefault(need, []).append(number)
        self._ready = [number for number, count in enumerate(self._open) if not count]

    def next(self) -> int | None:
        """The number of a task; None where none can be done before others have ended."""
        return heappop(self._ready) if self._ready else None

    def lacks(self, number: int) -> bool:
        """Whether a task cannot be done, since what it stands on came to no result."""
        task = self.tasks[number]
        there = len(self.needs(number))
        return bool(task.needs) and there < (len(task.needs) if task.strict else 1)

    def needs(self, number: int) -> tuple[Need, ...]:
        """The results that a task stands on."""
        return tuple(self.results[one] for one in self.tasks[number].needs if one in self.results)

    def ended(self, number: int, key: str | None) -> None:
        """A task came to its end, with a result or without one."""
        task = self.tasks[number]
        if key is not None:
            self.results[number] = Need(task.stage, task.camera, key)
        for other in self._after.get(number, ()):
            self._open[other] -= 1
            if not self._open[other]:
                heappush(self._ready, other)
