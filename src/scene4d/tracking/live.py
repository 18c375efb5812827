"""``watch``: a camera tracked while it runs; all of it is in the scene within two seconds."""

import threading
import time
from collections.abc import Iterator
from dataclasses import dataclass, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.progress import Progress, Silent
from scene4d.tracking._options import Job, TrackOptions, TrackRun
from scene4d.tracking._running import (
    calibrated,
    check_size,
    finish,
    run_name,
    shown_name,
    write_live,
    writer_of,
)

if TYPE_CHECKING:
    from scene4d.perception.objects import ObjectDetector
    from scene4d.store.log import Look
    from scene4d.tracking._live_view import LiveView
    from scene4d.video.live import LiveSource


@dataclass(frozen=True)
class WatchOptions:
    """Options of ``watch``.

    ``give_up_s`` is how long a lost stream is tried again (None: for ever).
    """

    give_up_s: float | None = None

    def __post_init__(self) -> None:
        """Check the values; raises :class:`InputError`."""
        if self.give_up_s is not None and not self.give_up_s >= 0:
            raise InputError(f"give_up_s: found {self.give_up_s}, expected seconds, or None")


@dataclass
class WatchRun(TrackRun):
    """What was written, and of the frames ``offered`` how many were ``dropped`` because the
    analysis was behind. ``reconnected`` counts how often a lost stream came back; ``not_in_view_s``
    is how long the view was another than the calibrated one.
    """

    offered: int = 0
    dropped: int = 0
    reconnected: int = 0
    not_in_view_s: float = 0.0

    def to_dict(self) -> dict[str, Any]:
        """The last line of ``--json``."""
        return super().to_dict() | {
            "frames": self.offered,
            "frames_dropped": self.dropped,
            "reconnected": self.reconnected,
            "not_in_view_s": self.not_in_view_s,
        }


def watch(
    source: str | Path,
    camera: str | Path | Calibration | Camera,
    out: str | Path,
    options: WatchOptions | None = None,
    tracking: TrackOptions | None = None,
    *,
    stop: threading.Event | None = None,
    progress: Progress | None = None,
    **more: Any,
) -> WatchRun:
    """Track a running camera, until the stream is given up, ``stop`` is set, or Ctrl-C.

    ``source`` is a stream's address, a capture device such as ``/dev/video0``, or a video, which is
    played at real time. Frames that cannot be analysed in time are dropped. A lost stream is opened
    again. While the view has moved nobody is tracked. Each call is a run of its own; others can
    read the scene meanwhile, and if this process dies they keep what was published, all but the
    last two seconds. Options are those of :class:`WatchOptions`, by name too; ``tracking`` has
    those of :func:`.track`. Raises as :func:`.track`.
    """
    from scene4d.video.live import LiveSource

    options = replace(options or WatchOptions(), **more)
    tracking = tracking or TrackOptions()
    if tracking.annotations is not None:
        raise InputError("annotations: cannot be watched; expected footage")
    calibration, described, background = calibrated(camera)
    live = LiveSource(source, tracking.rate_hz, give_up_s=options.give_up_s)
    check_size(live, calibration)
    with live:
        name = tracking.name or shown_name(source)
        run = WatchRun(Path(out), name, run_name(source, datetime.now(UTC)))
        job = Job(calibration, described, background, tracking, run, progress or Silent())
        _watch(live, job, stop or threading.Event())
        finish(job)
    return run


def _watch(live: "LiveSource", job: Job, stop: threading.Event) -> None:
    from scene4d.tracking._live_view import LiveView
    from scene4d.tracking.watching import detectors, watch_settings

    run = job.run
    assert isinstance(run, WatchRun)
    objects, view = detectors(job), LiveView(live, job)
    live.start()  # what came while networks were loaded is old
    began = job.options.start or live.began
    job = replace(job, options=replace(job.options, start=began))
    with writer_of(job, watch_settings(live, job), live=True) as writer:
        write_live(writer, _looks(live, job, objects, view, stop), job)
    run.offered, run.dropped, run.reconnected = live.offered, live.dropped, live.reconnected
    run.not_in_view_s = view.away_s
    run.timings |= objects.timings
    run.warnings.extend(live.warnings)


def _looks(
    live: "LiveSource",
    job: Job,
    objects: "ObjectDetector",
    view: "LiveView",
    stop: threading.Event,
) -> Iterator["Look"]:
    """What was seen in each second, also where nothing came. Ctrl-C ends it as ``stop`` does."""
    from scene4d.tracking.watching import LIVE_CHUNK_S, Moment, look_of

    with job.progress.stage("Watching people and vehicles", None) as step:
        while not live.ended:
            seen: list[Moment] = []
            until_s = time.monotonic() + LIVE_CHUNK_S
            try:
                while (left_s := until_s - time.monotonic()) > 0 and not live.ended:
                    if stop.is_set():
                        live.stop()
                    frame = live.take(left_s)
                    if frame is not None:
                        if view.is_right(frame):
                            seen.append((frame, *objects.look(frame)))
                        step(1)
            except KeyboardInterrupt:
                live.stop()
            yield look_of(seen, live.image_size)
