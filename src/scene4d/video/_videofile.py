"""Video files through PyAV (FFmpeg)."""

import io
from collections.abc import Iterable, Iterator
from contextlib import suppress
from itertools import dropwhile
from pathlib import Path
from typing import Any

import av
import numpy as np

from scene4d.core.errors import InputError
from scene4d.video._decoding import decode, packets, pixel_notes, upright_bgr, video_stream
from scene4d.video._timeline import read_packet_table
from scene4d.video.frames import FRAGMENTS, Frame, Source, Timeline

_SEEK_GAIN_FRAMES = 12
"""A seek costs about as much as decoding this many frames, so shorter gaps are decoded."""
_FRAME_THREADS_FROM = 64
"""Frame-level threads restart after each seek, so they pay off only for runs of this length."""
_INEXACT_AFTER_SEEK = frozenset({"mpeg"})
"""MPEG-PS stamps only some frames, so after a seek the times of the others are guesses."""
_SEEK_AHEAD_S = (0.0, 1.0, 5.0, 30.0, 1e6)
"""How far before a key frame to seek, tried in turn, if a seek lands after it."""
_FALLBACK_RATE = 25.0
"""Frames per second of a file without times and rate: PAL, as in most old recorders."""
_SKIPS_WELL = frozenset({"h264", "hevc", "mpeg2video", "mpeg4"})
"""Decoders that skip only unreferenced packets on request (libdav1d loses requested frames);
tests/video/test_video_files.py shows it for each."""
_EVEN_SHARE = 0.8
"""A recording has a constant rate if this share of its steps is even; chosen by hand."""
_MISSING_SHARE = 0.01
"""Smallest share of missing frames that is reported: recorders drop single ones."""


class VideoSource(Source):
    """A video file. Each call of :meth:`frames` opens it again, so calls may run concurrently.

    The index of a frame is its rank in display order among the frames in the file. It is exact
    even at variable frame rates and after seeking, because the packets' times are read first (see
    :mod:`scene4d.video._timeline`). Only if the container has no times (a raw elementary stream, or
    clocks that jump back) are frames counted as they decode, with ``time_s`` from the nominal rate.
    Such files and MPEG-PS are read without seeking.
    """

    timeline: Timeline
    fps: float

    def __init__(self, path: Path) -> None:
        self.name = str(path)
        self._asked: set[int] = set()
        self._failed: set[int] = set()
        self._damaged: set[int] = set()  # key frames after which a packet did not decode
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
            self._note_missing(container, stream, table.packets)
        height, width = self._first_image().shape[:2]
        self.image_size = (width, height)

    def _open(self) -> Any:
        try:
            return av.open(self.name, metadata_errors="replace")  # titles in any encoding
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

    def _note_missing(self, container: Any, stream: Any, found: int) -> None:
        """Note frames that are missing at the end, or inside a recording of constant rate."""
        promised = stream.frames or self._expected_frames(container, found)
        if promised - found > max(1, _MISSING_SHARE * promised):
            self._notes.append(
                f"{self.name}: is cut short or damaged: {found} of {promised} frames are there"
            )

    def _expected_frames(self, container: Any, found: int) -> int:
        """Expected number of frames in a container that does not state it."""
        step_s = _constant_step_s(self.timeline.time_s)
        if container.duration and len(container.streams) == 1:
            return round(container.duration / av.time_base / (step_s or 1 / self.fps))
        if step_s is None:
            return found
        return found + int(np.rint(np.diff(self.timeline.time_s) / step_s - 1).sum())

    def _first_image(self) -> np.ndarray:
        with self._open() as container:
            stream = video_stream(container, self.name)
            for packet in _to_the_end(container, stream):
                for frame in decode(stream, packet)[0]:
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
        notes = list(self._notes)
        if self._failed:
            notes.append(
                f"{self.name}: {len(self._failed)} of the {len(self._asked)} frames asked for are "
                "damaged and were left out"
            )
        damaged = self._damaged | {int(self.timeline.key_before[i]) for i in self._failed}
        if damaged:
            keys = int(self.timeline.is_key.sum())
            notes.append(
                f"{self.name}: is damaged behind {len(damaged)} of its {keys} key frames; "
                "frames there may show remains of others"
            )
        return tuple(notes)

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

    def copied(self, first: int, end: int) -> tuple[bytes, float] | None:
        """See :meth:`Source.copied`: H.264 whose times are known."""
        if self._pts is None or not self._can_seek:
            return None
        with self._open() as container:
            stream = video_stream(container, self.name)
            codec = stream.codec_context
            reordered = (
                container.format.name == "avi" and codec.has_b_frames
            )  # and no times say how
            if (codec.name, codec.pix_fmt) != ("h264", "yuv420p") or reordered:
                return None
            end_pts = int(self._pts[end]) if end < len(self._pts) else None
            found = []
            for packet in _from_key(container, stream, int(self._pts[first])):
                if packet.pts is None or packet.dts is None:
                    return None
                if packet.is_keyframe and end_pts is not None and packet.pts >= end_pts:
                    break
                found.append(packet)
            if not found:
                return None
            begin = found[0].dts
            offset_s = float((begin - int(self._pts[0])) * stream.time_base)
            return _muxed(stream, found, begin), offset_s

    def _runs(self, wanted: list[int]) -> Iterator[list[int]]:
        """Groups of frames that are decoded in one run, with a seek between groups."""
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
            frames, whole = decode(stream, packet)
            if not whole:
                self._note_damage(packet, counted)
            for frame in frames:
                index = counted if self._pts is None else _rank(self._pts, frame.pts)
                counted += 1
                if index not in wanted or index <= last:
                    continue
                image = upright_bgr(frame, self.name)
                self._check_size(image, f"frame {index}")
                last = index
                yield Frame(index, float(self.timeline.time_s[index]), image)
                if index == run[-1]:
                    return

    def _note_damage(self, packet: Any, counted: int) -> None:
        """Remember the key frame before a packet that did not decode."""
        index = counted if self._pts is None else _rank(self._pts, packet and packet.pts)
        index = min(index, len(self.timeline) - 1)
        if index >= 0:
            self._damaged.add(int(self.timeline.key_before[index]))

    def _packets_for(self, container: Any, stream: Any, run: list[int]) -> Iterator[Any]:
        """Packets from the key frame before the run to its last frame, then None (flush).

        Unreferenced packets that are not wanted are not decoded (NONREF).
        """
        if self._pts is None:
            yield from _to_the_end(container, stream)
            return
        key = int(self.timeline.key_before[run[0]])
        unfed = {int(self._pts[i]) for i in run}
        # The first run of a newly opened file needs no seek if it begins near the start.
        seek = self._can_seek and key > _SEEK_GAIN_FRAMES
        key_pts = int(self._pts[key])
        following = _from_key(container, stream, key_pts) if seek else _readable(container, stream)
        skips = stream.codec_context.name in _SKIPS_WELL
        for packet in following:
            if skips:
                stream.codec_context.skip_frame = "DEFAULT" if packet.pts in unfed else "NONREF"
            yield packet
            unfed.discard(packet.pts)
            if not unfed:
                break
        yield None


