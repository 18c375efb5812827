"""``track_scene``: the stages of a scene, one after the other."""

from collections.abc import Iterable, Iterator
from contextlib import ExitStack
from dataclasses import replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scene4d.core.calibration import GIVEN, Calibration
from scene4d.core.errors import InputError
from scene4d.core.files import read_json
from scene4d.core.progress import Progress, timed
from scene4d.core.tracks import Tracks
from scene4d.tracking.counting import TrackCount
from scene4d.tracking.detecting import log_settings, watched
from scene4d.tracking.naming import run_name, shown_name
from scene4d.tracking.options import TrackOptions, TrackRun
from scene4d.tracking.sketch import Sketch

if TYPE_CHECKING:
    from scene4d.store.writing import SceneWriter
    from scene4d.tracking.following import Look
    from scene4d.video.frames import Source

_FIGURES = "figures"
_GHOST_SIGHTINGS = 3
"""What a detector sees less often is mostly nobody; annotated people are believed at once."""


def track_scene(
    source: str | Path | None, scene: str | Path, options: TrackOptions, progress: Progress
) -> TrackRun:
    """Follow people and vehicles through footage of a calibrated camera, and write the scene.

    ``source`` is a video or a stream, None with annotations. A run over a video that was killed
    goes on after its last complete chunk of footage, and its result is that of a run that was not.
    A stream is watched until it ends or Ctrl-C is pressed; each time is a run of its own. Raises
    :class:`InputError` for bad input (a camera that moved is one), :class:`UnavailableError` where
    weights cannot be had, and :class:`OutputError` where the scene cannot be written.
    """
    from scene4d.formats.cameras import read_calibration

    calibration = read_calibration(options.camera)
    made_here = calibration.method != GIVEN
    described = read_json(options.camera) if made_here else calibration.to_dict()
    seen = options.annotations if source is None else source
    if seen is None:
        raise InputError("nothing to track: give a SOURCE, or --annotations FILE")
    with ExitStack() as opened:
        footage = None if source is None else opened.enter_context(_footage(source, calibration))
        if footage is not None and footage.timeline is None and options.start is None:
            options = replace(options, start=datetime.now(UTC))
        run = TrackRun(
            Path(scene),
            options.name or shown_name(seen),
            run_name(options.annotations or seen, options.start),
        )
        if options.annotations is not None:
            looks, provenance = _annotated(footage, calibration, options, run)
            with _writer(run, described, options, provenance) as writer:
                _write(writer, looks, calibration, options, run, progress)
        else:
            assert footage is not None
            settings = log_settings(footage, described, options)
            with _writer(run, described, options, settings) as writer:
                looks = watched(footage, settings, calibration, options, run, progress)
                _write(writer, looks, calibration, options, run, progress)
    return run


def _footage(source: str | Path, calibration: Calibration) -> "Source":
    from scene4d.video.reader import open_source

    footage = open_source(source)
    if footage.timeline is not None and len(footage.timeline) < 2:
        footage.close()
        raise InputError(f"{footage.name}: is a single picture, and a track needs several")
    if footage.image_size != calibration.image_size:
        footage.close()
        (w, h), (cw, ch) = footage.image_size, calibration.image_size
        raise InputError(
            f"{footage.name}: is {w}x{h}, but the camera was calibrated on {cw}x{ch}: give footage "
            "of that size, or calibrate on this"
        )
    return footage


def _annotated(
    footage: "Source | None", calibration: Calibration, options: TrackOptions, run: TrackRun
) -> tuple[Iterator["Look"], dict[str, Any]]:
    from scene4d.tracking.looking import looks_of_annotations

    path = Path(str(options.annotations))
    fps = options.fps or (None if footage is None else footage.fps)
    frames = None if footage is None else footage.frame_count
    looks = looks_of_annotations(path, calibration.image_size, fps, options, run, frames)
    return looks, {"annotations": str(path), "fps": fps, "rate_hz": options.rate_hz}


def _writer(
    run: TrackRun, described: dict[str, Any], options: TrackOptions, provenance: dict[str, Any]
) -> "SceneWriter":
    from scene4d.store.writing import SceneWriter

    return SceneWriter(
        run.scene,
        camera=run.camera,
        run=run.run,
        start_utc=options.start,
        camera_json=described,
        provenance=provenance,
    )


def _write(
    writer: "SceneWriter",
    looks: Iterable["Look"],
    calibration: Calibration,
    options: TrackOptions,
    run: TrackRun,
    progress: Progress,
) -> None:
    from scene4d.tracking.following import Follower

    few = 1 if options.annotations is not None else _GHOST_SIGHTINGS
    follower = Follower(calibration, options.height_m(calibration), run, min_sightings=few)
    count, sketch = TrackCount(), Sketch()
    with progress.stage("Placing and following", None):
        for look in looks:
            for tracks in follower.follow(look):
                _put(writer, tracks, count, sketch, run)
        _put(writer, follower.finish(), count, sketch, run)
        with timed(run.timings, "write"):
            writer.close()
    run.tracks = count.by_class()
    assert calibration.camera is not None
    with timed(run.timings, "draw"), progress.stage("Drawing", None):
        picture = run.scene / _FIGURES / f"{run.run}.png"
        if sketch.draw(picture, calibration.camera, Path(options.camera)):
            run.picture = picture


def _put(
    writer: "SceneWriter", tracks: Tracks, count: TrackCount, sketch: Sketch, run: TrackRun
) -> None:
    if not len(tracks):
        return
    with timed(run.timings, "write"):
        writer.write(tracks)
    count.add(tracks)
    sketch.add(tracks)
    run.rows += len(tracks)
    run.begin_s = float(np.fmin(run.begin_s, tracks.time_s.min()))
    run.end_s = float(np.fmax(run.end_s, tracks.time_s.max()))
