"""The sample video: people in front of a fixed camera whose true calibration is published.

It is PETS 2009 S2.L1 View_001 (795 frames, 768x576, 10 fps, University of Reading), which OpenCV
carries as ``vtest.avi``.
"""

import gzip
import hashlib
import http.client
import lzma
import os
import shutil
import subprocess
import tarfile
import tempfile
import urllib.request
import zlib
from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import BinaryIO

from scene4d.core.errors import UnavailableError
from scene4d.core.files import write_bytes

_FILE_NAME = "vtest.avi"
SHA256 = "45cddc9490be69345cbdab64ca583be65987e864ca408038e648db99e10516cf"
_DEBIAN_PACKAGE = "opencv-doc"
_OPENCV_URL = "https://github.com/opencv/opencv/raw/4.10.0/samples/data/vtest.avi"
TIMEOUT_S = 30.0
_APT_TIMEOUT_S = 600.0
_MAX_BYTES = 64 << 20


@dataclass(frozen=True)
class SampleSource:
    """A place that may have the video. ``fetch`` gives its bytes or raises one of FAILURES."""

    name: str
    fetch: Callable[[], bytes]


FAILURES = (
    OSError,
    EOFError,
    ValueError,
    LookupError,
    subprocess.SubprocessError,
    http.client.HTTPException,
    tarfile.TarError,
    lzma.LZMAError,
    zlib.error,
)
"""What a source may raise; anything else is a defect and is not swallowed."""


def sample_video(
    cache_dir: str | os.PathLike[str],
    *,
    progress: Callable[[str], None] | None = None,
    sources: Sequence[SampleSource] | None = None,
) -> Path:
    """The sample video in ``cache_dir``, fetched on first use from the first source that has it.

    Every copy is checked by its SHA-256 and put in place atomically; ``progress`` is told in one
    line what is tried. Raises :class:`UnavailableError` with each source's failure, the hash and
    where to put the file by hand, and ``OutputError`` for a cache that cannot be written.
    """
    target = Path(cache_dir) / _FILE_NAME
    failures = []
    problem = _cached_problem(target)
    if problem is None:
        return target
    failures.append(f"cache: {problem}")
    for source in SOURCES if sources is None else sources:
        if progress is not None:
            progress(f"sample video: trying {source.name}")
        try:
            content = source.fetch()
        except FAILURES as error:
            failures.append(f"{source.name}: {_one_line(error)}")
            continue
        found = hashlib.sha256(content).hexdigest()
        if found == SHA256:
            _make_folder(target.parent)
            write_bytes(target, content)
            return target
        failures.append(f"{source.name}: the file has SHA-256 {found}, which is another file")
    raise UnavailableError(
        f"the sample video {_FILE_NAME} cannot be had. "
        + "; ".join(failures)
        + f". Put a copy with SHA-256 {SHA256} at {target}"
    )


def _cached_problem(path: Path) -> str | None:
    try:
        with path.open("rb") as file:
            found = hashlib.file_digest(file, "sha256").hexdigest()
    except OSError as error:
        return f"{path}: {error.strerror}"
    return None if found == SHA256 else f"{path} has SHA-256 {found}, which is another file"


def _make_folder(folder: Path) -> None:
    try:
        folder.mkdir(parents=True, exist_ok=True)
    except OSError:
        return  # write_bytes says what is wrong


def _one_line(error: BaseException) -> str:
    if isinstance(error, subprocess.CalledProcessError):
        lines = (error.stderr or error.stdout or "").strip().splitlines()
        return f"{error.cmd[0]} failed: {lines[-1] if lines else error.returncode}"
    if isinstance(error, FileNotFoundError) and error.filename:
        return f"{error.filename} is not there"
    return str(error).replace("\n", " ") or type(error).__name__