def _muxed(stream: Any, found: list[Any], begin: int) -> bytes:
    """Packets as an MP4 in fragments, whose times of decoding begin at 0."""
    out = io.BytesIO()
    with av.open(out, "w", format="mp4", options=FRAGMENTS) as container:
        copy = container.add_stream_from_template(stream)
        for packet in found:
            packet.pts, packet.dts, packet.stream = packet.pts - begin, packet.dts - begin, copy
            container.mux(packet)
    return out.getvalue()


def _readable(container: Any, stream: Any) -> Iterator[Any]:
    """Packets up to the first that cannot be read."""
    with suppress(av.error.FFmpegError):
        yield from packets(container, stream)


def _to_the_end(container: Any, stream: Any) -> Iterator[Any]:
    """All packets that can be read, then None (flush)."""
    yield from _readable(container, stream)
    yield None


def _from_key(container: Any, stream: Any, key_pts: int) -> Iterator[Any]:
    """Packets from the key frame on; seeks to earlier positions if a seek lands after it.

    MP4, MKV and AVI land on the key frame; MPEG-TS and PS only estimate its position.
    """
    for ahead_s in _SEEK_AHEAD_S:
        target = key_pts - round(ahead_s / float(stream.time_base))
        try:
            container.seek(target, stream=stream, backward=True)
        except av.error.FFmpegError:
            continue
        following = _readable(container, stream)
        for packet in following:
            if packet.pts == key_pts:
                yield packet
                yield from following
                return
            if packet.dts is not None and packet.dts > key_pts:
                break
    # The key frame itself is damaged: nothing decodes before the next one.
    yield from dropwhile(lambda packet: not packet.is_keyframe, _readable(container, stream))


def _constant_step_s(time_s: np.ndarray) -> float | None:
    """The usual time between frames; None if the rate varies."""
    steps = np.diff(time_s)
    usual = float(np.median(steps)) if len(steps) else 0.0
    even = np.abs(steps - usual) < 0.1 * usual + 0.001  # containers round to milliseconds
    return usual if usual > 0 and even.mean() >= _EVEN_SHARE else None


def _rank(pts: np.ndarray, value: int | None) -> int:
    """The display index of a time stamp, -1 if the file does not contain it."""
    if value is None:
        return -1
    i = int(np.searchsorted(pts, value))
    return i if i < len(pts) and pts[i] == value else -1
