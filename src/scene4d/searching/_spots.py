"""Where others were, in all that is searched: collected piece by piece, each of which is read once
where the words look one way in time, and looked up in the pieces that come after it.

A piece is a run of a scene, or an hour of a site. The positions of a camera's runs share its ground
and its calibration, all of a site share the site's. Where the start of the footage is known, times
are UTC; else a run has a clock of its own and sees its own spots only.
"""

from collections.abc import Callable, Collection, Iterable, Mapping, Sequence
from dataclasses import dataclass, replace
from functools import partial

import numpy as np
from jaxtyping import Int

from scene4d.core.errors import InputError
from scene4d.searching.activities._events import Event
from scene4d.searching.activities._terms import value_of
from scene4d.searching.activities.definition import Activity, Spot
from scene4d.searching.activities.search import judge
from scene4d.searching.predicates._meeting import expand, runs
from scene4d.searching.predicates._spots import Spots, SpotTable, own_covariance_m2
from scene4d.searching.predicates.stage import Stage
from scene4d.store.runs import Run

_LEAST_SCORE = 0.1
"""Who did as is asked with a lower score was not there; chosen by hand."""
_CELL_M = 0.5
"""Who moves further than such a square is at another spot; a step."""
_VISIT_S = 5.0
"""Who comes back to a square after so long is there a second time."""
_MOST = 4_000_000
"""Most spots of a search: about 0.6 GB. Of a month, everywhere that people walked is more; where
they stood is a thousandth of it."""
_ROUNDING_S = 1e-6
_ROUNDED_S = 1.0
"""What is known of the times of pieces is rounded by less."""

Clips = Callable[[np.ndarray, np.ndarray, np.ndarray], np.ndarray]
"""Takes tracks, and from when to when (s) each was somewhere: the number of the clip that shows it
best."""


@dataclass(frozen=True)
class Clip:
    """Footage in which spots are shown: its run, and what it begins with on their clock (s)."""

    run: Run
    start_s: float


@dataclass(frozen=True, eq=False)
class Piece:
    """A part of what is searched: its rows lie on the ground ``frame``, and ``start_s`` turns their
    times into those of ``clock``, both by number; they lie within ``span_s``. ``run`` is the number
    of its only clip; None in a site, where a track's number is an identity and belongs to it in all
    pieces.
    """

    stage: Callable[[], Stage]
    classes: Collection[str]
    clips: Clips
    span_s: tuple[float, float]
    frame: int = 0
    clock: int = 0
    start_s: float = 0.0
    run: int | None = None


def pieces_of_runs(runs: Sequence[Run], staged: Callable[[Run], Stage]) -> dict[str, Piece]:
    """A piece for each run of a scene, under its name; ``staged`` reads it."""
    cameras = sorted({run.camera for run in runs})
    return {
        run.run: Piece(
            partial(staged, run),
            run.classes,
            partial(_same_clip, number),
            run.span_s or (0.0, 0.0),
            cameras.index(run.camera),
            0 if run.start_known else 1 + number,
            start_s(run),
            number,
        )
        for number, run in enumerate(runs)
    }


@dataclass(frozen=True)
class FoundSpot:
    """A spot that an event is near: who was there (``track``, of ``run``), from ``begin_s`` to
    ``end_s`` in the clip of that run, at ``xy_m``; ``name`` says what he did, ``role`` who of the
    event is near it, ``distance_m`` how near, where ``tau_m`` is asked for, and ``probability`` is
    that of ``near_spot``.
    """

    name: str
    role: str
    run: Run
    track: int
    begin_s: float
    end_s: float
    xy_m: tuple[float, float]
    distance_m: float
    tau_m: float
    probability: float


