"""``serve``: the page with search, footage and what is new, for a browser or a program."""

import os
import socket
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import TYPE_CHECKING

from scene4d.core.errors import InputError, UnavailableError

if TYPE_CHECKING:
    from starlette.applications import Starlette

    from scene4d.app._served import Served


@dataclass(frozen=True)
class ServeOptions:
    """Options of ``serve``.

    ``footage`` is a file or a folder with the footage, if it has moved since it was tracked;
    ``zones`` is the file that zones and lines are read from and saved to, ``zones.json`` in the
    first scene by default. Any ``host`` but this machine's own needs a ``token``, which every
    request must bring. ``public_names`` are those under which others reach it, such as a proxy's.
    """

    host: str = "127.0.0.1"
    port: int = 8080
    token: str | None = None
    footage: str | Path | None = None
    zones: str | Path | None = None
    public_names: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Check the values; raises :class:`InputError`."""
        from scene4d.app._hosts import is_loopback

        if not 0 <= self.port < 65_536:
            raise InputError(f"port: found {self.port}, expected 0 to 65535")
        if self.token is not None and (len(self.token) < 8 or not self.token.isprintable()):
            raise InputError("token: expected 8 or more printable characters")
        if self.token is None and not is_loopback(self.host):
            raise InputError(
                f"host: {self.host} can be reached by others, so a token is needed; set token"
            )
        if self.footage is not None and not Path(self.footage).exists():
            raise InputError(f"footage: {self.footage} does not exist")


def serve(
    scenes: Sequence[str | os.PathLike[str]],
    options: ServeOptions | None = None,
    *,
    ready: Callable[[str], None] = lambda address: None,
) -> None:
    """Answer at ``http://host:port/`` until interrupted; ``ready`` is called with the address once
    it accepts connections. A scene may still be empty: it fills while it is served.

    Raises :class:`InputError` for scenes that cannot be read and an address that is taken, and
    :class:`UnavailableError` without starlette and uvicorn.
    """
    options = options or ServeOptions()
    app, served = application(scenes, options)
    from scene4d.app._server import Server

    with _socket(options) as taken:
        port = taken.getsockname()[1]
        name = f"[{options.host}]" if ":" in options.host else options.host
        try:
            Server(app, served, lambda: ready(f"http://{name}:{port}/")).run(sockets=[taken])
        finally:
            served.close()


def application(
    scenes: Sequence[str | os.PathLike[str]], options: ServeOptions
) -> "tuple[Starlette, Served]":
    """The application for a server of your own, and what it holds, to be closed at the end."""
    try:
        from scene4d.app._api import Api
    except ModuleNotFoundError as error:
        raise UnavailableError(
            f"serve needs {error.name}, which is not installed; pip install 'scene4d[app]'"
        ) from error
    from scene4d.app._served import Served

    footage = None if options.footage is None else Path(options.footage)
    zones = None if options.zones is None else Path(options.zones)
    served = Served([Path(one) for one in scenes], footage, zones)
    return Api(served).app(options.token, (options.host, *options.public_names)), served


def _socket(options: ServeOptions) -> socket.socket:
    family = socket.AF_INET6 if ":" in options.host else socket.AF_INET
    taken = socket.socket(family)
    try:
        taken.setsockopt(socket.SOL_SOCKET, socket.SO_REUSEADDR, 1)
        taken.bind((options.host, options.port))
    except OSError as error:
        taken.close()
        where = f"{options.host}:{options.port}"
        raise InputError(f"{where}: cannot be used: {error.strerror}; name another port") from error
    return taken
