"""The result of a search: events as objects, tables, JSON, ActEV and HTML for notebooks."""

import json
import math
from collections.abc import Mapping
from dataclasses import dataclass, field
from html import escape
from pathlib import Path, PurePath
from typing import TYPE_CHECKING, Any

from scene4d.core.progress import Progress, Silent
from scene4d.core.tables import data_frame
from scene4d.core.tracks import Tracks
from scene4d.searching._asking import Asked
from scene4d.searching._spots import FoundSpot, Memory
from scene4d.searching.activities._events import Event
from scene4d.searching.activities.course import Course
from scene4d.store.runs import Run, iso_ms

if TYPE_CHECKING:
    from arro3.core import Table

_NOT_CALIBRATED = (
    "probability: unknown; scores are calibrated for some activities of the catalogue, as they "
    "stand there. The score ranks events"
)
_KPF = (".geom.yml", ".types.yml")
_AROUND_S = 4.0
"""Rows this long before and after an event are kept to show it; chosen by hand: long enough to see
where somebody came from."""


@dataclass(frozen=True, eq=False)
class FoundEvent:
    """An event, the run that it is in, and its first and last frame.

    ``around`` are the rows of all tracks at about that time, at the search rate, and ``course`` its
    predicates over time, of events that are shown and once they were asked for
    (:meth:`SearchResult.explain`). ``spots`` are where others were whom the search speaks of.
    ``across`` is what a site adds: who each role is in it, the cameras that saw the event, and its
    time on the site's clock.
    """

    event: Event
    run: Run
    begin_frame: int
    end_frame: int
    around: Tracks | None = None
    course: Course | None = None
    across: Mapping[str, Any] | None = None
    spots: tuple[FoundSpot, ...] = ()

    @property
    def clip(self) -> str:
        """The footage's file name, without folders; for annotations without extension."""
        return clip_name(self.run)

    @property
    def when(self) -> str:
        """The clock time (UTC), if known, and the time in the clip."""
        clip = f"{clip_time(self.event.begin_s)} to {clip_time(self.event.end_s)}"
        began = self.run.moment(self.event.begin_s)
        return clip if began is None else f"{began:%Y-%m-%d %H:%M:%S} UTC, clip {clip}"

    @property
    def notes(self) -> list[str]:
        """What is to be said of its probability, and of who was where the search speaks of."""
        return [self.about_probability, *self.about_spots]

    @property
    def about_probability(self) -> str:
        """What its probability is of, or why there is none."""
        known = self.event.calibration
        return _NOT_CALIBRATED if known is None else known.note

    @property
    def about_spots(self) -> list[str]:
        """Who was where the search speaks of, and when."""
        return [_spot_note(spot) for spot in self.spots]

    def to_dict(self) -> dict[str, Any]:
        """The event as in ``--json``, ``events.json`` and the page: times of day in ISO 8601 (UTC),
        null if the clip's start is unknown; null also for a predicate that cannot be judged.
        """
        event = self.event
        return {
            "activity": event.activity,
            "score": event.score,
            "probability": event.probability,
            **_times(self.run, event.begin_s, event.end_s),
            "begin_frame": self.begin_frame,
            "end_frame": self.end_frame,
            "camera": self.run.camera,
            "run": self.run.run,
            "clip": self.clip,
            "roles": dict(event.roles),
            "why": {key: None if math.isnan(p) else p for key, p in event.why.items()},
            "notes": self.notes,
            **({"also": list(event.also)} if event.also else {}),
            **({"spots": [_spot_dict(spot) for spot in self.spots]} if self.spots else {}),
            **(self.across or {}),
        }


