"""Footage as it happens: the newest frame, and none that came before it.

A thread reads and decodes; whoever analyses takes the newest frame. Frames that nobody took in time
are dropped and counted, so that the answer never lags behind the camera by more than the analysis
of one frame.
"""

import logging
import threading
import time
from collections.abc import Iterable, Iterator
from datetime import UTC, datetime
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.core.errors import InputError, Scene4DError
from scene4d.video.frames import Frame, Source
from scene4d.video.reader import open_source
from scene4d.video.stream import StreamSource

_LOG = logging.getLogger(__name__)
_FIRST_WAIT_S, _LONGEST_WAIT_S = 1.0, 30.0
"""Waits between attempts to reach a lost stream; each is twice the one before."""
_AHEAD_S, _AHEAD_SHARE = 4.0, 0.001
"""A stream's clock may run ahead of ours by what a server keeps for new viewers, and by a clock's
error. A server that sends a recording faster is slowed down to this."""
_EARLY_S = 1e-6
"""Times carry rounding errors: a frame this much before a slot belongs to it."""
_TELL_EVERY_S = 60.0
_TOLD_SHARE = 0.05
"""A larger share of frames dropped in a minute is worth a warning."""


class LiveSource(Source):
    """A stream, a capture device, or a file that is played at real time.

    ``rate_hz`` is how many frames a second are offered. ``time_s`` counts from the first frame on
    the stream's own clock, and goes on with ours where the connection was lost: it is opened again
    after 1, 2, 4, ... 30 seconds, until ``give_up_s`` have passed (None: for ever). Raises
    :class:`InputError` and :class:`UnavailableError` as :func:`.open_source`.
    """

    def __init__(
        self, source: str | Path, rate_hz: float, *, give_up_s: float | None = None
    ) -> None:
        self._where, self._rate_hz, self._give_up_s = source, rate_hz, give_up_s
        self._source = _opened(source)
        self.name, self.image_size = self._source.name, self._source.image_size
        self.fps, self.timeline = self._source.fps, None
        self.taken_s = 0.0  # time of the frame that was taken last
        self.offered = self.dropped = self.reconnected = 0
        self.is_lost = False  # whether a stream broke off and is not back yet
        self.is_counting = True  # whether frames that nobody takes are missed
        self._notes: list[str] = []
        self._news = threading.Condition()
        self._newest: Frame | None = None
        self._stopping, self._done = threading.Event(), False
        self._error: Exception | None = None
        self._told_s = time.monotonic()
        self._told = 0, 0
        self._last, self._last_at_s = (-1, 0.0), time.monotonic()
        self._began_s, self.began = time.monotonic(), datetime.now(UTC)
        self._thread = threading.Thread(target=self._read, name="frames", daemon=True)
        if self._source.timeline is None:
            self._thread.start()

    def start(self) -> None:
        """Begin to play a file; of a stream, forget what came before. :attr:`began` is then the
        time (UTC) of the first frame.
        """
        with self._news:
            self._newest, self.offered, self.dropped = None, 0, 0
        if self._source.timeline is not None:
            self._began_s, self.began = time.monotonic(), datetime.now(UTC)
            self._thread.start()

    @property
    def ended(self) -> bool:
        """Whether no frame will come any more, and none is waiting."""
        return self._done and self._newest is None

    @property
    def now_s(self) -> float:
        """The time now, on the clock of ``time_s``."""
        return self._last[1] + time.monotonic() - self._last_at_s

    @property
    def warnings(self) -> tuple[str, ...]:
        """See :attr:`Source.warnings`."""
        dropped = () if not self.dropped else (self._dropped_text(self.dropped, self.offered),)
        return (*self._notes, *self._source.warnings, *dropped)

    def take(self, timeout_s: float) -> Frame | None:
        """The newest frame that was not taken before; None if none comes in time, or any more. It
        needs :meth:`start`.

        Raises what reading raised: a stream that came back with frames of another size, say.
        """
        with self._news:
            self._news.wait_for(lambda: self._newest is not None or self._done, timeout_s)
            frame, self._newest = self._newest, None
            self.taken_s = self.taken_s if frame is None else frame.time_s
        if frame is None and self._error is not None:
            error, self._error = self._error, None
            raise error
        return frame

    def frames(self, indices: Iterable[int] | None = None) -> Iterator[Frame]:
        """The newest frames, until the end; ``indices`` cannot be chosen."""
        while not self.ended:
            frame = self.take(_TELL_EVERY_S)
            if frame is not None:
                yield frame

    def stop(self) -> None:
        """Read no further; a frame that is waiting can be taken. May be called from any thread."""
        self._stopping.set()
        with self._news:
            self._done = True
            self._news.notify_all()

    def close(self) -> None:
        """Stop. The thread closes the connection itself: it may be waiting for it."""
        self.stop()
        if self._thread.ident is not None:
            self._thread.join(timeout=1.0)

    def _read(self) -> None:
        try:
            source: Any = self._source
            while source is not None:
                self._source = source
                with source:
                    self._play(source)
                    lives = isinstance(source, StreamSource) and not source.is_recording
                self.is_lost = lives
                source = self._again(source) if lives else None
                self.is_lost = False
        except Exception as error:  # told to whoever takes
            self._error = error
        finally:
            self.stop()

    def _play(self, source: Source) -> None:
        """Offer the frames of one connection, no faster than they happen."""
        index = self._last[0] + 1
        began_s = self._began_s if index == 0 else time.monotonic()
        offset_s = 0.0 if index == 0 else self.now_s
        for frame in _thinned(source, self._rate_hz):
            passed_s = time.monotonic() - began_s
            stream = source.timeline is None
            allowed_s = _AHEAD_S + _AHEAD_SHARE * passed_s if stream else 0.0
            if self._stopping.wait(max(0.0, frame.time_s - passed_s - allowed_s)):
                return
            self._offer(Frame(index + frame.index, offset_s + frame.time_s, frame.image_bgr))

    def _offer(self, frame: Frame) -> None:
        with self._news:
            self.offered += self.is_counting
            self.dropped += self.is_counting and self._newest is not None
            self._newest = frame
            self._last, self._last_at_s = (frame.index, frame.time_s), time.monotonic()
            self._news.notify_all()
        if self._last_at_s - self._told_s >= _TELL_EVERY_S:
            self._tell_dropped()

    def _tell_dropped(self) -> None:
        dropped, offered = self.dropped - self._told[0], self.offered - self._told[1]
        self._told, self._told_s = (self.dropped, self.offered), self._last_at_s
        if dropped > _TOLD_SHARE * offered:
            _LOG.warning("%s", self._dropped_text(dropped, offered, " in the last minute"))

    def _dropped_text(self, dropped: int, offered: int, when: str = "") -> str:
        return (
            f"{self.name}: {dropped} of {offered} frames{when} were dropped because the analysis "
            "was behind; a lower rate keeps up"
        )

    def _again(self, lost: StreamSource) -> Source | None:
        """The same stream, opened once more; None where nothing more will come."""
        wait_s, since_s = _FIRST_WAIT_S, time.monotonic()
        if not self._stopping.is_set():
            _LOG.warning("%s: the stream %s; opening it again", self.name, lost.ending)
        while not self._stopping.wait(wait_s):
            away_s = time.monotonic() - since_s
            try:
                found = _opened(self._where)
            except Scene4DError as error:
                if self._give_up_s is not None and away_s > self._give_up_s:
                    self._notes.append(f"{self.name}: the stream did not come back: {error}")
                    return None
                wait_s = min(2 * wait_s, _LONGEST_WAIT_S)
                continue
            if found.image_size != self.image_size:
                (w, h), (cw, ch) = found.image_size, self.image_size
                raise InputError(f"{self.name}: the stream is {w}x{h} now and was {cw}x{ch} before")
            self.reconnected += 1
            _LOG.warning("%s: the stream is back after %.1f s", self.name, away_s)
            return found
        return None


def _opened(source: str | Path) -> Source:
    path = Path(source)
    if "://" not in str(source) and path.is_char_device():
        return StreamSource(str(path), live=True, form="v4l2")
    if "://" in str(source):
        return open_source(source, live=True)
    found = open_source(source)
    if found.timeline is None or not found.timeline.has_clock or len(found.timeline) < 2:
        raise InputError(
            f"{source}: has no times, and cannot be played at real time; expected a video, a "
            "stream's address, or a capture device such as /dev/video0"
        )
    return found


def _thinned(source: Source, rate_hz: float) -> Iterator[Frame]:
    """The first frame in each 1/rate of a second."""
    if isinstance(source, StreamSource):
        return source.thinned(rate_hz)
    if source.timeline is None:
        return source.frames()
    slot = np.floor(source.timeline.time_s * rate_hz + _EARLY_S)
    return source.frames(np.flatnonzero(np.diff(slot, prepend=-1) > 0).tolist())
