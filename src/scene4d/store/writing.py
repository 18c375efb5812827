"""Writing a scene: tracks in, Parquet files out, and a run is there as a whole or not at all.

Parts are made out of sight in ``runs/.RUN/``, moved to their places when the run is complete, and
count from the moment its manifest stands. What a rerun replaces is removed after that. So a run
killed at any moment leaves the scene as it was, or as it was to become. While a rerun is moved into
place, readers that do not know of manifests can see rows twice.
"""

import io
import json
import os
import re
import shutil
from collections import Counter
from collections.abc import Iterator
from contextlib import AbstractContextManager, contextmanager
from dataclasses import dataclass, replace
from datetime import UTC, datetime, timedelta
from importlib.metadata import version
from pathlib import Path
from typing import Any

import numpy as np
from arro3.io import write_parquet

from scene4d.core.errors import InputError, OutputError
from scene4d.core.files import read_json, write_bytes, write_json
from scene4d.core.tracks import Tracks
from scene4d.store.claims import Claim, claims, locked
from scene4d.store.runs import (
    Part,
    Run,
    camera_path,
    complete_runs,
    file_name,
    manifest_path,
    rows_folder,
)
from scene4d.store.schema import (
    COLUMNS,
    KEYPOINT_COLUMNS,
    RUN_TRACKS,
    SCENE_SCHEMA,
    check_tracks,
    time_ns,
    to_table,
)

_ROWS_PER_PART = 131_072
"""Rows that are held in memory before they become a file: about 70 MB with keypoints."""
_ROWS_PER_GROUP = 32_768
_EPOCH = datetime(1970, 1, 1, tzinfo=UTC)
_YEARS = (1900, 2200)  # what nanoseconds in 64 bits can hold, with room for the footage


