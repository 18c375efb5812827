"""Work in a process of its own, which is ended where nobody waits for it any more."""

import asyncio
import json
import sys
from collections.abc import Callable
from contextlib import suppress
from typing import Any

from scene4d.core.errors import InputError, OutputError, Scene4DError, UnavailableError

_LONGEST_LINE = 1 << 28
"""Bytes of an answer."""


class BusyError(Scene4DError):
    """Too many ask at once."""

    kind = "busy"


class SlowError(Scene4DError):
    """What was asked takes too long."""

    kind = "slow"


_ERRORS = {kind.kind: kind for kind in (InputError, OutputError, Scene4DError, UnavailableError)}
Teller = Callable[[dict[str, Any]], None]


class Worker:
    """One ``process``, which does one task after the other; it begins with the first one."""

    def __init__(self) -> None:
        self.process: asyncio.subprocess.Process | None = None
        self._turn = asyncio.Lock()

    async def ask(self, task: str, tell: Teller = lambda stage: None, **values: Any) -> Any:
        """The answer to a task of :data:`.TASKS`; ``tell`` hears where it stands.

        Whatever ends the waiting, a time limit too, ends the process: the next task gets a new
        one. Raises what the task does.
        """
        async with self._turn:
            try:
                said = await self._said(json.dumps({"task": task} | values), tell)
            except BaseException:
                await self.end()
                raise
        if "error" in said:
            raise _ERRORS[said["error"]["kind"]](said["error"]["message"])
        return said["answer"]

    async def _said(self, line: str, tell: Teller) -> dict[str, Any]:
        process = await self._begun()
        assert process.stdin is not None and process.stdout is not None
        process.stdin.write(f"{line}\n".encode())
        while line_back := await process.stdout.readline():
            said: dict[str, Any] = json.loads(line_back)
            if "stage" not in said:
                return said
            tell(said)
        raise Scene4DError("the process that did it was ended, perhaps for want of memory")

    async def _begun(self) -> asyncio.subprocess.Process:
        if self.process is None or self.process.returncode is not None:
            self.process = await asyncio.create_subprocess_exec(
                *(sys.executable, "-P", "-m", "scene4d.app._worker"),
                stdin=asyncio.subprocess.PIPE,
                stdout=asyncio.subprocess.PIPE,
                limit=_LONGEST_LINE,
                start_new_session=True,  # Ctrl-C is for the server, which ends it
            )
        return self.process

    async def end(self) -> None:
        """End the process, whatever it does."""
        process, self.process = self.process, None
        if process is not None:
            with suppress(ProcessLookupError):
                process.kill()
            await process.wait()
