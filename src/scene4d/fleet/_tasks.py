"""A plan as a list of tasks, and what each is called: pure functions."""

import hashlib
import json
from collections.abc import Sequence
from dataclasses import dataclass, fields, replace
from datetime import datetime
from heapq import heappop, heappush
from itertools import chain, product
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


class Result(NamedTuple):
    """What a task comes to: of which stage and camera, and under which key."""

    stage: str
    camera: str
    key: str

    @property
    def path(self) -> str:
        """Its folder in the store: STAGE/CAMERA/key=KEY, as Hive partitions are called."""
        return f"{self.stage}/{file_name(self.camera, 'camera')}/key={self.key}"


class Job(NamedTuple):
    """A task that can be done now, what it comes to, and the results that it stands on."""

    task: Task
    result: Result
    needs: tuple[Result, ...]


def tasks_of(plan: Plan) -> list[Task]:
    """All that is to be done, each after what it needs: cameras, clips, the site, searches."""
    tasks: list[Task] = []

    def add(task: Task) -> int:
        tasks.append(task)
        return len(tasks) - 1

    cameras = [one for one in plan.cameras if one.clips]
    solved: dict[str, tuple[int, ...]] = {}
    for one in cameras:
        if plan.calibrate is not None and one.camera is None:
            solved[one.name] = (add(_of_clip("calibrate", plan.calibrate, one, one.clips[0])),)
    tracked: dict[str, tuple[int, ...]] = {}
    for one in cameras if plan.track is not None else ():
        made = (_of_clip("track", plan.track, one, clip) for clip in one.clips)
        needs = solved.get(one.name, ())
        tracked[one.name] = tuple(add(replace(task, needs=needs)) for task in made)
    if plan.align is not None and tracked:
        needs = tuple(chain.from_iterable(tracked.values()))
        add(Task("align", SITE, plan.align, needs=needs, strict=False))
    for words, (camera, needs) in product(plan.words, tracked.items()):
        add(Task("search", camera, plan.search, words=words, needs=needs, strict=False))
    return tasks


def _of_clip(stage: str, options: Any, of: Footage, clip: Path) -> Task:
    return Task(stage, of.name, options, clip, of.begins(clip), of.boxes, of.camera)


def key_of(task: Task, clip_sha256: str | None, needs: Sequence[Result]) -> str:
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
        self.results: dict[int, Result] = {}
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

    def needs(self, number: int) -> tuple[Result, ...]:
        """The results that a task stands on."""
        return tuple(self.results[one] for one in self.tasks[number].needs if one in self.results)

    def ended(self, number: int, result: Result | None) -> None:
        """A task came to its end, with a result or without one."""
        if result is not None:
            self.results[number] = result
        for other in self._after.get(number, ()):
            self._open[other] -= 1
            if not self._open[other]:
                heappush(self._ready, other)
