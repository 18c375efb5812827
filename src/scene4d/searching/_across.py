"""Searching a site: what several cameras saw is one event, and one person is one in all of them.

What is seen in pictures (who vanishes behind what, who bends down) is searched for in each camera,
and events of the same people at the same time are merged. What lies on the ground alone is searched
for in the fused tracks of all cameras at once, so that somebody may be in one zone in one view and
in another zone in the next.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial
from typing import Any

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.placement import Placement
from scene4d.core.progress import Progress, timed
from scene4d.core.tracks import Tracks
from scene4d.searching._asking import Asked, in_window, of_pictures
from scene4d.searching._places import in_site
from scene4d.searching._spots import Clip, FoundSpot, Memory, Piece
from scene4d.searching.activities._events import Event
from scene4d.searching.activities.course import Course, course_of
from scene4d.searching.activities.search import judge
from scene4d.searching.predicates.stage import Stage
from scene4d.searching.result import FoundEvent, SearchResult, around, rank
from scene4d.store.runs import Run
from scene4d.store.site import STEP_S, Site

_SAME_S = 2.0
"""Events of the same people at most this far apart in time are one: cameras see its beginning and
end not quite alike."""
_STRETCH_S, _OVERLAP_S = 3600.0, 300.0
"""Fused tracks are searched an hour at a time, with so much of the hour before; what takes longer
than the second is found in pieces."""


def answer_site(
    asked: Asked, search: Callable[[Asked, Progress], SearchResult], progress: Progress
) -> SearchResult:
    """Search a site; ``search`` answers what is asked of one scene."""
    site = asked.site
    assert site is not None
    if of_pictures(asked.query) or not site.cameras:
        found = search(replace(asked, site=None), progress)
        return replace(found, asked=asked, events=_merged(found.events, site))
    result = SearchResult(asked)
    result.runs = list(asked.scene.runs)
    stretches = _Stretches(site, result)
    result.memory = memory = _memory(stretches)
    begins = {str(begin_s): begin_s for begin_s in stretches.begins}
    with progress.stage("Searching the site", len(begins)) as step:
        for name in begins if memory is None else memory.in_order(begins):
            if memory is not None:
                memory.look_about(name)
            stretch = stretches(begins[name])
            result.rows += len(stretch.stage.tracks)
            with timed(result.timings, "search"):
                _search_stretch(result, stretch, name)
            step(1)
    result.events = _once(sorted(result.events, key=rank))
    top = asked.options.top
    result.events[top:] = [replace(one, around=None, course=None) for one in result.events[top:]]
    return result


@dataclass(frozen=True, eq=False)
class _Stretch:
    """An hour of a site: what each camera saw (by identity, in the site), and that fused."""

    seen: Mapping[str, Tracks]
    stage: Stage


class _Stretches:
    """Reads the stretches of a site, by their begin (s); the last one is kept."""

    def __init__(self, site: Site, result: SearchResult) -> None:
        self.site, self.result = site, result
        first, last = site.span_s
        self.begins = np.arange(first, last + 1e-9, _STRETCH_S).tolist()
        self._last: tuple[float, _Stretch] | None = None

    def __call__(self, begin_s: float) -> _Stretch:
        """The stretch of an hour."""
        if self._last is None or self._last[0] != begin_s:
            self._last = None  # before the next one is read
            with timed(self.result.timings, "load"):
                self._last = begin_s, self._read(begin_s)
        return self._last[1]

    def stage(self, begin_s: float) -> Stage:
        """What of it is searched."""
        return self(begin_s).stage

    def _read(self, begin_s: float) -> _Stretch:
        site, places = self.site, self.result.asked.of_site
        limits = {"begin": begin_s - _OVERLAP_S, "end": begin_s + _STRETCH_S}
        seen = {
            name: site.camera_tracks(name, keypoints=False, **limits)  # type: ignore[arg-type]
            for name in site.cameras
        }
        stage = Stage(
            tracks=site.fused(list(seen), list(seen.values()), STEP_S),
            image_size=(1, 1),
            step_s=STEP_S,
            camera_factor=None if site.errors is None else partial(_modes_m, site),
            zones=in_site(places, "zone", site),
            lines=in_site(places, "line", site),
        )
        return _Stretch(seen, stage)


def _modes_m(site: Site, xy_m: Float[np.ndarray, "m 2"]) -> Float[np.ndarray, "m 2 k"]:
    """What the site's errors move places by, each as the camera sees it that knows it best."""
    found = np.stack([site.error_modes(camera, xy_m) for camera in site.cameras])
    size = np.nan_to_num((found**2).sum(axis=(2, 3)), nan=np.inf)
    return found[size.argmin(axis=0), np.arange(len(xy_m))]


def _memory(stretches: _Stretches) -> Memory | None:
    """Where others were whom the words speak of, in all cameras; None where they do not."""
    site, asked = stretches.site, stretches.result.asked
    if not asked.query.activity.spots:
        return None
    start_s = site.start.timestamp() if site.start is not None else 0.0
    clips = [
        (camera, Clip(run, start_s + clock.middle_shift_s(run.span_s)))
        for camera in site.cameras
        for run, clock in site.runs(camera)
    ]
    pieces = {
        str(begin_s): Piece(
            partial(stretches.stage, begin_s),
            asked.scene.classes,
            partial(_clips_of, stretches, begin_s, clips, start_s),
            (begin_s - _OVERLAP_S, begin_s + _STRETCH_S),
            start_s=start_s,
        )
        for begin_s in stretches.begins
    }
    return Memory(asked.query.activity, pieces, [clip for _, clip in clips])


