"""Alerts: events go out to webhooks, MQTT topics and commands, and nothing waits for them.

What is to be sent lies in the scene, one file each, until it was taken:

    SCENE/alerts/CAMERA/TARGET/00001763689012345678901.json

The number is a time in nanoseconds, or one more than that before it: alerts keep their order, and
none takes the place of another, also where the clock stands still or is set back.
So an alert that could not be delivered is delivered after a restart, and one that was is not sent
again. Only if the process dies between a delivery and the removal of its file is it sent twice,
with the same ``id``. TARGET is a hash: addresses hold passwords.
"""

import hashlib
import json
import logging
import threading
import time
from collections import deque
from collections.abc import Sequence
from contextlib import ExitStack
from pathlib import Path
from typing import Any

from filelock import FileLock, Timeout

from scene4d.core.files import write_bytes
from scene4d.store.runs import file_name
from scene4d.tracking._alert_targets import Target, target_of

_LOG = logging.getLogger(__name__)
_MOST_WAITING = 1000
"""Alerts that wait for one target; older ones are dropped."""
_FIRST_WAIT_S, _LONGEST_WAIT_S = 1.0, 60.0
"""Waits between attempts; each is twice the one before."""
_LAST_S = 10.0
"""At the end, what waits is sent for this long, until an attempt fails."""


class Alerts:
    """Sends each event to all targets, each with a thread of its own.

    Raises :class:`InputError` for a target of an unknown kind, and :class:`UnavailableError` where
    the library that it needs is not installed.
    """

    def __init__(self, targets: Sequence[str], scene: Path, camera: str) -> None:
        folder = scene / "alerts" / file_name(camera, "camera")
        self._outboxes = [_Outbox(target_of(said), folder, said) for said in targets]

    def __enter__(self) -> "Alerts":
        for one in self._outboxes:
            one.open()
        return self

    def __exit__(self, *_: object) -> None:
        with ExitStack() as closing:
            for one in self._outboxes:
                closing.callback(one.close, time.monotonic() + _LAST_S)

    def __bool__(self) -> bool:
        return bool(self._outboxes)

    def put(self, event: dict[str, Any]) -> None:
        """Send an event soon. Raises :class:`OutputError` if the scene cannot be written."""
        for one in self._outboxes:
            one.put(event)

    @property
    def sent(self) -> int:
        """Number of deliveries."""
        return sum(one.sent for one in self._outboxes)

    @property
    def warnings(self) -> list[str]:
        """What was not delivered."""
        return [text for one in self._outboxes for text in one.warnings]


class _Outbox:
    """What waits for one target, oldest first."""

    def __init__(self, target: Target, folder: Path, said: str) -> None:
        self._target = target
        self._folder = folder / hashlib.sha256(said.encode()).hexdigest()[:12]
        self._lock = FileLock(self._folder / ".lock", timeout=0)
        self._waiting: deque[Path] = deque()
        self._number = 0
        self._news = threading.Condition()
        self._until_s: float | None = None
        self.sent = self.lost = 0
        self._thread = threading.Thread(target=self._work, name="alerts", daemon=True)

    @property
    def warnings(self) -> list[str]:
        name, waiting = self._target.name, len(self._waiting)
        texts = [f"{name}: {self.lost} alerts were dropped: too many waited"] if self.lost else []
        if waiting:
            texts.append(f"{name}: {waiting} alerts wait in the scene for the next time")
        return texts

    def open(self) -> None:
        """Begin, with what an earlier process left."""
        self._folder.mkdir(parents=True, exist_ok=True)
        try:
            self._lock.acquire()
            self._waiting.extend(sorted(self._folder.glob("*.json")))
        except Timeout:  # another process watches this camera, and sends its own
            pass
        if self._waiting and self._waiting[-1].stem.isdecimal():
            self._number = int(self._waiting[-1].stem)
        self._thread.start()

    def put(self, event: dict[str, Any]) -> None:
        self._number = max(time.time_ns(), self._number + 1)
        while (path := self._folder / f"{self._number:020d}.json").exists():
            self._number += 1
        write_bytes(path, json.dumps(event, allow_nan=False).encode())
        with self._news:
            self._waiting.append(path)
            while len(self._waiting) > _MOST_WAITING:
                self._waiting.popleft().unlink(missing_ok=True)
                self.lost += 1
            self._news.notify_all()

    def close(self, until_s: float) -> None:
        """Send what waits until then."""
        with self._news:
            self._until_s = until_s
            self._news.notify_all()
        self._thread.join(timeout=max(0.0, until_s - time.monotonic()))
        self._lock.release()

    def _work(self) -> None:
        wait_s = 0.0
        while (path := self._next(wait_s)) is not None:
            closing = self._until_s is not None
            try:
                content = path.read_bytes()
            except FileNotFoundError:  # dropped, or taken away by hand
                self._forget(path)
                continue
            try:
                self._target.send(content)
            except Exception as error:  # whatever a library raises: the alert waits
                if not wait_s:
                    _LOG.warning("%s: an alert cannot be delivered: %s", self._target.name, error)
                wait_s = min(max(2 * wait_s, _FIRST_WAIT_S), _LONGEST_WAIT_S)
                if closing:  # it was the last attempt
                    break
                continue
            if wait_s:
                _LOG.warning("%s: alerts are delivered again", self._target.name)
            wait_s = 0.0
            self.sent += 1
            self._forget(path)
        self._target.close()

    def _forget(self, path: Path) -> None:
        with self._news:
            if path in self._waiting:
                self._waiting.remove(path)
        path.unlink(missing_ok=True)

    def _next(self, wait_s: float) -> Path | None:
        """The oldest alert, ``wait_s`` from now; None at the end."""
        with self._news:
            self._news.wait_for(lambda: self._until_s is not None, wait_s)
            self._news.wait_for(lambda: self._waiting or self._until_s is not None)
            over = self._until_s is not None and time.monotonic() >= self._until_s
            if over or not self._waiting:
                return None
            return self._waiting[0]
