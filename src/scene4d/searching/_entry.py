"""``search``: every event that words ask for, in all runs of a scene, best first."""

import os
from collections.abc import Collection, Sequence
from dataclasses import replace
from typing import Any

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.progress import Progress, Silent, timed
from scene4d.core.tracks import Tracks
from scene4d.searching._across import answer_site
from scene4d.searching._asking import (
    Asked,
    SearchOptions,
    in_window,
    reaches,
    tracks_of,
    understand,
    watched_within,
)
from scene4d.searching._spots import Clip, Memory, pieces_of_runs, start_s
from scene4d.searching.activities._terms import lag_of, places_of
from scene4d.searching.activities.calibrated import ANNOTATED, DETECTED
from scene4d.searching.activities.course import course_of
from scene4d.searching.activities.definition import Activity
from scene4d.searching.activities.search import judge
from scene4d.searching.predicates._registry import PREDICATES
from scene4d.searching.predicates.stage import Stage
from scene4d.searching.result import FoundEvent, SearchResult, around, rank
from scene4d.searching.stages import STEP_S, kept_moments, stage_of
from scene4d.store.query import Scene
from scene4d.store.runs import Run
from scene4d.store.schema import COLOURS
from scene4d.store.site import Site
from scene4d.store.site_file import is_site

_Place = str | os.PathLike[str] | Scene | Site
_DRAWN = ("velocity", "heading", "box")
"""Columns of these."""


def search(
    scene: _Place | Sequence[_Place],
    words: str,
    options: SearchOptions | None = None,
    *,
    progress: Progress | None = None,
    **more: Any,
) -> SearchResult:
    """Find what ``words`` say in what cameras tracked: events, best first.

    ``scene`` is a folder that ``track`` wrote, a :class:`Scene`, or several of them, or a site;
    docs/search-language.md says what words are understood. Options are those of
    :class:`SearchOptions`, in one or by their names: ``search("scene", "person enters vehicle",
    min_score=0.3)``. Raises :class:`InputError` for a scene that cannot be read, for words, files
    and places that are not understood, and where nobody can be found for a role.
    """
    several = [scene] if isinstance(scene, str | os.PathLike | Scene | Site) else scene
    options = replace(options or SearchOptions(), **more)
    return answer(understand(opened(*several), words, options), progress or Silent())


def opened(*places: _Place) -> Scene | Site:
    """One scene of several, or the one site; raises :class:`InputError` for a site among others."""
    sites = [
        one
        for one in places
        if isinstance(one, Site) or (isinstance(one, str | os.PathLike) and is_site(one))
    ]
    if not sites:
        return Scene.open(*[one for one in places if not isinstance(one, Site)])
    if len(places) > 1:
        raise InputError(f"{len(places)} places with a site among them; search a site by itself")
    (site,) = sites
    return Site.open(site) if isinstance(site, str | os.PathLike) else site


def answer(asked: Asked, progress: Progress) -> SearchResult:
    """Search all runs one after the other; memory holds one of them.

    Raises :class:`InputError` for a scene that cannot be read, and where no camera sees the places
    that are asked for.
    """
    if asked.site is not None:
        return answer_site(asked, answer, progress)
    result = SearchResult(asked)
    result.runs = runs = _runs(asked)
    reader = _Reader(result)
    result.memory = memory = _memory(asked, runs, reader)
    if memory is not None:
        named = {run.run: run for run in runs}
        runs = [named[name] for name in memory.in_order(named)]
    with progress.stage("Searching", len(runs)) as step:
        for run in runs:
            stage = reader(run)
            with timed(result.timings, "search"):
                _search_run(result, stage, run)
            step(1)
    return result


class _Reader:
    """Reads runs as stages; the last one is kept, in case that the same is asked for again."""

    def __init__(self, result: SearchResult, also: Collection[str] = ()) -> None:
        self._result, self._also = result, also
        self._calibrations: dict[str, Calibration] = {}
        self._last: tuple[Run, Stage] | None = None

    def __call__(self, run: Run) -> Stage:
        """The stage of a run, with the spots that are asked for in it."""
        memory = self._result.memory
        if memory is None:
            return self.read(run)
        memory.look_about(run.run)
        return memory.seen_from(self.read(run), run.run)

    def read(self, run: Run) -> Stage:
        """The stage of a run alone."""
        if self._last is None or self._last[0] is not run:
            self._last = None  # before the next one is read
            asked = self._result.asked
            if run.camera not in self._calibrations:
                known = Calibration.load(asked.scene.camera_file(run.camera))
                self._calibrations[run.camera] = known
            with timed(self._result.timings, "load"):
                stage = staged_run(asked, run, self._calibrations[run.camera], self._also)
            self._last = run, stage
        return self._last[1]


def _memory(asked: Asked, runs: Sequence[Run], reader: _Reader) -> Memory | None:
    """Where others were whom the words speak of; None where they do not."""
    if not asked.query.activity.spots:
        return None
    cameras, names = {run.camera for run in runs}, {run.run for run in runs}
    known = any(run.start_known for run in runs)
    there = [
        run
        for run in asked.scene.runs
        if run.rows and run.camera in cameras and (run.run in names or (known and run.start_known))
    ]
    clips = [Clip(run, start_s(run)) for run in there]
    return Memory(asked.query.activity, pieces_of_runs(there, reader.read), clips)


