"""Writing a scene: tracks in, Parquet files out.

Parts are written to the hidden folder ``runs/.RUN/``, moved into place when the run is committed,
and count once the manifest names them; the files they replace are removed after that. A run killed
at any moment therefore leaves the scene as it was at the last commit. Recorded footage is committed
once, at its end; a stream every second, with its provisional rows, which the next commit replaces.
Until a stream's part is full its name is hidden (``.RUN-00007.parquet``), and a part that was
replaced stays for half a minute, for those who have opened the scene. What a killed writer left is
removed by the next one of any run. Readers that ignore manifests
can see rows twice during a commit.
"""

import hashlib
import os
import shutil
import time
from collections import Counter
from dataclasses import dataclass, replace
from datetime import datetime
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from filelock import FileLock
from jaxtyping import Float, Int

from scene4d.core.errors import InputError
from scene4d.core.files import read_json, write_bytes, write_json
from scene4d.core.tracks import Tracks
from scene4d.store._claims import Claim, claims
from scene4d.store._manifest import as_json, classes, settle, start_ns, writing
from scene4d.store._remains import (
    buried,
    parts_of,
    remove_half_written,
    staging_folder,
    unnamed_parts,
)
from scene4d.store.runs import (
    Part,
    Run,
    Watched,
    camera_identity,
    camera_path,
    complete_runs,
    file_name,
    manifest_path,
    rows_folder,
)
from scene4d.store.schema import (
    RUN_TRACKS,
    as_stored,
    check_tracks,
    time_ns,
    to_parquet,
    with_keypoints,
)

_ROWS_PER_PART = 131_072
"""Rows held in memory before they are written to a file: about 70 MB with keypoints."""
_LIVE_ROWS_PER_PART = 16_384
"""The same of a stream, whose last part is written again whenever rows become final, every ten
seconds: 0.1 s of work and 7 MB."""
_KEPT_S = 30.0
"""A stream's replaced parts are removed this much later: a search opens a scene, and reads it."""


