"""Several cameras watched by one process: the networks are in memory once."""

import threading
from collections.abc import Sequence
from dataclasses import replace
from pathlib import Path
from typing import Any

from scene4d.core.calibration import Calibration
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.tracking._options import TrackOptions
from scene4d.tracking.live import Teller, WatchOptions, WatchRun, watch

_WAKE_S = 0.5
"""Signals are handled between waits of this length."""


def watch_several(
    sources: Sequence[str | Path],
    cameras: Sequence[str | Path | Calibration | Camera],
    out: str | Path,
    options: WatchOptions | None = None,
    tracking: TrackOptions | None = None,
    *,
    names: Sequence[str] = (),
    stop: threading.Event | None = None,
    tell: Teller = lambda event: None,
    **more: Any,
) -> list[WatchRun]:
    """As :func:`.watch`, of several cameras at once, into one scene: a source, a camera and perhaps
    a name each. ``tell`` is called from one thread at a time. When one fails all end, and its error
    is raised; a stream that does not come back ends alone.
    """
    if len(cameras) != len(sources) or len(names) not in (0, len(sources)):
        raise InputError(
            f"found {len(sources)} sources, {len(cameras)} cameras and {len(names)} names; "
            "expected a camera for each source, and a name for each or none"
        )
    options, tracking = replace(options or WatchOptions(), **more), tracking or TrackOptions()
    stop, one_at_a_time = stop or threading.Event(), threading.Lock()
    runs: list[WatchRun | None] = [None] * len(sources)
    errors: list[BaseException] = []

    def told(event: dict[str, Any]) -> None:
        with one_at_a_time:
            tell(event)

    def work(number: int) -> None:
        own = replace(tracking, name=names[number]) if names else tracking
        try:
            runs[number] = watch(
                sources[number], cameras[number], out, options, own, stop=stop, tell=told
            )
        except BaseException as error:  # raised below, in the thread that asked
            errors.append(error)
            stop.set()

    threads = [threading.Thread(target=work, args=(number,)) for number in range(len(sources))]
    for thread in threads:
        thread.start()
    while any(thread.is_alive() for thread in threads):
        try:
            for thread in threads:
                thread.join(_WAKE_S)
        except KeyboardInterrupt:
            stop.set()
    if errors:
        raise errors[0]
    return [run for run in runs if run is not None]
