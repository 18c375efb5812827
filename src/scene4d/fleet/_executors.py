"""Who does the tasks: this process, one after the other, or Ray, placed by cores and memory."""

import os
import re
import socket
import time
from contextlib import ExitStack, redirect_stdout
from pathlib import Path
from typing import Any

from scene4d.core.errors import UnavailableError
from scene4d.fleet._plan import Workers
from scene4d.fleet._stages import KILLED, LOST, Outcome, Work
from scene4d.fleet._tasks import Job

LOCAL = "local"
"""In place of an address: a cluster of this machine alone, for as long as the fleet runs."""
_QUEUED = 2
"""Jobs on their way for each that can run: a worker that ends one finds the next."""
_COUNT_EVERY_S = 5.0
"""How often machines are counted, which come and go."""
_OBJECTS_BYTES = 80 * 2**20
"""Ray's shared memory on this machine, the least that it takes: results go to the store."""
_GB = 1e9
_ANSWER_S = 10.0


class Here:
    """Takes a job while it is ``free``, and does it when its outcome is asked for."""

    def __init__(self, address: str, work: Work) -> None:
        self._address, self._work = address, work
        self._jobs: list[tuple[int, Job]] = []

    @property
    def free(self) -> bool:
        """Whether to give it another job; so many are on their way and no more."""
        return not self._jobs

    def begin(self, number: int, job: Job) -> None:
        """Take a job, with a number to know it by."""
        self._jobs.append((number, job))

    def next(self) -> tuple[int, Outcome]:
        """Wait for one to end, in any order; its number, and how it ended."""
        number, job = self._jobs.pop()
        return number, self._work(job, self._address)

    def close(self) -> None:
        """End whatever is under way."""


class OnRay:
    """As :class:`Here`, on a cluster. Each job is tried once: what a lost worker or machine costs
    is decided by who gave it.

    Raises :class:`UnavailableError` without Ray, without a cluster at the address, where no machine
    has the cores and the memory, and when the cluster is gone.
    """

    def __init__(self, address: str, cluster: str, workers: Workers, work: Work) -> None:
        os.environ["RAY_USAGE_STATS_ENABLED"] = "0"  # read when Ray is imported
        _check_answers(cluster)
        try:
            import ray
        except ImportError as error:
            raise UnavailableError("Ray is not here; pip install 'scene4d[ray]'") from error
        self._ray, self._address, self._workers = ray, address, workers
        self._opened = ExitStack()
        # Ray writes its log of lost machines to standard output, where results go.
        nowhere = Path(os.devnull)
        self._opened.enter_context(redirect_stdout(self._opened.enter_context(nowhere.open("w"))))
        self._opened.callback(ray.shutdown)
        local = {"include_dashboard": False, "object_store_memory": _OBJECTS_BYTES}
        try:
            ray.init(
                address=LOCAL if cluster == LOCAL else cluster,
                log_to_driver=False,
                logging_level="error",
                **(local if cluster == LOCAL else {}),
            )
        except Exception as error:  # of many kinds
            self.close()
            raise UnavailableError(f"{cluster}: no Ray cluster answers: {error}") from error
        self._task = ray.remote(work).options(
            num_cpus=workers.cores, memory=int(workers.memory_gb * _GB), max_retries=0
        )
        self._numbers: dict[Any, int] = {}
        self._most, self._counted_s = 0, -_COUNT_EVERY_S
        if not self.free:
            self.close()
            raise UnavailableError(
                f"{cluster}: no machine has {workers.cores:g} cores and {workers.memory_gb:g} GB; "
                "ask for less under workers, in the plan"
            )

    @property
    def free(self) -> bool:
        """See :class:`Here`."""
        if time.monotonic() - self._counted_s >= _COUNT_EVERY_S:
            self._counted_s = time.monotonic()
            machines = [one["Resources"] for one in self._ray.nodes() if one["Alive"]]
            self._most = _QUEUED * sum(map(self._fitting, machines))
        return len(self._numbers) < self._most

    def _fitting(self, machine: dict[str, float]) -> int:
        """How many jobs a machine can do at a time."""
        cores = machine.get("CPU", 0.0) / self._workers.cores
        return int(min(cores, machine.get("memory", 0.0) / (self._workers.memory_gb * _GB)))

    def begin(self, number: int, job: Job) -> None:
        """See :class:`Here`."""
        self._numbers[self._task.remote(job, self._address)] = number

    def next(self) -> tuple[int, Outcome]:
        """See :class:`Here`; raises :class:`UnavailableError` when the cluster is gone."""
        from ray import exceptions as lost

        try:
            (done, *_), _ = self._ray.wait(list(self._numbers), num_returns=1)
            number = self._numbers.pop(done)
            try:
                return number, self._ray.get(done)
            except lost.NodeDiedError:
                return number, Outcome(kind=LOST)
            except (lost.WorkerCrashedError, lost.OutOfMemoryError) as error:
                return number, Outcome(kind=KILLED, reason=type(error).__name__)
        except lost.RayTaskError as error:
            why = str(error).strip().splitlines()[-1]
            raise UnavailableError(
                f"Ray: a worker cannot begin: {why}; install scene4d alike on every machine"
            ) from error
        except lost.RayError as error:
            raise UnavailableError(f"Ray: {' '.join(str(error).split())}") from error

    def close(self) -> None:
        """See :class:`Here`."""
        self._opened.close()


def _check_answers(cluster: str) -> None:
    """Raise :class:`UnavailableError` where nothing listens; Ray would ask for many minutes."""
    named = re.fullmatch(r"(?:ray://)?\[?([^/\]]+?)\]?:(\d{1,5})", cluster)
    if named is None:
        return
    try:
        socket.create_connection((named[1], int(named[2])), timeout=_ANSWER_S).close()
    except (OSError, OverflowError, UnicodeError) as error:
        raise UnavailableError(f"{cluster}: no Ray cluster answers: {error}") from error


Executor = Here | OnRay