class SceneWriter:
    """Writes the tracks of one run into a scene; other processes may write to it concurrently.

    ``folder`` is the scene, created if missing; ``run`` is the run's name: writing a run of the
    same name replaces it. ``start_utc`` is the time of the clip's start; None if unknown, and then
    time counts from 1970-01-01. ``camera_json`` is the camera's calibration, the same for all runs
    of a camera. ``provenance`` (source, settings, hashes of weights) goes into the manifest. A run
    that is ``live`` is read by others while it is written. Use it in a ``with`` block: leaving the
    block closes the run, an exception abandons it.

    Raises :class:`InputError` for unusable names, a start without a time zone, another calibration
    under the same camera name, or a run that another process is writing; :class:`OutputError` if
    the folder is not writable.
    """

    def __init__(
        self,
        folder: str | os.PathLike[str],
        *,
        camera: str,
        run: str,
        start_utc: datetime | None,
        camera_json: dict[str, Any],
        provenance: dict[str, Any],
        live: bool = False,
    ) -> None:
        self._folder = Path(folder)
        self._run = Run(
            run=run,
            camera=camera,
            start_ns=start_ns(start_utc),
            start_known=start_utc is not None,
            track_base=0,
            keypoints=0,
            rows=0,
            classes={},
            parts=(),
            software=f"scene4d {version('scene4d')}",
            provenance=as_json(provenance, "provenance"),
        )
        self._file_name = file_name(run, "run")
        self._staging = staging_folder(self._folder, run)
        self._rows_per_part = _LIVE_ROWS_PER_PART if live else _ROWS_PER_PART
        self._live = live
        self._buffer: list[Tracks] = []
        self._buffered = 0
        self._staged: list[_Staged] = []  # full parts not yet in place
        self._placed: list[Part] = []  # full parts in place
        self._classes: Counter[str] = Counter()  # of both
        self._tail: tuple[int, list[Part]] = (0, [])  # rows written when these parts were placed
        self._written = 0
        self._replaced: dict[Path, float] = {}  # parts of no manifest, and since when
        self._next_part = 0
        self._watched: list[Watched] = []
        self._dirty = True  # the manifest does not yet cover what was written
        self._committed = False
        self._claim: Claim | None = None
        calibration = as_json(camera_json, "camera_json")
        camera_path(self._folder, camera)  # rejects bad names before anything is created
        with writing(self._folder):
            self._staging.parent.mkdir(parents=True, exist_ok=True)
            with self._scene_locked():
                self._claim = self._begin(calibration)

    def __enter__(self) -> "SceneWriter":
        return self

    def __exit__(self, error: type[BaseException] | None, *_: object) -> None:
        if error is None:
            self.close()
        else:
            self.abandon()

    @property
    def track_base(self) -> int:
        """Offset of this run's track numbers that makes them unique in the scene."""
        return self._run.track_base

    @property
    def run(self) -> Run:
        """The manifest as of the last commit."""
        return self._run

    def write(self, tracks: Tracks) -> None:
        """Add rows, in any order and any number of times; memory stays bounded.

        Raises :class:`InputError` for classes, times and track numbers that a scene cannot hold,
        or if the skeleton changes; :class:`OutputError` if a file cannot be written.
        """
        if self._claim is None:
            raise InputError(f"{self._folder}: run {self._run.run!r} is closed already")
        check_tracks(tracks)
        if not len(tracks):
            return
        self._check_skeleton(tracks)
        self._dirty = True
        self._written += len(tracks)
        # Split in the order of arrival, so that the files do not depend on how calls are batched.
        begin = 0
        while begin < len(tracks):
            end = min(len(tracks), begin + self._rows_per_part - self._buffered)
            piece = tracks if end - begin == len(tracks) else tracks.select(np.arange(begin, end))
            self._buffer.append(as_stored(piece))
            self._buffered += end - begin
            begin = end
            if self._buffered == self._rows_per_part:
                self._flush()

    def watched(
        self, time_s: Float[np.ndarray, "n"], frame: Int[np.ndarray, "n"], gap_s: float
    ) -> None:
        """These moments were looked at, whoever was there; farther apart than ``gap_s`` nothing
        was. They come in order of time.
        """
        for second, number in zip(time_s.tolist(), frame.tolist(), strict=True):
            last = self._watched[-1] if self._watched else None
            if last is not None and second - last[1] <= gap_s:
                self._watched[-1] = (last[0], max(last[1], second), last[2], number)
            else:
                self._watched.append((second, second, number, number))
            self._dirty = True

    def _check_skeleton(self, tracks: Tracks) -> None:
        k = tracks.keypoint_uv.shape[1]
        if k and self._run.keypoints not in (0, k):
            raise InputError(
                f"tracks: have {k} keypoints, those written before {self._run.keypoints}; "
                "one run has one skeleton"
            )
        self._run = replace(self._run, keypoints=max(k, self._run.keypoints))

    def commit(self, provisional: Tracks | None = None) -> None:
        """Add everything written so far to the scene; the run stays open.

        ``provisional`` rows are in the scene until the next commit. The last part of a run is
        rewritten with its new rows until it is full. Raises :class:`OutputError` if a file cannot
        be written; the scene is then unchanged.
        """
        if not self._dirty and provisional is None:
            return
        extra = [] if provisional is None or not len(provisional) else [provisional]
        for tracks in extra:
            check_tracks(tracks)
            self._check_skeleton(tracks)
        extra = [as_stored(tracks) for tracks in extra]
        hidden = self._live and provisional is not None
        with writing(self._folder):
            last = self._tail_parts(hidden=hidden)
            last += map(self._place, self._stage_all(extra, hidden=hidden))
            before, parts = self._run.parts, (*self._placed, *last)
            for folder in {(self._folder / part.path).parent for part in {*parts} - {*before}}:
                settle(folder)
            total = self._classes + classes([*self._buffer, *extra])
            self._run = replace(
                self._run,
                rows=sum(part.rows for part in parts),
                classes=dict(sorted(total.items())),
                parts=parts,
                watched=tuple(self._watched) or None,
            )
            write_json(manifest_path(self._folder, self._run.run), self._run.to_dict())
            self._committed, self._dirty = True, provisional is not None
            if hidden:
                self._remove_replaced(before)
            else:
                self._sweep()

    def _tail_parts(self, *, hidden: bool) -> list[Part]:
        """The parts of rows that fill none; hidden ones stay until rows are added."""
        written, tail = self._tail
        if not (hidden and tail and written == self._written):
            staged = self._stage_all(self._buffer, hidden=hidden)
            self._placed += [self._place(part) for part in self._staged]
            self._staged = []
            tail = [self._place(part) for part in staged]
        self._tail = self._written, tail
        return list(tail)

    def _remove_replaced(self, before: tuple[Part, ...]) -> None:
        """Remove the parts that the manifest has not named for a while."""
        now = time.monotonic()
        for part in {*before} - {*self._run.parts}:
            self._replaced.setdefault(self._folder / part.path, now)
        for path in [path for path, since in self._replaced.items() if now - since > _KEPT_S]:
            path.unlink(missing_ok=True)
            del self._replaced[path]

    def close(self) -> None:
        """Commit, and release the run; may be called twice.

        Raises :class:`OutputError` if a file cannot be written; the scene is then unchanged.
        """
        if self._claim is None:
            return
        try:
            self.commit()
        except Exception:
            self.abandon()
            raise
        self.abandon()

    def abandon(self) -> None:
        """Release the run, and leave the scene as it was at the last commit."""
        claim, self._claim = self._claim, None
        if claim is None:
            return
        shutil.rmtree(self._staging, ignore_errors=True)
        try:
            with self._scene_locked():
                claim.release(done=self._committed)
        finally:
            claim.release(done=False)

    def _begin(self, calibration: dict[str, Any]) -> Claim:
        """Claim the run, its track numbers and its camera; the caller holds the scene's lock."""
        runs = complete_runs(self._folder)
        own = next((run for run in runs if run.run == self._run.run), None)
        if own is not None and own.camera != self._run.camera:
            raise InputError(
                f"{self._folder}: run {own.run!r} is of camera {own.camera!r}, not of "
                f"{self._run.camera!r}: give it that name again, or choose another folder"
            )
        claim = Claim.take(self._staging.with_name(f".{self._file_name}.claim"), self._run.run)
        try:
            others = claims(self._staging.parent, but=self._run.run)
            in_use = {run.camera for run in runs} | {c.camera for c, alive in others if alive}
            self._put_camera(calibration, in_use=self._run.camera in in_use)
            before = own or claim.before
            taken = [run.track_base for run in runs] + [c.track_base for c, _ in others]
            base = max(taken, default=-RUN_TRACKS) + RUN_TRACKS
            self._run = replace(self._run, track_base=before.track_base if before else base)
            claim.write(self._run.run, self._run.camera, self._run.track_base)
            self._sweep()
            dead = [path for c, alive in others if not alive for path in buried(self._folder, c)]
            self._replaced = dict.fromkeys(dead, time.monotonic())
            shutil.rmtree(self._staging, ignore_errors=True)
            self._staging.mkdir()
            # New numbers: the parts to be replaced are never overwritten.
            own_parts = parts_of(self._folder, self._run.run)
            self._next_part = max((number for number, _ in own_parts), default=-1) + 1
        except BaseException:
            claim.release(done=False)
            raise
        return claim

    def _put_camera(self, calibration: dict[str, Any], *, in_use: bool) -> None:
        path = camera_path(self._folder, self._run.camera)
        if not (in_use and path.exists()):
            path.parent.mkdir(exist_ok=True)
            write_json(path, calibration)
            return
        before = read_json(path)
        if not isinstance(before, dict):
            raise InputError(f"{path}: is not a JSON object")
        there, here = camera_identity(before), camera_identity(calibration)
        other = sorted(k for k in {*there, *here} if there.get(k) != here.get(k))
        if other:
            raise InputError(
                f"{path}: camera {self._run.camera!r} has another calibration there "
                f"({', '.join(other)}); give this one another name, or write to another folder"
            )

    def _flush(self) -> None:
        """Turn the buffer into full parts."""
        self._staged += self._stage_all(self._buffer)
        self._classes += classes(self._buffer)
        self._buffer, self._buffered = [], 0

    def _stage_all(self, buffer: list[Tracks], *, hidden: bool = False) -> list["_Staged"]:
        """One part for each day."""
        if not buffer:
            return []
        tracks = Tracks.concatenate([with_keypoints(t, self._run.keypoints) for t in buffer])
        tracks = tracks.select(np.lexsort((tracks.track, tracks.time_s)))
        times = time_ns(tracks.time_s, self._run.start_ns).astype("datetime64[ns]")
        days, begins = np.unique(times.astype("datetime64[D]"), return_index=True)
        pieces = np.split(np.arange(len(tracks)), begins[1:])
        return [
            self._stage(tracks if len(days) == 1 else tracks.select(rows), str(day), hidden=hidden)
            for day, rows in zip(days, pieces, strict=True)
        ]

    def _stage(self, tracks: Tracks, day: str, *, hidden: bool) -> "_Staged":
        content = to_parquet(
            tracks,
            camera=self._run.camera,
            start_ns=self._run.start_ns,
            track_base=self._run.track_base,
        )
        number, self._next_part = self._next_part, self._next_part + 1
        target = rows_folder(self._folder, self._run.camera) / f"day={day}"
        target /= f"{'.' * hidden}{self._file_name}-{number:05d}.parquet"
        staged = self._staging / target.name
        write_bytes(staged, content)
        part = Part(
            path=target.relative_to(self._folder).as_posix(),
            rows=len(tracks),
            bytes=len(content),
            begin_s=float(tracks.time_s[0]),
            end_s=float(tracks.time_s[-1]),
            sha256=hashlib.sha256(content).hexdigest(),
        )
        return _Staged(staged, part)

    def _place(self, staged: "_Staged") -> Part:
        target = self._folder / staged.part.path
        target.parent.mkdir(parents=True, exist_ok=True)
        staged.file.replace(target)
        return staged.part

    def _sweep(self) -> None:
        """Remove this run's unfinished files, those its manifest no longer names, and what others
        who were killed have left.
        """
        for path in {*unnamed_parts(self._folder, self._run.run), *self._replaced}:
            path.unlink(missing_ok=True)
        self._replaced = {}
        remove_half_written(self._folder, self._run.run)

    def _scene_locked(self) -> FileLock:
        """The scene's lock, held for a few milliseconds at a time."""
        return FileLock(self._staging.with_name(".lock"))


@dataclass(frozen=True)
class _Staged:
    """A part that is written to ``file`` and not yet in place."""

    file: Path
    part: Part
