"""The server process: uvicorn, told what it serves so that it ends at once."""

import socket

import uvicorn
from starlette.applications import Starlette

from scene4d.app._served import Served

_MOST_AT_ONCE = 64
"""Connections: a page holds one for what is new and a few for footage."""
_ENDING_S = 3
"""Longer than connections take that look for what is new once a second."""


class Server(uvicorn.Server):
    """Ends the connections that wait for what is new before it waits for all."""

    def __init__(self, app: Starlette, served: Served) -> None:
        self._served = served
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

    async def shutdown(self, sockets: list[socket.socket] | None = None) -> None:
        """See :class:`uvicorn.Server`."""
        self._served.ending = True
        await super().shutdown(sockets)
