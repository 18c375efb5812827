"""The cameras of several scenes as alignment takes them: which runs, on which clock."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass, replace
from itertools import combinations
from pathlib import Path

import numpy as np

from scene4d.core.calibration import Calibration
from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.store.query import Scene
from scene4d.store.runs import Run, camera_path, complete_runs
from scene4d.store.site import clock_s

_ROW_S = 0.2
"""Rows closer to each other than this are left out: people do little in less."""
_PIECE_S = 1800.0
"""So much of a run is read at a time, before rows are left out."""


@dataclass(frozen=True, eq=False)
class Watched:
    """A camera of the site to be: its name there and in its scene, the runs that are taken, and
    whether it is known when they began.
    """

    name: str
    folder: Path
    camera: str
    runs: tuple[Run, ...]
    start_known: bool

    @property
    def file(self) -> Path:
        """Its calibration."""
        return camera_path(self.folder, self.camera)

    @property
    def rows(self) -> int:
        """Rows of all runs."""
        return sum(run.rows for run in self.runs)

    def span_s(self, start_ns: int | None) -> tuple[float, float] | None:
        """The first and last time of a row on its clock."""
        spans = [
            (run.span_s[0] + clock_s(run, start_ns), run.span_s[1] + clock_s(run, start_ns))
            for run in self.runs
            if run.span_s
        ]
        return (min(b for b, _ in spans), max(e for _, e in spans)) if spans else None

    def calibration(self) -> Calibration:
        """Read from its file."""
        return Calibration.load(self.file)

    def tracks(self, start_ns: int | None) -> Tracks | None:
        """Its rows on its clock, ordered by (track, time), at most every :data:`_ROW_S`, without
        keypoints; None if nobody was tracked.
        """
        if not self.rows:
            return None
        scene, parts = Scene.open(self.folder), []
        for run in self.runs:
            shift_s, pieces = clock_s(run, start_ns), _pieces(scene.only(run.run), run)
            parts += [replace(found, time_s=found.time_s + shift_s) for found in pieces]
        tracks = Tracks.concatenate(parts)
        return tracks.select(np.lexsort((tracks.time_s, tracks.track)))


def watched(scenes: Iterable[str | Path]) -> tuple[list[Watched], list[str]]:
    """The cameras of these scenes, and warnings about runs that are left out.

    Raises :class:`InputError` where there is no scene, one is there twice, or all together hold
    fewer than two cameras.
    """
    found: list[Watched] = []
    warnings: list[str] = []
    seen: dict[Path, Path] = {}
    for folder in map(Path, scenes):
        here = folder.resolve()
        if here in seen:
            raise InputError(f"{folder}: the scene is there twice; give each scene once")
        seen[here] = folder
        runs = complete_runs(folder)
        if not runs:
            raise InputError(f"{folder}: holds no scene: no complete run in its folder runs/")
        for camera in dict.fromkeys(run.camera for run in runs):
            taken, left = _taken([run for run in runs if run.camera == camera])
            known = all(run.start_known for run in taken)
            found.append(Watched(camera, folder, camera, tuple(taken), known))
            warnings += [f"{folder}: camera {camera!r}: {one}" for one in left]
    _check_copies(found)
    if len(found) < 2:
        raise InputError(
            f"{', '.join(one.name for one in found)}: one camera is no site; give scenes of two "
            "cameras or more"
        )
    return _named(found), warnings


def site_start_ns(cameras: Sequence[Watched]) -> int | None:
    """The earliest start that is known: zero of the site's clock."""
    known = [run.start_ns for one in cameras if one.start_known for run in one.runs]
    return min(known) if known else None


def _taken(runs: Sequence[Run]) -> tuple[list[Run], list[str]]:
    """Runs that follow each other on one clock, and why others are left out."""
    filled = [run for run in runs if run.rows] or list(runs[:1])
    known = [run for run in filled if run.start_known]
    left = []
    if len(known) < len(filled) and len(filled) > 1:
        chosen = known or [max(filled, key=lambda run: run.rows)]
        out = [run.run for run in filled if run not in chosen]
        left.append(
            f"run {', '.join(map(repr, out))} left out: when it began is not known, so its clock "
            "cannot be joined to that of the other runs; track again with its start"
        )
        filled = chosen
    kept: list[Run] = []
    for run in sorted(filled, key=lambda run: -run.rows):
        rival = next((one for one in kept if _overlap(one, run)), None)
        if rival is None:
            kept.append(run)
        else:
            left.append(f"run {run.run!r} left out: it is of the same time as {rival.run!r}")
    return sorted(kept, key=lambda run: run.moment_ns(run.span_s[0]) if run.span_s else 0), left


