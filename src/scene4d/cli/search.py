"""``scene4d search``: words in, ranked events out."""

from pathlib import Path
from typing import TYPE_CHECKING, Annotated

import typer

from scene4d.cli.arguments import catalogue_option, command_line, zones_option
from scene4d.cli.command import Answer, Job, command, output_folder

if TYPE_CHECKING:
    from rich.console import Console

    from scene4d.searching import Asked, FoundEvent, SearchResult

_ASKED = "Query"
_RESULT = "Output"
_FORMS = {"csv": "Table", "actev": "ActEV"}
_SIGNS = 40
"""Signs of a predicate over time."""


@command("search")
def search(
    job: Job,
    scenes: Annotated[
        list[Path],
        typer.Argument(
            metavar="SCENE|SITE...",
            help="Folders written by track: one scene or several; or one written by align.",
        ),
    ],
    words: Annotated[
        str,
        typer.Argument(
            metavar="WORDS",
            help='What to search for, in quotes, as "person enters vehicle"; several with ";" '
            'between them, or "all activities".',
        ),
    ],
    *,
    top: Annotated[
        int,
        typer.Option(
            metavar="N", min=1, help="Number of events shown; --json, --csv and --actev hold all."
        ),
    ] = 10,
    min_score: Annotated[
        float,
        typer.Option(
            metavar="P",
            min=0.0,
            max=1.0,
            help="Lowest score of an event, the product of its predicates: it ranks events of one "
            "search and is no probability; values below 0.001 count as 0.001.",
        ),
    ] = 0.05,
    min_probability: Annotated[
        float | None,
        typer.Option(
            metavar="P",
            min=0.0,
            max=1.0,
            help="Lowest probability of an event; for activities of which scores are calibrated.",
        ),
    ] = None,
    explain: Annotated[
        bool, typer.Option("--explain", help="Show every predicate of an event over time.")
    ] = False,
    catalogue: Annotated[list[Path] | None, catalogue_option(_ASKED)] = None,
    zones: Annotated[Path | None, zones_option(_ASKED)] = None,
    footage: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE|DIR",
            help="Footage for the clips of --out, if it has moved since it was tracked.",
            rich_help_panel=_RESULT,
        ),
    ] = None,
    out: Annotated[
        Path | None,
        typer.Option(
            metavar="DIR",
            help="Folder for search.html, a page with clips and paths, and events.json.",
            rich_help_panel=_RESULT,
        ),
    ] = None,
    csv: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE", help="Table of all events, a line each.", rich_help_panel=_RESULT
        ),
    ] = None,
    actev: Annotated[
        Path | None,
        typer.Option(
            metavar="FILE",
            help="JSON file for all events, in the format of NIST's ActEV_Scorer.",
            rich_help_panel=_RESULT,
        ),
    ] = None,
) -> Answer:
    """Search tracked scenes in plain words: who, when, where, and why each event matches.

    The words become predicates: probabilities of what happens in space and time. These are shown
    first, then the events, best first. docs/searching.md shows how to search, and
    docs/search-language.md lists the words and the grammar.

    [bold]Examples[/bold]

      scene4d search scene "person enters vehicle"
      scene4d search scene "two people meet" --out meetings --top 20
      scene4d search north south "person crosses line gate" --zones places.json
      scene4d search scene "vehicle stops" --min-probability 0.5 --json
      scene4d search scene "person enters vehicle" --top 1 --explain
      scene4d search scene "all activities" --actev found.json
      scene4d search site "person enters vehicle"
    """
    absent = [path for path in scenes if not path.is_dir()]
    if absent:
        raise typer.BadParameter(
            f"{absent[0]} is no folder; give the scenes, then the words in quotes, as "
            '"person enters vehicle"',
            param_hint="SCENE",
        )
    if footage is not None and out is None:
        raise typer.BadParameter("is for the page of --out", param_hint="--footage")
    from scene4d.core.files import write_bytes
    from scene4d.searching import SearchOptions, answer, opened, understand_all
    from scene4d.searching.exporting import exported

    options = SearchOptions(min_score, top, min_probability, tuple(catalogue or ()), zones, footage)
    asked = understand_all(opened(*scenes), words, options)
    if len(asked) > 1 and out is not None:
        raise typer.BadParameter("is for one search", param_hint="--out")
    if not job.as_json:
        for one in asked:
            _show_understood(one)
    with output_folder(out), job.progress() as progress:
        done = [answer(one, progress) for one in asked]
        for result in done if explain else ():
            result.explain()
        if out is not None:
            done[0].save(out, command=command_line(), progress=progress)
        files = {form: path for form, path in (("csv", csv), ("actev", actev)) if path is not None}
        for form, path in files.items():
            write_bytes(path, exported(done, form).encode())
    found = [one.to_dict() for one in done]
    notes = tuple(dict.fromkeys(note for one in asked for note in one.notes))
    said = found[0] if len(found) == 1 else {"searches": found}
    return Answer(said, lambda: _show(done, explain=explain, out=out, files=files), notes)


