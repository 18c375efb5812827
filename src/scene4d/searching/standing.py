"""Searches that stand while a camera is watched: each event is told once, soon after its end.

What was tracked lately is searched again and again. Its last seconds are provisional: an event is
told when its end lies :data:`SETTLED_S` back, and once more when all its rows are final, with its
final score, or as withdrawn.
"""

import hashlib
from collections.abc import Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.searching._asking import SearchOptions, second_of_day, words_of
from scene4d.searching._places import Places
from scene4d.searching.activities._casting import is_symmetric
from scene4d.searching.activities._events import Event
from scene4d.searching.activities.search import judge
from scene4d.searching.language import Query
from scene4d.searching.predicates._registry import PREDICATES
from scene4d.searching.predicates.stage import Stage
from scene4d.searching.result import FoundEvent
from scene4d.searching.stages import STEP_S, stage_of, thinned
from scene4d.store.runs import Run

WINDOW_S = 120.0
"""What was tracked in this time is searched; chosen by hand: longer than what activities last."""
SETTLED_S = 1.5
"""An event is told when its end is this long ago. Who is gone for so long has most likely left: the
softest of the predicates about ends is then above 0.98."""
_WAITED_S = 2.0
"""Rows up to this long after an event's end must be final for the event to be: gaps of that length
are bridged."""
_LATE_S = 60.0
"""An event whose end lies further back is not told for the first time: where the window begins,
tracks that are cut look like others."""
_EVENT_SCHEMA = "scene4d/watch-event/1"
PROVISIONAL, FINAL, WITHDRAWN = "provisional", "final", "withdrawn"


@dataclass(frozen=True, eq=False)
class Told:
    """An event that was found while watching. ``state`` says whether its rows may still change;
    ``id`` is the same each time that it is told, and ``span_s`` from its earliest beginning to its
    latest end so far: while rows are provisional, an event may grow and fall apart again.
    """

    id: str
    search: str
    state: str
    found: FoundEvent
    span_s: tuple[float, float]

    def to_dict(self) -> dict[str, Any]:
        """The event as in ``search --json``, with its id, the words and the state."""
        head = {"schema": _EVENT_SCHEMA, "id": self.id, "search": self.search}
        return head | {"state": self.state} | self.found.to_dict()


class StandingSearches:
    """Several searches of one running camera; ``placed`` are those that name zones or lines.

    Raises :class:`InputError` for words, files and places that are not understood.
    """

    def __init__(
        self,
        searches: Sequence[str],
        options: SearchOptions,
        camera: str,
        calibration: Calibration,
    ) -> None:
        asked = [words_of(words, options, (camera,)) for words in searches]
        self._queries = [query for query, _ in asked]
        for query in self._queries:
            if query.activity.spots:
                raise InputError(
                    f"{query.text!r}: where another one was is not remembered while watching; "
                    "search the scene for it"
                )
        self.placed = [said for said, (_, there) in zip(searches, asked, strict=True) if there.all]
        self._places = Places(tuple({p.name: p for _, ps in asked for p in ps.all}.values()))
        self._options, self._camera, self._calibration = options, camera, calibration
        self._told: list[list[Told]] = [[] for _ in searches]

    def look(self, tracks: Tracks, run: Run, now_s: float, final_s: float) -> list[Told]:
        """What is new: ``tracks`` are those of about :data:`WINDOW_S`, with the scene's numbers,
        ``now_s`` is the time of the last frame, and up to ``final_s`` rows are final.
        """
        if not len(tracks):
            return []
        rows, step_s = thinned(tracks, STEP_S)
        stage = stage_of(
            bridged(rows, step_s),
            self._calibration,
            step_s=step_s,
            zones=self._places.of(self._camera, "zone"),
            lines=self._places.of(self._camera, "line"),
        )
        news: list[Told] = []
        for query, told in zip(self._queries, self._told, strict=True):
            events = self._events(stage, query, run)
            news += _settle(query, told, events, now_s, final_s)
            told[:] = [one for one in told if one.found.event.end_s > now_s - WINDOW_S - _LATE_S]
        return news

    def _events(self, stage: Stage, query: Query, run: Run) -> list[FoundEvent]:
        classes = set(stage.tracks.class_name.tolist())
        if not all(set(role.classes) & classes for role in query.activity.roles):
            return []
        events = judge(stage, query.activity, min_score=self._options.min_score).events
        window = query.window
        return [
            FoundEvent(one, run, stage.frame_at(one.begin_s), stage.frame_at(one.end_s))
            for one in events
            if window is None or window.contains(second_of_day(run, one.begin_s))
        ]


