"""What clips contain, as a hash, read once and remembered in the store."""

import hashlib
from pathlib import Path

from scene4d.core.errors import UnavailableError
from scene4d.fleet._store import Store
from scene4d.store.runs import file_name

_Stat = tuple[int, int]
"""Bytes, and when it was changed (ns)."""


class Clips:
    """SHA-256 of clips; those of unchanged size and time of change are not read again."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._known: dict[str, dict[str, tuple[_Stat, str]]] = {}
        self._changed: set[str] = set()

    def sha256(self, camera: str, clip: Path) -> str:
        """The hash of a clip's content; raises :class:`UnavailableError` if it cannot be read."""
        known = self._of(camera)
        name = str(clip)
        try:
            said = clip.stat()
            stat = said.st_size, said.st_mtime_ns
            if name not in known or known[name][0] != stat:
                with clip.open("rb") as file:
                    known[name] = stat, hashlib.file_digest(file, "sha256").hexdigest()
                self._changed.add(camera)
        except OSError as error:
            raise UnavailableError(f"{clip}: cannot be read: {error.strerror}") from error
        return known[name][1]

    def save(self) -> None:
        """Write what is new."""
        for camera in self._changed:
            said = {name: [*stat, digest] for name, (stat, digest) in self._of(camera).items()}
            self._store.write(_path(camera), said)
        self._changed.clear()

    def _of(self, camera: str) -> dict[str, tuple[_Stat, str]]:
        if camera not in self._known:
            said = self._store.read(_path(camera)) or {}
            self._known[camera] = {name: ((n, ns), sha) for name, (n, ns, sha) in said.items()}
        return self._known[camera]


def _path(camera: str) -> str:
    return f"clips/{file_name(camera, 'camera')}"
