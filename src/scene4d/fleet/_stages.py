"""What a worker does: one task, from the store into the store. The rooms below do the work."""

import errno
import io
import shutil
import tempfile
import time
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import Any, NamedTuple

from scene4d.core.errors import InputError, OutputError, Scene4DError, UnavailableError
from scene4d.core.files import write_bytes, write_json
from scene4d.core.progress import Silent
from scene4d.core.staging import scratch
from scene4d.fleet._store import Store
from scene4d.fleet._tasks import Job, Result
from scene4d.store.runs import Run, complete_runs, file_name

EVENTS = "events.parquet"
_CAMERA = "camera.json"
_FULL = frozenset({errno.ENOSPC, errno.EDQUOT, errno.EFBIG, errno.EROFS})
KILLED, LOST = "killed", "lost"
"""Kinds that executors tell: a job's worker came to its end, or the machine under it."""


class Outcome(NamedTuple):
    """How a task ended: seconds of processor time, seconds of footage that it went through, and
    what kind of failure it was and why, if it failed.
    """

    cpu_s: float = 0.0
    footage_s: float = 0.0
    kind: str | None = None
    reason: str | None = None


Work = Callable[[Job, str], Outcome]
"""A job and the store's address."""


def work(job: Job, address: str) -> Outcome:
    """Do a task: stage the result on this machine, put it into the store, and mark it as done."""
    begun_s, footage_s, kind, reason = time.process_time(), 0.0, None, None
    try:
        store = Store(address)
        with scratch(Path(tempfile.gettempdir()), "scene4d-fleet-") as here:
            out = here / "out"
            out.mkdir()
            footage_s = _STAGES[job.task.stage](job, store, here, out)
            store.put(out, job.result)
        said = said_of(job) | {"path": job.result.path, "footage_s": footage_s}
        store.write(f"done/{job.result.key}", said)
    except Exception as error:  # a defect costs its clip, and no other
        kind, reason = _kind_of(error), " ".join(str(error).split())
        if not isinstance(error, Scene4DError):
            reason = f"{type(error).__name__}: {reason}"
    return Outcome(time.process_time() - begun_s, footage_s, kind, reason)


def said_of(job: Job) -> dict[str, Any]:
    """What the store says of a task, done or not."""
    task = job.task
    return {
        "key": job.result.key,
        "stage": task.stage,
        "camera": task.camera,
        "clip": None if task.clip is None else str(task.clip),
        "words": task.words or None,
        "needs": [need.key for need in job.needs],
    }


def _kind_of(error: Exception) -> str:
    if isinstance(error, Scene4DError):
        return error.kind
    full = isinstance(error, OSError) and error.errno in _FULL
    return OutputError.kind if full else "defect"


def _calibrate(job: Job, store: Store, scratch: Path, out: Path) -> float:
    from scene4d.calibration.calibrating import run
    from scene4d.calibration.writing import write

    task = job.task
    clip = _clip(job)
    options = replace(task.options, annotations=clip) if task.boxes else task.options
    result = run(None if task.boxes else clip, options, Silent(), command="scene4d fleet")
    if not result.calibration:
        raise InputError(f"the camera is undetermined: {result.calibration.reason}")
    write(result, out, progress=Silent())
    return 0.0


def _track(job: Job, store: Store, scratch: Path, out: Path) -> float:
    from scene4d.tracking import track

    task, clip = job.task, _clip(job)
    camera = task.calibration
    if camera is None:
        camera = store.fetched(job.needs[0].path, scratch) / _CAMERA
    options = replace(
        task.options,
        name=task.camera,
        start=task.begins,
        annotations=clip if task.boxes else None,
    )
    run = track(None if task.boxes else clip, camera, out, options)
    shutil.rmtree(out / "detections", ignore_errors=True)  # the log is for runs that go on
    if task.boxes:
        return run.end_s - run.begin_s if run.rows else 0.0
    from scene4d.video.reader import open_source

    with open_source(clip) as footage:
        return footage.duration_s or 0.0


def _align(job: Job, store: Store, scratch: Path, out: Path) -> float:
    from scene4d.alignment import align
    from scene4d.store.joining import join

    cameras: dict[str, list[Path]] = {}
    seen: set[str] = set()
    for need in job.needs:
        folder, runs = _scene(need, store, scratch)
        cameras.setdefault(need.camera, []).append(folder)
        if any(run.rows for run in runs):
            seen.add(need.camera)
    scenes = [
        join(folders, out / "scenes" / file_name(camera, "camera"))
        for camera, folders in cameras.items()
        if camera in seen
    ]
    found = align(scenes, out / "site", job.task.options)
    if not found:
        raise InputError(f"the site is undetermined: {found.reason}")
    return 0.0


def _search(job: Job, store: Store, scratch: Path, out: Path) -> float:
    from arro3.io import write_parquet

    from scene4d.searching import search, words_of

    options = job.task.options
    scenes = [_scene(need, store, scratch) for need in job.needs]
    runs = [run for _, of_one in scenes for run in of_one]
    said = {"words": job.task.words, "runs": len(runs), "events": 0}
    activity = words_of(job.task.words, options, None)[0].activity
    # Where nobody of the kind was ever tracked, nothing is found; alone it would be an error.
    if any(run.rows and activity.playable_by(run.classes) for run in runs):
        found = search([folder for folder, _ in scenes], job.task.words, options)
        table = io.BytesIO()
        write_parquet(found.to_arrow(), table)
        write_bytes(out / EVENTS, table.getvalue())
        said["events"] = len(found)
    write_json(out / "search.json", said)
    return 0.0


def _scene(need: Result, store: Store, scratch: Path) -> tuple[Path, tuple[Run, ...]]:
    """A tracked clip on this machine; raises :class:`InputError` where its result is no scene."""
    folder = store.fetched(need.path, scratch)
    runs = complete_runs(folder)
    if not runs:
        raise InputError(
            f"{store.address}/{need.path}: is no scene, or was spoilt; remove it and "
            f"{store.address}/done/{need.key}.json to have its clip tracked again"
        )
    return folder, runs


def _clip(job: Job) -> Path:
    """The clip, which must be on this machine under the same name as on that of the plan."""
    clip = job.task.clip
    assert clip is not None
    if not clip.is_file():
        raise UnavailableError(
            f"{clip}: is not on this machine; mount footage at the same path on every machine"
        )
    return clip


_STAGES: dict[str, Callable[[Job, Store, Path, Path], float]] = {
    "calibrate": _calibrate,
    "track": _track,
    "align": _align,
    "search": _search,
}
"""Each takes the task, the store, and two folders on this machine, the second for its result;
returns how many seconds of footage it went through.
"""
