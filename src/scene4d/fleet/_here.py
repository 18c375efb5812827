"""Tasks done one after the other, in this process."""

from typing import Protocol, runtime_checkable

from scene4d.fleet._stages import Outcome, Work
from scene4d.fleet._tasks import Job


@runtime_checkable
class Executor(Protocol):
    """Takes jobs while it is ``free``, and gives them back with their outcome, in any order."""

    @property
    def free(self) -> bool:
        """Whether to give it another job; so many are on their way and no more."""
        ...

    def begin(self, number: int, job: Job) -> None:
        """Take a job, with a number to know it by."""
        ...

    def next(self) -> tuple[int, Outcome]:
        """Wait for one to end; its number, and how it ended."""
        ...

    def close(self) -> None:
        """End whatever is under way."""
        ...


class Here:
    """Each job is done when its outcome is asked for."""

    def __init__(self, address: str, work: Work) -> None:
        self._address, self._work = address, work
        self._job: tuple[int, Job] | None = None

    @property
    def free(self) -> bool:
        """See :class:`Executor`."""
        return self._job is None

    def begin(self, number: int, job: Job) -> None:
        """See :class:`Executor`."""
        self._job = number, job

    def next(self) -> tuple[int, Outcome]:
        """See :class:`Executor`."""
        assert self._job is not None
        (number, job), self._job = self._job, None
        return number, self._work(job, self._address)

    def close(self) -> None:
        """See :class:`Executor`."""
