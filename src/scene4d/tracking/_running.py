"""``track``: the stages of a run, one after the other."""

import hashlib
from collections import Counter
from collections.abc import Callable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scene4d.calibration.writing import BACKGROUND
from scene4d.core.calibration import GIVEN, Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.files import read_json, write_bytes
from scene4d.core.progress import Progress, Silent, timed
from scene4d.core.tracks import Tracks
from scene4d.tracking._options import Job, TrackOptions, TrackRun

if TYPE_CHECKING:
    from scene4d.store.log import Look
    from scene4d.store.query import Scene
    from scene4d.store.writing import SceneWriter
    from scene4d.video.frames import Source

_FIGURES = "figures"
_MOST_DRAWN = 40_000
"""Most positions drawn in one figure; more cannot be distinguished."""
_MOMENT_S = 1e-3
"""Rows of one frame lie within this."""
_BRIDGED_S = 2.0
"""Frames at most this far apart leave no gap in what was watched: people are followed across it
(``SmoothingSettings.max_gap_s``)."""
_MANY_WITHOUT = 0.5
"""Share of rows without a position beyond which the camera is probably wrong."""


def track(
    source: str | Path | None,
    camera: str | Path | Calibration | Camera,
    out: str | Path,
    options: TrackOptions | None = None,
    *,
    progress: Progress | None = None,
    **more: Any,
) -> TrackRun:
    """Track people and vehicles in footage of a calibrated camera, and write a scene.

    ``source`` is a video or a stream, or None with annotations; ``camera`` a camera file or a
    camera in memory; ``out`` the folder of the scene, which is added to. Options are those of
    :class:`TrackOptions`, as an object or by name: ``track(video, camera, "scene", rate_hz=5)``.

    A killed run over a video resumes after its last complete chunk of footage, with the same
    result as an uninterrupted run. A stream is tracked until it ends or Ctrl-C is pressed; each
    call is a separate run, and what was seen is in the scene within two seconds. Raises
    :class:`InputError` for bad input (including a camera that moved), :class:`UnavailableError` if
    weights are not available, and :class:`OutputError` if the scene cannot be written.
    """
    options = replace(options or TrackOptions(), **more)
    seen = options.annotations or source
    if seen is None:
        raise InputError("source: there is nothing to track: give footage, or annotations")
    calibration, described, background = calibrated(camera)
    with ExitStack() as opened:
        footage = None if source is None else opened.enter_context(_footage(source, calibration))
        live = options.annotations is None and footage is not None and footage.timeline is None
        now = datetime.now(UTC)
        if live and options.start is None:
            options = replace(options, start=now)
        name = options.name or shown_name(options.annotations if source is None else source)
        run = TrackRun(Path(out), name, run_name(seen, now if live else None))
        job = Job(calibration, described, background, options, run, progress or Silent())
        looks, provenance = _looks(footage, job, live=live)
        with writer_of(job, provenance, live=live) as writer:
            if live:
                write_live(writer, looks, job)
            else:
                _write(writer, looks, job)
        finish(job, footage)
    return run


def calibrated(
    camera: str | Path | Calibration | Camera,
) -> tuple[Calibration, dict[str, Any], Path | None]:
    """The calibration, its stored form, and the path where an image of the view may exist."""
    if isinstance(camera, Camera):
        camera = Calibration.of_camera(camera)
    if isinstance(camera, Calibration):
        if camera.camera is None:
            raise InputError("camera: the calibration is undetermined, expected one with a camera")
        return camera, camera.to_dict(), None
    from scene4d.formats.cameras import read_calibration

    found = read_calibration(camera)
    described = found.to_dict() if found.method == GIVEN else read_json(camera)
    return found, described, Path(camera).with_name(BACKGROUND)


def _footage(source: str | Path, calibration: Calibration) -> "Source":
    from scene4d.video.reader import open_source

    footage = open_source(source)
    if footage.timeline is not None and len(footage.timeline) < 2:
        footage.close()
        raise InputError(f"{footage.name}: is a single picture, and a track needs several")
    check_size(footage, calibration)
    return footage


def check_size(footage: "Source", calibration: Calibration) -> None:
    """Raise :class:`InputError` if the frames have not the calibrated size; closes the footage."""
    if footage.image_size != calibration.image_size:
        footage.close()
        (w, h), (cw, ch) = footage.image_size, calibration.image_size
        raise InputError(
            f"{footage.name}: is {w}x{h}, but the camera was calibrated on {cw}x{ch}: give footage "
            "of that size, or calibrate on this"
        )


def shown_name(seen: str | Path | None) -> str:
    """The footage's name without folders, ending and passwords."""
    from scene4d.video.stream import stream_name, without_password

    text = str(seen)
    return stream_name(text) if "://" in text else Path(without_password(text)).stem


def run_name(seen: str | Path, began: datetime | None) -> str:
    """The footage's name with a hash of its path: the same footage gets the same name. Each run of
    a stream is different, so its name includes the time when it ``began``.
    """
    from scene4d.video.stream import without_password

    text = without_password(str(seen))
    place = text if "://" in text else str(Path(text).resolve())
    name = f"{shown_name(seen)}-{hashlib.sha256(place.encode()).hexdigest()[:6]}"
    return name if began is None else f"{name}-{began:%Y%m%dT%H%M%S.%fZ}"