def bridged(tracks: Tracks, step_s: float) -> Tracks:
    """The rows, ordered by (track, time), and straight between those of a track that are more than
    a step but at most :data:`_WAITED_S` apart: where frames were dropped nothing ended.
    """
    away_s = np.diff(tracks.time_s)
    same = np.diff(tracks.track) == 0
    wide = same & (away_s > 1.5 * step_s) & (away_s <= _WAITED_S)
    more = np.where(wide, np.rint(away_s / step_s).astype(int) - 1, 0)
    if not more.any():
        return tracks
    before = np.repeat(np.arange(len(more)), more)
    number = np.arange(len(before)) - np.repeat(np.cumsum(more) - more, more) + 1
    share = number / (more[before] + 1)

    def between(values: np.ndarray) -> np.ndarray:
        way = share.reshape(-1, *[1] * (values.ndim - 1))
        return (1 - way) * values[before] + way * values[before + 1]

    new = tracks.select(before)
    new = replace(
        new,
        time_s=between(tracks.time_s),
        frame=between(tracks.frame).astype(tracks.frame.dtype),
        xy_m=between(tracks.xy_m),
        velocity_mps=between(tracks.velocity_mps),
        box_xyxy=np.full_like(new.box_xyxy, np.nan),
        keypoint_score=np.zeros_like(new.keypoint_score),
        observed=np.zeros(len(new), bool),
    )
    every = Tracks.concatenate([tracks, new])
    return every.select(np.lexsort((every.time_s, every.track)))


def _settle(
    query: Query, told: list[Told], events: list[FoundEvent], now_s: float, final_s: float
) -> list[Told]:
    """Tell new events, and those that have become final; ``told`` is brought up to date."""
    news = []
    matched: dict[str, FoundEvent] = {}
    swaps = is_symmetric(query.activity, PREDICATES)
    for found in events:
        event = found.event
        known = next((k for k, one in enumerate(told) if _is_same(one, event, swaps)), None)
        if known is not None:
            one = told[known]
            matched.setdefault(one.id, found)
            begin_s, end_s = one.span_s
            span_s = min(begin_s, event.begin_s), max(end_s, event.end_s)
            told[known] = replace(one, span_s=span_s)
        elif now_s - _LATE_S < event.end_s <= now_s - SETTLED_S:
            span_s = event.begin_s, event.end_s
            news.append(Told(_id(query, found), query.text, PROVISIONAL, found, span_s))
    for number, one in enumerate(told):
        latest = matched.get(one.id, one.found)
        state = one.state
        if state == PROVISIONAL and final_s >= latest.event.end_s + _WAITED_S:
            state = FINAL if one.id in matched else WITHDRAWN
            news.append(replace(one, state=state, found=latest))
        told[number] = replace(one, state=state, found=latest)
    told.extend(one for one in news if one.state == PROVISIONAL)
    return news


def _is_same(told: Told, event: Event, swaps: bool) -> bool:
    """Whether an event was told: in one time, with one doer, who is any where roles may swap."""
    meets = told.span_s[0] <= event.end_s and event.begin_s <= told.span_s[1]
    mine, theirs = list(told.found.event.roles.values()), list(event.roles.values())
    return meets and bool({*mine} & {*theirs} if swaps else mine[0] == theirs[0])


def _id(query: Query, found: FoundEvent) -> str:
    event = found.event
    said = [found.run.run, query.text, event.activity, *map(str, event.roles.values())]
    said.append(f"{event.begin_s:.1f}")
    return hashlib.sha256("\n".join(said).encode()).hexdigest()[:16]
