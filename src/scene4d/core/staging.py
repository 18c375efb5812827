"""All files of a result, or none of them."""

import errno
import os
import shutil
import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager, suppress
from pathlib import Path

from filelock import FileLock

from scene4d.core.errors import OutputError

_LOCK, _CONTENT = "lock", "content"
_NO_LOCKS = (errno.ENOLCK, errno.EOPNOTSUPP)
"""Of shares and mounts that know no locks; files can be written there all the same."""


def ensure_folder(path: str | Path) -> Path:
    """Create the output folder and check that it is writable, before any work is done."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        with tempfile.TemporaryFile(dir=folder):  # of its own: others may try it as well
            pass
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror}") from error
    return folder


@contextmanager
def staged(out: Path, names: Sequence[str], last: str) -> Iterator[Path]:
    """A temporary folder to write into; at the end its files ``names`` are moved to ``out``.

    The earlier result survives any failure, including Ctrl-C: every target is checked before the
    first is touched, and files already moved are restored. ``last`` is replaced after all the
    others. Files of ``names`` that were not written this time are removed. Raises
    :class:`OutputError` naming the file.
    """
    try:
        with scratch(out, ".scene4d-") as staging:
            try:
                yield staging
            except OutputError as error:
                raise OutputError(str(error).replace(str(staging), str(out))) from error
            written = [name for name in (*names, last) if (staging / name).exists()]
            install({staging / name: out / name for name in written})
            for name in set(names) - set(written):
                (out / name).unlink(missing_ok=True)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {error.strerror}") from error


@contextmanager
def scratch(folder: Path, prefix: str) -> Iterator[Path]:
    """A folder of its own in ``folder``, removed at the end; if this process is killed before, by
    the next one that asks for the same prefix there.

    Its lock tells that its owner lives: the operating system releases it with the process, in
    other containers and with process numbers that are given again too. On a file system without
    locks nobody removes what is another's.
    """
    for left in folder.glob(f"{prefix}*/{_CONTENT}"):
        with suppress(OSError):  # its owner lives: the lock is not to be had
            with FileLock(left.with_name(_LOCK), timeout=0):
                shutil.rmtree(left)
            shutil.rmtree(left.parent)
    with tempfile.TemporaryDirectory(dir=folder, prefix=prefix) as made:
        lock = FileLock(Path(made) / _LOCK)
        try:
            lock.acquire()
        except OSError as error:
            if error.errno not in _NO_LOCKS:
                raise
        try:
            content = Path(made) / _CONTENT  # there once it is locked
            content.mkdir()
            yield content
        finally:
            lock.release()


def install(target_of: dict[Path, Path]) -> None:
    """Move new files to their targets, in order: all of them, or everything stays as it was.

    New files and targets lie on one file system; a missing folder of a target is made where its
    parent exists. Raises :class:`OutputError` naming the target.
    """
    for new, target in target_of.items():
        with naming(target):
            _check(target)
            _flush(new)
    alone = len(target_of) == 1  # moved in one step: nothing to go back to, nothing left by a kill
    moved: dict[Path, Path | None] = {}
    try:
        for new, target in target_of.items():
            with naming(target):
                if not alone:
                    moved[target] = _kept(target, new.with_name(f"{new.name}.before"))
                new.replace(target)
    except BaseException:
        for target, before in reversed(moved.items()):
            _move_back(target, before)
        raise
    for before in moved.values():
        if before is not None:
            before.unlink()


def _check(target: Path) -> None:
    target.parent.mkdir(exist_ok=True)
    if target.is_dir():
        raise OutputError(f"{target}: cannot be written: is a folder")
    if not os.access(target.parent, os.W_OK | os.X_OK):
        raise OutputError(f"{target}: cannot be written: its folder is read-only")


def _flush(new: Path) -> None:
    """Bring a file's content to the disk, so that no power failure leaves an empty target."""
    with new.open("rb") as file:
        os.fsync(file.fileno())


def _kept(target: Path, before: Path) -> Path | None:
    """A second name for what is at the target, which stays there; None where nothing is."""
    if not target.exists():
        return None
    try:
        before.hardlink_to(target)
    except OSError:  # a file system without links
        shutil.copy2(target, before)
    return before


def _move_back(target: Path, before: Path | None) -> None:
    if before is None:
        target.unlink(missing_ok=True)
    elif before.exists():
        # Renaming one name of a file to another name of the same file would leave both.
        if not (target.exists() and before.samefile(target)):
            before.replace(target)
        before.unlink(missing_ok=True)


@contextmanager
def naming(target: Path) -> Iterator[None]:
    """Failures of the system become an :class:`OutputError` that names the target."""
    try:
        yield
    except OSError as error:
        raise OutputError(f"{target}: cannot be written: {error.strerror}") from error
