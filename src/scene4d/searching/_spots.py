"""Where others were, in all runs of a scene: collected once, then looked up run by run.

The positions of a camera's runs share its ground and its calibration. Where the start of the
footage is known, times are UTC; else a run has a clock of its own and sees its own spots only.
"""

from collections.abc import Callable, Mapping, Sequence
from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Int

from scene4d.core.errors import InputError
from scene4d.core.progress import Progress
from scene4d.searching.activities._events import Event
from scene4d.searching.activities._terms import value_of
from scene4d.searching.activities.definition import Activity, Spot
from scene4d.searching.activities.search import judge
from scene4d.searching.predicates._meeting import expand, runs
from scene4d.searching.predicates._registry import PREDICATES
from scene4d.searching.predicates._spots import Spots, SpotTable
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

Staged = Callable[[Run], Stage]
"""Reads a run as a stage."""


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
    """The spots that an activity names, of all ``runs``, which are read one after the other."""

    def __init__(
        self, activity: Activity, runs: Sequence[Run], staged: Staged, progress: Progress
    ) -> None:
        self._activity, self._runs = activity, runs
        self._number = {run.run: number for number, run in enumerate(runs)}
        cameras = sorted({run.camera for run in runs})
        # With several cameras on one ground, positions are turned into it here, and the frame is
        # that ground.
        self._frame = {camera: number for number, camera in enumerate(cameras)}
        with progress.stage("Looking back", len(runs)) as step:
            self._tables = self._collected(staged, step)

    def seen_from(self, stage: Stage, run: Run) -> Stage:
        """The stage of a run with the spots that share its ground and clock."""
        spots = {}
        for spot in self._activity.spots:
            table = self._tables[spot.name]
            same = table.frame == self._frame[run.camera]
            same &= table.clock == self._clock(run)
            spots[spot.name] = Spots(
                table.select(same),
                spot.when,
                run=self._number[run.run],
                start_s=_start_s(run),
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
            tau_m, sigma_m = (value_of(term, key, PREDICATES) for key in ("tau_m", "sigma_m"))
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
        run = self._runs[int(spot.run[0])]
        begin_s, end_s = (float(t[0]) - _start_s(run) for t in (spot.begin_s, spot.end_s))
        x_m, y_m = spot.xy_m[0].tolist()
        track = int(spot.track[0])
        return FoundSpot(name, role, run, track, begin_s, end_s, (x_m, y_m), apart_m, tau_m, p)

    def _clock(self, run: Run) -> int:
        return 0 if run.start_known else 1 + self._number[run.run]

    def _collected(self, staged: Staged, step: Callable[[int], None]) -> Mapping[str, SpotTable]:
        parts: dict[str, list[SpotTable]] = {spot.name: [] for spot in self._activity.spots}
        for run in self._runs:
            for spot in self._activity.spots:
                if all(set(r.classes) & set(run.classes) for r in spot.activity.roles):
                    stage = staged(run)
                    parts[spot.name].append(self._of_run(stage, run, spot))
                    total = sum(map(len, parts[spot.name]))
                    if total > _MOST:
                        raise InputError(
                            f"{spot.name!r}: more than {_MOST:,} places; ask for fewer, such as "
                            '"where another person stood", or search fewer scenes'
                        )
            step(1)
        return {
            name: SpotTable.joined(tables) if tables else _nowhere()
            for name, tables in parts.items()
        }

    def _of_run(self, stage: Stage, run: Run, spot: Spot) -> SpotTable:
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
        scatter = off[:, :, None] * off[:, None, :] + tracks.covariance_m2[rows]
        n = len(first)
        return SpotTable(
            xy_m=xy,
            covariance_m2=np.add.reduceat(scatter, first) / count[:, :, None],
            begin_s=time_s[first] + _start_s(run),
            end_s=time_s[last] + _start_s(run),
            clock=np.full(n, self._clock(run)),
            frame=np.full(n, self._frame[run.camera]),
            run=np.full(n, self._number[run.run]),
            track=tracks.track[rows[first]],
            score=np.array([event.score for event in events])[owner[first]],
        )


def _start_s(run: Run) -> float:
    """What a run's clip begins with on its clock."""
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
