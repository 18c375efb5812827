"""The query of a search: words and options, checked against a scene."""

from collections.abc import Collection, Sequence
from dataclasses import dataclass, field
from pathlib import Path

import numpy as np
from jaxtyping import Float

from scene4d.core.errors import InputError
from scene4d.core.text import nearest
from scene4d.searching._places import Places, in_cameras, read_places
from scene4d.searching.activities._events import Event
from scene4d.searching.activities._terms import places_of
from scene4d.searching.activities.calibrated import ANNOTATED, DETECTED, calibration_of
from scene4d.searching.activities.catalogue import load_catalogue
from scene4d.searching.activities.search import LEAST_SCORE, MIN_SCORE
from scene4d.searching.language import Query, Window, parse_query
from scene4d.searching.predicates._when import DAY_S
from scene4d.store.query import Scene
from scene4d.store.runs import Run
from scene4d.store.site import Site

EVERYTHING = "all activities"
"""Asks for every activity of the catalogue."""
_OF_PICTURES = {
    *("appears", "appears_from", "disappears", "disappears_into"),
    *("stooping", "arm_moving_up", "arm_moving_down"),
}
"""Predicates that look at boxes or bodies, which belong to one camera's picture."""


@dataclass(frozen=True)
class SearchOptions:
    """The options of a search.

    ``min_score`` is the lowest score of an event, ``min_probability`` the lowest probability, which
    only calibrated scores have. ``top`` is how many events are shown with images
    on the page; the result holds all. ``catalogues`` are YAML files of activities, added to the
    built-in ones; ``zones`` is a file of named zones and lines. ``footage`` is a file or a folder
    with the footage, if it has moved since it was tracked.
    """

    min_score: float = MIN_SCORE
    top: int = 10
    min_probability: float | None = None
    catalogues: Sequence[str | Path] = ()
    zones: str | Path | None = None
    footage: str | Path | None = None

    def __post_init__(self) -> None:
        """Check the values; raises :class:`InputError`."""
        if not 0 <= self.min_score <= 1:
            raise InputError(f"min_score must lie between 0 and 1, found {self.min_score}")
        if self.min_probability is not None and not 0 <= self.min_probability <= 1:
            raise InputError(
                f"min_probability must lie between 0 and 1, found {self.min_probability}"
            )
        if self.top < 1:
            raise InputError(f"top must be at least 1, found {self.top}")
        if self.footage is not None and not Path(self.footage).exists():
            raise InputError(f"footage: {self.footage} does not exist")


@dataclass(frozen=True, eq=False)
class Asked:
    """A search that is ready to run: the ``query`` as understood, the ``places`` that it names, and
    ``notes``: those of the query, and those on this scene. Of a ``site``, ``scene`` is all of its
    cameras, ``places`` are in the metres of each, and ``of_site`` as the file has them.
    """

    scene: Scene
    query: Query
    options: SearchOptions
    places: Places
    notes: tuple[str, ...]
    site: Site | None = None
    of_site: Places = field(default_factory=Places)

    @property
    def least_score(self) -> float:
        """The lowest score of an event that is asked for: at least :data:`LEAST_SCORE`."""
        least, wanted = max(self.options.min_score, LEAST_SCORE), self.options.min_probability
        if wanted is None:
            return least
        known = [
            calibration_of(one, tracks)
            for one in self.query.activity.options
            for tracks in (ANNOTATED, DETECTED)
        ]
        return max(least, min(one.least_score(wanted) for one in known if one is not None))

    def wants(self, event: Event) -> bool:
        """Whether an event scores enough, and is probable enough."""
        wanted = self.options.min_probability
        sure = wanted is None or (event.probability or 0.0) >= wanted - 1e-9
        return sure and event.score >= self.least_score