class SceneWriter:
    """Writes the tracks of one run into a scene, which other processes may write to at once.

    ``folder`` is the scene, made where missing; ``run`` names what is written, so that the same
    run again replaces it. ``start_utc`` is the moment of the clip's start; None where unknown,
    and then time counts from 1970-01-01. ``camera_json`` is the camera's calibration, the same
    for all runs of a camera. ``provenance`` (source, settings, hashes of weights) goes into the
    manifest. Use it in a ``with`` block: leaving it closes the run, an exception abandons it.

    Raises :class:`InputError` for names that cannot be used, a start without time zone, another
    calibration under the same camera's name, and a run that another process is writing;
    :class:`OutputError` where the folder cannot be written to.
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
        rows_per_part: int = _ROWS_PER_PART,
    ) -> None:
        self._folder = Path(folder)
        self._run = Run(
            run=run,
            camera=camera,
            start_ns=_start_ns(start_utc),
            start_known=start_utc is not None,
            track_base=0,
            keypoints=0,
            rows=0,
            classes={},
            parts=(),
            software=f"scene4d {version('scene4d')}",
            provenance=_as_json(provenance, "provenance"),
        )
        self._file_name = file_name(run, "run")
        self._staging = self._folder / "runs" / f".{self._file_name}"
        self._rows_per_part = rows_per_part
        self._buffer: list[Tracks] = []
        self._buffered = 0
        self._staged: list[_Staged] = []
        self._classes: Counter[str] = Counter()
        self._claim: Claim | None = None
        calibration = _as_json(camera_json, "camera_json")
        camera_path(self._folder, camera)  # refuses names before anything is made
        with _writing(self._folder):
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
        """What is added to this run's track numbers, so that they are the scene's own."""
        return self._run.track_base

    def write(self, tracks: Tracks) -> None:
        """Take rows, in any order and any number of times; memory stays bounded.

        Raises :class:`InputError` for classes, times and track numbers that a scene cannot hold
        and for another skeleton than before; :class:`OutputError` where a file cannot be written.
        """
        self._check_open()
        check_tracks(tracks)
        if not len(tracks):
            return
        k = tracks.keypoint_uv.shape[1]
        if k and self._run.keypoints not in (0, k):
            raise InputError(
                f"tracks: have {k} keypoints, those written before {self._run.keypoints}; "
                "one run has one skeleton"
            )
        self._run = replace(self._run, keypoints=max(k, self._run.keypoints))
        # Cut in the order of arrival, so that the files do not depend on how rows are handed over.
        begin = 0
        while begin < len(tracks):
            end = min(len(tracks), begin + self._rows_per_part - self._buffered)
            piece = tracks if end - begin == len(tracks) else tracks.select(np.arange(begin, end))
            self._buffer.append(_as_stored(piece))
            self._buffered += end - begin
            begin = end
            if self._buffered == self._rows_per_part:
                self._flush()

    def close(self) -> None:
        """Make the run a part of the scene; twice does no harm.

        Raises :class:`OutputError` where a file cannot be written; the scene is as it was then.
        """
        if self._claim is None:
            return
        try:
            self._flush()
            with _writing(self._folder):
                self._complete()
        except Exception:
            self.abandon()
            raise
        self._release(self._claim, done=True)

    def abandon(self) -> None:
        """Leave the scene as it was."""
        if self._claim is not None:
            shutil.rmtree(self._staging, ignore_errors=True)
            self._release(self._claim, done=False)

    def _begin(self, calibration: dict[str, Any]) -> Claim:
        """Take the run, its track numbers and its camera; the scene is locked meanwhile."""
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
            in_use = {run.camera for run in runs} | {c.camera for c in others if c.alive}
            self._put_camera(calibration, in_use=self._run.camera in in_use)
            base = claim.track_base if own is None else own.track_base
            if base is None:
                taken = [run.track_base for run in runs] + [c.track_base for c in others]
                base = max(taken, default=-RUN_TRACKS) + RUN_TRACKS
            self._run = replace(self._run, track_base=base)
            claim.write(self._run.run, self._run.camera, base)
            self._sweep()
            self._staging.mkdir()
        except BaseException:
            claim.release()
            raise
        return claim

    def _put_camera(self, calibration: dict[str, Any], *, in_use: bool) -> None:
        path = camera_path(self._folder, self._run.camera)
        if not (in_use and path.exists()):
            path.parent.mkdir(exist_ok=True)
            write_json(path, calibration)
            return
        before = read_json(path)
        other = sorted(k for k in {*before, *calibration} if before.get(k) != calibration.get(k))
        if other:
            raise InputError(
                f"{path}: camera {self._run.camera!r} has another calibration there "
                f"({', '.join(other)}); give this one another name, or write to another folder"
            )

    def _complete(self) -> None:
        old = [number for number, _ in self._own_parts()]
        # Beside the parts that are to be replaced, never over them.
        first = 0 if min(old, default=len(self._staged)) >= len(self._staged) else max(old) + 1
        parts = [self._place(part, first + i) for i, part in enumerate(self._staged)]
        for folder in {(self._folder / part.path).parent for part in parts}:
            _settle(folder)
        self._run = replace(
            self._run,
            rows=sum(part.rows for part in parts),
            classes=dict(sorted(self._classes.items())),
            parts=tuple(parts),
        )
        write_json(manifest_path(self._folder, self._run.run), self._run.to_dict())
        self._sweep()

    def _flush(self) -> None:
        if not self._buffered:
            return
        tracks = Tracks.concatenate([with_keypoints(t, self._run.keypoints) for t in self._buffer])
        self._buffer, self._buffered = [], 0
        tracks = tracks.select(np.lexsort((tracks.track, tracks.time_s)))
        times = time_ns(tracks.time_s, self._run.start_ns).astype("datetime64[ns]")
        days, begins = np.unique(times.astype("datetime64[D]"), return_index=True)
        for day, rows in zip(days, np.split(np.arange(len(tracks)), begins[1:]), strict=True):
            self._stage(tracks if len(days) == 1 else tracks.select(rows), str(day))
        names, counts = np.unique(tracks.class_name, return_counts=True)
        self._classes.update(dict(zip(names.tolist(), counts.tolist(), strict=True)))

    def _stage(self, tracks: Tracks, day: str) -> None:
        content = self._parquet(tracks)
        path = self._staging / f"{len(self._staged):05d}"
        write_bytes(path, content)
        self._staged.append(
            _Staged(
                path,
                day,
                rows=len(tracks),
                bytes=len(content),
                begin_s=float(tracks.time_s[0]),
                end_s=float(tracks.time_s[-1]),
            )
        )

    def _parquet(self, tracks: Tracks) -> bytes:
        table = to_table(
            tracks,
            camera=self._run.camera,
            start_ns=self._run.start_ns,
            track_base=self._run.track_base,
        )
        buffer = io.BytesIO()
        write_parquet(
            table,
            buffer,
            compression="zstd(1)",
            max_row_group_size=_ROWS_PER_GROUP,
            key_value_metadata={"scene4d.schema": SCENE_SCHEMA},
            **_floats_in_planes(),
        )
        return buffer.getvalue()

    def _place(self, staged: "_Staged", number: int) -> Part:
        folder = rows_folder(self._folder, self._run.camera) / f"day={staged.day}"
        folder.mkdir(parents=True, exist_ok=True)
        target = folder / f"{self._file_name}-{number:05d}.parquet"
        staged.path.replace(target)
        return Part(
            path=target.relative_to(self._folder).as_posix(),
            rows=staged.rows,
            bytes=staged.bytes,
            begin_s=staged.begin_s,
            end_s=staged.end_s,
        )

    def _own_parts(self) -> list[tuple[int, Path]]:
        """The parts in place that bear this run's name, with their numbers."""
        ours = re.compile(re.escape(self._file_name) + r"-(\d{5,})\.parquet")
        paths = self._folder.glob(f"tracks/camera=*/day=*/{self._file_name}-*.parquet")
        matches = ((ours.fullmatch(path.name), path) for path in paths)
        return [(int(match[1]), path) for match, path in matches if match]

    def _sweep(self) -> None:
        """Remove what this run left unfinished, and what its manifest no longer names."""
        manifest = manifest_path(self._folder, self._run.run)
        named = {part.path for part in Run.load(manifest).parts} if manifest.exists() else set()
        for _, path in self._own_parts():
            if path.relative_to(self._folder).as_posix() not in named:
                path.unlink()
        half_written = re.compile(re.escape(f".{manifest.name[:100]}.") + "[0-9a-f]{12}")
        for path in manifest.parent.iterdir():
            if half_written.fullmatch(path.name):
                path.unlink()
        shutil.rmtree(self._staging, ignore_errors=True)

    def _check_open(self) -> None:
        if self._claim is None:
            raise InputError(f"{self._folder}: run {self._run.run!r} is closed already")

    def _scene_locked(self) -> AbstractContextManager[None]:
        return locked(self._staging.with_name(".lock"))

    def _release(self, claim: Claim, *, done: bool) -> None:
        self._claim = None
        try:
            with self._scene_locked():
                if done:
                    claim.path.unlink(missing_ok=True)
        finally:
            claim.release()