def _overlap(one: Run, other: Run) -> bool:
    spans = _spans_ns((one, other))
    return len(spans) == 2 and max(b for b, _ in spans) < min(e for _, e in spans)


def _spans_ns(runs: Sequence[Run]) -> list[tuple[int, int]]:
    """First and last moment of those in which anybody was tracked."""
    spans = [(run, run.span_s) for run in runs]
    return [(run.moment_ns(span[0]), run.moment_ns(span[1])) for run, span in spans if span]


def _check_copies(found: Sequence[Watched]) -> None:
    """Raise for one run under two names: a camera would be aligned with itself."""
    for one, other in combinations(found, 2):
        parts = [{part.sha256 for run in two.runs for part in run.parts} for two in (one, other)]
        if (parts[0] & parts[1]) - {None}:
            raise InputError(
                f"{other.folder}: camera {other.camera!r} holds the same rows as camera "
                f"{one.camera!r} of {one.folder}; give each scene once"
            )


def _named(found: list[Watched]) -> list[Watched]:
    """With names that differ: a camera's own, else with that of its scene's folder."""
    names = [one.camera for one in found]
    called = [
        f"{one.folder.resolve().name}/{one.camera}" if names.count(one.camera) > 1 else one.camera
        for one in found
    ]
    for name in called:
        if called.count(name) > 1:
            raise InputError(
                f"camera {name!r} is there twice; rename one of the scenes' folders, or track it "
                "with another camera name"
            )
    return [replace(one, name=name) for one, name in zip(found, called, strict=True)]


def _pieces(scene: Scene, run: Run) -> Iterator[Tracks]:
    """The thinned rows of a run, read piece by piece; a scene of that run alone."""
    if run.span_s is None:
        return
    begin_s, last_s = run.span_s
    while begin_s <= last_s:
        end_s = begin_s + _PIECE_S
        found = scene.tracks(keypoints=False, begin=begin_s, end=end_s)
        if len(found):
            yield _thinned(found)
        begin_s = end_s


def _thinned(tracks: Tracks) -> Tracks:
    times = np.unique(tracks.time_s)
    if len(times) < 2:
        return tracks
    step = max(1, round(_ROW_S / float(np.median(np.diff(times)))))
    return tracks.select(np.searchsorted(times, tracks.time_s) % step == 0)


def apart(one: Watched, other: Watched, start_ns: int | None, most_s: float) -> str | None:
    """Why two cameras cannot have seen anybody at one time, if so: their clocks are known, and
    further apart than clocks are set wrong.
    """
    spans = one.span_s(start_ns), other.span_s(start_ns)
    if spans[0] is None or spans[1] is None:
        nobody = one if spans[0] is None else other
        return f"nobody was tracked by camera {nobody.name!r}"
    gap_s = gap_between_s(one, other, start_ns)
    if gap_s is None or gap_s <= most_s:
        return None
    times = f"camera {one.name!r} is of {_when(one)} and camera {other.name!r} of {_when(other)}"
    return f"no common moment: {times}"


def gap_between_s(one: Watched, other: Watched, start_ns: int | None) -> float | None:
    """Seconds between the rows of two cameras, negative where they overlap; None where a clock is
    not known or nobody was tracked.
    """
    spans = one.span_s(start_ns), other.span_s(start_ns)
    if spans[0] is None or spans[1] is None or not (one.start_known and other.start_known):
        return None
    return max(spans[0][0], spans[1][0]) - min(spans[0][1], spans[1][1])


def _when(one: Watched) -> str:
    spans = _spans_ns(one.runs)
    begin, end = min(b for b, _ in spans), max(e for _, e in spans)
    first, last = (
        str(np.datetime64(ns, "ns").astype("datetime64[m]")).replace("T", " ")
        for ns in (begin, end)
    )
    return f"{first} to {last[11:] if first[:10] == last[:10] else last} UTC"