class Memory:
    """The spots that an activity names, of all ``pieces`` by their names, and the ``clips`` in
    which they are shown. Whoever searches the pieces takes them :meth:`in_order`, calls
    :meth:`look_about` before he reads one and :meth:`seen_from` with its stage.
    """

    def __init__(
        self, activity: Activity, pieces: Mapping[str, Piece], clips: Sequence[Clip]
    ) -> None:
        self._activity, self._pieces, self._clips = activity, pieces, clips
        self._tables: dict[str, dict[str, SpotTable]] = {}
        every = pieces.values()
        self._begin_s, self._end_s = (
            np.array([one.span_s[at] + one.start_s for one in every]) for at in (0, 1)
        )
        self._shared = np.array([(one.frame, one.clock) for one in every])

    def in_order(self, names: Iterable[str]) -> list[str]:
        """Names of pieces, in an order in which most spots are known before they are asked for."""
        later = all(spot.when.later for spot in self._activity.spots)
        begin_s = dict(zip(self._pieces, self._begin_s.tolist(), strict=True))
        return sorted(names, key=lambda name: begin_s[name], reverse=later)

    def look_about(self, name: str) -> None:
        """Read the pieces whose spots may be asked for in another one and are not known yet."""
        for other in self._asked(name):
            if other != name:
                self._collect(other)

    def seen_from(self, stage: Stage, name: str) -> Stage:
        """The stage of a piece with the spots that may be asked for in it."""
        self._collect(name, stage)
        piece, spots = self._pieces[name], {}
        there = self._asked(name)
        for spot in self._activity.spots:
            tables = [self._tables[one][spot.name] for one in there]
            spots[spot.name] = Spots(
                SpotTable.joined(tables) if tables else _nowhere(),
                spot.when,
                run=piece.run,
                start_s=piece.start_s,
                span_s=stage.span_s,
                factor=stage.camera_factor,
            )
        return replace(stage, spots=spots)

    def found(self, stage: Stage, events: Sequence[Event]) -> list[tuple[FoundSpot, ...]]:
        """The spots that each event of such a stage is near: those that count most."""
        found: list[list[FoundSpot]] = [[] for _ in events]
        uses = {
            (term.roles[0], str(term.parameters["spot"])): (term, number)
            for number, phase in enumerate(self._activity.phases)
            for term in phase.terms
            if term.predicate == "near_spot" and not term.negated
        }
        for (role, name), (term, phase) in uses.items():
            tracks = [event.roles[role] for event in events]
            owner, rows = _rows(stage, tracks, [event.phases_s[phase] for event in events])
            tau_m, sigma_m = (value_of(term, key) for key in ("tau_m", "sigma_m"))
            spots = stage.spots[name]
            p, at = spots.probability(stage.rows(rows), tau_m, sigma_m)
            order = np.lexsort((-np.where(at >= 0, p, -1.0), owner))
            for best in order[runs(owner[order])]:
                if at[best] < 0:
                    continue
                spot = spots.table.select(at[best : best + 1])
                apart_m = float(np.linalg.norm(stage.tracks.xy_m[rows[best]] - spot.xy_m[0]))
                one = self._told(name, role, spot, apart_m, tau_m, float(p[best]))
                found[int(owner[best])].append(one)
        return [tuple(one) for one in found]

    def _told(
        self, name: str, role: str, spot: SpotTable, apart_m: float, tau_m: float, p: float
    ) -> FoundSpot:
        clip = self._clips[int(spot.run[0])]
        run = clip.run
        begin_s, end_s = (float(t[0]) - clip.start_s for t in (spot.begin_s, spot.end_s))
        x_m, y_m = spot.xy_m[0].tolist()
        track = int(spot.track[0])
        return FoundSpot(name, role, run, track, begin_s, end_s, (x_m, y_m), apart_m, tau_m, p)

    def _asked(self, name: str) -> list[str]:
        """The pieces with the same ground and clock whose spots may fit some moment of a piece."""
        at = list(self._pieces).index(name)
        same = (self._shared == self._shared[at]).all(axis=1)
        span_s = self._begin_s[at] - _ROUNDED_S, self._end_s[at] + _ROUNDED_S
        may = [
            spot.when.possible(span_s, self._begin_s - _ROUNDED_S, self._end_s + _ROUNDED_S)
            for spot in self._activity.spots
        ]
        asked = same & np.any(may, axis=0)
        return [other for other, may_fit in zip(self._pieces, asked, strict=True) if may_fit]

    def _collect(self, name: str, stage: Stage | None = None) -> None:
        if name in self._tables:
            return
        piece, found = self._pieces[name], {}
        for spot in self._activity.spots:
            found[spot.name] = _nowhere()
            if all(set(r.classes) & set(piece.classes) for r in spot.activity.roles):
                stage = piece.stage() if stage is None else stage
                found[spot.name] = _spots_of(stage, piece, spot)
        self._tables[name] = found
        for spot in self._activity.spots:
            if sum(len(one[spot.name]) for one in self._tables.values()) > _MOST:
                raise InputError(
                    f"{spot.name!r}: more than {_MOST:,} places; ask for fewer, such as "
                    '"where another person stood", or search fewer scenes'
                )