def _show_understood(asked: "Asked") -> None:
    from scene4d.cli.output import screen
    from scene4d.searching.language import explain

    query = asked.query
    with screen() as console:
        console.print(f"Understood  {query.text}", style="bold", soft_wrap=True)
        for line in explain(query.activity, query.window, ()):
            console.print(f"  {line}", soft_wrap=True)
        for note in asked.notes:
            console.print(f"Note: {note}", style="yellow", soft_wrap=True)
        console.print()


def _show(
    done: "list[SearchResult]", *, explain: bool, out: Path | None, files: dict[str, Path]
) -> None:
    from scene4d.cli.output import screen

    with screen() as console:
        for one in done:
            _show_result(console, one, named=len(done) > 1, explain=explain)
        if out is not None:
            console.print(f"Page        {out / 'search.html'}", soft_wrap=True)
        for form, path in files.items():
            console.print(f"{_FORMS[form]:11} {path}", soft_wrap=True)


def _show_result(console: "Console", done: "SearchResult", *, named: bool, explain: bool) -> None:
    shown = done.shown
    less = len(done.events) - len(shown)
    rest = f" The {len(shown)} best of them:" if less else ""
    name = f"{done.asked.query.text}: " if named else ""
    console.print(f"{name}{done.verdict}{rest}", style="bold", soft_wrap=True)
    for number, found in enumerate(shown, 1):
        console.print()
        _show_event(console, number, found)
        if explain:
            _show_course(console, found)
    for note in done.about_scores:
        console.print(f"\n{note[0].upper()}{note[1:]}.", style="dim", soft_wrap=True)
    taken = ", ".join(f"{name} {s:.1f} s" for name, s in done.timings.items())
    console.print(f"\nTime taken  {taken or 'none'}", style="dim")


def _show_event(console: "Console", number: int, found: "FoundEvent") -> None:
    from rich.padding import Padding
    from rich.text import Text

    from scene4d.searching.result import probability_text, why_groups

    probable = probability_text(found.event)
    sure = f"  probability {probable}" if probable else ""
    roles = ", ".join(f"{role} {track}" for role, track in found.event.roles.items())
    console.print(
        f"{number:3d}  {found.event.score:.2f}{sure}  {found.when}  camera {_cameras(found)}",
        style="bold",
        soft_wrap=True,
    )
    console.print(f"     {roles}  in {found.clip}", soft_wrap=True)
    for note in found.about_spots:
        console.print(f"     {note}", soft_wrap=True)
    for phase, terms in why_groups(found.event.why):
        said = ", ".join(f"{term} {value}" for term, value, _ in terms)
        line = f"{phase}: {said}" if phase else said
        console.print(Padding(Text(line, style="dim"), (0, 0, 0, 5)))


def _cameras(found: "FoundEvent") -> str:
    """The camera whose clip is named, and others that saw the same."""
    others = [name for name in (found.across or {}).get("cameras", ()) if name != found.run.camera]
    return ", also ".join([found.run.camera, *([", ".join(others)] if others else [])])


def _show_course(console: "Console", found: "FoundEvent") -> None:
    """Every predicate of an event as a line of signs, from 0 to 1, with the span of the event."""
    course, event = found.course, found.event
    if course is None:
        return
    first, last = float(course.time_s[0]), float(course.time_s[-1])
    places = [
        round((s - first) / max(last - first, 1e-9) * (_SIGNS - 1))
        for s in (event.begin_s, event.end_s)
    ]
    begin, end = (min(max(place, 0), _SIGNS - 1) for place in places)
    ruler = " " * begin + "├" + "─" * max(end - begin - 1, 0) + ("┤" if end > begin else "")
    about = f"{first - event.begin_s:+.1f} s to {last - event.begin_s:+.1f} s"
    console.print(f"     {ruler:{_SIGNS}}  event; the line is {about}", style="dim", soft_wrap=True)
    for name in course.values:
        console.print(f"     {course.signs(name, _SIGNS)}  ", style="cyan", end="")
        console.print(name, style="dim", soft_wrap=True, highlight=False)
