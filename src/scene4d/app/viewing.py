"""``view``: a scene as one self-contained page that opens from disk."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scene4d.app._contents import (
    Shown,
    contents,
    places_json,
    run_of,
    search_of,
    shown_runs,
    watched_events,
)
from scene4d.app._footage import Footage, footage_for_page
from scene4d.app._page import page_html
from scene4d.app._rows import rows_of
from scene4d.core.errors import InputError
from scene4d.core.files import write_bytes
from scene4d.core.progress import Progress, Silent
from scene4d.searching import SearchOptions, answer, read_places, understand_all
from scene4d.store.footage import footage_of
from scene4d.store.query import Scene

_VIDEO_BYTES = 10_000_000
"""Most that all footage of a page takes before base64, which makes it a third more."""
_MOST_ROWS = 1_000_000
"""Rows of one page: 30 MB of it. What is larger is for ``serve``."""


@dataclass(frozen=True)
class ViewOptions:
    """Options of ``view``.

    ``footage`` is a file or a folder with the footage, if it has moved since it was tracked;
    ``searches`` are words as for :func:`.search`, whose events are shown; ``zones`` is a file of
    named zones and lines for them. With ``video`` false the page shows the empty view only.
    """

    footage: str | Path | None = None
    searches: Sequence[str] = ()
    zones: str | Path | None = None
    video: bool = True

    def __post_init__(self) -> None:
        """Check the values; raises :class:`InputError`."""
        if self.footage is not None and not Path(self.footage).exists():
            raise InputError(f"footage: {self.footage} does not exist")


def view(
    scenes: Sequence[str | os.PathLike[str]],
    out: str | os.PathLike[str],
    options: ViewOptions | None = None,
    *,
    progress: Progress | None = None,
) -> Path:
    """Write a page of one or several scenes to ``out``; returns its path.

    Raises :class:`InputError` for a scene that cannot be read, is empty or too large for a page,
    and for words that are not understood; :class:`OutputError` if ``out`` cannot be written.
    """
    options, progress = options or ViewOptions(), progress or Silent()
    folders = [Path(one) for one in scenes]
    scene = Scene.open(*folders)
    if len(scene) > _MOST_ROWS:
        raise InputError(
            f"the scene has {len(scene):,} rows, more than the {_MOST_ROWS:,} of a page; serve it"
        )
    shown = shown_runs(scene)
    found = _searched(scene, options, progress)
    runs, media = [], []
    with progress.stage("Gathering tracks and footage", len(shown)) as step:
        for one in shown:
            run, footage = _run(scene, one, folders, options, len(shown))
            runs.append(run)
            media.append(footage)
            step(1)
    title = ", ".join([*(folder.resolve().name for folder in folders), *scene.cameras])
    said = contents(title, runs, shown) | {"searches": found, "places": _places(scene, options)}
    write_bytes(out, page_html(said, media).encode())
    return Path(out)


def _run(
    scene: Scene, shown: Shown, folders: list[Path], options: ViewOptions, runs: int
) -> tuple[dict[str, Any], Footage]:
    given = None if options.footage is None else Path(options.footage)
    place = footage_of(shown.run, given, alone=runs == 1)
    budget = _VIDEO_BYTES // runs if options.video else 0
    footage = footage_for_page(place, shown.calibration.image_size, budget)
    watched = [event for folder in folders for event in watched_events(folder, shown.run)]
    return run_of(shown) | {
        "data": rows_of(scene.only(shown.run.run)),
        "watched": watched,
        "note": footage.note,
    }, footage


def _searched(scene: Scene, options: ViewOptions, progress: Progress) -> list[dict[str, Any]]:
    asked = [
        one
        for words in options.searches
        for one in understand_all(scene, words, SearchOptions(zones=options.zones))
    ]
    return [search_of(answer(one, progress)) for one in asked]


def _places(scene: Scene, options: ViewOptions) -> dict[str, Any] | None:
    if options.zones is None:
        return None
    return places_json(read_places(Path(options.zones), scene.cameras))
