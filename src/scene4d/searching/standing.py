"""Searches that stand while a camera is watched: each event is told once, soon after its end.

What was tracked lately is searched again and again. Its last seconds are provisional: an event is
told when its end lies :data:`SETTLED_S` back, and once more when all its rows are final, with its
final score, or as withdrawn.
"""

import hashlib
import logging
from collections.abc import Sequence
from dataclasses import dataclass, field, replace
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.searching._asking import SearchOptions, in_window
from scene4d.searching._places import Places
from scene4d.searching.activities._casting import is_symmetric
from scene4d.searching.activities._events import Event
from scene4d.searching.activities.search import judge
from scene4d.searching.kept import STANDING, ZONES, kept_options, kept_searches, standing_query
from scene4d.searching.language import Query
from scene4d.searching.predicates.stage import Stage
from scene4d.searching.result import FoundEvent
from scene4d.searching.stages import STEP_S, stage_of, thinned
from scene4d.store.runs import Run, complete_runs

_LOG = logging.getLogger(__name__)
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


@dataclass(frozen=True, eq=False)
class _Standing:
    """A search that stands, the places that it names, and what was told of it."""

    query: Query
    places: Places
    told: list[Told] = field(default_factory=list)


class StandingSearches:
    """Several searches of one running camera; ``placed`` are those that name zones or lines. Those
    that are kept in the ``scene`` (:mod:`.kept`) come and go while it runs.

    Raises :class:`InputError` for words, files and places that are not understood; of those in the
    scene it is a warning.
    """

    def __init__(
        self,
        searches: Sequence[str],
        options: SearchOptions,
        camera: str,
        calibration: Calibration,
        scene: Path,
    ) -> None:
        self._given = [_Standing(*standing_query(said, options, (camera,))) for said in searches]
        self.placed = [
            said for said, one in zip(searches, self._given, strict=True) if one.places.all
        ]
        self._options, self._camera, self._calibration = options, camera, calibration
        self._scene = scene
        self._kept: dict[str, _Standing] = {}
        self._stamp: list[tuple[int, int] | None] = []

    def look(self, tracks: Tracks, run: Run, now_s: float, final_s: float) -> list[Told]:
        """What is new: ``tracks`` are those of about :data:`WINDOW_S`, with the scene's numbers,
        ``now_s`` is the time of the last frame, and up to ``final_s`` rows are final.
        """
        news: list[Told] = []
        if not len(tracks):
            return news
        rows, step_s = thinned(tracks, STEP_S)
        rows = bridged(rows, step_s)
        for group in (self._given, [*self._kept.values()]):
            if not group:
                continue
            places = Places(tuple({p.name: p for one in group for p in one.places.all}.values()))
            stage = stage_of(
                rows,
                self._calibration,
                step_s=step_s,
                zones=places.of(self._camera, "zone"),
                lines=places.of(self._camera, "line"),
            )
            for one in group:
                events = self._events(stage, one.query, run)
                news += _settle(one.query, one.told, events, now_s, final_s)
                from_s = now_s - WINDOW_S - _LATE_S
                one.told[:] = [told for told in one.told if told.found.event.end_s > from_s]
        return news

    def stand(self) -> bool:
        """Take what is kept in the scene now, and say whether anything is searched for."""
        stamp = [_stamp_of(self._scene / name) for name in (STANDING, ZONES)]
        if stamp != self._stamp:
            self._stamp = stamp
            self._take_kept()
        return bool(self._given or self._kept)

    def _take_kept(self) -> None:
        """What was told of a search stays told."""
        before, self._kept = self._kept, {}
        given = {one.query.text for one in self._given}
        try:
            for said in kept_searches(self._scene):
                one = self._understood(said)
                if one is not None and one.query.text not in given:
                    self._kept[said] = replace(
                        one, told=before[said].told if said in before else []
                    )
        except InputError as error:
            _LOG.warning("%s: %s", self._camera, error)

    def _understood(self, words: str) -> _Standing | None:
        """A search of the scene; None where it is not of this camera, or not understood."""
        try:
            options = kept_options(self._scene, self._options)
            query, places = standing_query(words, options, None)
        except InputError as error:
            _LOG.warning("%s: %r is not searched for: %s", self._camera, words, error)
            return None
        cameras = {run.camera for run in complete_runs(self._scene)} | {self._camera}
        whose = (self._camera,) if len(cameras) > 1 else (self._camera, None)
        own = Places(tuple(place for place in places.all if place.camera in whose))
        missing = {place.name for place in places.all} - {place.name for place in own.all}
        return None if missing else _Standing(query, own)

    def _events(self, stage: Stage, query: Query, run: Run) -> list[FoundEvent]:
        classes = set(stage.tracks.class_name.tolist())
        if not query.activity.playable_by(classes):
            return []
        events = judge(stage, query.activity, min_score=self._options.min_score).events
        return [
            FoundEvent(one, run, stage.frame_at(one.begin_s), stage.frame_at(one.end_s))
            for one in events
            if in_window(run, one.begin_s, query.window)
        ]


def _stamp_of(path: Path) -> tuple[int, int] | None:
    """Changes with the file; None where there is none."""
    try:
        about = path.stat()
    except OSError:
        return None
    return about.st_mtime_ns, about.st_size


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
    swaps = is_symmetric(query.activity)
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
