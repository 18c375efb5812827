"""Searching a site: what several cameras saw is one event, and one person is one in all of them.

What is seen in pictures (who vanishes behind what, who bends down) is searched for in each camera,
and events of the same people at the same time are merged. What lies on the ground alone is searched
for in the fused tracks of all cameras at once, so that somebody may be in one zone in one view and
in another zone in the next.
"""

from collections.abc import Callable, Iterator, Mapping, Sequence
from dataclasses import dataclass, replace
from typing import Any

import numpy as np

from scene4d.core.placement import Placement
from scene4d.core.progress import Progress, timed
from scene4d.core.tracks import Tracks
from scene4d.searching._asking import Asked, second_of_day
from scene4d.searching._places import in_site
from scene4d.searching.activities._events import Event
from scene4d.searching.activities.course import Course, course_of
from scene4d.searching.activities.search import judge
from scene4d.searching.predicates.stage import Stage
from scene4d.searching.result import FoundEvent, SearchResult
from scene4d.store.fusing import fused
from scene4d.store.runs import Run
from scene4d.store.site import STEP_S, Site

_OF_PICTURES = {
    *("appears", "appears_from", "disappears", "disappears_into"),
    *("stooping", "arm_moving_up", "arm_moving_down"),
}
"""Predicates that look at boxes or bodies, which belong to one camera's picture."""
_SAME_S = 2.0
"""Events of the same people at most this far apart in time are one: cameras see its beginning and
end not quite alike."""
_STRETCH_S, _OVERLAP_S = 3600.0, 300.0
"""Fused tracks are searched an hour at a time, with so much of the hour before; what takes longer
than the second is found in pieces."""
_AROUND_S = 4.0


def answer_site(
    asked: Asked, search: Callable[[Asked, Progress], SearchResult], progress: Progress
) -> SearchResult:
    """Search a site; ``search`` answers what is asked of one scene."""
    site = asked.site
    assert site is not None
    if _of_pictures(asked) or not site.cameras:
        found = search(replace(asked, site=None), progress)
        return replace(found, asked=asked, events=_merged(found.events, site))
    result = SearchResult(asked)
    result.runs = list(asked.scene.runs)
    with progress.stage("Searching the site", None):
        for stretch in _stretches(site, result):
            with timed(result.timings, "search"):
                _search_stretch(result, stretch)
    result.events = _once(sorted(result.events, key=_rank))
    top = asked.options.top
    result.events[top:] = [replace(one, around=None, course=None) for one in result.events[top:]]
    return result


def _of_pictures(asked: Asked) -> bool:
    """Whether each camera is searched by itself, as also where spots are remembered."""
    activity = asked.query.activity
    return bool(activity.spots) or any(term.predicate in _OF_PICTURES for term in activity.terms)


@dataclass(frozen=True, eq=False)
class _Stretch:
    """An hour of a site: what each camera saw (by identity, in the site), and that fused."""

    seen: Mapping[str, Tracks]
    stage: Stage


def _stretches(site: Site, result: SearchResult) -> Iterator[_Stretch]:
    first, last = site.span_s
    begin = first
    while begin <= last:
        with timed(result.timings, "load"):
            limits = {"begin": begin - _OVERLAP_S, "end": begin + _STRETCH_S}
            seen = {
                name: site.camera_tracks(name, keypoints=False, **limits)  # type: ignore[arg-type]
                for name in site.cameras
            }
            tracks = fused(list(seen.values()), STEP_S)
        places = result.asked.of_site
        stage = Stage(
            tracks=tracks,
            image_size=(1, 1),
            step_s=STEP_S,
            zones=in_site(places, "zone", site),
            lines=in_site(places, "line", site),
        )
        result.rows += len(tracks)
        if len(tracks):
            yield _Stretch(seen, stage)
        begin += _STRETCH_S


def _search_stretch(result: SearchResult, stretch: _Stretch) -> None:
    asked = result.asked
    activity = asked.query.activity
    judged = judge(stretch.stage, activity, min_score=min(asked.least_score, 1.0))
    result.candidates += judged.casts
    for event in judged.events:
        if not asked.wants(event):
            continue
        found = _seen_best(event, stretch, asked)
        if found is not None:
            course = course_of(stretch.stage, activity, event) or Course(np.zeros(1), {})
            shift_s = event.begin_s - found.event.begin_s
            course = replace(course, time_s=course.time_s - shift_s)
            result.events.append(replace(found, course=course))


