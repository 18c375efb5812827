"""Which process writes which run: locks that the operating system releases if it dies."""

import os
from dataclasses import dataclass
from pathlib import Path

from filelock import FileLock, Timeout

from scene4d.core.errors import InputError
from scene4d.core.files import write_json
from scene4d.core.json_object import JsonObject


@dataclass(frozen=True)
class Claimed:
    """What the writer of a run states about it until the run is complete."""

    run: str
    camera: str
    track_base: int
    pid: int


@dataclass
class Claim:
    """The right to write one run, held through a lock.

    ``before`` is the claim of an earlier attempt, None for the first: the file remains if a run is
    killed, so that its rerun uses the same track numbers.
    """

    path: Path
    lock: FileLock
    before: Claimed | None

    @classmethod
    def take(cls, path: Path, run: str) -> "Claim":
        """Claim the run; raises :class:`InputError` if another process has it."""
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
        """Write the claim file; the caller holds the scene's lock."""
        said = {"run": run, "camera": camera, "track_base": track_base, "pid": os.getpid()}
        write_json(self.path, said)

    def release(self, *, done: bool) -> None:
        """Release the run, and remove the files of the claim if it is ``done``; the caller holds
        the scene's lock.
        """
        self.lock.release()
        if done:
            self.path.unlink(missing_ok=True)
            Path(self.lock.lock_file).unlink(missing_ok=True)


def claims(folder: Path, *, but: str) -> list[tuple[Claimed, bool]]:
    """All claims in a scene's ``runs`` except that of run ``but``, each with whether its writer is
    alive; the caller holds the scene's lock.
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
    """The content of a claim; None if its writer was killed before writing it."""
    try:
        said = JsonObject.read(path)
        base, pid = (said.integer(name, least=0) for name in ("track_base", "pid"))
        return Claimed(said.text("run"), said.text("camera"), base, pid)
    except InputError:
        return None
