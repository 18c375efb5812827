"""Reading and writing files so that errors name them and nothing is ever half-written."""

import json
import os
import secrets
from pathlib import Path
from typing import Any

from scene4d.core.errors import InputError, OutputError
from scene4d.core.text import quoted


def read_json(path: str | os.PathLike[str]) -> Any:
    """What a JSON file holds; raises :class:`InputError` where it cannot be read, is no JSON, or
    has a name twice in one object, of which readers would take the last without a word.
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

    Raises :class:`OutputError` (read-only folder, full disk, missing folder).
    """
    path = Path(path)
    temporary: Path | None = None
    try:
        beside = path.parent / f".{path.name[:100]}.{secrets.token_hex(6)}"
        with beside.open("xb") as file:  # made with the user's own permissions
            temporary = beside
            file.write(content)
            file.flush()
            os.fsync(file.fileno())
        temporary.replace(path)
    except OSError as error:
        raise OutputError(f"{path}: cannot be written: {error.strerror}") from error
    finally:
        if temporary is not None:
            temporary.unlink(missing_ok=True)
