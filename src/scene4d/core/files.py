"""Reading and writing files: errors name the file, and writes are atomic."""

import errno
import json
import os
import secrets
from collections.abc import Iterable, Mapping
from contextlib import ExitStack, suppress
from pathlib import Path
from typing import IO, Any

from scene4d.core.errors import InputError
from scene4d.core.staging import install, naming
from scene4d.core.text import quoted


def read_json(path: str | os.PathLike[str]) -> Any:
    """The content of a JSON file; raises :class:`InputError` if it cannot be read, is not JSON, or
    has a duplicate name in one object, of which readers would silently take the last.
    """
    path = Path(path)
    try:
        return json.loads(path.read_text(encoding="utf-8-sig"), object_pairs_hook=_object)
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    except InputError as error:
        raise InputError(f"{path}: {error}") from None
    except (ValueError, RecursionError) as error:
        raise InputError(f"{path}: is not JSON: {error}") from error


def _object(pairs: list[tuple[str, Any]]) -> dict[str, Any]:
    values: dict[str, Any] = {}
    for name, value in pairs:
        if name in values:
            raise InputError(f"the name {quoted(name)} is there twice")
        values[name] = value
    return values


def write_json(path: str | os.PathLike[str], values: dict[str, Any]) -> None:
    """Write JSON beside ``path`` and move it into place, so that it is never seen half-written."""
    text = json.dumps(values, indent=1, allow_nan=False) + "\n"
    write_bytes(path, text.encode())


def write_bytes(path: str | os.PathLike[str], content: bytes) -> None:
    """Write a file atomically; the previous one survives any failure.

    Raises :class:`~scene4d.core.errors.OutputError` (read-only folder, full disk, missing folder).
    """
    replace_files({"": Path(path)}, [("", content)])


def replace_files(
    paths: Mapping[str, Path], contents: Iterable[tuple[str, bytes]], *, parents: bool = False
) -> None:
    """Write all of these files, or none: each piece of ``contents`` follows in the file of its key.

    They are written beside their targets and moved into place once all are whole, so that whatever
    fails, in ``contents`` too, leaves every target as it was. ``parents`` makes missing folders.
    Raises :class:`~scene4d.core.errors.OutputError` naming the file.
    """
    with ExitStack() as stack:
        files = {key: _beside(path, stack, parents=parents) for key, path in paths.items()}
        for key, content in contents:
            with naming(paths[key]):
                files[key].write(content)
        for key, file in files.items():
            with naming(paths[key]):
                file.close()
        install({Path(file.name): paths[key] for key, file in files.items()})


def _beside(path: Path, stack: ExitStack, *, parents: bool) -> IO[bytes]:
    """A new file beside ``path``; ``stack`` removes it, and the folders that were made for it."""
    with naming(path):
        for folder in reversed((path.parent, *path.parent.parents) if parents else ()):
            if not folder.exists():
                folder.mkdir()
                stack.callback(_remove_empty, folder)
        if path.is_dir():
            raise IsADirectoryError(errno.EISDIR, os.strerror(errno.EISDIR))
        temporary = path.parent / f".{path.name[:100]}.{secrets.token_hex(6)}"
        file = temporary.open("xb")  # made with the user's own permissions
    stack.callback(_discard, file)
    return file


def _discard(file: IO[bytes]) -> None:
    with suppress(OSError):  # a full disk fails once more here, and has been told
        file.close()
    Path(file.name).unlink(missing_ok=True)


def _remove_empty(folder: Path) -> None:
    with suppress(OSError):  # it is not empty: the files are in place
        folder.rmdir()
