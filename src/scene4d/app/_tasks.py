"""What a server does in a process of its own: values of JSON in and out."""

import os
import tempfile
from collections.abc import Callable
from contextlib import suppress
from itertools import count
from pathlib import Path
from typing import Any

from scene4d.core.errors import InputError
from scene4d.core.files import write_json
from scene4d.core.progress import Progress


def search(
    folders: list[str], words: str, options: dict[str, Any], progress: Progress
) -> list[dict[str, Any]]:
    """Searches as words ask for them, as a page shows them."""
    from scene4d.app._contents import search_of

    return [search_of(one) for one in _searched(folders, words, options, progress)]


def export(
    folders: list[str], words: str, form: str, options: dict[str, Any], progress: Progress
) -> str:
    """All events of such searches as a file of ``scene4d search``."""
    from scene4d.searching.exporting import exported

    return exported(_searched(folders, words, options, progress), form)


def _searched(
    folders: list[str], words: str, options: dict[str, Any], progress: Progress
) -> list[Any]:
    from scene4d.app._opened import opened_places
    from scene4d.searching import SearchOptions, answer, understand_all
    from scene4d.store.query import Scene

    whole = opened_places([Path(one) for one in folders], growing=True)
    if isinstance(whole, Scene) and not whole.classes:
        raise InputError("nobody was tracked yet")
    asked = understand_all(whole, words, SearchOptions(**options))
    return [answer(one, progress) for one in asked]


def calibrate(
    source: str,
    annotations: str | None,
    person_height_m: float,
    said: dict[str, Any],
    out: str,
    progress: Progress,
) -> dict[str, Any]:
    """A camera calibrated again with an ``orientation``, ``landmarks`` or both, as files of them
    hold them; written to the next free folder ``OUT-1``, ``OUT-2`` ...
    """
    from scene4d.app._contents import camera_of
    from scene4d.calibration.calibrating import run
    from scene4d.calibration.options import CalibrateOptions
    from scene4d.calibration.writing import write

    with tempfile.TemporaryDirectory(prefix="scene4d-") as folder:
        files = {name: Path(folder) / f"{name}.json" for name in said}
        for name, path in files.items():
            write_json(path, said[name])
        options = CalibrateOptions(
            annotations=None if annotations is None else Path(annotations),
            person_height_m=person_height_m,
            orientation=files.get("orientation", "auto"),
            landmarks=files.get("landmarks"),
        )
        try:
            result = run(source, options, progress, command="scene4d serve, Judge")
        except InputError as error:
            raise InputError(str(error).replace(f"{folder}{os.sep}", "")) from None
    found = result.calibration
    if not found:
        raise InputError(f"the camera is undetermined: {found.reason}")
    made = _free(Path(out))
    write(result, made, progress=progress)
    return {
        "camera": camera_of(found),
        "file": str(Path(made.parent.name, made.name, "camera.json")),
    }


def _free(out: Path) -> Path:
    """A new folder; what is there stays."""
    out.parent.mkdir(exist_ok=True)
    for number in count(1):
        made = out.with_name(f"{out.name}-{number}")
        with suppress(FileExistsError):
            made.mkdir()
            return made
    raise AssertionError


TASKS: dict[str, Callable[..., Any]] = {"search": search, "export": export, "calibrate": calibrate}
"""By name; each takes its values by name, and ``progress``."""