@dataclass
class SearchResult:
    """The query and its events, best first; the runs searched, their rows, and how many casts
    (such as pairs of a person and a vehicle) were evaluated if no event was found. ``memory`` is
    where others were whom the search speaks of.
    """

    asked: Asked
    events: list[FoundEvent] = field(default_factory=list)
    runs: list[Run] = field(default_factory=list)
    rows: int = 0
    candidates: int = 0
    timings: dict[str, float] = field(default_factory=dict)
    memory: Memory | None = None

    def explain(self) -> None:
        """Look up the predicates over time (:attr:`FoundEvent.course`) of the events shown, and who
        was around them; reads their runs again. Raises as :func:`search`.
        """
        from scene4d.searching._entry import explained

        explained(self)

    @property
    def shown(self) -> list[FoundEvent]:
        """The best events, as many as ``top`` says."""
        return self.events[: self.asked.options.top]

    @property
    def about_scores(self) -> list[str]:
        """What is to be said of the probabilities of the best events, once."""
        return list(dict.fromkeys(found.about_probability for found in self.shown))

    @property
    def verdict(self) -> str:
        """One sentence: how many events in how many clips, or how many candidates without one."""
        clips = _count(len(self.runs), "clip")
        where = f"{clips} of {_count(len({run.camera for run in self.runs}), 'camera')}"
        if self.events:
            return f"{_count(len(self.events), 'event')} in {where}."
        roles = [role.name for role in self.asked.query.activity.roles]
        what = {1: "track", 2: "pair"}.get(len(roles), "group")
        return (
            f"Nothing found in {where}: of {_count(self.candidates, f'candidate {what}')} "
            f"({', '.join(roles)}) none scores {self.asked.least_score:.2g} or more."
        )

    def __len__(self) -> int:
        return len(self.events)

    def to_dict(self) -> dict[str, Any]:
        """The query and every event, ready for ``json.dumps``."""
        return {
            "query": self.asked.query.text,
            "predicates": list(self.asked.query.predicates),
            "events": [found.to_dict() for found in self.events],
        }

    def columns(self) -> dict[str, tuple[str, list[Any]]]:
        """Name, Arrow type and values of the table's columns; a role's column has its track."""
        rows = [found.to_dict() for found in self.events]
        plain = {"activity": "utf8", "score": "float64", "probability": "float64"}
        plain |= {"begin_s": "float64", "end_s": "float64"}
        plain |= {"begin_time": "utf8", "end_time": "utf8", "begin_frame": "int64"}
        plain |= {"end_frame": "int64", "camera": "utf8", "run": "utf8", "clip": "utf8"}
        columns = {name: (kind, [row[name] for row in rows]) for name, kind in plain.items()}
        for role in self.asked.query.activity.roles:
            columns[role.name] = ("int64", [row["roles"].get(role.name) for row in rows])
        columns["why"] = ("utf8", [json.dumps(row["why"]) for row in rows])
        return columns

    def to_arrow(self) -> "Table":
        """The events as an Arrow table, a row each; ``why`` is JSON."""
        from arro3.core import Array, DataType, Table

        return Table.from_pydict(
            {
                name: Array(values, getattr(DataType, kind)())
                for name, (kind, values) in self.columns().items()
            }
        )

    def __arrow_c_stream__(self, requested_schema: object | None = None) -> object:
        return self.to_arrow().__arrow_c_stream__(requested_schema)

    def to_pandas(self) -> Any:
        """The events as a pandas DataFrame; needs pandas."""
        return data_frame({name: values for name, (_, values) in self.columns().items()})

    def _repr_html_(self) -> str:
        """The best events as a table, and a plan of the best one."""
        from scene4d.searching.pages._plan import plan_svg, role_colours

        self.explain()
        roles = [role.name for role in self.asked.query.activity.roles]
        head = "<th>score</th><th>probability</th><th>when</th><th>camera</th>" + "".join(
            f'<th><span style="color:{colour}">&#9632;</span> {escape(role)}</th>'
            for role, colour in role_colours(roles).items()
        )
        rows = "".join(
            f"<tr><td>{found.event.score:.2f}</td><td>{probability_text(found.event)}</td>"
            f"<td>{escape(found.when)}</td>"
            f"<td>{escape(found.run.camera)}</td>"
            + "".join(f"<td>{found.event.roles.get(role, '')}</td>" for role in roles)
            + "</tr>"
            for found in self.shown
        )
        table = f"<table><thead><tr>{head}</tr></thead><tbody>{rows}</tbody></table>"
        plan = plan_svg(self.shown[0], self.asked.places) if self.shown else None
        title = f"<p><b>{escape(self.asked.query.text)}</b>: {escape(self.verdict)}</p>"
        return title + (table if self.shown else "") + (plan or "")

    def save(
        self,
        out: str | Path,
        *,
        command: str | None = None,
        progress: Progress | None = None,
    ) -> Path:
        """Write ``search.html``, a page with clips and plans of the best events, and
        ``events.json`` with all; returns the page's path. ``command`` is shown on the page.

        Raises :class:`OutputError` if ``out`` cannot be written; an earlier result is then kept.
        """
        from scene4d.searching.pages._page import write_page

        return write_page(self, Path(out), progress or Silent(), command)


