"""Whether the files of a run are as it wrote them."""

import hashlib
from dataclasses import replace
from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.store._question import Stored
from scene4d.store.runs import Part, Run, manifest_path

Parts = list[tuple[Stored, Part]]


class GoneError(InputError):
    """A part that a manifest named is there no longer."""

    def __init__(self, path: Path, run: str) -> None:
        super().__init__(
            f"{path}: is not there; if run {run!r} was written again meanwhile, open the scene "
            "again"
        )


def check_parts(parts: Parts, known: set[Path]) -> None:
    """Raise :class:`InputError` for the first part that is missing (:class:`GoneError`), unreadable
    or changed. ``known`` are those whose content is right, and becomes all of them.
    """
    written_ns: dict[Path, int] = {}
    for one, part in parts:
        manifest, path = manifest_path(one.folder, one.run.run), one.folder / part.path
        if manifest not in written_ns:
            written_ns[manifest] = _written_ns(manifest)
        _check_part(path, one.run, part, written_ns[manifest], known=path in known)
        known.add(path)


def check_parts_there(parts: Parts) -> None:
    """Raise :class:`GoneError` for the first part that is not there."""
    for one, part in parts:
        if not (one.folder / part.path).exists():
            raise GoneError(one.folder / part.path, one.run.run)


def renewed(one: Stored) -> Stored:
    """The same stream as its newer manifest says; a run that was written anew stays as it was,
    since it may have other rows at the same times.
    """
    path = manifest_path(one.folder, one.run.run)
    now = Run.load(path) if path.exists() else one.run
    same = ("run", "camera", "start_ns", "track_base", "provenance")
    goes_on = all(getattr(one.run, name) == getattr(now, name) for name in same)
    return replace(one, run=now) if goes_on else one


def _written_ns(manifest: Path) -> int:
    """When a manifest was written; 0 if that is not known."""
    try:
        return manifest.stat().st_mtime_ns
    except OSError:
        return 0


def _check_part(path: Path, run: Run, part: Part, written_ns: int, *, known: bool) -> None:
    """Content is checked unless it is ``known`` to be right, or older than the manifest, which is
    written after it.
    """
    try:
        there = path.stat()
        found, digest = there.st_size, part.sha256
        older = there.st_mtime_ns < written_ns
        if not (known or older) and found == part.bytes and digest is not None:
            with path.open("rb") as file:
                digest = hashlib.file_digest(file, "sha256").hexdigest()
    except FileNotFoundError as error:
        raise GoneError(path, run.run) from error
    except OSError as error:
        raise InputError(f"{path}: cannot be read: {error.strerror}") from error
    if found != part.bytes:
        raise InputError(
            f"{path}: is damaged: has {found} bytes, run {run.run!r} wrote {part.bytes}; track "
            "again"
        )
    if digest != part.sha256:
        raise InputError(
            f"{path}: is damaged: its content is not what run {run.run!r} wrote; track again"
        )
