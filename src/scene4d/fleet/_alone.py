"""One fleet at a time on a store: a lock in a folder, a lease that is renewed elsewhere."""

import os
import secrets
import socket
import threading
import time
from collections.abc import Callable, Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock, Timeout

from scene4d.core.errors import InputError, OutputError, Scene4DError
from scene4d.core.json_object import JsonObject
from scene4d.fleet._store import Store

_LEASE = "lease"
_LEASE_S, _RENEW_S = 60.0, 15.0
"""A lease that was not renewed for so long is nobody's; three renewals may fail, and clocks of two
machines may differ by what is between.
"""
_REMEDY = "wait for it to end, or give another store"


@contextmanager
def alone(store: Store) -> Iterator[Callable[[], None]]:
    """Open a store for this fleet alone; what is given raises :class:`OutputError` once another
    fleet has it. Raises :class:`InputError` where one has it already.
    """
    store.open()
    if store.folder is not None:
        with _locked(store.folder):
            store.sweep()
            try:
                yield lambda: None
            finally:
                store.sweep()
        return
    lease = Lease(store)
    lease.take()
    ended = threading.Event()
    thread = threading.Thread(target=lease.keep, args=[ended], daemon=True)
    thread.start()
    try:
        yield lease.check
    finally:
        ended.set()
        thread.join()
        lease.release()


@contextmanager
def _locked(folder: Path) -> Iterator[None]:
    """The operating system releases it if the program dies."""
    lock = FileLock(folder / ".lock", timeout=0)
    try:
        lock.acquire()
    except Timeout as error:
        raise InputError(f"{folder}: another fleet works on this store; {_REMEDY}") from error
    except (OSError, NotImplementedError) as error:
        raise OutputError(f"{folder}: cannot be locked: {error}") from error
    try:
        yield
    finally:
        lock.release()


class Lease:
    """``lease.json``: whose the store is, and when that was last said. No kind of storage needs to
    know locks: of two that write it at the same moment, the first one finds it changed.
    """

    def __init__(self, store: Store) -> None:
        self._store, self._me = store, secrets.token_hex(8)
        self._renewed_s = time.monotonic()
        self._lost: str | None = None

    def take(self) -> None:
        """Raises :class:`InputError` where another fleet has it."""
        self._renew()
        if self._lost is not None:
            raise InputError(self._lost)

    def keep(self, ended: threading.Event) -> None:
        """Renew it until that is set, or it is lost."""
        while self._lost is None and not ended.wait(_RENEW_S):
            try:
                self._renew()
            except Scene4DError as error:  # the next one may pass
                if time.monotonic() - self._renewed_s > _LEASE_S:
                    self._lost = str(error)

    def check(self) -> None:
        """Raises :class:`OutputError` where it is lost."""
        if self._lost is not None:
            raise OutputError(self._lost)

    def release(self) -> None:
        """Give it back; if that fails it ends by itself."""
        with suppress(Scene4DError):
            if self._lost is None and self._other() is None:
                self._store.remove(_LEASE)

    def _renew(self) -> None:
        self._lost = self._other()
        if self._lost is not None:
            return
        said = {"owner": self._me, "host": socket.gethostname(), "pid": os.getpid()}
        self._store.write(_LEASE, said | {"renewed_s": time.time()})
        self._renewed_s = time.monotonic()
        self._lost = self._other()

    def _other(self) -> str | None:
        """Who else has the store, as an error says it."""
        content = self._store.read(_LEASE)
        if content is None:
            return None
        said = JsonObject(content, f"{self._store.address}/{_LEASE}.json")
        ago_s = time.time() - said.number("renewed_s")
        if said.text("owner") == self._me or abs(ago_s) > _LEASE_S:
            return None
        return (
            f"{self._store.address}: another fleet works on this store (process "
            f"{said.integer('pid')} on {said.text('host')}, {ago_s:.0f} s ago; one that was killed "
            f"is forgotten after {_LEASE_S:.0f} s); {_REMEDY}"
        )
