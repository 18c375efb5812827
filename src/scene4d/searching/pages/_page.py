"""The page of a search: what was understood, and a card for each event; all events beside it."""

import base64
from pathlib import Path

from scene4d.core.files import write_bytes
from scene4d.core.progress import Progress, timed
from scene4d.core.staging import staged
from scene4d.searching.exporting import exported
from scene4d.searching.language import explain
from scene4d.searching.pages._clip import Clip, mp4, still, stills
from scene4d.searching.pages._footage import clips_of
from scene4d.searching.pages._plan import course_svg, plan_svg, role_colours
from scene4d.searching.result import FoundEvent, SearchResult, why_groups
from scene4d.store.footage import NoFootage

_PAGE, _EVENTS = "search.html", "events.json"
_STILL_PX = 150


def write_page(result: SearchResult, out: Path, progress: Progress, command: str | None) -> Path:
    """Write the page and ``events.json`` into a folder; see :meth:`SearchResult.save`."""
    result.explain()
    with timed(result.timings, "pictures"), progress.stage("Cutting out clips", None):
        clips = clips_of(result)
    with timed(result.timings, "page"), progress.stage("Writing the page", None):
        html = search_html(result, clips, command)
        out.mkdir(parents=True, exist_ok=True)
        with staged(out, [_EVENTS], _PAGE) as folder:
            write_bytes(folder / _EVENTS, exported([result], "json").encode())
            write_bytes(folder / _PAGE, html.encode())
    return out / _PAGE


def search_html(result: SearchResult, clips: list[Clip | NoFootage], command: str | None) -> str:
    """One HTML page with everything inside it; ``clips`` belong to the events that are shown."""
    from scene4d.drawing.page import rendered, seconds_text

    query = result.asked.query
    fewer = len(result.shown) < len(result.events)
    cards = zip(result.shown, clips, strict=True)
    return rendered(
        "scene4d.searching.pages",
        "search.html.j2",
        {
            "words": query.text,
            "understood": explain(query.activity, query.window, ()),
            "verdict": result.verdict
            + (f" The {len(result.shown)} best are shown." if fewer else ""),
            "notes": result.asked.notes,
            "about": result.about_scores,
            "cards": [_card(n, result, found, clip) for n, (found, clip) in enumerate(cards, 1)],
            "provenance": _provenance(result, command),
            "timings": [(name, seconds_text(s)) for name, s in result.timings.items()],
        },
    )


def _provenance(result: SearchResult, command: str | None) -> list[tuple[str, str]]:
    from scene4d.drawing.page import made_by

    there = sum(run.rows > 0 for run in result.asked.scene.runs)
    return [
        ("Clips searched", f"{len(result.runs)} of {there}"),
        ("Cameras", ", ".join(sorted({run.camera for run in result.runs})) or "none"),
        ("Rows searched", f"{result.rows:,}"),
        ("Least score", f"{result.asked.least_score:.2g}"),
        ("All events", _EVENTS),
        *made_by(command),
    ]


def _card(
    number: int, result: SearchResult, found: FoundEvent, clip: Clip | NoFootage
) -> dict[str, object]:
    colours = role_colours(found.event.roles)
    return {
        **found.to_dict(),
        "number": number,
        "when": found.when,
        "about": found.about_spots,
        "mean": found.event.mean_score,
        "players": [(role, track, colours[role]) for role, track in found.event.roles.items()],
        "plan": plan_svg(found, result.asked.places),
        "why": _why(found),
        **_pictures(clip),
    }


def _why(found: FoundEvent) -> list[tuple[str, list[tuple[str, str, float, str]]]]:
    """What the score is the product of, by phase, with its course over time."""
    return [
        (
            phase,
            [
                (name, text, value, course_svg(found, f"{phase}: {name}"))
                for name, text, value in terms
            ],
        )
        for phase, terms in why_groups(found.event.why)
    ]


def _pictures(clip: Clip | NoFootage) -> dict[str, object]:
    if isinstance(clip, NoFootage):
        return {"stills": [], "missing": clip.reason}
    video = mp4(clip.crops, clip.rate_hz)
    height, width = clip.crops[0].image_bgr.shape[:2]
    middle = clip.crops[len(clip.crops) // 2]
    return {
        "video": None if video is None else _uri("video/mp4", video),
        "size": (width, height),
        "poster": _uri("image/jpeg", still(middle, width)),
        "stills": [
            (_uri("image/jpeg", still(crop, _STILL_PX)), f"{crop.time_s:+.1f} s")
            for crop in stills(clip)
        ],
        "faster": f"{clip.faster:g} times as fast as it was" if clip.faster > 1.05 else "",
    }


def _uri(kind: str, content: bytes) -> str:
    return f"data:{kind};base64,{base64.b64encode(content).decode()}"
