"""Progress display, and timing of stages."""

import time
from collections.abc import Callable, Iterator
from contextlib import AbstractContextManager, contextmanager, nullcontext
from typing import Protocol, runtime_checkable

Advance = Callable[[int], None]


@runtime_checkable
class Progress(Protocol):
    """Shows progress, such as a bar for every stage; ``total`` is None if unknown."""

    def stage(self, title: str, total: int | None) -> AbstractContextManager[Advance]:
        """Begin a stage; call the result with how many steps were done."""
        ...


class Silent:
    """Shows nothing."""

    def stage(self, title: str, total: int | None) -> AbstractContextManager[Advance]:
        """Begin a stage without display."""
        return nullcontext(lambda steps: None)


@contextmanager
def timed(timings: dict[str, float], name: str) -> Iterator[None]:
    """Add the seconds spent inside to ``timings[name]``."""
    begun = time.perf_counter()
    yield
    timings[name] = timings.get(name, 0.0) + time.perf_counter() - begun
