"""A camera that is calibrated again from the page: one at a time, with progress, and cancelled."""

import asyncio
from typing import Any

from scene4d.app._jobs import BusyError, SlowError, Worker
from scene4d.core.errors import InputError, Scene4DError

_LONGEST_S = 1800.0
_KNOWN = ("orientation", "landmarks")


class Calibrating:
    """The last calibration that was asked for. ``state`` is what the page is told of it."""

    def __init__(self) -> None:
        self.state: dict[str, Any] = {"state": "none"}
        self._worker = Worker()
        self._work: asyncio.Task | None = None

    def begin(self, values: dict[str, Any], about: dict[str, Any]) -> None:
        """Calibrate with these values of :func:`._tasks.calibrate`; ``about`` is told with it.

        Raises :class:`BusyError` while another one runs.
        """
        if self._work is not None and not self._work.done():
            raise BusyError("a camera is being calibrated; wait for it, or cancel it")
        self.state = about | {"state": "running", "stage": "Starting", "share": None}
        self._work = asyncio.create_task(self._run(values, about))

    async def _run(self, values: dict[str, Any], about: dict[str, Any]) -> None:
        self.state = about | await self._outcome(values)

    async def _outcome(self, values: dict[str, Any]) -> dict[str, Any]:
        try:
            async with asyncio.timeout(_LONGEST_S):
                made = await self._worker.ask("calibrate", self._tell, **values)
            return {"state": "done"} | made
        except TimeoutError:
            return _failure(SlowError(f"it takes longer than {_LONGEST_S / 60:.0f} minutes"))
        except Scene4DError as error:
            return _failure(error)
        finally:
            await self._worker.end()  # the networks take memory

    def _tell(self, stage: dict[str, Any]) -> None:
        self.state = self.state | stage

    async def cancel(self) -> None:
        """End it, if it runs; nothing is written then."""
        if self._work is not None and not self._work.done():
            self._work.cancel()
            await asyncio.wait({self._work})
            self.state = {"state": "none"}


def _failure(error: Scene4DError) -> dict[str, Any]:
    message = " ".join(str(error).split())
    return {"state": "failed", "error": {"kind": error.kind, "message": message}}


def known_of(said: dict[str, Any]) -> dict[str, Any]:
    """What is known of a camera; raises :class:`InputError` for anything else."""
    if not said or not said.keys() <= set(_KNOWN):
        raise InputError(f"expected {' or '.join(_KNOWN)}, found {', '.join(said) or 'nothing'}")
    for name, value in said.items():
        if not isinstance(value, dict):
            raise InputError(f"{name}: expected an object, as its file holds it")
    return said
