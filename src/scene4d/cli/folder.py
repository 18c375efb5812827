"""The folder that results go to."""

from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path

from scene4d.core.errors import OutputError
from scene4d.core.staging import ensure_folder


@contextmanager
def output_folder(out: Path) -> Iterator[None]:
    """Make the folder before any work is done; if the work fails, take away what was made here.

    Raises :class:`OutputError` where it cannot be written.
    """
    try:
        made = [folder for folder in (out, *out.parents) if not folder.exists()]
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {error.strerror}") from error
    try:
        ensure_folder(out)
        yield
    except BaseException:
        with suppress(OSError):  # not empty: somebody else uses it
            for folder in made:
                folder.rmdir()
        raise
