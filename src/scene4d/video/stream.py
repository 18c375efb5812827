"""Network streams: frames as they arrive, without a known end."""

import re
from collections.abc import Iterable, Iterator
from itertools import chain
from typing import Any

import av

from scene4d.core.errors import InputError, UnavailableError
from scene4d.video._decoding import decode, packets, pixel_notes, upright_bgr, video_stream
from scene4d.video.frames import Frame, Source

_STREAM_TIMEOUT_S = 15.0
"""A camera that sends nothing for this long is considered lost; players wait 5 to 30 s."""
_FALLBACK_RATE = 25.0
_EARLY_S = 1e-6
"""Times carry rounding errors: a frame this much before a slot belongs to it."""
_AUDIO_S = 0.5
"""The pictures of a recording may end so much before or after its stated length, which is that of
its sound."""


def stream_name(url: str) -> str:
    """A short name of the address for file names: host, path and query without secrets."""
    return re.sub(r"[^\w.]+", "-", without_password(url).split("://", 1)[-1]).strip("-.")


def without_password(url: str) -> str:
    """The address without secrets, for messages and reports."""
    address = re.sub(r"//[^\s/?#]*@", "//", url)  # up to the last @: passwords may contain one
    secret = r"(?i)\b(pass(?:word|wd)?|pwd|token|auth|key)=[^&\s/]*"
    return re.sub(secret, r"\1=***", address)


class StreamSource(Source):
    """A live stream. Frames are numbered from the first one received; each can be read only once.

    ``time_s`` is the stream's own clock from that frame on. ``live`` decodes each frame as soon as
    it is there, with fewer cores; ``form`` is FFmpeg's name of the format, for a capture device.
    Raises :class:`UnavailableError` if the stream cannot be reached.
    """

    def __init__(self, url: str, *, live: bool = False, form: str | None = None) -> None:
        self.name = without_password(url)
        self.timeline = None
        self._end: str | None = None  # how it ended, if unexpectedly
        self._played_s = 0.0
        # UDP loses packets of large frames, and damaged frames look like moving objects.
        options = {"rtsp_transport": "tcp"} if url.startswith("rtsp") else {}
        try:
            self._container = av.open(
                url,
                format=form,
                options=options,
                metadata_errors="replace",
                timeout=_STREAM_TIMEOUT_S,
            )
        except (av.error.FFmpegError, OSError) as error:
            raise UnavailableError(
                f"{self.name}: the stream cannot be opened "
                f"({getattr(error, 'strerror', None) or 'no answer'}); check its address, user and "
                "password with a player, or record a clip and give the file"
            ) from error
        self._stated_s = (self._container.duration or 0) / av.time_base
        self._has_size = self._container.size > 0
        stream = video_stream(self._container, self.name)
        if live:  # several frames at once are several frames late
            stream.thread_type = "SLICE"
        self._notes = pixel_notes(stream, self.name)
        rate = stream.guessed_rate or stream.average_rate
        self.fps = float(rate) if rate else None
        self._decoded = self._decode(stream)
        self._ahead = next(self._decoded, None)
        if self._ahead is None:
            self.close()
            raise InputError(f"{self.name}: the stream is open but no frame of it can be decoded")
        height, width = upright_bgr(self._ahead[2], self.name).shape[:2]
        self.image_size = (width, height)

    def _decode(self, stream: Any) -> Iterator[tuple[int, float, Any]]:
        """(index, time, decoded frame); a clock that jumps back is continued."""
        index, time_s, last_pts = 0, 0.0, None
        step = 1 / (self.fps or _FALLBACK_RATE)
        for packet in chain(self._packets(stream), [None]):
            for frame in decode(stream, packet)[0]:
                if index:
                    known = frame.pts is not None and last_pts is not None
                    ticks = frame.pts - last_pts if known else 0
                    time_s += ticks * float(stream.time_base) if ticks > 0 else step
                last_pts, self._played_s = frame.pts, time_s
                yield index, time_s, frame
                index += 1
        if self._end is None and not self.is_recording:
            self._end = "ended"
        if self._end is not None:
            self._end += f" after {time_s:.1f} s"

    def _packets(self, stream: Any) -> Iterator[Any]:
        """All packets; records at the end whether the stream was lost."""
        try:
            yield from packets(self._container, stream)
        except av.error.FFmpegError as error:
            if not self._ends_as_stated:
                self._end = f"was lost ({error.strerror})"

    @property
    def warnings(self) -> tuple[str, ...]:
        """See :attr:`Source.warnings`; a stream that ended or was lost is one of them."""
        ended = () if self._end is None else (f"{self.name}: the stream {self._end}",)
        return (*self._notes, *ended)

    @property
    def ending(self) -> str:
        """How the stream ended, as in "ended after 3.2 s"."""
        return self._end or "ended"

    @property
    def is_recording(self) -> bool:
        """Whether it is a recording behind an address. Some running cameras state a length too: a
        recording has a size as well, or ends when it says.
        """
        return self._ends_as_stated or (self._stated_s > 0 and self._has_size)

    @property
    def _ends_as_stated(self) -> bool:
        return self._stated_s > 0 and abs(self._played_s - self._stated_s) <= _AUDIO_S

    def thinned(self, rate_hz: float) -> Iterator[Frame]:
        """The first frame in each 1/rate of a second; the others are decoded only."""
        slot = -1
        for index, time_s, decoded in chain(filter(None, [self._ahead]), self._decoded):
            self._ahead = None
            now = int(time_s * rate_hz + _EARLY_S)
            if now > slot:
                slot = now
                yield self._frame(index, time_s, decoded)

    def _frame(self, index: int, time_s: float, decoded: Any) -> Frame:
        image = upright_bgr(decoded, self.name)
        self._check_size(image, f"frame {index}")
        return Frame(index, time_s, image)

    def frames(self, indices: Iterable[int] | None = None) -> Iterator[Frame]:
        """See :meth:`Source.frames`; past indices are not available again."""
        wanted = None if indices is None else sorted({int(i) for i in indices})
        while wanted is None or wanted:
            item = self._ahead or next(self._decoded, None)
            self._ahead = None
            if item is None:
                if wanted and self._end is None:
                    self._end = "ended before all frames that were asked for came"
                return
            index, time_s, decoded = item
            while wanted and wanted[0] < index:
                wanted.pop(0)
            if wanted is None or (wanted and wanted[0] == index):
                yield self._frame(index, time_s, decoded)
                if wanted:
                    wanted.pop(0)

    def close(self) -> None:
        """Close the connection."""
        self._container.close()
