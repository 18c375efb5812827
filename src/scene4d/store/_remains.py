"""Files of a run that its manifest does not name: replaced parts, and what a killed writer left."""

import re
import shutil
from pathlib import Path

from scene4d.core.errors import InputError
from scene4d.store._claims import Claimed
from scene4d.store.runs import Run, file_name, manifest_path


def staging_folder(folder: Path, run: str) -> Path:
    """Where the parts of a run are written. Raises :class:`InputError` if the way to it, to the
    claim or to the lock leads out of the scene.
    """
    staging = folder / "runs" / f".{file_name(run, 'run')}"
    for ending in ("", ".claim", ".lock"):
        path = staging.with_name(staging.name + ending)
        if path.is_symlink():
            raise InputError(f"{path}: is a symbolic link, which is not followed; remove it")
    return staging


def parts_of(folder: Path, run: str) -> list[tuple[int, Path]]:
    """The parts in place that have a run's name, with their numbers."""
    name = file_name(run, "run")
    ours = re.compile(r"\.?" + re.escape(name) + r"-(\d{5,})\.parquet")
    paths = folder.glob(f"tracks/camera=*/day=*/*{name}-*.parquet")
    matches = ((ours.fullmatch(path.name), path) for path in paths)
    return [(int(match[1]), path) for match, path in matches if match]


def unnamed_parts(folder: Path, run: str) -> list[Path]:
    """Those of them that the manifest does not name."""
    manifest = manifest_path(folder, run)
    named = {part.path for part in Run.load(manifest).parts} if manifest.exists() else set()
    paths = (path for _, path in parts_of(folder, run))
    return [path for path in paths if path.relative_to(folder).as_posix() not in named]


def remove_half_written(folder: Path, run: str) -> None:
    """Remove manifests and claims of which a writer was killed before they had their name."""
    manifest = manifest_path(folder, run)
    names = (manifest.name, f".{file_name(run, 'run')}.claim")
    starts = "|".join(re.escape(f".{name[:100]}.") for name in names)
    half_written = re.compile(f"({starts})[0-9a-f]{{12}}")
    for path in manifest.parent.iterdir():
        if half_written.fullmatch(path.name):
            path.unlink()


def buried(folder: Path, dead: Claimed) -> list[Path]:
    """Remove what a killed writer was about to write, and its claim if it had published: nobody
    resumes it then. Returns the parts that no manifest names; readers may have them open. The
    caller holds the scene's lock.
    """
    staging = staging_folder(folder, dead.run)
    shutil.rmtree(staging, ignore_errors=True)
    remove_half_written(folder, dead.run)
    if manifest_path(folder, dead.run).exists():
        for ending in (".claim", ".lock"):
            staging.with_name(staging.name + ending).unlink(missing_ok=True)
    return unnamed_parts(folder, dead.run)
