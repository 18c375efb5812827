"""``watch``: a camera tracked while it runs; all of it is in the scene within two seconds."""

import threading
import time
from collections.abc import Callable, Iterator, Sequence
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
    unheard,
    write_live,
    writer_of,
)

if TYPE_CHECKING:
    from scene4d.perception.objects import ObjectDetector
    from scene4d.store.log import Look
    from scene4d.tracking._live_view import LiveView
    from scene4d.tracking._pictures import Pictures
    from scene4d.video.live import LiveSource


Teller = Callable[[dict[str, Any]], None]
ALERT_SCORE = 0.3
"""Lowest score of an event that is told: higher than that of a search, whose best events are looked
at first. Chosen by hand: what is told interrupts somebody."""


@dataclass(frozen=True)
class WatchOptions:
    """Options of ``watch``.

    ``give_up_s`` is how long a lost stream is tried again (None: for ever). ``searches`` are words
    as for :func:`.search`, whose events are told soon after they end; ``min_score`` is their lowest
    score, ``catalogues`` and ``zones`` are files as for a search. ``alerts`` are where events are
    sent: ``https://...``, ``mqtt://host/topic`` or ``exec:COMMAND``.
    """

    give_up_s: float | None = None
    searches: Sequence[str] = ()
    min_score: float = ALERT_SCORE
    catalogues: Sequence[str | Path] = ()
    zones: str | Path | None = None
    alerts: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Check the values; raises :class:`InputError`."""
        if self.give_up_s is not None and not self.give_up_s >= 0:
            raise InputError(f"give_up_s: found {self.give_up_s}, expected seconds, or None")
        if self.alerts and not self.searches:
            raise InputError("alerts: nothing is searched for; give words, as searches")


@dataclass
class WatchRun(TrackRun):
    """What was written, and of the frames ``offered`` how many were ``dropped`` because the
    analysis was behind. ``reconnected`` counts how often a lost stream came back; ``not_in_view_s``
    is how long the view was another than the calibrated one. ``events`` counts those that were
    found, ``alerts_sent`` deliveries.
    """

    offered: int = 0
    dropped: int = 0
    reconnected: int = 0
    not_in_view_s: float = 0.0
    events: int = 0
    alerts_sent: int = 0

    def to_dict(self) -> dict[str, Any]:
        """The last line of ``--json``."""
        return super().to_dict() | {
            "frames": self.offered,
            "frames_dropped": self.dropped,
            "reconnected": self.reconnected,
            "not_in_view_s": self.not_in_view_s,
            "events": self.events,
            "alerts_sent": self.alerts_sent,
        }


def watch(
    source: str | Path,
    camera: str | Path | Calibration | Camera,
    out: str | Path,
    options: WatchOptions | None = None,
    tracking: TrackOptions | None = None,
    *,
    stop: threading.Event | None = None,
    tell: Teller = lambda event: None,
    progress: Progress | None = None,
    **more: Any,
) -> WatchRun:
    """Track a running camera, until the stream is given up, ``stop`` is set, or Ctrl-C.

    ``source`` is a stream's address, a capture device such as ``/dev/video0``, or a video, which is
    played at real time. Frames that cannot be analysed in time are dropped. A lost stream is opened
    again. While the view has moved nobody is tracked. Each call is a run of its own; others can
    read the scene meanwhile, and if this process dies they keep what was published, all but the
    last two seconds. ``tell`` gets each event of the searches as soon as it is found, and once more
    when it is final or withdrawn (:class:`.Told`). Options are those of :class:`WatchOptions`, by
    name too; ``tracking`` has those of :func:`.track`. Raises as :func:`.track`.
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
        _watch(live, job, options, stop or threading.Event(), tell)
        finish(job)
    return run


def _watch(
    live: "LiveSource", job: Job, options: WatchOptions, stop: threading.Event, tell: Teller
) -> None:
    from scene4d.searching import SearchOptions
    from scene4d.searching.standing import StandingSearches
    from scene4d.tracking._alerts import Alerts
    from scene4d.tracking._live_events import LiveEvents
    from scene4d.tracking._live_view import LiveView
    from scene4d.tracking._pictures import Pictures
    from scene4d.tracking.watching import detectors, watch_settings

    run = job.run
    assert isinstance(run, WatchRun)
    asked = SearchOptions(options.min_score, catalogues=options.catalogues, zones=options.zones)
    searches = StandingSearches(options.searches, asked, run.camera, job.calibration)
    alerts, pictures = Alerts(options.alerts, run.scene, run.camera), Pictures()
    objects, view = detectors(job), LiveView(live, job)
    live.start()  # what came while networks were loaded is old
    began = job.options.start or live.began
    job = replace(job, options=replace(job.options, start=began))
    with writer_of(job, watch_settings(live, job), live=True) as writer, alerts:
        events = LiveEvents(searches, live, writer, run.scene, alerts, pictures, run.timings, tell)
        looks = _looks(live, job, objects, view, stop, pictures if alerts else None)
        write_live(writer, looks, job, events.published if options.searches else unheard)
    run.events, run.alerts_sent = events.found, alerts.sent
    run.warnings.extend(alerts.warnings)
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
    pictures: "Pictures | None",
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
                        if pictures is not None:
                            pictures.add(frame)
                        if view.is_right(frame):
                            seen.append((frame, *objects.look(frame)))
                        step(1)
            except KeyboardInterrupt:
                live.stop()
            yield look_of(seen, live.image_size)