@dataclass(frozen=True)
class _Staged:
    """A part that is written, and not in its place yet."""

    path: Path
    day: str
    rows: int
    bytes: int
    begin_s: float
    end_s: float


def _floats_in_planes() -> dict[str, Any]:
    """Options of the Parquet writer: bytes of equal weight together, which zstd packs better."""
    names: list[Any] = [c.name for c in COLUMNS if c.type == "float64"]
    names += [(name, "list", "element") for name in KEYPOINT_COLUMNS]
    return {
        "column_encoding": dict.fromkeys(names, "byte_stream_split"),
        "column_dictionary_enabled": dict.fromkeys(names, False),
    }


def _as_stored(tracks: Tracks) -> Tracks:
    """Keypoints in the precision of the files: half the memory, and half the copying."""
    uv, score = tracks.keypoint_uv.astype(np.float32), tracks.keypoint_score.astype(np.float32)
    return replace(tracks, keypoint_uv=uv, keypoint_score=score)


def with_keypoints(tracks: Tracks, k: int) -> Tracks:
    """Rows without a skeleton as rows of one with ``k`` keypoints that are not seen."""
    n = len(tracks)
    if tracks.keypoint_uv.shape[1] == k:
        return tracks
    uv, score = np.full((n, k, 2), np.nan, np.float32), np.zeros((n, k), np.float32)
    return replace(tracks, keypoint_uv=uv, keypoint_score=score)


def _start_ns(start_utc: datetime | None) -> int:
    if start_utc is None:
        return 0
    if start_utc.tzinfo is None:
        raise InputError(f"start_utc: {start_utc.isoformat()} has no time zone, expected UTC")
    first, last = _YEARS
    if not first <= start_utc.year < last:
        raise InputError(f"start_utc: year {start_utc.year}, expected {first} to {last - 1}")
    return (start_utc - _EPOCH) // timedelta(microseconds=1) * 1000


def _as_json(values: dict[str, Any], what: str) -> dict[str, Any]:
    """As it will be read again; told now, and not when hours of work are to be closed."""
    try:
        return json.loads(json.dumps(values, allow_nan=False))
    except (TypeError, ValueError) as error:
        raise InputError(f"{what}: cannot be written as JSON: {error}") from error


def _settle(folder: Path) -> None:
    """Names in a folder reach the disk before the manifest that relies on them."""
    descriptor = os.open(folder, os.O_RDONLY)
    try:
        os.fsync(descriptor)
    finally:
        os.close(descriptor)


@contextmanager
def _writing(folder: Path) -> Iterator[None]:
    try:
        yield
    except OSError as error:
        raise OutputError(f"{folder}: cannot be written to: {error}") from error
