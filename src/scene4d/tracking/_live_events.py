"""Events while a camera is watched: searched for, kept in the scene, told and sent."""

import json
from collections.abc import Callable
from dataclasses import replace
from pathlib import Path
from typing import TYPE_CHECKING, Any

import numpy as np

from scene4d.core.errors import OutputError
from scene4d.core.progress import timed
from scene4d.core.tracks import Tracks
from scene4d.searching.standing import PROVISIONAL, WINDOW_S, StandingSearches
from scene4d.store.runs import file_name
from scene4d.store.schema import with_keypoints
from scene4d.tracking._alerts import Alerts
from scene4d.tracking._pictures import Pictures
from scene4d.tracking._smoothing import SmoothingSettings

if TYPE_CHECKING:
    from scene4d.store.writing import SceneWriter
    from scene4d.video.live import LiveSource

Teller = Callable[[dict[str, Any]], None]
_MORE_S = 5.0
"""At the end time goes on by this: longer than what an event waits for."""
_SHARE = 0.25
"""Searching takes at most about this share of the time: then it is done less often."""


class LiveEvents:
    """Takes what was published, and tells the events in it: to ``tell``, to a file of the scene
    (``events/RUN.jsonl``), and the first time to ``alerts``, with a picture.
    """

    def __init__(
        self,
        searches: StandingSearches,
        live: "LiveSource",
        writer: "SceneWriter",
        scene: Path,
        alerts: Alerts,
        pictures: Pictures,
        timings: dict[str, float],
        tell: Teller,
    ) -> None:
        self._searches, self._live, self._writer = searches, live, writer
        self._alerts, self._pictures, self._tell = alerts, pictures, tell
        self._path = scene / "events" / f"{file_name(writer.run.run, 'run')}.jsonl"
        self._timings = timings
        self._recent: list[Tracks] = []
        self._final_s, self._next_s = -np.inf, -np.inf
        self.found = 0

    def published(self, final: Tracks, provisional: Tracks) -> None:
        """Search what is new. Raises :class:`OutputError` if the scene cannot be written."""
        now_s = self._live.taken_s
        if len(final):
            self._recent.append(final)
        self._recent = [one for one in self._recent if one.time_s.max() > now_s - WINDOW_S]
        released_s = now_s - 2 * SmoothingSettings.lag_s
        newest = float(final.time_s.max()) if len(final) else -np.inf
        self._final_s = max(self._final_s, released_s, newest)
        if now_s >= self._next_s:
            before_s = self._timings.get("search", 0.0)
            self._search([*self._recent, provisional], now_s, self._final_s)
            self._next_s = now_s + (self._timings.get("search", 0.0) - before_s) / _SHARE

    def close(self) -> None:
        """Search for the last time: nothing more will come, so what has ended has ended."""
        end_s = self._live.taken_s + _MORE_S
        if self._recent:
            self._search(self._recent, end_s, end_s)

    def _search(self, parts: list[Tracks], now_s: float, final_s: float) -> None:
        if not self._searches.stand():
            return
        with timed(self._timings, "search"):
            tracks = self._window(parts)
            news = self._searches.look(tracks, self._writer.run, now_s, final_s)
        for told in news:
            said = told.to_dict() | {"latency_s": self._live.now_s - told.found.event.end_s}
            self._keep(said)
            if told.state == PROVISIONAL:
                self.found += 1
                if self._alerts:
                    event = told.found.event
                    picture = self._pictures.of(event.end_s, tracks, event.roles)
                    self._alerts.put(said | {"thumbnail_jpeg": picture})
            self._tell(said)

    def _window(self, parts: list[Tracks]) -> Tracks:
        """Ordered by (track, time), numbered as in the scene."""
        run = self._writer.run
        tracks = Tracks.concatenate([with_keypoints(one, run.keypoints) for one in parts])
        tracks = tracks.select(np.lexsort((tracks.time_s, tracks.track)))
        return replace(tracks, track=tracks.track + run.track_base)

    def _keep(self, said: dict[str, Any]) -> None:
        try:
            self._path.parent.mkdir(exist_ok=True)
            with self._path.open("a", encoding="utf-8") as file:
                file.write(json.dumps(said, allow_nan=False) + "\n")
        except OSError as error:
            raise OutputError(f"{self._path}: cannot be written: {error.strerror}") from error