def explained(result: SearchResult) -> None:
    """Give each event that is shown its predicates over time, and who was about; the runs of these
    are read again.
    """
    asked, reader = result.asked, _Reader(result, also=_DRAWN)
    shown = [n for n, found in enumerate(result.shown) if found.course is None]
    for number in sorted(shown, key=lambda n: result.events[n].run.run):
        found = result.events[number]
        stage = reader(found.run)
        course = course_of(stage, asked.query.activity, found.event)
        rows = around(stage.tracks, found.event)
        result.events[number] = replace(found, course=course, around=rows)


def _runs(asked: Asked) -> list[Run]:
    """Those that can hold an event."""
    activity = asked.query.activity
    of_nobody = any(one.is_of_nobody for one in activity.options)
    runs = [
        run
        for run in asked.scene.runs
        if (run.rows or of_nobody) and (run.watched is not None or not of_nobody)
    ]
    names = [run.run for run in runs]
    twice = next((name for name in names if names.count(name) > 1), None)
    if twice is not None:
        raise InputError(f"run {twice!r} is in two of the scenes; search them apart")
    seeing = _seeing(asked)
    return [
        run
        for run in runs
        if run.camera in seeing
        and activity.playable_by(run.classes)
        and reaches(run, asked.query.window)
    ]


def _seeing(asked: Asked) -> list[str]:
    """The cameras that see all places that are asked for; raises where there is none."""
    terms = asked.query.activity.every_term
    wanted = {kind: set(places_of(terms, kind)) for kind in ("zone", "line")}
    seeing = [
        camera
        for camera in asked.scene.cameras
        if all(names <= set(asked.places.of(camera, kind)) for kind, names in wanted.items())
    ]
    if not seeing:
        places = ", ".join(sorted(set().union(*wanted.values())))
        raise InputError(f"{asked.query.text!r}: no one camera sees all of {places}")
    return seeing


def staged_run(
    asked: Asked, run: Run, calibration: Calibration, also: Collection[str] = ()
) -> Stage:
    """One run as a stage; raises as :meth:`Scene.sql` and :func:`stage_of`.

    Without columns that no predicate looks at, beside ``also``: reading a day's rows, which are
    mostly keypoints and covariances, takes several times as long as the search itself. Tracks of
    annotations, where one object may have several, are united.
    """
    everybody = tracks_of(run) == DETECTED
    groups = _groups(asked.query.activity) | set(also) | (set() if everybody else {"box"})
    if COLOURS in groups:
        _check_colours(run)
    tracks, step_s = lean_tracks(asked.scene.only(run.run), STEP_S, groups)
    stage = stage_of(
        tracks,
        calibration,
        step_s=step_s,
        zones=asked.places.of(run.camera, "zone"),
        lines=asked.places.of(run.camera, "line"),
        everybody=everybody,
        watched=watched_within(run, asked.query.window),
    )
    if not everybody:
        from scene4d.searching.activities.identity import unite_tracks  # SciPy's graphs load slowly

        stage = unite_tracks(stage)
    return stage


def _groups(activity: Activity) -> set[str]:
    """The groups of columns that a search for an activity looks at."""
    terms = activity.every_term
    # Who was somewhere at any earlier time is compared where it stood.
    stood = {"velocity"} if any(np.isinf(lag_of(term)) for term in terms) else set()
    return stood.union(*(PREDICATES[term.predicate].reads for term in terms))


def _check_colours(run: Run) -> None:
    """Raise :class:`InputError` for a run whose tracks were never looked at for their colours."""
    if tracks_of(run) == ANNOTATED:
        why = "come from annotations: track the footage itself"
    elif COLOURS in run.lacks:
        why = "were written by an earlier version: track the footage again"
    else:
        return
    raise InputError(f"run {run.run!r}: its tracks have no colours, since they {why}")


def lean_tracks(scene: Scene, step_s: float, groups: Collection[str]) -> tuple[Tracks, float]:
    """Rows of a scene with some groups of columns, :func:`thinned` and ordered by (track, time),
    and the time between them.
    """
    step = step_s

    def choose(track: np.ndarray, time_s: np.ndarray) -> np.ndarray:
        nonlocal step
        kept, step = kept_moments(time_s, step_s)
        order: np.ndarray = np.lexsort((time_s, track))
        return order if kept is None else order[kept[order]]

    tracks = scene.lean_tracks(choose, groups)
    return tracks, step


def _search_run(result: SearchResult, stage: Stage, run: Run) -> None:
    asked = result.asked
    result.rows += len(stage.tracks)
    judged = judge(stage, asked.query.activity, min_score=min(asked.least_score, 1.0))
    found = [event for event in judged.events if asked.wants(event)]
    events = [event for event in found if in_window(run, event.begin_s, asked.query.window)]
    if not events:
        result.candidates += judged.casts
    memory = result.memory
    spots = [()] * len(events) if memory is None else memory.found(stage, events)
    for number, event in enumerate(events):
        begin, end = stage.frame_at(event.begin_s), stage.frame_at(event.end_s)
        result.events.append(FoundEvent(event, run, begin, end, spots=spots[number]))
    result.events.sort(key=rank)
