"""The page of a search, and all its events beside it."""

import json
from pathlib import Path
from typing import Any

from scene4d.core.calibration import Calibration
from scene4d.core.files import write_bytes
from scene4d.core.progress import Progress, timed
from scene4d.core.staging import staged
from scene4d.searching.finding import FoundEvent, Search
from scene4d.searching.footage import NoFootage, clips_of
from scene4d.searching.language import explain
from scene4d.searching.pages.page import EventCard, SearchPage, search_html
from scene4d.searching.telling import clip_name, verdict, when
from scene4d.store.query import Scene

PAGE, EVENTS = "search.html", "events.json"


def write_search(
    done: Search,
    scene: Scene,
    out: Path,
    progress: Progress,
    *,
    top: int,
    footage: Path | None = None,
    command: str | None = None,
) -> Path:
    """Write the page with the ``top`` best events and ``events.json`` with all; the page's path.

    ``footage`` is a file or folder of footage, where it is not where it was tracked. Raises
    :class:`InputError` where that is not there, and :class:`OutputError` where ``out`` cannot be
    written; an earlier result is untouched then.
    """
    shown = [one for one in done.events[:top] if one.around is not None]
    with timed(done.timings, "pictures"), progress.stage("Cutting out clips", len(shown)) as step:
        cards: dict[int, EventCard] = {}
        sizes = {
            camera: Calibration.load(scene.camera_file(camera)).image_size
            for camera in {one.run.camera for one in shown}
        }
        for number, clip in clips_of(shown, sizes, footage, alone=len(done.runs) == 1):
            cards[number] = _card(done, shown[number], clip)
            step(1)
    with timed(done.timings, "page"), progress.stage("Writing the page", None):
        html = search_html(
            _page(done, scene, command, len(shown)), [cards[n] for n in range(len(shown))]
        )
        with staged(out, [EVENTS], PAGE) as folder:
            text = json.dumps(done.to_dict(), indent=1, allow_nan=False) + "\n"
            write_bytes(folder / EVENTS, text.encode())
            write_bytes(folder / PAGE, html.encode())
    return out / PAGE


def _card(done: Search, one: FoundEvent, clip: Any) -> EventCard:
    assert one.around is not None
    places = done.asked.places
    return EventCard(
        one.event,
        when(one),
        [
            ("camera", one.run.camera),
            ("clip", clip_name(one.run)),
            ("frames", f"{one.begin_frame} to {one.end_frame}"),
        ],
        one.around,
        None if isinstance(clip, NoFootage) else clip,
        clip.reason if isinstance(clip, NoFootage) else "",
        places.of(one.run.camera, "zone"),
        places.of(one.run.camera, "line"),
    )


def _page(done: Search, scene: Scene, command: str | None, shown: int) -> SearchPage:
    from importlib.metadata import version

    query = done.asked.query
    rows = [
        ("Clips searched", f"{len(done.runs)} of {sum(run.rows > 0 for run in scene.runs)}"),
        ("Cameras", ", ".join(sorted({run.camera for run in done.runs})) or "none"),
        ("Rows searched", f"{done.rows:,}"),
        ("Least probability", f"{done.least_score:g}"),
        ("All events", EVENTS),
        ("scene4d", version("scene4d")),
    ]
    if command is not None:
        rows.append(("Command", command))
    return SearchPage(
        query.text,
        explain(query.activity, query.window, ()),
        verdict(done) + (f" The {shown} best are shown." if shown < len(done.events) else ""),
        done.asked.notes,
        rows,
        done.timings,
    )
