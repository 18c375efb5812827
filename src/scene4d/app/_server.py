"""The server process: uvicorn, told what it serves so that it ends at once."""

import socket
from collections.abc import Callable

import uvicorn
from starlette.applications import Starlette

from scene4d.app._served import Served

_MOST_AT_ONCE = 64
"""Connections: a page holds one for what is new and a few for footage."""
_ENDING_S = 3
"""Longer than connections take that look for what is new once a second."""


class Server(uvicorn.Server):
    """Calls ``ready`` once it accepts connections, and ends those that wait for what is new before
    it waits for all.
    """

    def __init__(
        self, app: Starlette, served: Served, ready: Callable[[], None] = lambda: None
    ) -> None:
        self._served, self._ready = served, ready
        super().__init__(
            uvicorn.Config(
                app,
                log_level="warning",
                limit_concurrency=_MOST_AT_ONCE,
                timeout_graceful_shutdown=_ENDING_S,
                server_header=False,
                access_log=False,
            )
        )

    async def startup(self, sockets: list[socket.socket] | None = None) -> None:
        """See :class:`uvicorn.Server`."""
        await super().startup(sockets)
        if self.started:
            self._ready()

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """See :class:`uvicorn.Server`."""
        self._served.ending = True
        await super().shutdown(sockets)