def _seen_best(event: Event, stretch: _Stretch, asked: Asked) -> FoundEvent | None:
    """An event in the clip of the camera that saw most of it; None outside the time asked for."""
    site = asked.site
    assert site is not None
    who = list(event.roles.values())
    rows = {name: _during(one, event, who) for name, one in stretch.seen.items()}
    cameras = sorted((name for name in rows if len(rows[name])), key=lambda n: -len(rows[n]))
    if not cameras:
        return None
    best = rows[cameras[0]]
    run, shift_s = min(
        site.runs(cameras[0]), key=lambda one: _outside(one[0], event.begin_s - one[1])
    )
    window, begin_s = asked.query.window, event.begin_s - shift_s
    if window is not None and not (
        run.start_known and window.contains(second_of_day(run, begin_s))
    ):
        return None
    frames = [
        int(best.frame[np.abs(best.time_s - moment).argmin()])
        for moment in (event.begin_s, event.end_s)
    ]
    here = replace(event, begin_s=begin_s, end_s=event.end_s - shift_s)
    around = _own(stretch.seen[cameras[0]], event, site.placements[cameras[0]], shift_s)
    across = _told(event.roles, cameras, event.begin_s, event.end_s)
    return FoundEvent(here, run, frames[0], frames[1], around, across=across)


def _outside(run: Run, time_s: float) -> float:
    """How far (s) a moment is from a run."""
    begin, end = run.span_s or (np.inf, np.inf)
    return max(begin - time_s, time_s - end, 0.0)


def _during(tracks: Tracks, event: Event, who: Sequence[int]) -> Tracks:
    time = (tracks.time_s >= event.begin_s) & (tracks.time_s <= event.end_s)
    return tracks.select(time & np.isin(tracks.track, who))


def _own(tracks: Tracks, event: Event, placement: Placement, shift_s: float) -> Tracks:
    """Rows at about the time of an event, on the camera's own ground and in its clip's time."""
    time = tracks.time_s
    near = (time >= event.begin_s - _AROUND_S) & (time <= event.end_s + _AROUND_S)
    rows = tracks.select(near)
    xy = placement.inverse().points(rows.xy_m)
    return replace(rows, time_s=rows.time_s - shift_s, xy_m=xy)


def _told(
    roles: Mapping[str, int | None], cameras: Sequence[str], begin_s: float, end_s: float
) -> dict[str, Any]:
    """What an event of a site says beside those of a scene."""
    return {
        "identities": dict(roles),
        "cameras": list(cameras),
        "site_begin_s": begin_s,
        "site_end_s": end_s,
    }


def _merged(events: Sequence[FoundEvent], site: Site) -> list[FoundEvent]:
    """The events of single cameras on the site's clock, those of the same people at one time once:
    as the camera saw it whose event scores best.
    """
    identity = _identity_of(site)
    clock = {run.run: (name, shift_s) for name in site.cameras for run, shift_s in site.runs(name)}
    told = []
    for found in events:
        camera, shift_s = clock.get(found.run.run, (None, 0.0))
        if camera is None:
            told.append(found)
            continue
        roles = {role: identity.get(track) for role, track in found.event.roles.items()}
        times = found.event.begin_s + shift_s, found.event.end_s + shift_s
        told.append(replace(found, across=_told(roles, [camera], *times)))
    return _once(told)


def _identity_of(site: Site) -> dict[int, int]:
    """The identity of each track of the scene of all cameras."""
    _, offsets = site.whole()
    known = site.identities
    added = np.array([offsets[name] for name in known.camera.tolist()], np.int64)
    return dict(zip((known.track + added).tolist(), known.identity.tolist(), strict=True))


def _once(events: Sequence[FoundEvent]) -> list[FoundEvent]:
    """Of events of the same people at one time the first, with the cameras of all; best first."""
    kept: list[FoundEvent] = []
    of: dict[Any, list[int]] = {}
    for found in events:
        across = found.across
        if across is None or None in across["identities"].values():
            kept.append(found)
            continue
        key = (found.event.activity, *sorted(across["identities"].items()))
        same = next((k for k in of.get(key, []) if _at_once(kept[k].across, across)), None)
        if same is None:
            of.setdefault(key, []).append(len(kept))
            kept.append(found)
        else:
            first = dict(kept[same].across or {})
            first["cameras"] = list(dict.fromkeys([*first["cameras"], *across["cameras"]]))
            kept[same] = replace(kept[same], across=first)
    return kept


def _at_once(one: Mapping[str, Any] | None, other: Mapping[str, Any]) -> bool:
    assert one is not None
    later = max(one["site_begin_s"], other["site_begin_s"])
    return bool(later - min(one["site_end_s"], other["site_end_s"]) <= _SAME_S)


def _rank(found: FoundEvent) -> tuple[float, str, float]:
    return (-found.event.score, found.run.run, found.event.begin_s)