def rank(found: FoundEvent) -> tuple[float, str, float]:
    """Sorts the best event first."""
    return (-found.event.score, found.run.run, found.event.begin_s)


def around(tracks: Tracks, event: Event) -> Tracks:
    """The rows at about the time of an event."""
    time = tracks.time_s
    return tracks.select((time >= event.begin_s - _AROUND_S) & (time <= event.end_s + _AROUND_S))


def clip_name(run: Run) -> str:
    """The file name of a run's footage, without folders; for annotations without extension."""
    source = run.provenance.get("source") or run.provenance.get("annotations")
    if not isinstance(source, str) or "://" in source:
        return run.run
    name = PurePath(source).name
    ending = next((end for end in _KPF if name.endswith(end)), "")
    return name.removesuffix(ending)


def clip_time(seconds: float) -> str:
    """``01:02:03.4``, with hours where there are any."""
    tenths = round(10 * seconds)
    minutes, tenths = divmod(tenths, 600)
    hours, minutes = divmod(minutes, 60)
    text = f"{minutes:02d}:{tenths // 10:02d}.{tenths % 10}"
    return f"{hours}:{text}" if hours else text


def probability_text(event: Event) -> str:
    """``0.93``, or nothing where no probability is known."""
    return "" if event.probability is None else f"{event.probability:.2f}"


def why_groups(why: Mapping[str, float]) -> list[tuple[str, list[tuple[str, str, float]]]]:
    """Predicates by phase, as (name, value in words, value for a bar)."""
    groups: dict[str, list[tuple[str, str, float]]] = {}
    for key, value in why.items():
        phase, colon, term = key.partition(": ")
        name = term if colon else phase
        unknown = math.isnan(value)
        text = "cannot be judged, counts ½" if unknown else f"{value:.2f}"
        groups.setdefault(phase if colon else "", []).append(
            (name, text, 0.5 if unknown else value)
        )
    return list(groups.items())


def _spot_dict(spot: FoundSpot) -> dict[str, Any]:
    return {
        "spot": spot.name,
        "role": spot.role,
        "track": spot.track,
        "camera": spot.run.camera,
        "run": spot.run.run,
        **_times(spot.run, spot.begin_s, spot.end_s),
        "x_m": spot.xy_m[0],
        "y_m": spot.xy_m[1],
        "distance_m": spot.distance_m,
        "probability": spot.probability,
    }


def _spot_note(spot: FoundSpot) -> str:
    """Who was at a spot, and when."""
    begin, end = (spot.run.moment(time_s) for time_s in (spot.begin_s, spot.end_s))
    when = f"from {clip_time(spot.begin_s)} to {clip_time(spot.end_s)} in the clip"
    if begin is not None and end is not None:
        last = f"{end:%H:%M:%S}" if begin.date() == end.date() else f"{end:%Y-%m-%d %H:%M:%S}"
        when = f"from {begin:%Y-%m-%d %H:%M:%S} to {last} UTC"
    return (
        f"{spot.distance_m:.1f} m from {spot.name!r}: track {spot.track} of camera "
        f"{spot.run.camera}, run {spot.run.run}, {when}"
    )


def _times(run: Run, begin_s: float, end_s: float) -> dict[str, Any]:
    """A span in the clip, and as times of day."""
    begin, end = (one and iso_ms(one) for one in (run.moment(begin_s), run.moment(end_s)))
    return {"begin_s": begin_s, "end_s": end_s, "begin_time": begin, "end_time": end}


def _count(number: int, what: str) -> str:
    return f"{number:,} {what}{'' if number == 1 else 's'}"