def understand(scene: Scene | Site, words: str, options: SearchOptions) -> Asked:
    """Parse the words and check them against the scene, or a site; only manifests are read.

    Raises :class:`InputError` for words, files and places that are not understood, for a role that
    no class in the scene can play, and for a time of day if the footage's start is unknown.
    """
    site = scene if isinstance(scene, Site) else None
    scene = scene.whole()[0] if isinstance(scene, Site) else scene
    query, named = words_of(words, options, scene.cameras)
    if options.min_probability is not None:
        check_calibrated(query, {tracks_of(run) for run in scene.runs})
    notes = [*query.notes, *_check_roles(scene, query), *_check_watched(scene, site, query)]
    if named.shared and len(scene.cameras) > 1 and site is None:
        notes.append(
            f"{', '.join(map(repr, named.shared))}: used in the ground coordinates of each of "
            f"{len(scene.cameras)} cameras, because the file names no camera for it"
        )
    if query.window is not None:
        notes += _check_window(scene, query)
    notes += _check_clocks(scene, query, is_one=site is not None and not of_pictures(query))
    places = named if site is None else in_cameras(named, site)
    return Asked(scene, query, options, places, tuple(notes), site, named)


def understand_all(scene: Scene | Site, words: str, options: SearchOptions) -> list[Asked]:
    """Several searches, as :func:`understand`: words with ``;`` between them, or
    :data:`EVERYTHING`, which are those activities of the catalogue that the scene can hold.
    """
    several = [part for part in map(str.strip, words.split(";")) if part]
    if several == [EVERYTHING]:
        return _everything(scene, options)
    return [understand(scene, part, options) for part in several or [words]]


def _everything(scene: Scene | Site, options: SearchOptions) -> list[Asked]:
    asked, refused = [], InputError(f"{EVERYTHING!r}: the catalogue is empty")
    for name, activity in load_catalogue(*map(Path, options.catalogues)).items():
        try:
            asked.append(understand(scene, next(iter(activity.phrases), name), options))
        except InputError as error:
            refused = error
    if not asked:
        raise refused
    return asked


def words_of(
    words: str, options: SearchOptions, cameras: Collection[str] | None
) -> tuple[Query, Places]:
    """The words as understood, and the places that they name, of these cameras (None: of any).

    Raises :class:`InputError` for words, files and places that are not understood.
    """
    places = Places() if options.zones is None else read_places(Path(options.zones), cameras)
    catalogue = load_catalogue(*map(Path, options.catalogues))
    query = parse_query(words, catalogue, zones=places.names("zone"), lines=places.names("line"))
    used = _used(query, places)
    return query, Places(tuple(place for place in places.all if place.name in used))


def tracks_of(run: Run) -> str:
    """Whose tracks a run holds."""
    return ANNOTATED if "annotations" in run.provenance else DETECTED


def check_calibrated(query: Query, kinds: Collection[str]) -> None:
    """Raise where something is asked for that has no probability on such tracks."""
    for one in query.activity.options:
        if not any(calibration_of(one, tracks) for tracks in kinds):
            whose = f" on {' or '.join(sorted(kinds))} tracks"
            raise InputError(
                f"min_probability: the scores of {query.text!r} are not calibrated{whose}, only "
                "those of some activities of the catalogue as they stand there; min_score limits "
                "the score"
            )


def _check_roles(scene: Scene, query: Query) -> list[str]:
    """A note on each alternative that nobody here can do; raises where that are all."""
    activity, notes = query.activity, []
    spots = [role for spot in activity.spots for role in spot.activity.roles]
    for one in activity.options:
        for role in (*one.roles, *spots):
            if not (role.absent or set(role.classes) & set(scene.classes)):
                rows = ", ".join(
                    f"{name} ({count:,} rows)" for name, count in scene.classes.items()
                )
                notes.append(
                    f"the scene has no {' or '.join(role.classes)}: nobody can be the "
                    f"{role.name!r} of {one.name!r}; there: {rows}"
                )
    if not activity.playable_by(scene.classes) or (spots and notes):
        raise InputError(notes[0])
    return notes


def _check_watched(scene: Scene, site: Site | None, query: Query) -> list[str]:
    """Notes on where nobody can be looked for; raises where it can be in no clip."""
    if not any(one.is_of_nobody for one in query.activity.options):
        return []
    if site is not None:
        raise InputError(
            f"{query.text!r}: that nobody is there is searched for in the scene of one camera, not "
            "in a site"
        )
    runs = scene.runs
    unknown = [run for run in runs if run.watched is None]
    if len(unknown) == len(runs):
        raise InputError(
            f"{query.text!r}: no clip says when its camera was watched, and where there are no "
            "rows there may be no footage: track it again (annotations do not tell it)"
        )
    notes = [
        "that nobody is there has a score and no probability: who was never tracked is not counted"
    ]
    if unknown:
        notes.append(
            f"{len(unknown)} of {len(runs)} clips are left out: when they were watched is not known"
        )
    return notes


