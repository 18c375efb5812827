"""Video files through PyAV (FFmpeg)."""

from collections.abc import Iterable, Iterator
from itertools import dropwhile
from pathlib import Path
from typing import Any

import av
import numpy as np

from scene4d.core.errors import InputError
from scene4d.video.decoding import decode, packets, pixel_notes, upright_bgr, video_stream
from scene4d.video.frames import Frame, Source, Timeline
from scene4d.video.timeline import read_packet_table

_SEEK_GAIN_FRAMES = 12
"""A seek costs about as much as decoding this many frames, so a shorter gap is decoded."""
_FRAME_THREADS_FROM = 64
"""Threads that work on several frames at once start anew after each seek; short runs lose."""
_INEXACT_AFTER_SEEK = frozenset({"mpeg"})
"""MPEG-PS stamps only some frames, so that after a seek the times of the others are guesses."""
_SEEK_AHEAD_S = (0.0, 1.0, 5.0, 30.0, 1e6)
_FALLBACK_RATE = 25.0


class VideoSource(Source):
    """A video file. Each call of :meth:`frames` opens it anew, so calls may run side by side.

    The index of a frame is its rank in display order among the frames that the file holds. It is
    exact also at variable frame rates and after seeking, because the packets' times are read
    first (see :mod:`scene4d.video.timeline`). Only where the container has no times (a raw
    elementary stream, or clocks that jump back) the frames are counted as they decode, and
    ``time_s`` follows from the nominal rate. There, and in MPEG-PS, nothing is skipped by seeking.
    """

    timeline: Timeline
    fps: float

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        self._asked: set[int] = set()
        self._failed: set[int] = set()
        with self._open() as container:
            stream = video_stream(container, self.name)
            self._notes = pixel_notes(stream, self.name)
            table = read_packet_table(container, stream, path.stat().st_size)
            if not len(table.is_key):
                raise InputError(f"{self.name}: holds no frames; record or copy it again")
            self._pts = table.pts
            self._can_seek = table.pts is not None and (
                container.format.name not in _INEXACT_AFTER_SEEK
            )
            self._set_clock(stream, table.is_key)
            self._note_missing_end(container, stream, table.packets)
        height, width = self._first_image().shape[:2]
        self.image_size = (width, height)

    def _open(self) -> Any:
        try:
            return av.open(self.name)
        except (av.error.FFmpegError, OSError) as error:
            raise InputError(
                f"{self.name}: is not a video that can be read, or its index is missing because "
                f"the recording was cut off ({getattr(error, 'strerror', None) or error}); "
                "expected MP4, MKV, AVI, MOV, TS or another format that FFmpeg reads"
            ) from error

    def _set_clock(self, stream: Any, is_key: np.ndarray) -> None:
        rate = float(stream.guessed_rate or stream.average_rate or _FALLBACK_RATE)
        if self._pts is None:
            times = np.arange(len(is_key)) / rate
            self._notes.append(
                f"{self.name}: has no usable times; {rate:.6g} frames a second are assumed"
            )
        else:
            times = (self._pts - self._pts[0]) * float(stream.time_base)
        self.timeline = Timeline(times, is_key)
        self.fps = 1 / self.timeline.frame_s if len(times) > 1 else rate

    def _note_missing_end(self, container: Any, stream: Any, found: int) -> None:
        promised = stream.frames
        if not promised and container.duration and len(container.streams) == 1:
            promised = round(container.duration / av.time_base * self.fps)
        if promised - found > max(1, 0.01 * promised):
            self._notes.append(
                f"{self.name}: is cut short or damaged: {found} of {promised} frames are there"
            )

    def _first_image(self) -> np.ndarray:
        with self._open() as container:
            stream = video_stream(container, self.name)
            for packet in self._to_the_end(container, stream):
                for frame in decode(stream, packet):
                    return upright_bgr(frame, self.name)
        raise self._nothing_decodes(len(self.timeline))

    def _nothing_decodes(self, frames: int) -> InputError:
        return InputError(
            f"{self.name}: none of {frames} frames can be decoded; the file is damaged: "
            "copy or record it again"
        )

    @property
    def warnings(self) -> tuple[str, ...]:
        """See :attr:`Source.warnings`."""
        if not self._failed:
            return tuple(self._notes)
        failed = (
            f"{self.name}: {len(self._failed)} of the {len(self._asked)} frames asked for are "
            "damaged and were left out"
        )
        return (*self._notes, failed)

    def frames(self, indices: Iterable[int] | None = None) -> Iterator[Frame]:
        """See :meth:`Source.frames`. Only the wanted frames are converted to BGR."""
        wanted = self._wanted(indices)
        with self._open() as container:
            stream = video_stream(container, self.name)
            runs = list(self._runs(wanted))
            if self._mean_length(runs) < _FRAME_THREADS_FROM:
                stream.thread_type = "SLICE"
            for run in runs:
                self._asked.update(run)
                missing = set(run)
                for frame in self._decode_run(container, stream, run):
                    missing.discard(frame.index)
                    self._failed.discard(frame.index)
                    yield frame
                self._failed |= missing
        if wanted and self._failed.issuperset(wanted):
            raise self._nothing_decodes(len(wanted))

    def _runs(self, wanted: list[int]) -> Iterator[list[int]]:
        """Groups of frames that are decoded in one go; a seek stands between groups."""
        key_before = self.timeline.key_before
        run: list[int] = []
        for i in wanted:
            if run and self._can_seek and key_before[i] - run[-1] > _SEEK_GAIN_FRAMES:
                yield run
                run = []
            run.append(i)
        if run:
            yield run

    def _mean_length(self, runs: list[list[int]]) -> float:
        """Frames from the key frame before a run to its end, on average."""
        key_before = self.timeline.key_before
        return sum(run[-1] - key_before[run[0]] + 1 for run in runs) / max(1, len(runs))

    def _decode_run(self, container: Any, stream: Any, run: list[int]) -> Iterator[Frame]:
        wanted, counted, last = set(run), 0, -1
        for packet in self._packets_for(container, stream, run):
            for frame in decode(stream, packet):
                index = counted if self._pts is None else _rank(self._pts, frame.pts)
                counted += 1
                if index not in wanted or index <= last or frame.is_corrupt:
                    continue
                image = upright_bgr(frame, self.name)
                self._check_size(image, f"frame {index}")
                last = index
                yield Frame(index, float(self.timeline.time_s[index]), image)
                if index == run[-1]:
                    return

    def _packets_for(self, container: Any, stream: Any, run: list[int]) -> Iterator[Any]:
        """Packets from the key frame before the run to its last one, then None (flush).

        Packets that nothing refers to and nobody asked for are not decoded (NONREF).
        """
        if self._pts is None:
            yield from self._to_the_end(container, stream)
            return
        key = int(self.timeline.key_before[run[0]])
        unfed = {int(self._pts[i]) for i in run}
        # The first run of a file that was just opened needs no seek if it begins at the front.
        seek = self._can_seek and key > _SEEK_GAIN_FRAMES
        from_key = self._from_key if seek else self._from_here
        for packet in from_key(container, stream, int(self._pts[key])):
            stream.codec_context.skip_frame = "DEFAULT" if packet.pts in unfed else "NONREF"
            yield packet
            unfed.discard(packet.pts)
            if not unfed:
                break
        yield None

    def _from_key(self, container: Any, stream: Any, key_pts: int) -> Iterator[Any]:
        """Packets from the key frame on; it is sought further ahead where a seek lands behind it.

        MP4, MKV and AVI land on the key frame; MPEG-TS and PS search by guesses.
        """
        for ahead_s in _SEEK_AHEAD_S:
            target = key_pts - round(ahead_s / float(stream.time_base))
            try:
                container.seek(target, stream=stream, backward=True)
            except av.error.FFmpegError:
                continue
            following = packets(container, stream)
            for packet in following:
                if packet.pts == key_pts:
                    yield packet
                    yield from following
                    return
                if packet.dts is not None and packet.dts > key_pts:
                    break
        # The key frame itself is damaged: nothing decodes before the next one.
        yield from dropwhile(lambda packet: not packet.is_keyframe, packets(container, stream))

    @staticmethod
    def _from_here(container: Any, stream: Any, _: int) -> Iterator[Any]:
        yield from packets(container, stream)

    @staticmethod
    def _to_the_end(container: Any, stream: Any) -> Iterator[Any]:
        yield from packets(container, stream)
        yield None


def _rank(pts: np.ndarray, value: int | None) -> int:
    """The display index of a time stamp, -1 where it is none of the file's."""
    if value is None:
        return -1
    i = int(np.searchsorted(pts, value))
    return i if i < len(pts) and pts[i] == value else -1
