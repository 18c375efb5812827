"""``run_fleet``: a plan's tasks, as many at a time as there is room for, until all have ended."""

import logging
import time
from collections.abc import Callable
from dataclasses import dataclass, field
from itertools import count
from pathlib import Path
from typing import Any

from scene4d.core.errors import OutputError, UnavailableError
from scene4d.core.progress import Advance, Progress, Silent
from scene4d.fleet._alone import alone
from scene4d.fleet._executors import Executor, Here, OnRay
from scene4d.fleet._plan import Plan, read_plan
from scene4d.fleet._stages import KILLED, LOST, Work, said_of, work
from scene4d.fleet._status import Status, merged
from scene4d.fleet._store import Clips, Store
from scene4d.fleet._tasks import Job, Line, Result, Task, key_of, tasks_of

_log = logging.getLogger("scene4d")
_ERRORS = {kind.kind: kind for kind in (OutputError, UnavailableError)}
"""Failures that are not the clip's: the next one would fail likewise, as on a full disk."""
_SAVED_EVERY_S = 5.0
"""How often ``status.json`` is written, and what clips contain: both are small."""


@dataclass(frozen=True)
class FleetRun:
    """What became of a plan: the store, the state of each camera, what is in quarantine (``key``,
    ``stage``, ``camera``, ``clip``, ``reason``), and the events of each search, best first, over
    all cameras. Of several rounds it is the last one.
    """

    store: str
    status: dict[str, Any]
    quarantine: list[dict[str, Any]] = field(default_factory=list)
    events: dict[str, dict[str, Any]] = field(default_factory=dict)
    rounds: int = 1

    def to_dict(self) -> dict[str, Any]:
        """The output of ``--json``."""
        return {
            "out": self.store,
            "rounds": self.rounds,
            **self.status,
            "quarantine": self.quarantine,
            "searches": self.events,
        }


def run_fleet(
    plan: str | Path | Plan,
    store: str | Path,
    *,
    ray: str | None = None,
    progress: Progress | None = None,
    work: Work = work,
    wait: Callable[[float], None] = time.sleep,
) -> FleetRun:
    """Do what a plan says, but for what the store holds already; may be killed and run again.

    ``plan`` is a file or a folder of clips (:func:`.read_plan`), ``store`` a folder or an address
    that fsspec knows, as ``s3://bucket/fleet``. Tasks run one after the other in this process, or
    on Ray: ``ray`` is the address of a cluster, or ``"local"`` for one on this machine. A clip that
    fails by its own fault, or kills one worker after another, is put into the store's quarantine,
    and the others go on. ``work`` does one task. A plan with ``every_s`` is read and done again
    that long after it was begun, until ``wait`` (seconds) is interrupted (Ctrl-C).

    Raises :class:`InputError` for a plan that is not as it must be, and for a store on which
    another fleet works; :class:`OutputError` and :class:`UnavailableError` where the next clip
    would fail as well (a full disk, no weights, a cluster that is gone); what is done by then
    stays.
    """
    progress = progress or Silent()
    asked = _read(plan)
    there = Store(str(store))
    outdated = _Outdated(there)
    with alone(there) as check:
        for rounds in count(1):
            begun_s = time.monotonic()
            found = _round(asked, there, ray, progress, work, check, rounds, outdated)
            if asked.every_s is None:
                break
            left_s = begun_s + asked.every_s - time.monotonic()
            try:
                with progress.stage(_so_far(found), None):
                    wait(max(left_s, 0.0))
            except KeyboardInterrupt:
                break
            asked = _read(plan)
    return found


def _so_far(found: FleetRun) -> str:
    """What is said while nothing is done."""
    said = found.status
    more = {"put aside": said["quarantined"], "still recorded": said["recording"]}
    told = ", ".join(f"{count} {what}" for what, count in more.items() if count)
    return (
        f"Round {found.rounds}: {said['done']} of {said['tasks']} done{', ' * bool(told)}{told}; "
        "waiting for the next"
    )


def _read(plan: str | Path | Plan) -> Plan:
    asked = plan if isinstance(plan, Plan) else read_plan(plan)
    return asked if asked.every_s is None else asked.whole(time.time())


def _round(
    plan: Plan,
    store: Store,
    ray: str | None,
    progress: Progress,
    work: Work,
    check: Callable[[], None],
    number: int,
    outdated: "_Outdated",
) -> FleetRun:
    executor = (
        Here(store.address, work) if ray is None else OnRay(store.address, ray, plan.workers, work)
    )
    try:
        fleet = _Fleet(plan, store, executor, check)
        with progress.stage("Working through the plan", len(fleet.line.tasks)) as step:
            fleet.run(step)
    finally:
        executor.close()
    check()
    events = merged(plan.words, fleet.line, store)
    outdated.remove(fleet)
    return FleetRun(store.address, fleet.status.to_dict(), fleet.quarantine, events, number)


