"""Where a fleet's results lie: a folder, or any address that fsspec knows, as s3://bucket/fleet.

STAGE/CAMERA/key=KEY/...    a result, as its stage writes it: a camera, a scene, a site, events
done/KEY.json               it is whole: written after all of it
quarantine/KEY.json         it cannot be made, and why; remove the file to have it tried again
lease.json                  the fleet that works on it; in a folder a lock, .lock
clips/CAMERA.json           what the clips' content is, for those that have not changed since
events/NUMBER.parquet       what the searches of the plan found in all cameras, best first
status.json                 how far the plan is, camera by camera
"""

import hashlib
import json
import shutil
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from typing import Any

import fsspec
from fsspec.implementations.local import LocalFileSystem

from scene4d.core.errors import InputError, OutputError, UnavailableError
from scene4d.core.files import write_bytes
from scene4d.core.staging import ensure_folder, scratch
from scene4d.fleet._tasks import Result
from scene4d.store.runs import file_name

_HALF = ".half"
"""Where results on their way into a folder are."""


class Store:
    """Reads and writes below one address. Every failure is an error that names it:
    :class:`OutputError` while writing, :class:`InputError` while reading.
    """

    def __init__(self, address: str) -> None:
        try:
            self._fs, root = fsspec.core.url_to_fs(address)
        except ImportError as error:
            raise UnavailableError(
                f"{address}: {error}; pip install the package that it names"
            ) from error
        except Exception as error:
            raise InputError(
                f"{address}: is no store: {error}; give a folder or an address"
            ) from error
        self._root = str(root).rstrip("/")
        local = isinstance(self._fs, LocalFileSystem)
        self.folder = Path(self._root) if local else None
        self.address = self._root if local else address.rstrip("/")  # workers stand elsewhere

    def open(self) -> None:
        """Make it where it is not there, and check that it can be written."""
        if self.folder is not None:
            ensure_folder(self.folder)
        self.write("store", {"schema": "scene4d/fleet-store/1"})

    def sweep(self) -> None:
        """Remove what killed workers left half; workers of a killed program may still be at it."""
        if self.folder is not None:
            with self._half():
                pass

    def keys(self, kind: str) -> set[str]:
        """The keys of all that is ``done``, or in ``quarantine``."""
        with self._reading(kind):
            try:
                self._fs.invalidate_cache()
                found = self._fs.ls(f"{self._root}/{kind}", detail=False)
            except FileNotFoundError:
                return set()
        return {Path(one).stem for one in found if one.endswith(".json")}

    def read(self, name: str) -> Any:
        """The JSON file NAME.json; None where it is not there."""
        with self._reading(name):
            try:
                return json.loads(self._fs.cat_file(f"{self._root}/{name}.json"))
            except FileNotFoundError:
                return None

    def write(self, name: str, values: dict[str, Any]) -> None:
        """Write NAME.json, whole or not at all."""
        text = json.dumps(values, indent=1, allow_nan=False) + "\n"
        self.write_bytes(f"{name}.json", text.encode())

    def remove(self, name: str) -> None:
        """Remove NAME.json."""
        with self._writing(name):
            self._fs.rm_file(f"{self._root}/{name}.json")

    def drop(self, result: Result) -> None:
        """Remove a result, if somebody has not done so already; first the word that it is whole."""
        with self._writing(result.path):
            with suppress(FileNotFoundError):
                self._fs.rm_file(f"{self._root}/done/{result.key}.json")
            with suppress(FileNotFoundError):
                if self.folder is None:
                    self._fs.rm(f"{self._root}/{result.path}", recursive=True)
                    return
                with self._half() as here:  # a folder goes at once, as it came
                    (self.folder / result.path).rename(here / "dropped")

    def write_bytes(self, name: str, content: bytes) -> None:
        """Write a file, whole or not at all."""
        if self.folder is not None:
            path = self.folder / name
            path.parent.mkdir(parents=True, exist_ok=True)
            write_bytes(path, content)
            return
        with self._writing(name):
            self._fs.pipe_file(f"{self._root}/{name}", content)

    def put(self, folder: Path, result: Result) -> None:
        """Put the files of a folder in place, those that are not hidden; a folder appears at once.

        A worker of a killed program may have put the same there, and mark it as done at any moment:
        it stays. What a machine that went down has spoilt is not marked, and is replaced.
        """
        files = _files(folder)
        with self._writing(result.path):
            if self.folder is None:
                there = [f"{self._root}/{result.path}/{name}" for name in files]
                self._fs.put([str(folder / name) for name in files], there)
                return
            with self._half() as here:
                half = here / "result"
                half.mkdir()
                for name in files:
                    (half / name).parent.mkdir(parents=True, exist_ok=True)
                    shutil.copyfile(folder / name, half / name)
                self._settle(half, self.folder / result.path, result.key)

    def _settle(self, half: Path, target: Path, key: str) -> None:
        target.parent.mkdir(parents=True, exist_ok=True)
        try:
            half.rename(target)
        except OSError:
            if not target.exists():
                raise
            if self.read(f"done/{key}") is None and _files(target) != _files(half):
                target.rename(half.with_name("spoilt"))
                half.rename(target)

    @contextmanager
    def _half(self) -> Iterator[Path]:
        """A folder on the same disk, which others leave alone for as long as this process lives."""
        assert self.folder is not None
        place = self.folder / _HALF
        place.mkdir(exist_ok=True)
        with scratch(place, "on-its-way-") as here:
            yield here

    def fetched(self, path: str, place: Path) -> Path:
        """A result as a folder on this machine: that of the store, or a copy in ``place``."""
        if self.folder is not None:
            return self.folder / path
        with self._reading(path):
            target = place / path
            target.parent.mkdir(parents=True, exist_ok=True)
            self._fs.get(f"{self._root}/{path}/", f"{target}/", recursive=True)
        return target

    @contextmanager
    def _writing(self, name: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:  # each kind of store has its own
            raise OutputError(f"{self.address}/{name}: cannot be written: {error}") from error

    @contextmanager
    def _reading(self, name: str) -> Iterator[None]:
        try:
            yield
        except Exception as error:
            raise InputError(f"{self.address}/{name}: cannot be read: {error}") from error


def _files(folder: Path) -> dict[str, int]:
    """Names of files in a folder, those that are not hidden, with their sizes."""
    found = ((one.relative_to(folder), one) for one in folder.rglob("*") if one.is_file())
    return {
        name.as_posix(): one.stat().st_size
        for name, one in sorted(found)
        if not any(part.startswith(".") for part in name.parts)
    }


class Clips:
    """SHA-256 of clips; those of unchanged size and time of change are not read again."""

    def __init__(self, store: Store) -> None:
        self._store = store
        self._known: dict[str, dict[str, list[Any]]] = {}
        self._changed: set[str] = set()

    def sha256(self, camera: str, clip: Path) -> str:
        """The hash of a clip's content; raises :class:`UnavailableError` if it cannot be read."""
        if camera not in self._known:
            self._known[camera] = self._store.read(_clips_of(camera)) or {}
        known, name = self._known[camera], str(clip)
        try:
            said = clip.stat()
            stat = [said.st_size, said.st_mtime_ns]
            if name not in known or known[name][:2] != stat:
                with clip.open("rb") as file:
                    known[name] = [*stat, hashlib.file_digest(file, "sha256").hexdigest()]
                self._changed.add(camera)
        except OSError as error:
            raise UnavailableError(f"{clip}: cannot be read: {error.strerror}") from error
        return known[name][2]

    def save(self) -> None:
        """Write what is new."""
        for camera in self._changed:
            self._store.write(_clips_of(camera), self._known[camera])
        self._changed.clear()


def _clips_of(camera: str) -> str:
    return f"clips/{file_name(camera, 'camera')}"
