"""Display times and key frames of a video file, without decoding."""

from dataclasses import dataclass
from typing import Any

import av
import numpy as np
from jaxtyping import Bool, Int

from scene4d.video._decoding import demuxed


@dataclass(frozen=True, eq=False)
class PacketTable:
    """One entry per frame in display order. ``pts`` is None if the container has no times.

    ``packets`` counts all packets in the file, including those hidden by its edit list.
    """

    pts: Int[np.ndarray, "n"] | None
    is_key: Bool[np.ndarray, "n"]
    packets: int


def read_packet_table(container: Any, stream: Any, size_bytes: int | None) -> PacketTable:
    """The packet table of an open file, from its index if sufficient, else by reading it.

    An index (MP4, AVI) holds decoding times. Unless frames are reordered, these are the display
    times up to a constant, and a file of any length opens at once. With reordering, or without a
    complete index (Matroska, MPEG-TS), every packet is read but none is decoded.
    """
    table = _from_index(stream, size_bytes)
    return _from_packets(container, stream) if table is None else table


def _from_index(stream: Any, size_bytes: int | None) -> PacketTable | None:
    entries = getattr(stream, "index_entries", None)  # PyAV 17 and later
    if not entries or len(entries) != stream.frames or stream.codec_context.has_b_frames:
        return None
    if stream.start_time is None or size_bytes is None:
        return None
    rows = np.array(
        [(e.timestamp, e.is_keyframe, e.is_discard, e.pos + e.size) for e in entries], np.int64
    )
    pts, is_key, hidden, end = rows.T
    if end.max() > size_bytes or hidden.any() or (np.diff(pts) <= 0).any():
        return None  # cut short, edited or disordered: read the packets
    return PacketTable(pts - pts[0] + stream.start_time, is_key.astype(bool), len(pts))


def _from_packets(container: Any, stream: Any) -> PacketTable:
    pts: list[int | None] = []
    keys: list[bool] = []
    packets = 0
    try:
        for packet in demuxed(container, stream):
            if packet.size == 0:  # end of the stream, or an AVI "frame not captured"
                continue
            packets += 1
            if not packet.is_discard:
                pts.append(packet.pts)
                keys.append(packet.is_keyframe)
    except av.error.FFmpegError:
        pass  # a file cut short: it ends with what was read so far
    is_key = np.array(keys, bool)
    known = [p for p in pts if p is not None]
    if len(known) < len(pts) or len(set(known)) < len(known):
        return PacketTable(None, is_key, packets)
    shown = np.argsort(np.array(known, np.int64))
    return PacketTable(np.array(known, np.int64)[shown], is_key[shown], packets)
