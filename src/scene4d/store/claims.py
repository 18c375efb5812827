"""Who is writing which run: locks that the operating system takes back from a dead process."""

import fcntl
import json
import os
from collections.abc import Iterator
from contextlib import contextmanager
from dataclasses import dataclass
from pathlib import Path
from typing import IO

from scene4d.core.errors import InputError
from scene4d.core.files import read_json


@dataclass
class Claim:
    """The right to write one run, held through an open and locked file.

    ``track_base`` is the one an attempt before had, None for the first: the file stays where a
    run is killed, so that its rerun counts its tracks from the same number.
    """

    path: Path
    track_base: int | None
    file: IO[bytes]

    @classmethod
    def take(cls, path: Path, run: str) -> "Claim":
        """Take the run; raises :class:`InputError` where another process has it."""
        file = path.open("ab")
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError as error:
            file.close()
            pid = _read(path).get("pid", "unknown")
            raise InputError(
                f"{path.parent.parent}: run {run!r} is being written by process {pid}; wait for "
                "it to end"
            ) from error
        return cls(path, _read(path).get("track_base"), file)

    def write(self, run: str, camera: str, track_base: int) -> None:
        """Say what is claimed; the scene is locked meanwhile."""
        values = {"pid": os.getpid(), "run": run, "camera": camera, "track_base": track_base}
        self.file.truncate(0)
        self.file.write(json.dumps(values).encode())
        self.file.flush()
        os.fsync(self.file.fileno())

    def release(self) -> None:
        """Let another process take it."""
        self.file.close()


@dataclass(frozen=True)
class Claimed:
    """A run without a manifest: one that is being written (``alive``), or was killed."""

    run: str
    camera: str
    track_base: int
    alive: bool


def claims(folder: Path, *, but: str) -> list[Claimed]:
    """All claims in a scene's ``runs`` but one run's; the scene is locked meanwhile."""
    found = []
    for path in sorted(folder.glob(".*.claim")):
        said = _read(path)
        if said and said["run"] != but:
            alive = _is_locked(path)
            found.append(Claimed(said["run"], said["camera"], said["track_base"], alive))
    return found


@contextmanager
def locked(path: Path) -> Iterator[None]:
    """Wait for a lock, and hold it; for the few milliseconds in which a scene is looked over."""
    with path.open("ab") as file:
        fcntl.flock(file, fcntl.LOCK_EX)
        yield


def _is_locked(path: Path) -> bool:
    with path.open("ab") as file:
        try:
            fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
        except BlockingIOError:
            return True
    return False


def _read(path: Path) -> dict:
    try:
        said = read_json(path)
    except InputError:  # killed before it said anything, hence before it wrote anything
        return {}
    return said if isinstance(said, dict) else {}
