"""Who is writing which run: locks that the operating system takes back from a dead process."""

import os
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from scene4d.core.errors import InputError
from scene4d.core.files import write_json
from scene4d.core.json_object import JsonObject


@dataclass(frozen=True)
class Claimed:
    """What the writer of a run says of itself, as long as the run has not been written whole."""

    run: str
    camera: str
    track_base: int
    pid: int


@dataclass
class Claim:
    """The right to write one run, held through a lock.

    ``before`` is what an earlier attempt said, None for the first: the file stays where a run is
    killed, so that its rerun counts its tracks from the same number.
    """

    path: Path
    lock: FileLock
    before: Claimed | None

    @classmethod
    def take(cls, path: Path, run: str) -> "Claim":
        """Take the run; raises :class:`InputError` where another process has it."""
        lock, before = FileLock(path.with_suffix(".lock"), timeout=0), read_claim(path)
        try:
            lock.acquire()
        except Timeout as error:
            pid = "unknown" if before is None else before.pid
            raise InputError(
                f"{path.parent.parent}: run {run!r} is being written by process {pid}; wait for "
                "it to end"
            ) from error
        return cls(path, lock, before)

    def write(self, run: str, camera: str, track_base: int) -> None:
        """Say what is claimed; the scene is locked meanwhile."""
        said = {"run": run, "camera": camera, "track_base": track_base, "pid": os.getpid()}
        write_json(self.path, said)

    def release(self, *, done: bool) -> None:
        """Let another process take it, and leave nothing of a run that is ``done``; the scene is
        locked meanwhile.
        """
        self.lock.release()
        if done:
            self.path.unlink(missing_ok=True)
            Path(self.lock.lock_file).unlink(missing_ok=True)


def claims(folder: Path, *, but: str) -> list[tuple[Claimed, bool]]:
    """All claims in a scene's ``runs`` but one run's, each with whether its writer is alive; the
    scene is locked meanwhile.
    """
    found = []
    for path in sorted(folder.glob(".*.claim")):
        said = read_claim(path)
        if said is not None and said.run != but:
            found.append((said, _is_locked(path.with_suffix(".lock"))))
    return found


def _is_locked(path: Path) -> bool:
    lock = FileLock(path, timeout=0)
    try:
        lock.acquire()
    except Timeout:
        return True
    lock.release()
    return False


def read_claim(path: Path) -> Claimed | None:
    """What a claim says; None where its writer was killed before it said anything."""
    try:
        said = JsonObject.read(path)
        base, pid = (said.integer(name, least=0) for name in ("track_base", "pid"))
        return Claimed(said.text("run"), said.text("camera"), base, pid)
    except InputError:
        return None