class _Outdated:
    """Sites and searches that stood on the clips of a round before the last one: each round with
    new clips makes all of them anew, and a store that kept each would grow with the square of its
    clips. Whoever reads those of the last round may go on; what other programs made stays.
    """

    def __init__(self, store: Store) -> None:
        self._store = store
        self._made: set[Result] = set()
        self._last: set[Result] = set()

    def remove(self, fleet: "_Fleet") -> None:
        """Called after each round."""
        line = fleet.line
        now = {one for number, one in line.results.items() if line.tasks[number].clip is None}
        outdated = self._made - self._last - now
        for one in outdated:
            self._store.drop(one)
        self._made = (self._made - outdated) | (fleet.made & now)
        self._last = now


class _Fleet:
    """The state of a round; the store is all that outlives it."""

    def __init__(
        self, plan: Plan, store: Store, executor: Executor, check: Callable[[], None]
    ) -> None:
        self._plan, self._store, self._executor, self._check = plan, store, executor, check
        self.line = Line(tasks_of(plan))
        self.status = Status(plan, self.line.tasks)
        self.quarantine: list[dict[str, Any]] = []
        self.made: set[Result] = set()
        self._done, self._bad = store.keys("done"), store.keys("quarantine")
        self._clips = Clips(store)
        self._running: dict[int, Job] = {}
        self._killed: dict[int, int] = {}
        self._save_at_s = 0.0

    def run(self, step: Advance) -> None:
        """Until every task has ended; ``step`` is told of each."""
        try:
            while self._fill(step) or self._running:
                self._take(step)
                if time.monotonic() >= self._save_at_s:
                    self._save()
        finally:
            for job in self._running.values():
                self.status.add(job.task, running=-1)
            self._save()

    def _fill(self, step: Advance) -> bool:
        """Give the executor what it has room for; whether it has anything to do."""
        while self._executor.free:
            self._check()
            number = self.line.next()
            if number is None:
                break
            task, needs = self.line.tasks[number], self.line.needs(number)
            if self.line.lacks(number) or self._is_gone(task):
                self._ended(number, None, step, skipped=1)
                continue
            sha256 = None if task.clip is None else self._clips.sha256(task.camera, task.clip)
            result = Result(task.stage, task.camera, key_of(task, sha256, needs))
            job = Job(task, result, needs)
            if result.key in self._done:
                self._ended(number, result, step, done=1, earlier=1)
            elif result.key in self._bad:
                said = self._store.read(f"quarantine/{result.key}") or {}
                self._put_aside(number, job, said, step)
            else:
                self._running[number] = job
                self.status.add(task, running=1)
                self._executor.begin(number, job)
        return bool(self._running)

    def _is_gone(self, task: Task) -> bool:
        """Whether a clip was removed since the plan was read, as where footage is kept for days."""
        if self._plan.every_s is None or task.clip is None or task.clip.exists():
            return False
        if gone := task.clip.parent.is_dir():  # else it is the disk that is gone
            _log.warning("%s: was removed and is left out", task.shown)
        return gone

    def _take(self, step: Advance) -> None:
        if not self._running:
            return
        number, outcome = self._executor.next()
        job = self._running[number]
        if outcome.kind == LOST or (outcome.kind == KILLED and self._again(number)):
            why = "machine was lost" if outcome.kind == LOST else "worker was killed"
            _log.warning("%s: its %s; it is begun again", job.task.shown, why)
            self._executor.begin(number, job)
            return
        if outcome.kind in _ERRORS:
            raise _ERRORS[outcome.kind](outcome.reason)
        del self._running[number]
        self.status.add(job.task, running=-1, cpu_s=outcome.cpu_s, footage_s=outcome.footage_s)
        if outcome.kind is None:
            self._done.add(job.result.key)
            self.made.add(job.result)
            self._ended(number, job.result, step, done=1)
            return
        reason = outcome.reason
        if outcome.kind == KILLED:
            reason = f"it killed {self._killed[number]} workers ({reason})"
        said = said_of(job) | {"kind": outcome.kind, "reason": reason}
        self._store.write(f"quarantine/{job.result.key}", said)
        self._put_aside(number, job, said, step)

    def _again(self, number: int) -> bool:
        """Whether a job that killed its worker gets another one."""
        self._killed[number] = self._killed.get(number, 0) + 1
        return self._killed[number] < self._plan.workers.attempts

    def _ended(self, number: int, result: Result | None, step: Advance, **how: int) -> None:
        self.status.add(self.line.tasks[number], **how)
        self.line.ended(number, result)
        step(1)

    def _put_aside(self, number: int, job: Job, said: dict[str, Any], step: Advance) -> None:
        self.quarantine.append(said_of(job) | said)
        self._ended(number, None, step, quarantined=1)

    def _save(self) -> None:
        self._save_at_s = time.monotonic() + _SAVED_EVERY_S
        self._clips.save()
        self._store.write("status", {"schema": "scene4d/fleet-status/1"} | self.status.to_dict())
