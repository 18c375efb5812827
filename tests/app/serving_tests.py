"""A server in a thread, for tests."""

import http.client
import json
import socket
import threading
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path

from scene4d.app import ServeOptions, application
from scene4d.app._server import Server


class Running:
    """A server in a thread, and a plain client."""

    def __init__(self, folder: Path, at_port: int = 0, **options) -> None:
        app, self.served = application([folder], ServeOptions(**options))
        self.api = app.state.api
        self.server = Server(app, self.served)
        taken = socket.create_server(("127.0.0.1", at_port))
        self.port = taken.getsockname()[1]
        work = {"target": self.server.run, "kwargs": {"sockets": [taken]}, "daemon": True}
        self.thread = threading.Thread(**work)
        self.thread.start()

    @property
    def url(self) -> str:
        return f"http://127.0.0.1:{self.port}"

    def ask(self, method: str, path: str, body: str | None = None, **headers: str):
        """Status, headers and body of an answer; ``_`` in names of headers is ``-``."""
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        sent = {name.replace("_", "-"): value for name, value in headers.items()}
        client.request(method, path, body, sent)
        answer = client.getresponse()
        content = answer.read()
        client.close()
        return answer.status, dict(answer.getheaders()), content

    def post(self, path: str, said: object, method: str = "POST"):
        status, _, body = self.ask(method, path, json.dumps(said), Content_Type="application/json")
        return status, json.loads(body)

    @contextmanager
    def listening(self) -> Iterator[Iterator[tuple[str, object]]]:
        """What the server tells of itself while it is listened to: kinds and contents."""
        client = http.client.HTTPConnection("127.0.0.1", self.port, timeout=30)
        client.request("GET", "/api/live")
        lines = (line.decode().rstrip("\n") for line in client.getresponse())
        try:
            yield _news(lines)
        finally:
            client.close()

    def close(self) -> None:
        self.server.should_exit = True
        self.thread.join(10)
        self.served.close()


def _news(lines: Iterator[str]) -> Iterator[tuple[str, object]]:
    for line in lines:
        assert not line.startswith(":"), "nothing was told for 15 s"
        if line.startswith("event: "):
            yield line.removeprefix("event: "), json.loads(next(lines).removeprefix("data: "))