def _used(query: Query, places: Places) -> set[str]:
    """The names of the places that the query uses."""
    used: set[str] = set()
    for kind in ("zone", "line"):
        for name in places_of(query.activity.every_term, kind):
            there = places.names(kind)
            if name not in there:
                raise InputError(
                    f"{query.text!r} asks for the {kind} {name!r}{nearest(name, there)}; name "
                    "places in a file and pass it as zones"
                )
            used.add(name)
    return used


def _without_start(scene: Scene, query: Query, wanted: str | None) -> tuple[int, int]:
    """How many clips do not know when they began, of how many; raises where these are all, and
    something is ``wanted`` for which it must be known.
    """
    known = [run.start_known for run in scene.runs if run.rows]
    if wanted is not None and not any(known):
        raise InputError(
            f"{query.text!r} asks for {wanted}, but the start of the footage is unknown: "
            "track it again with its start, such as 2026-11-20T08:00:00Z"
        )
    return known.count(False), len(known)


def _check_window(scene: Scene, query: Query) -> list[str]:
    """Notes on the time of day; raises if it is unknown for all runs."""
    unknown, clips = _without_start(scene, query, "a time of day")
    notes = ["times of day are UTC; an event belongs to the time at which it begins"]
    if unknown:
        notes.append(f"{unknown} of {clips} clips are left out: their start is not known")
    return notes


def of_pictures(query: Query) -> bool:
    """Whether a search looks at pictures, so that each camera of a site is searched by itself."""
    return any(term.predicate in _OF_PICTURES for term in query.activity.every_term)


def _check_clocks(scene: Scene, query: Query, *, is_one: bool) -> list[str]:
    """Notes on which clips are compared, unless all share ground and clock (``is_one``); raises
    where days are asked for and none is known.
    """
    if not query.activity.spots:
        return []
    whens = [spot.when for spot in query.activity.spots]
    dated = [repr(str(w)) for w in whens if w.day is not None or w.clock is not None]
    unknown, clips = _without_start(scene, query, next(iter(dated), None))
    notes: list[str] = []
    if is_one:
        return notes
    if unknown and clips > 1:
        notes.append(
            f"the start of {unknown} of {clips} clips is not known: who was where is looked up "
            "in the same clip only there"
        )
    if len(scene.cameras) > 1:
        notes.append(
            "who was where is looked up in the same camera: boxes are compared in one picture, and "
            "cameras share no ground until scene4d align has made them a site"
        )
    return notes


def reaches(run: Run, window: Window | None) -> bool:
    """Whether an event of the run can begin in the window."""
    if window is None:
        return True
    spans = [run.span_s] if run.span_s else []
    spans += [(begin_s, end_s) for begin_s, end_s, *_ in run.watched or ()]
    if not run.start_known or not spans:
        return False
    begin_s = min(begin_s for begin_s, _ in spans)
    length_s = max(end_s for _, end_s in spans) - begin_s
    first = second_of_day(run, begin_s)
    return window.contains(first) or (window.begin_s - first) % DAY_S <= length_s


def watched_within(run: Run, window: Window | None) -> Float[np.ndarray, "s 4"] | None:
    """When a run's camera was watched (begin, end, and their frames), within a time of day; None
    where it is not known.
    """
    if run.watched is None or window is None:
        return None if run.watched is None else np.array(run.watched)
    found = []
    for begin, end, first, last in run.watched:
        start = begin - second_of_day(run, begin) - DAY_S
        for day in np.arange(start, end, DAY_S):
            a = max(begin, float(day) + window.begin_s)
            b = min(end, float(day) + window.begin_s + window.length_s)
            if a < b:
                frames = np.interp([a, b], [begin, end], [first, last])
                found.append([a, b, *frames])
    return np.array(found, float).reshape(-1, 4)


def in_window(run: Run, time_s: float, window: Window | None) -> bool:
    """Whether a moment of a run lies in a time of day (None: any)."""
    return window is None or (run.start_known and window.contains(second_of_day(run, time_s)))


def second_of_day(run: Run, time_s: float) -> float:
    """Seconds since midnight, UTC, of a run whose start is known."""
    return (run.moment_ns(time_s) / 1e9) % DAY_S
