"""Where alerts go: a webhook, an MQTT topic, or a command."""

import base64
import shlex
import shutil
import subprocess
import urllib.request
from typing import Any, Protocol, runtime_checkable
from urllib.parse import unquote, urlsplit

from scene4d.core.errors import InputError, UnavailableError
from scene4d.core.text import quoted
from scene4d.video.stream import without_password

_TIMEOUT_S = 10.0
_COMMAND_TIMEOUT_S = 60.0


@runtime_checkable
class Target(Protocol):
    """Takes alerts, one at a time; ``name`` is shown, and has no secrets."""

    name: str

    def send(self, content: bytes) -> None:
        """Deliver the JSON of an event, or raise anything."""

    def close(self) -> None:
        """Nothing more will be sent."""


def target_of(said: str) -> Target:
    """The target of a URL or ``exec:COMMAND``; raises :class:`InputError` for another."""
    if said.startswith("exec:"):
        return _Command(said.removeprefix("exec:"))
    kind = said.partition("://")[0].lower()
    if kind in {"http", "https"}:
        return _Webhook(said)
    if kind in {"mqtt", "mqtts"}:
        return _Topic(said)
    raise InputError(
        f"alert: found {quoted(without_password(said))}; expected https://..., "
        "mqtt://host/topic or exec:COMMAND"
    )


class _Webhook:
    """POSTs the JSON."""

    def __init__(self, url: str) -> None:
        self.name = without_password(url)
        parts = _address(url)
        user, _, host = parts.netloc.rpartition("@")
        self._url = parts._replace(netloc=host).geturl()
        self._headers = {"Content-Type": "application/json", "User-Agent": "scene4d"}
        if user:
            secret = base64.b64encode(unquote(user).encode()).decode()
            self._headers["Authorization"] = f"Basic {secret}"

    def send(self, content: bytes) -> None:
        asked = urllib.request.Request(self._url, content, self._headers, method="POST")
        with urllib.request.urlopen(asked, timeout=_TIMEOUT_S) as answer:
            answer.read(1024)

    def close(self) -> None:
        """Each delivery is a connection of its own."""


class _Topic:
    """Publishes the JSON with quality of service 1: the broker confirms that it has it."""

    def __init__(self, url: str) -> None:
        try:
            from paho.mqtt.client import Client
            from paho.mqtt.enums import CallbackAPIVersion
        except ImportError as error:
            raise UnavailableError(
                "alerts to MQTT need the library paho-mqtt; pip install 'scene4d[mqtt]'"
            ) from error
        self.name = without_password(url)
        parts = _address(url)
        self._topic = unquote(parts.path.lstrip("/"))
        if not self._topic or set(url.partition(parts.netloc)[2]) & {"+", "#", "?"}:
            raise InputError(f"alert: {self.name}: expected mqtt://host/topic, without +, ? and #")
        secure = parts.scheme.lower() == "mqtts"
        self._host, self._port = parts.hostname or "", parts.port or (8883 if secure else 1883)
        self._client: Any = Client(CallbackAPIVersion.VERSION2)
        if parts.username:
            self._client.username_pw_set(unquote(parts.username), unquote(parts.password or ""))
        if secure:
            self._client.tls_set()
        self._running = False

    def send(self, content: bytes) -> None:
        if not self._running:
            self._client.connect(self._host, self._port)
            self._client.loop_start()  # connects again by itself
            self._running = True
        told = self._client.publish(self._topic, content, qos=1)
        told.wait_for_publish(_TIMEOUT_S)
        if not told.is_published():
            self.close()
            raise TimeoutError("the broker does not confirm")

    def close(self) -> None:
        if self._running:
            self._client.disconnect()
            self._client.loop_stop()
            self._running = False


class _Command:
    """Runs a program, without a shell, with the JSON on its standard input."""

    def __init__(self, said: str) -> None:
        try:
            self._words = shlex.split(said)
        except ValueError as error:
            raise InputError(f"alert: exec:{said}: {error}") from error
        if not self._words or shutil.which(self._words[0]) is None:
            name = quoted(self._words[0] if self._words else "")
            raise InputError(f"alert: there is no command {name}; give its path")
        self.name = f"exec:{self._words[0]}"

    def send(self, content: bytes) -> None:
        done = subprocess.run(
            self._words,
            input=content,
            stdout=subprocess.DEVNULL,
            timeout=_COMMAND_TIMEOUT_S,
            check=False,
        )
        if done.returncode:
            raise OSError(f"the command ended with {done.returncode}")

    def close(self) -> None:
        """Each delivery is a process of its own."""


def _address(url: str) -> Any:
    parts = urlsplit(url)
    try:
        port_is_read = parts.port is None or parts.port > 0
    except ValueError:
        port_is_read = False
    if not parts.hostname or not port_is_read:
        raise InputError(f"alert: {without_password(url)}: expected an address with a host")
    return parts