def _looks(
    footage: "Source | None", job: Job, *, live: bool
) -> tuple[Iterator["Look"], dict[str, Any]]:
    """The looks to track, and their provenance."""
    options = job.options
    if options.annotations is not None:
        from scene4d.tracking.annotated import annotated_looks

        fps = options.fps or (None if footage is None else footage.fps)
        said = {"annotations": str(options.annotations), "fps": fps, "rate_hz": options.rate_hz}
        if footage is not None:
            said["source"] = str(Path(footage.name).resolve())
        return annotated_looks(footage, job), said
    from scene4d.tracking.watching import streamed, watch_settings, watched

    assert footage is not None
    look = streamed if live else watched
    return look(footage, job), watch_settings(footage, job)


def writer_of(job: Job, provenance: dict[str, Any], *, live: bool) -> "SceneWriter":
    """The writer of a run."""
    from scene4d.store.writing import SceneWriter

    return SceneWriter(
        job.run.scene,
        camera=job.run.camera,
        run=job.run.run,
        start_utc=job.options.start,
        camera_json=job.described,
        provenance=provenance,
        live=live,
    )


def _write(writer: "SceneWriter", looks: Iterator["Look"], job: Job) -> None:
    """Track, and write rows that have become final."""
    from scene4d.tracking.following import follow

    for tracks in follow(
        _noted(looks, writer, job),
        job.calibration,
        job.person_height_m,
        trusted=job.options.annotations is not None,
        timings=job.run.timings,
    ):
        _put(writer, tracks, job.run)
    with timed(job.run.timings, "write"):
        writer.close()


def unheard(final: Tracks, provisional: Tracks) -> None:
    """Nobody listens."""


def write_live(
    writer: "SceneWriter",
    looks: Iterator["Look"],
    job: Job,
    published: Callable[[Tracks, Tracks], None] = unheard,
) -> None:
    """Track, and publish after each look what is final and what is provisional; ``published`` is
    told both.
    """
    from scene4d.tracking.following import follow_live

    run = job.run
    for final, provisional in follow_live(
        _noted(looks, writer, job), job.calibration, job.person_height_m, timings=run.timings
    ):
        _put(writer, final, run)
        with timed(run.timings, "write"):
            writer.commit(provisional)
        published(final, provisional)
    with timed(run.timings, "write"):
        writer.close()


def _noted(looks: Iterator["Look"], writer: "SceneWriter", job: Job) -> Iterator["Look"]:
    """The looks; the scene learns when footage was looked at. Annotations tell where somebody is,
    and not that nobody is elsewhere.
    """
    gap_s = max(_BRIDGED_S, 2.5 / job.options.rate_hz)
    for look in looks:
        if job.options.annotations is None:
            writer.watched(look.time_s, look.frame, gap_s)
        yield look


def _put(writer: "SceneWriter", tracks: Tracks, run: TrackRun) -> None:
    if not len(tracks):
        return
    with timed(run.timings, "write"):
        writer.write(tracks)
    run.rows += len(tracks)
    run.without_position += int(np.isnan(tracks.xy_m[:, 0]).sum())
    run.begin_s = float(np.fmin(run.begin_s, tracks.time_s.min()))
    run.end_s = float(np.fmax(run.end_s, tracks.time_s.max()))


def finish(job: Job, footage: "Source | None" = None) -> None:
    """Count and draw the tracks written; those of one moment over its frame of recorded footage."""
    from scene4d.store.query import Scene

    run = job.run
    if not run.rows:
        return
    if run.without_position > _MANY_WITHOUT * run.rows:
        run.warnings.append(
            f"{run.without_position} of {run.rows} rows have no position: the camera does not see "
            "them on the ground; are its height and its tilt right?"
        )
    scene = Scene.open(run.scene).only(run.run)
    run.tracks = dict(Counter(run.tracks) + Counter(scene.track_counts()))
    with timed(run.timings, "draw"), job.progress.stage("Drawing", None):
        run.picture = _drawn(job, scene.paths(run.camera, _MOST_DRAWN))
        if footage is not None and footage.timeline is not None:
            run.objects_picture = _drawn_objects(job, scene, footage)


def _drawn(job: Job, paths: dict[int, tuple[str, np.ndarray]]) -> Path | None:
    """The figure of a run; None if no row has a position."""
    from scene4d.drawing.scene_map import draw_scene_map
    from scene4d.video.background import calibrated_view

    image = calibrated_view(job.background, job.camera.image_size)
    return _kept(job, draw_scene_map(job.camera, paths, image), "")


def _drawn_objects(job: Job, scene: "Scene", footage: "Source") -> Path | None:
    """The moment with the most objects, vehicles counted twice; None if there is none."""
    from scene4d.drawing.objects import draw_objects

    frames = scene.sql(
        "SELECT frame, min(time_s) AS time_s FROM scene WHERE observed AND x_m IS NOT NULL "
        "GROUP BY frame ORDER BY count(*) + count(length_m) DESC, frame LIMIT 1"
    )
    if not frames.num_rows:
        return None
    ((number,), (time_s,)) = (frames[name].to_pylist() for name in ("frame", "time_s"))
    rows = scene.tracks(begin=time_s, end=time_s + _MOMENT_S)
    rows = rows.select(rows.observed & (rows.frame == number))
    frame = next(iter(footage.frames([number])))
    return _kept(job, draw_objects(job.camera, rows, frame.image_bgr), "-objects")


def _kept(job: Job, content: bytes | None, ending: str) -> Path | None:
    """Where a figure was written."""
    from scene4d.store.runs import file_name

    if content is None:
        return None
    path = job.run.scene / _FIGURES / f"{file_name(job.run.run, 'run')}{ending}.png"
    path.parent.mkdir(parents=True, exist_ok=True)
    write_bytes(path, content)
    return path
