"""``run_fleet``: a plan's tasks, as many at a time as there is room for, until all have ended."""

import logging
import time
from dataclasses import dataclass, field
from pathlib import Path
from typing import Any

from scene4d.core.errors import OutputError, UnavailableError
from scene4d.core.progress import Advance, Progress, Silent
from scene4d.fleet._clips import Clips
from scene4d.fleet._here import Executor, Here
from scene4d.fleet._merging import merged
from scene4d.fleet._plan import Plan, read_plan
from scene4d.fleet._stages import KILLED, LOST, Outcome, Work, said_of, work
from scene4d.fleet._status import Status
from scene4d.fleet._store import Store
from scene4d.fleet._tasks import Job, Line, key_of, tasks_of

_log = logging.getLogger("scene4d")
_ERRORS = {kind.kind: kind for kind in (OutputError, UnavailableError)}
_SAVED_EVERY_S = 5.0
"""How often ``status.json`` is written, and what clips contain: both are small."""


@dataclass(frozen=True)
class FleetRun:
    """What became of a plan: the store, the state of each camera, what is in quarantine (``key``,
    ``stage``, ``camera``, ``clip``, ``reason``), and the events of each search, best first, over
    all cameras.
    """

    store: str
    status: Status
    quarantine: list[dict[str, Any]] = field(default_factory=list)
    events: dict[str, dict[str, Any]] = field(default_factory=dict)

    def to_dict(self) -> dict[str, Any]:
        """The output of ``--json``."""
        return {
            "out": self.store,
            **self.status.to_dict(),
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
) -> FleetRun:
    """Do what a plan says, but for what the store holds already; may be killed and run again.

    ``plan`` is a file or a folder of clips (:func:`.read_plan`), ``store`` a folder or an address
    that fsspec knows, as ``s3://bucket/fleet``. Tasks run one after the other in this process, or
    on Ray: ``ray`` is the address of a cluster, or ``"local"`` for one on this machine. A clip that
    fails by its own fault, or kills one worker after another, is put into the store's quarantine,
    and the others go on. ``work`` does one task.

    Raises :class:`InputError` for a plan that is not as it must be; :class:`OutputError` and
    :class:`UnavailableError` where the next clip would fail as well (a full disk, no weights,
    a cluster that is gone); what is done by then stays.
    """
    plan = plan if isinstance(plan, Plan) else read_plan(plan)
    there = Store(str(store))
    there.open()
    executor = _executor(plan, there.address, ray, work)
    try:
        fleet = _Fleet(plan, there, executor)
        with (progress or Silent()).stage(
            "Working through the plan", len(fleet.line.tasks)
        ) as step:
            fleet.run(step)
    finally:
        executor.close()
    events = merged(plan.words, fleet.line, there)
    return FleetRun(there.address, fleet.status, fleet.quarantine, events)


def _executor(plan: Plan, address: str, ray: str | None, work: Work) -> Executor:
    if ray is None:
        return Here(address, work)
    from scene4d.fleet._ray import OnRay

    return OnRay(address, ray, plan.workers, work)


class _Fleet:
    """The state of a run; the store is all that outlives it."""

    def __init__(self, plan: Plan, store: Store, executor: Executor) -> None:
        self._store, self._executor = store, executor
        self._attempts_most = plan.workers.attempts
        self.line = Line(tasks_of(plan))
        self.status = Status(self.line.tasks)
        self.quarantine: list[dict[str, Any]] = []
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
            self._running.clear()
            self._save()

    def _fill(self, step: Advance) -> bool:
        """Give the executor what it has room for; whether it has anything to do."""
        while self._executor.free:
            number = self.line.next()
            if number is None:
                break
            task, needs = self.line.tasks[number], self.line.needs(number)
            sha256 = None if task.clip is None else self._clips.sha256(task.camera, task.clip)
            job = Job(task, key_of(task, sha256, needs), needs)
            if job.key in self._done:
                self._ended(number, job, Outcome(), step, earlier=True)
            elif job.key in self._bad:
                said = self._store.read(f"quarantine/{job.key}") or {}
                self._put_aside(number, job, said, step, None)
            else:
                self._running[number] = job
                self.status.began(task)
                self._executor.begin(number, job)
        return bool(self._running)

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
        if outcome.ends_all:
            raise _ERRORS[str(outcome.kind)](outcome.reason)
        del self._running[number]
        if outcome.kind is None:
            self._done.add(job.key)
            self._ended(number, job, outcome, step)
            return
        reason = outcome.reason
        if outcome.kind == KILLED:
            reason = f"it killed {self._killed[number]} workers ({reason})"
        said = said_of(job) | {"kind": outcome.kind, "reason": reason}
        self._store.write(f"quarantine/{job.key}", said)
        self._put_aside(number, job, said, step, outcome)

    def _again(self, number: int) -> bool:
        """Whether a job that killed its worker gets another one."""
        self._killed[number] = self._killed.get(number, 0) + 1
        return self._killed[number] < self._attempts_most

    def _ended(
        self, number: int, job: Job, outcome: Outcome, step: Advance, *, earlier: bool = False
    ) -> None:
        self.status.ended(job.task, outcome, earlier=earlier)
        self.line.ended(number, job.key)
        step(1)

    def _put_aside(
        self, number: int, job: Job, said: dict[str, Any], step: Advance, outcome: Outcome | None
    ) -> None:
        self.quarantine.append(said_of(job) | said)
        self.status.put_aside(job.task, outcome)
        self.line.ended(number, None)
        step(1)

    def _save(self) -> None:
        self._save_at_s = time.monotonic() + _SAVED_EVERY_S
        self._clips.save()
        self.status.skipped = self.line.skipped
        self._store.write("status", {"schema": "scene4d/fleet-status/1"} | self.status.to_dict())