def from_debian() -> bytes:
    """The video out of Debian's package, downloaded and unpacked in a temporary folder.

    Needs ``apt-get`` and no rights: where the machine's package lists are missing or stale
    (containers drop them), private ones are fetched into the same folder.
    """
    if shutil.which("apt-get") is None:
        raise LookupError("apt-get is not installed")
    with tempfile.TemporaryDirectory(prefix="scene4d-sample-") as name:
        folder = Path(name)
        try:
            _run(["apt-get", "download", _DEBIAN_PACKAGE], folder)
        except subprocess.SubprocessError:
            options = _private_apt(folder)
            _run(["apt-get", *options, "update"], folder)
            _run(["apt-get", *options, "download", _DEBIAN_PACKAGE], folder)
        packages = sorted(folder.glob(f"{_DEBIAN_PACKAGE}_*.deb"))
        if not packages:
            raise LookupError(f"apt-get downloaded no {_DEBIAN_PACKAGE} package")
        return video_from_deb(packages[0])


def _private_apt(folder: Path) -> list[str]:
    """Options that keep apt's lists and caches in ``folder``, so that no root is needed."""
    options = ["-o", "Debug::NoLocking=true"]
    for key, part in (("Dir::State::Lists", "lists"), ("Dir::Cache", "cache")):
        (folder / part / "partial").mkdir(parents=True)
        options += ["-o", f"{key}={folder / part}"]
    (folder / "cache" / "archives" / "partial").mkdir(parents=True)
    return options


def _run(command: list[str], folder: Path) -> None:
    environment = {**os.environ, "LC_ALL": "C"}
    subprocess.run(
        command,
        cwd=folder,
        env=environment,
        check=True,
        capture_output=True,
        text=True,
        stdin=subprocess.DEVNULL,
        timeout=_APT_TIMEOUT_S,
    )


def video_from_deb(package: Path) -> bytes:
    """``vtest.avi`` (or ``vtest.avi.gz``) out of a ``.deb``.

    A ``.deb`` is an ``ar`` archive (deb(5)) that Python reads itself, but for Zstandard, which
    needs ``dpkg-deb``. Raises one of FAILURES where the package does not hold the video.
    """
    with package.open("rb") as file:
        name = _go_to_data(file)
        if not name.endswith(".zst"):
            with tarfile.open(fileobj=file, mode="r|*") as archive:
                return _video_from_tar(archive)
    command = ["dpkg-deb", "--fsys-tarfile", str(package)]
    with subprocess.Popen(command, stdout=subprocess.PIPE, stderr=subprocess.DEVNULL) as process:
        assert process.stdout is not None
        with tarfile.open(fileobj=process.stdout, mode="r|") as archive:
            return _video_from_tar(archive)


def _go_to_data(file: BinaryIO) -> str:
    """Stand at the content of the member ``data.tar*`` and say its name."""
    if file.read(8) != b"!<arch>\n":
        raise ValueError("what was downloaded is no Debian package")
    while len(header := file.read(60)) == 60:
        name, size = header[:16].decode("latin-1").strip().rstrip("/"), int(header[48:58])
        if name.startswith("data.tar"):
            return name
        file.seek(size + size % 2, os.SEEK_CUR)
    raise LookupError("the package holds no data.tar")


def _video_from_tar(archive: tarfile.TarFile) -> bytes:
    for member in archive:
        name = Path(member.name).name
        if name in (_FILE_NAME, f"{_FILE_NAME}.gz") and member.isfile():
            file = archive.extractfile(member)
            assert file is not None
            content = file.read(_MAX_BYTES)
            return gzip.decompress(content) if name.endswith(".gz") else content
    raise LookupError(f"the package holds no {_FILE_NAME}")


def from_opencv() -> bytes:
    """The video from OpenCV's repository."""
    with urllib.request.urlopen(_OPENCV_URL, timeout=TIMEOUT_S) as answer:
        return bytes(answer.read(_MAX_BYTES))


SOURCES = (
    SampleSource(f"Debian package {_DEBIAN_PACKAGE}", from_debian),
    SampleSource("OpenCV's repository", from_opencv),
)
