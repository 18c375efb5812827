"""``view``: a scene as one self-contained page that opens from disk."""

import os
from collections.abc import Sequence
from dataclasses import dataclass
from pathlib import Path
from typing import Any

from scene4d.app._contents import (
    contents,
    places_json,
    run_of,
    search_of,
    watched_events,
)
from scene4d.app._fleet import fleet_of
from scene4d.app._footage import Footage, footage_for_page
from scene4d.app._opened import Opened, Shown
from scene4d.app._page import page_html
from scene4d.app._rows import rows_of
from scene4d.core.errors import InputError
from scene4d.core.files import write_bytes
from scene4d.core.progress import Progress, Silent
from scene4d.searching import SearchOptions, answer, read_places, understand_all
from scene4d.store.footage import footage_of

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
    """Write a page of one or several scenes, or of a site, to ``out``; returns its path.

    Raises :class:`InputError` for a scene that cannot be read, is empty or too large for a page,
    and for words that are not understood; :class:`OutputError` if ``out`` cannot be written.
    """
    options, progress = options or ViewOptions(), progress or Silent()
    folders = [Path(one) for one in scenes]
    opened = Opened(folders)
    if not opened.shown:
        raise InputError("nobody was tracked, so there is nothing to show")
    if opened.rows > _MOST_ROWS:
        raise InputError(
            f"the scene has {opened.rows:,} rows, more than the {_MOST_ROWS:,} of a page; serve it"
        )
    found = _searched(opened, options, progress)
    runs, media = [], []
    with progress.stage("Gathering tracks and footage", len(opened.shown)) as step:
        for one in opened.shown:
            run, footage = _run(opened, one, folders, options)
            runs.append(run)
            media.append(footage)
            step(1)
    said = contents(folders, opened, runs)
    fused = opened.fused()
    said |= {"searches": found, "places": _places(opened, options)}
    said |= {"fused": None if fused is None else rows_of(fused)}
    said |= {"fleet": fleet_of(opened, folders)}
    write_bytes(out, page_html(said, media).encode())
    return Path(out)


def _run(
    opened: Opened, shown: Shown, folders: list[Path], options: ViewOptions
) -> tuple[dict[str, Any], Footage]:
    runs = len(opened.shown)
    given = None if options.footage is None else Path(options.footage)
    place = footage_of(shown.run, given, alone=runs == 1)
    budget = _VIDEO_BYTES // runs if options.video else 0
    footage = footage_for_page(place, shown.calibration.image_size, budget)
    watched = [event for folder in folders for event in watched_events(folder, shown.run)]
    return run_of(shown) | {
        "data": rows_of(opened.tracks(shown)),
        "watched": watched,
        "note": footage.note,
    }, footage


def _searched(opened: Opened, options: ViewOptions, progress: Progress) -> list[dict[str, Any]]:
    asked = [
        one
        for words in options.searches
        for one in understand_all(opened.whole, words, SearchOptions(zones=options.zones))
    ]
    return [search_of(answer(one, progress)) for one in asked]


def _places(opened: Opened, options: ViewOptions) -> dict[str, Any] | None:
    if options.zones is None:
        return None
    return places_json(read_places(Path(options.zones), opened.cameras))