def _same_clip(number: int, tracks: np.ndarray, *_: np.ndarray) -> np.ndarray:
    return np.full(len(tracks), number)


def _spots_of(stage: Stage, piece: Piece, spot: Spot) -> SpotTable:
    """Where the doer of each event was during its state: a spot for each square of
    :data:`_CELL_M` and visit.
    """
    events = judge(stage, spot.activity, min_score=_LEAST_SCORE).events
    who = [event.roles[spot.doer] for event in events]
    names = [phase.name for phase in spot.activity.phases]
    at = slice(None) if spot.phase is None else names.index(spot.phase)
    lasted = [np.ravel(event.phases_s[at]) for event in events]
    spans_s = [(float(times.min()), float(times.max())) for times in lasted]
    owner, rows = _rows(stage, who, spans_s)
    tracks = stage.tracks
    placed = np.isfinite(tracks.xy_m[rows]).all(axis=1)
    owner, rows = owner[placed], rows[placed]
    if len(rows) == 0:
        return _nowhere()
    cell = np.floor(tracks.xy_m[rows] / _CELL_M).astype(np.int64)
    order = np.lexsort((tracks.time_s[rows], cell[:, 1], cell[:, 0], owner))
    owner, rows, cell = owner[order], rows[order], cell[order]
    time_s = tracks.time_s[rows]
    visit = np.cumsum(np.diff(time_s, prepend=time_s[0]) > _VISIT_S)
    first = runs(owner, cell[:, 0], cell[:, 1], visit)
    last = np.append(first[1:], len(rows)) - 1
    count = (last - first + 1)[:, None]
    xy = np.add.reduceat(tracks.xy_m[rows], first) / count
    off = tracks.xy_m[rows] - np.repeat(xy, count[:, 0], axis=0)
    scatter = off[:, :, None] * off[:, None, :] + own_covariance_m2(stage, rows)
    n = len(first)
    times_s, track = (time_s[first], time_s[last]), tracks.track[rows[first]]
    return SpotTable(
        xy_m=xy,
        covariance_m2=np.add.reduceat(scatter, first) / count[:, :, None],
        begin_s=times_s[0] + piece.start_s,
        end_s=times_s[1] + piece.start_s,
        clock=np.full(n, piece.clock),
        frame=np.full(n, piece.frame),
        run=piece.clips(track, *times_s),
        track=track,
        score=np.array([event.score for event in events])[owner[first]],
    )


def start_s(run: Run) -> float:
    """What a run's clip begins with on its clock: UTC where it is known."""
    return run.start_ns / 1e9 if run.start_known else 0.0


def _rows(
    stage: Stage, tracks: Sequence[int], spans_s: Sequence[tuple[float, float]]
) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """Rows of tracks within spans of time, ends included: which of the tracks, and the row."""
    if not tracks:
        return np.zeros(0, int), np.zeros(0, int)
    at = np.searchsorted(stage.tracks.track[stage.first_row], np.array(tracks))
    low, high = np.array(spans_s, float).T
    first = np.searchsorted(stage.line_s, stage.on_line(at, low - _ROUNDING_S))
    stop = np.searchsorted(stage.line_s, stage.on_line(at, high + _ROUNDING_S), side="right")
    return expand(first, stop - first)


def _nowhere() -> SpotTable:
    none, whole = np.zeros(0), np.zeros(0, int)
    return SpotTable(
        np.zeros((0, 2)), np.zeros((0, 2, 2)), none, none, whole, whole, whole, whole, none
    )
