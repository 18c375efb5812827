"""All files of a result, or none of them."""

import tempfile
from collections.abc import Iterator, Sequence
from contextlib import contextmanager
from pathlib import Path

from scene4d.core.errors import OutputError


def ensure_folder(path: str | Path) -> Path:
    """Make the output folder and see that it can be written, before any work is done."""
    folder = Path(path)
    try:
        folder.mkdir(parents=True, exist_ok=True)
        probe = folder / ".scene4d-writes-here"
        probe.touch()
        probe.unlink()
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written: {error.strerror}") from error
    return folder


@contextmanager
def staged(out: Path, names: Sequence[str], last: str) -> Iterator[Path]:
    """A folder beside the target to write into; at the end its files ``names`` go to ``out``.

    An earlier result survives a full disk and Ctrl-C. The old result goes as the new one comes
    (a file of ``names`` that was not written is removed), and ``last`` is taken away first and
    comes last: a folder that has it is complete. Raises :class:`OutputError` naming ``out``.
    """
    try:
        with tempfile.TemporaryDirectory(dir=out, prefix=".scene4d-") as staging:
            try:
                yield Path(staging)
            except OutputError as error:
                raise OutputError(str(error).replace(staging, str(out))) from error
            _move(Path(staging), out, names, last)
    except OSError as error:
        raise OutputError(f"{out}: cannot be written: {error.strerror}") from error


def _move(staging: Path, out: Path, names: Sequence[str], last: str) -> None:
    (out / last).unlink(missing_ok=True)
    for name in names:
        if (staging / name).exists():
            (out / name).parent.mkdir(exist_ok=True)
            (staging / name).replace(out / name)
        else:
            (out / name).unlink(missing_ok=True)
    (staging / last).replace(out / last)
