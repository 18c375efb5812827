"""The process in which a server searches and calibrates, so that this can be ended at any moment.

One task a line on standard input, as JSON; lines of JSON come back: where it stands, and then the
answer or the error. It ends with its input, however the server ended.
"""

import json
import os
import queue
import sys
import threading
import time
import traceback
from collections.abc import Iterator
from contextlib import contextmanager
from typing import Any, TextIO

from scene4d.app._tasks import TASKS
from scene4d.core.errors import Scene4DError
from scene4d.core.progress import Advance

_TELL_S = 0.3
"""How often progress is told at most."""


class _Told:
    """Progress as lines of JSON: the stage, and what share of it is done where that is known."""

    def __init__(self, out: TextIO) -> None:
        self._out, self._next_s = out, 0.0

    @contextmanager
    def stage(self, title: str, total: int | None) -> Iterator[Advance]:
        """See :class:`.Progress`."""
        done, self._next_s = 0, 0.0

        def step(steps: int) -> None:
            nonlocal done
            done += steps
            if time.monotonic() >= self._next_s:
                self._next_s = time.monotonic() + _TELL_S
                share = min(1.0, done / total) if total else None
                say(self._out, {"stage": title, "share": share})

        step(0)
        yield step


def say(out: TextIO, said: dict[str, Any]) -> None:
    """One line."""
    out.write(json.dumps(said, allow_nan=False) + "\n")
    out.flush()


def main() -> None:
    """Answer tasks until the input ends."""
    out = os.fdopen(os.dup(1), "w", encoding="utf-8")
    os.dup2(2, 1)  # whatever a library prints is no answer
    tasks: queue.Queue[str] = queue.Queue()
    threading.Thread(target=_listen, args=(tasks,), daemon=True).start()
    while True:
        task = json.loads(tasks.get())
        try:
            said = {"answer": TASKS[task.pop("task")](**task, progress=_Told(out))}
        except Scene4DError as error:
            said = {"error": {"kind": error.kind, "message": str(error)}}
        except Exception as error:  # a defect ends the task, not the process
            traceback.print_exc()
            said = {"error": {"kind": "failed", "message": f"{type(error).__name__}: {error}"}}
        say(out, said)


def _listen(tasks: "queue.Queue[str]") -> None:
    for line in sys.stdin:
        tasks.put(line)
    os._exit(0)


if __name__ == "__main__":
    main()