def _clips_of(
    stretches: _Stretches,
    stretch_s: float,
    clips: Sequence[tuple[str, Clip]],
    start_s: float,
    tracks: Int[np.ndarray, "n"],
    begin_s: Float[np.ndarray, "n"],
    end_s: Float[np.ndarray, "n"],
) -> Int[np.ndarray, "n"]:
    """The clip that shows each: of the camera with most rows of it, the one nearest in time."""
    stretch = stretches(stretch_s)
    names = list(stretch.seen)
    count = np.zeros((len(names), len(tracks)), int)
    for number, name in enumerate(names):
        seen = stretch.seen[name]
        if len(seen):
            stage = Stage(seen, (1, 1), STEP_S)
            at = np.searchsorted(seen.track[stage.first_row], tracks)
            known = np.append(seen.track[stage.first_row], -1)[at] == tracks
            ends_s = np.clip([begin_s - STEP_S, end_s + STEP_S], *stage.span_s)
            low, high = (np.searchsorted(stage.line_s, stage.on_line(at, t)) for t in ends_s)
            count[number] = np.where(known, high - low, 0)
    best = count.argmax(axis=0)
    outside = np.empty((len(clips), len(tracks)))
    for number, (camera, clip) in enumerate(clips):
        first_s, last_s = (t + clip.start_s - start_s for t in clip.run.span_s or (np.inf, np.inf))
        away_s = np.maximum(np.maximum(first_s - begin_s, begin_s - last_s), 0.0)
        outside[number] = np.where(best == names.index(camera), away_s, np.inf)
    return outside.argmin(axis=0)


def _search_stretch(result: SearchResult, stretch: _Stretch, name: str) -> None:
    asked, memory = result.asked, result.memory
    activity = asked.query.activity
    if memory is not None:
        stretch = replace(stretch, stage=memory.seen_from(stretch.stage, name))
    judged = judge(stretch.stage, activity, min_score=min(asked.least_score, 1.0))
    result.candidates += judged.casts
    events = [event for event in judged.events if asked.wants(event)]
    spots = [()] * len(events) if memory is None else memory.found(stretch.stage, events)
    for event, near in zip(events, spots, strict=True):
        found = _seen_best(event, stretch, asked)
        if found is not None:
            found = replace(found, spots=tuple(_on_ground_of(found, spot, asked) for spot in near))
            course = course_of(stretch.stage, activity, event) or Course(np.zeros(1), {})
            shift_s = event.begin_s - found.event.begin_s
            course = replace(course, time_s=course.time_s - shift_s)
            result.events.append(replace(found, course=course))


def _seen_best(event: Event, stretch: _Stretch, asked: Asked) -> FoundEvent | None:
    """An event in the clip of the camera that saw most of it; None outside the time asked for."""
    site = asked.site
    assert site is not None
    rows = {name: _playing(one, event) for name, one in stretch.seen.items()}
    cameras = sorted((name for name in rows if len(rows[name])), key=lambda n: -len(rows[n]))
    if not cameras:
        return None
    best = rows[cameras[0]]
    run, clock = min(
        site.runs(cameras[0]), key=lambda one: _outside(one[0], one[1].in_clip(event.begin_s))
    )
    begin_s = clock.in_clip(event.begin_s)
    shift_s = event.begin_s - begin_s
    if not in_window(run, begin_s, asked.query.window):
        return None
    frames = [
        int(best.frame[np.abs(best.time_s - moment).argmin()])
        for moment in (event.begin_s, event.end_s)
    ]
    here = replace(event, begin_s=begin_s, end_s=event.end_s - shift_s)
    own = _own(stretch.seen[cameras[0]], event, site.placements[cameras[0]], shift_s)
    across = _told(event.roles, cameras, event.begin_s, event.end_s)
    return FoundEvent(here, run, frames[0], frames[1], own, across=across)


def _on_ground_of(found: FoundEvent, spot: FoundSpot, asked: Asked) -> FoundSpot:
    """A spot on the ground of the camera in whose clip an event is shown."""
    assert asked.site is not None and found.across is not None
    placement = asked.site.placements[found.across["cameras"][0]]
    x_m, y_m = placement.inverse().points(np.array([spot.xy_m]))[0].tolist()
    return replace(spot, xy_m=(x_m, y_m))


def _outside(run: Run, time_s: float) -> float:
    """How far (s) a moment is from a run."""
    begin, end = run.span_s or (np.inf, np.inf)
    return max(begin - time_s, time_s - end, 0.0)


def _playing(tracks: Tracks, event: Event) -> Tracks:
    """The rows of those who take part, while it lasts."""
    time = (tracks.time_s >= event.begin_s) & (tracks.time_s <= event.end_s)
    return tracks.select(time & np.isin(tracks.track, list(event.roles.values())))


def _own(tracks: Tracks, event: Event, placement: Placement, shift_s: float) -> Tracks:
    """Rows at about the time of an event, on the camera's own ground and in its clip's time."""
    rows = around(tracks, event)
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
    clocks = {run.run: (name, clock) for name in site.cameras for run, clock in site.runs(name)}
    told = []
    for found in events:
        if found.run.run not in clocks:
            told.append(found)
            continue
        camera, clock = clocks[found.run.run]
        roles = {role: identity.get(track) for role, track in found.event.roles.items()}
        times = clock.in_site(found.event.begin_s), clock.in_site(found.event.end_s)
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
