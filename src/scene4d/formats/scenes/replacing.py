"""Files that are written bit by bit and appear whole, or not at all."""

import os
import secrets
from collections.abc import Iterator
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import IO

from scene4d.core.errors import OutputError


class Replacement:
    """A new file that takes a path's place once it is complete.

    As :func:`~scene4d.core.write_bytes`, for content that need not fit into memory. Its methods
    raise :class:`OutputError` naming the path.
    """

    def __init__(self, path: Path) -> None:
        self.path = path
        self._temporary = path.parent / f".{path.name[:100]}.{secrets.token_hex(6)}"
        try:
            self._file: IO[bytes] = self._temporary.open("xb")
        except OSError as error:
            raise self._failed(error) from error

    def _failed(self, error: OSError) -> OutputError:
        return OutputError(f"{self.path}: cannot be written: {error.strerror}")

    def write(self, content: bytes) -> None:
        """Append to the new file."""
        try:
            self._file.write(content)
        except OSError as error:
            raise self._failed(error) from error

    def complete(self) -> None:
        """Bring everything to the disk; the path is still as it was."""
        try:
            self._file.flush()
            os.fsync(self._file.fileno())
            self._file.close()
        except OSError as error:
            raise self._failed(error) from error

    def install(self) -> None:
        """Move the complete file into place."""
        try:
            self._temporary.replace(self.path)
        except OSError as error:
            raise self._failed(error) from error

    def discard(self) -> None:
        """Remove what was not moved into place."""
        with suppress(OSError):  # a full disk fails once more here, and has been told
            self._file.close()
        self._temporary.unlink(missing_ok=True)


def replace_files(paths: dict[str, Path], contents: Iterator[tuple[str, bytes]]) -> None:
    """Write the contents, each to the path of its key, and put all files in place at the end.

    Whatever fails before that, in the contents too, leaves every path as it was. Raises
    :class:`OutputError` naming the file.
    """
    with ExitStack() as stack:
        files = {}
        for key, path in paths.items():
            files[key] = Replacement(path)
            stack.callback(files[key].discard)
        for key, content in contents:
            files[key].write(content)
        for file in files.values():
            file.complete()
        for file in files.values():
            file.install()
