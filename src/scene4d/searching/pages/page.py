"""The page: what was understood, and a card for each event."""

import base64
from collections.abc import Mapping, Sequence
from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float

from scene4d.core.tracks import Tracks
from scene4d.searching.activities.events import Event
from scene4d.searching.pages.clip import Clip, jpeg, mp4, stills
from scene4d.searching.pages.look import role_colours
from scene4d.searching.pages.why import why_groups

_STILL_PX = 150


@dataclass(frozen=True, eq=False)
class EventCard:
    """An event as the page shows it.

    ``when`` says when it was, ``facts`` are further lines (name, value). ``clip`` are pictures, or
    else ``missing`` says why there are none. ``around`` are the rows at about that time.
    """

    event: Event
    when: str
    facts: Sequence[tuple[str, str]]
    around: Tracks
    clip: Clip | None = None
    missing: str = ""
    zones: Mapping[str, Float[np.ndarray, "_ 2"]] = field(default_factory=dict)
    lines: Mapping[str, Float[np.ndarray, "_ 2"]] = field(default_factory=dict)


@dataclass(frozen=True)
class SearchPage:
    """What stands around the cards: the words, what was understood of them (lines), a sentence on
    what was found, notes, where it comes from, and seconds by stage.
    """

    words: str
    understood: Sequence[str]
    verdict: str
    notes: Sequence[str] = ()
    provenance: Sequence[tuple[str, str]] = ()
    timings: Mapping[str, float] = field(default_factory=dict)


def search_html(page: SearchPage, cards: Sequence[EventCard]) -> str:
    """One HTML page with everything inside it."""
    from scene4d.drawing.page import rendered, seconds_text

    return rendered(
        "scene4d.searching.pages",
        "search.html.j2",
        {
            "words": page.words,
            "understood": page.understood,
            "verdict": page.verdict,
            "found": bool(cards),
            "notes": page.notes,
            "cards": [_card(number, card) for number, card in enumerate(cards, 1)],
            "provenance": page.provenance,
            "timings": [(name, seconds_text(s)) for name, s in page.timings.items()],
        },
    )


def _card(number: int, card: EventCard) -> dict[str, object]:
    from scene4d.searching.pages.paths import draw_paths

    event = card.event
    above = draw_paths(card.around, event, card.zones, card.lines)
    colours = role_colours(event.roles)
    return {
        "number": number,
        "activity": event.activity,
        "score": f"{event.score:.2f}",
        "mean": f"{event.mean_score:.2f}",
        "when": card.when,
        "facts": card.facts,
        "roles": [(role, track, colours[role]) for role, track in event.roles.items()],
        "above": None if above is None else _uri("image/png", above),
        "why": why_groups(event.why),
        "missing": card.missing,
        **_pictures(card.clip),
    }


def _pictures(clip: Clip | None) -> dict[str, object]:
    if clip is None:
        return {"video": None, "poster": None, "stills": [], "faster": ""}
    video = mp4(clip.crops, clip.rate_hz)
    height, width = clip.crops[0].image_bgr.shape[:2]
    middle = clip.crops[len(clip.crops) // 2]
    return {
        "video": None if video is None else _uri("video/mp4", video),
        "size": (width, height),
        "poster": _uri("image/jpeg", jpeg(middle, width)),
        "stills": [
            (_uri("image/jpeg", jpeg(crop, _STILL_PX)), f"{crop.time_s:+.1f} s")
            for crop in stills(clip)
        ],
        "faster": f"{clip.faster:g} times as fast as it was" if clip.faster > 1.05 else "",
    }


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
