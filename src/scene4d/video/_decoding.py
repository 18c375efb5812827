"""PyAV steps shared by files and streams."""

import threading
from collections.abc import Iterator
from typing import Any

import av
import numpy as np
from av.sidedata.sidedata import SideDataContainer
from av.video.reformatter import VideoReformatter
from jaxtyping import UInt8

from scene4d.core.errors import InputError
from scene4d.video.frames import check_picture_size

_NOT_FOOTAGE = frozenset({"tty", "concat"})
"""FFmpeg "decodes" any text file as terminal output; concat lists open other files."""


class _Converter(threading.local):
    """FFmpeg's converter of pixels: one a thread, since a new one for each frame takes four times
    as long as the frame, and begins threads of its own.
    """

    def __init__(self) -> None:
        self.to = VideoReformatter()


_CONVERTER = _Converter()


def video_stream(container: Any, name: str) -> Any:
    """The first video stream, set to decode with all cores.

    Raises :class:`InputError` if there is none, its codec is unknown, or its frames are too large.
    """
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
    if stream.codec_context is None:
        raise InputError(
            f"{name}: its video codec is unknown or cannot be decoded here; expected H.264, HEVC, "
            "AV1, VP9, MPEG-4, MJPEG or another codec of FFmpeg: convert the recording to H.264"
        )
    if stream.codec_context.width:  # 0: known only when a frame is decoded
        check_picture_size(stream.codec_context.width, stream.codec_context.height, name)
    stream.thread_type = "AUTO"
    return stream


def pixel_notes(stream: Any, name: str) -> list[str]:
    """A warning if the file declares non-square pixels."""
    aspect = stream.sample_aspect_ratio
    if not aspect or aspect == 1:
        return []
    return [
        f"{name}: says that its pixels are not square ({aspect.numerator}:{aspect.denominator}); "
        "they are taken as square: give a lens file, or scale the video to square pixels"
    ]


def packets(container: Any, stream: Any) -> Iterator[Any]:
    """Whole packets, until the end or :class:`av.error.FFmpegError`.

    An empty packet would end the decoder, and a partial packet would be completed with content of
    other frames.
    """
    for packet in demuxed(container, stream):
        if packet.size and not packet.is_corrupt:
            yield packet


def demuxed(container: Any, stream: Any) -> Iterator[Any]:
    """All packets. AVI has no times of display, and those that FFmpeg makes up for H.264 and H.265
    are wrong by a frame or more: it is shown as it is decoded, or in an order that is not known.
    """
    codec = stream.codec_context
    made_up = container.format.name == "avi" and codec.name in ("h264", "hevc")
    for packet in container.demux(stream):
        if made_up:
            packet.pts = None if codec.has_b_frames else packet.dts
        yield packet


def decode(stream: Any, packet: Any) -> tuple[list[Any], bool]:
    """The intact frames decoded from a packet (None: flush), and whether none was damaged."""
    try:
        frames = list(stream.codec_context.decode(packet))
    except av.error.FFmpegError:
        return [], False
    whole = [frame for frame in frames if not frame.is_corrupt]
    return whole, len(whole) == len(frames)


def upright_bgr(frame: Any, name: str) -> UInt8[np.ndarray, "h w 3"]:
    """The decoded frame as BGR, rotated and mirrored by its display matrix.

    The matrix ((a, b, u), (c, d, v), (x, y, w)) shows pixel (p, q) at (a p + c q, b p + d q)
    (ISO 14496-12, 6.2.2; FFmpeg's libavutil/display.h).
    """
    check_picture_size(frame.width, frame.height, name)
    image: np.ndarray = _CONVERTER.to.reformat(frame, format="bgr24").to_ndarray()
    # Not frame.side_data: frame and side data would hold each other, and the picture, until Python
    # looks for such cycles, which is seldom in a program that runs for hours.
    held: Any = SideDataContainer  # its stub lacks the frame
    matrix = held(frame).get("DISPLAYMATRIX")
    if matrix is None:
        return image
    values = np.frombuffer(bytes(matrix), np.int32).reshape(3, 3)[:2, :2]
    (a, b), (c, d) = np.rint(values / max(1, np.abs(values).max())).astype(int)
    if not abs(a) == abs(d) != abs(b) == abs(c):
        raise InputError(
            f"{name}: its metadata turns the picture by {frame.rotation} degrees; only multiples "
            "of 90 and mirroring are read: re-encode it upright"
        )
    if not a:
        image, a, d = image.swapaxes(0, 1), c, b
    return np.ascontiguousarray(image[::d, ::a])
