"""``search``: every event of what is asked for, in all runs of a scene, best first."""

from collections.abc import Iterable
from dataclasses import dataclass, field
from typing import Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.progress import Progress, Silent, timed
from scene4d.core.tracks import Tracks
from scene4d.searching.activities.events import Event
from scene4d.searching.activities.known import PREDICATES
from scene4d.searching.activities.search import LEAST_SCORE, MIN_SCORE, judge
from scene4d.searching.activities.terms import places_of
from scene4d.searching.asking import Asked
from scene4d.searching.clock import reaches, second_of_day
from scene4d.searching.loading import asks_for_keypoints, playable, staged_run
from scene4d.searching.stages import Staged
from scene4d.store.query import Scene
from scene4d.store.runs import Run

_AROUND_S = 4.0
"""So much before and after an event is kept to show it."""


@dataclass(frozen=True, eq=False)
class FoundEvent:
    """An event, the run that it is in, and its first and last frame.

    ``around`` are the rows of everybody from :data:`_AROUND_S` before it until as much after, at
    the rate that was searched; None for events that nobody looks at.
    """

    event: Event
    run: Run
    begin_frame: int
    end_frame: int
    around: Tracks | None = None

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints of it; what could not be judged is null."""
        event = self.event
        return {
            "activity": event.activity,
            "score": event.score,
            "begin_s": event.begin_s,
            "end_s": event.end_s,
            "begin_frame": self.begin_frame,
            "end_frame": self.end_frame,
            "camera": self.run.camera,
            "roles": dict(event.roles),
            "why": {k: None if np.isnan(v) else v for k, v in event.why.items()},
        }


@dataclass
class Search:
    """What came of it: events, best first; the runs that were searched, and how many casts (pairs
    of a person and a vehicle, say) came close enough to be judged where no event was found.
    """

    asked: Asked
    min_score: float
    events: list[FoundEvent] = field(default_factory=list)
    runs: list[Run] = field(default_factory=list)
    rows: int = 0
    candidates: int = 0
    timings: dict[str, float] = field(default_factory=dict)

    @property
    def least_score(self) -> float:
        """What an event must score: ``min_score``, and :data:`LEAST_SCORE` where that is less."""
        return max(self.min_score, LEAST_SCORE)

    def to_dict(self) -> dict[str, Any]:
        """What ``--json`` prints."""
        return {
            "query": self.asked.query.text,
            "predicates": list(self.asked.query.predicates),
            "events": [event.to_dict() for event in self.events],
        }


def search(
    scene: Scene,
    asked: Asked,
    *,
    min_score: float = MIN_SCORE,
    keep: int = 0,
    progress: Progress | None = None,
) -> Search:
    """Search all runs one after the other; memory holds one of them.

    Events score at least ``min_score`` (and :data:`LEAST_SCORE`); ``keep`` of them, the best, know
    what was around them. Raises :class:`InputError` for a scene that cannot be read, and where no
    camera sees the places that are asked for.
    """
    done = Search(asked, min_score)
    runs = _runs(scene, asked)
    posed = asks_for_keypoints(asked.query.activity)
    with (progress or Silent()).stage("Searching", len(runs)) as step:
        calibrations = {
            camera: Calibration.load(scene.camera_file(camera))
            for camera in {run.camera for run in runs}
        }
        for run in runs:
            with timed(done.timings, "load"):
                staged = staged_run(
                    scene, run, calibrations[run.camera], asked.places, with_keypoints=posed
                )
            with timed(done.timings, "search"):
                _search_run(done, staged, run, keep)
            step(1)
    done.events.sort(key=_rank)
    done.events[keep:] = [_bare(one) for one in done.events[keep:]]
    return done


def _runs(scene: Scene, asked: Asked) -> list[Run]:
    """Those that can hold an event."""
    runs = [run for run in scene.runs if run.rows]
    names = [run.run for run in runs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"run {twice!r} is in two of the scenes; search them apart")
    activity = asked.query.activity
    terms = [term for phase in activity.phases for term in phase.terms]
    wanted = {kind: set(places_of(terms, kind, PREDICATES)) for kind in ("zone", "line")}
    seeing = [
        camera
        for camera in scene.cameras
        if all(names <= set(asked.places.of(camera, kind)) for kind, names in wanted.items())
    ]
    if not seeing:
        places = ", ".join(sorted(set().union(*wanted.values())))
        raise InputError(f"{asked.query.text!r}: no one camera sees all of {places}")
    return [
        run
        for run in runs
        if run.camera in seeing
        and playable(activity, run.classes)
        and reaches(run, asked.query.window)
    ]


def _search_run(done: Search, staged: Staged, run: Run, keep: int) -> None:
    activity, stage = done.asked.query.activity, staged.stage
    done.runs.append(run)
    done.rows += len(stage.tracks)
    judged = judge(stage, activity, min_score=done.min_score)
    events = _in_window(done, run, judged.events)
    if not events:
        done.candidates += judged.casts
    for number, event in enumerate(events):
        begin, end = staged.frame_at(event.begin_s), staged.frame_at(event.end_s)
        around = _around(stage.tracks, event) if number < keep else None
        done.events.append(FoundEvent(event, run, begin, end, around))


def _in_window(done: Search, run: Run, events: Iterable[Event]) -> list[Event]:
    window = done.asked.query.window
    if window is None:
        return list(events)
    return [event for event in events if window.contains(second_of_day(run, event.begin_s))]


def _around(tracks: Tracks, event: Event) -> Tracks:
    time = tracks.time_s
    return tracks.select((time >= event.begin_s - _AROUND_S) & (time <= event.end_s + _AROUND_S))


def _bare(found: FoundEvent) -> FoundEvent:
    return FoundEvent(found.event, found.run, found.begin_frame, found.end_frame)


def _rank(found: FoundEvent) -> tuple[float, str, float]:
    return (-found.event.score, found.run.run, found.event.begin_s)
