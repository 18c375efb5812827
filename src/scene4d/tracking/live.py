"""``watch``: a camera tracked while it runs; all of it is in the scene within two seconds."""

import threading
from collections.abc import Callable, Iterator, Sequence
from dataclasses import dataclass, field, replace
from datetime import UTC, datetime
from pathlib import Path
from typing import TYPE_CHECKING, Any

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.progress import Advance, Progress, Silent
from scene4d.core.staging import ensure_folder
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
    from scene4d.tracking._alerts import Alerts
    from scene4d.tracking._pulse import Pulse
    from scene4d.tracking._view import View
    from scene4d.video.frames import Frame
    from scene4d.video.live import LiveSource


Teller = Callable[[dict[str, Any]], None]
ALERT_SCORE = 0.3
"""Lowest score of an event that is told: higher than that of a search, whose best events are looked
at first. Chosen by hand: what is told interrupts somebody."""
_SECOND_S = 1.0
"""As often is what was seen published, also where nothing came."""


@dataclass(frozen=True)
class WatchOptions:
    """Options of ``watch``.

    ``give_up_s`` is how long a lost stream is tried again (None: for ever). With ``recalibrate`` a
    camera whose view has moved is calibrated again on its new view. ``searches`` are words
    as for :func:`.search`, whose events are told soon after they end; ``min_score`` is their lowest
    score, ``catalogues`` and ``zones`` are files as for a search. ``alerts`` are where events are
    sent: ``https://...``, ``mqtt://host/topic`` or ``exec:COMMAND``.
    """

    give_up_s: float | None = None
    recalibrate: bool = False
    searches: Sequence[str] = ()
    min_score: float = ALERT_SCORE
    catalogues: Sequence[str | Path] = ()
    zones: str | Path | None = None
    alerts: Sequence[str] = ()

    def __post_init__(self) -> None:
        """Check the values; raises :class:`InputError`."""
        if self.give_up_s is not None and not self.give_up_s >= 0:
            raise InputError(f"give_up_s: found {self.give_up_s}, expected seconds, or None")


@dataclass
class WatchRun(TrackRun):
    """What was written, and of the frames ``offered`` how many were ``dropped`` because the
    analysis was behind. ``reconnected`` counts how often a lost stream came back; ``not_in_view_s``
    is how long the view was another than the calibrated one. ``events`` counts those that were
    found, ``alerts_sent`` deliveries. ``cameras`` are the names that the camera had, one after the
    other: where it was calibrated again it is another, and ``camera`` and ``run`` are the last.
    """

    offered: int = 0
    dropped: int = 0
    reconnected: int = 0
    not_in_view_s: float = 0.0
    events: int = 0
    alerts_sent: int = 0
    cameras: list[str] = field(default_factory=list)

    def to_dict(self) -> dict[str, Any]:
        """The last line of ``--json``."""
        return super().to_dict() | {
            "frames": self.offered,
            "frames_dropped": self.dropped,
            "reconnected": self.reconnected,
            "not_in_view_s": self.not_in_view_s,
            "events": self.events,
            "alerts_sent": self.alerts_sent,
            "cameras": self.cameras,
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
    from scene4d.tracking._alerts import Alerts
    from scene4d.tracking._pulse import Pulse
    from scene4d.tracking._recalibrating import Known, calibrated_again
    from scene4d.video.live import LiveSource

    options = replace(options or WatchOptions(), **more)
    tracking = tracking or TrackOptions()
    if tracking.annotations is not None:
        raise InputError("annotations: cannot be watched; expected footage")
    calibration, described, background = calibrated(camera)
    live = LiveSource(source, tracking.rate_hz, give_up_s=options.give_up_s)
    check_size(live, calibration)
    ensure_folder(out)  # whoever serves the scene finds it while networks are loaded
    name = tracking.name or shown_name(source)
    run = WatchRun(Path(out), name, "")
    job = Job(calibration, described, background, tracking, run, progress or Silent())
    stop = stop or threading.Event()
    with live, Alerts(options.alerts, run.scene, name) as alerts, Pulse(live, run.scene) as pulse:
        watching = _Watching(live, options, stop, alerts, pulse, tell)
        while watching.until_it_moves(job):
            left_s = live.taken_s
            again = calibrated_again(live, job, Known(name, camera), stop, pulse)
            run.not_in_view_s += live.taken_s - left_s
            if again is None:
                break
            job = again
        run.offered, run.dropped, run.reconnected = live.offered, live.dropped, live.reconnected
    run.alerts_sent = alerts.sent
    run.warnings.extend([*alerts.warnings, *live.warnings])
    return run


class _Watching:
    """A running camera, what is asked of it, and who is told."""

    def __init__(
        self,
        live: "LiveSource",
        options: WatchOptions,
        stop: threading.Event,
        alerts: "Alerts",
        pulse: "Pulse",
        tell: Teller,
    ) -> None:
        from scene4d.tracking._pictures import Pictures

        self._live, self._options, self._stop = live, options, stop
        self._alerts, self._tell, self._pictures = alerts, tell, Pictures()
        self._pulse = pulse
        self._searches = list(options.searches)

    def until_it_moves(self, job: Job) -> bool:
        """One run; true if it ended because the view is another that stands still, and the camera
        is to be calibrated again.
        """
        from scene4d.searching import SearchOptions
        from scene4d.searching.standing import StandingSearches
        from scene4d.tracking._live_events import LiveEvents
        from scene4d.tracking._view import View
        from scene4d.tracking.watching import detectors, watch_settings, watched_live

        live, run, options = self._live, job.run, self._options
        assert isinstance(run, WatchRun)
        asked = SearchOptions(options.min_score, catalogues=options.catalogues, zones=options.zones)
        searches = StandingSearches(self._searches, asked, run.camera, job.calibration, run.scene)
        objects, view = detectors(job), View(live, job, live=True)
        if not run.cameras:
            live.start()  # what came while networks were loaded is old
        run.cameras.append(run.camera)
        run.run = run_name(live.name, datetime.now(UTC))
        began = job.options.start or live.began
        job = replace(job, options=replace(job.options, start=began))
        with writer_of(job, watch_settings(live, job), live=True) as writer:
            self._pulse.begin(run.camera, run.run)
            events = LiveEvents(
                searches, live, writer, run.scene, self._alerts, self._pictures, run.timings,
                self._tell,
            )  # fmt: skip
            with job.progress.stage("Watching people and vehicles", None) as step:
                looks = watched_live(self._frames(view, step), job, objects, view)
                write_live(writer, looks, job, events.published)
            events.close()
        run.events += events.found
        run.not_in_view_s += view.away_s
        finish(job)
        self._leave_out(searches.placed)
        return options.recalibrate and view.is_settled and not live.ended

    def _frames(self, view: "View", step: Advance) -> Iterator["Frame | None"]:
        """The newest frames, and None after each second in which none came."""
        live = self._live
        while not live.ended and not (self._options.recalibrate and view.is_settled):
            if self._stop.is_set():
                live.stop()
            self._pulse.beat()
            frame = live.take(_SECOND_S)
            if frame is not None and self._alerts:
                self._pictures.add(frame)
            yield frame
            if frame is not None:
                self._pulse.show(frame, away=view.is_away)
            step(frame is not None)

    def _leave_out(self, placed: Sequence[str]) -> None:
        """Zones and lines lie in the metres of the first view."""
        if placed and self._options.recalibrate:
            self._searches = [words for words in self._searches if words not in placed]
