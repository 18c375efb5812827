"""The few steps with PyAV that files and streams share."""

from collections.abc import Iterator
from typing import Any

import av
import numpy as np
from jaxtyping import UInt8

from scene4d.core.errors import InputError

_NOT_FOOTAGE = frozenset({"tty", "concat"})
"""FFmpeg "decodes" any text file as terminal output; concat lists open other files."""


def video_stream(container: Any, name: str) -> Any:
    """The first video stream, set to decode with all cores. Raises where there is none."""
    streams = [
        s
        for s in container.streams.video
        if not s.disposition & av.stream.Disposition.attached_pic  # the cover of a sound file
    ]
    if not streams or container.format.name in _NOT_FOOTAGE:
        raise InputError(
            f"{name}: holds no video; expected a video, an image, or a folder of images"
        )
    stream = streams[0]
    stream.thread_type = "AUTO"
    return stream


def pixel_notes(stream: Any, name: str) -> list[str]:
    """A warning where the file declares pixels that are not square."""
    aspect = stream.sample_aspect_ratio
    if not aspect or aspect == 1:
        return []
    return [
        f"{name}: says that its pixels are not square ({aspect.numerator}:{aspect.denominator}); "
        "they are taken as square: give a lens file, or scale the video to square pixels"
    ]


def packets(container: Any, stream: Any) -> Iterator[Any]:
    """Whole packets; an unreadable rest ends them, what came before is used.

    An empty packet would tell the decoder that the end is reached, and half a packet would be
    patched up with other frames' content.
    """
    try:
        for packet in container.demux(stream):
            if packet.size and not packet.is_corrupt:
                yield packet
    except av.error.FFmpegError:
        return


def decode(stream: Any, packet: Any) -> list[Any]:
    """The frames that come out for a packet (None: what is left); a damaged one gives none."""
    try:
        return list(stream.codec_context.decode(packet))
    except av.error.FFmpegError:
        return []


def upright_bgr(frame: Any, name: str) -> UInt8[np.ndarray, "h w 3"]:
    """The decoded frame as BGR, turned as its display matrix says (degrees counter-clockwise)."""
    image: np.ndarray = frame.to_ndarray(format="bgr24")
    if frame.rotation == 0:
        return image
    if frame.rotation % 90:
        raise InputError(
            f"{name}: its metadata turns the picture by {frame.rotation} degrees; only multiples "
            "of 90 are read: re-encode it upright"
        )
    return np.ascontiguousarray(np.rot90(image, frame.rotation // 90))
