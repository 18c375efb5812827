"""Footage for a page: encoded small enough to live inside it, or what the empty view looks like."""

import io
from collections.abc import Sequence
from dataclasses import dataclass
from fractions import Fraction
from pathlib import Path

import cv2
import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.pictures import jpeg
from scene4d.store.footage import NoFootage
from scene4d.video.background import Background
from scene4d.video.reader import FRAGMENTS, Source, open_source

_ATTEMPTS = ((1280, 27), (960, 30), (768, 33), (640, 36))
"""Longest side (px) and x264's CRF: the first that fits the budget is taken. Chosen by eye."""
_TICKS = 1000
"""Per second: presentation times are whole milliseconds, as rows' times in a page."""
_KEY_S = 1.0
"""A key frame at least as often, so that a slider finds its picture at once."""
_MOST_FPS = 30.0
_PLAYED = ("h264", "vp8", "libvpx", "vp9", "libvpx-vp9", "av1", "libdav1d")
_VIEW_PX, _VIEW_QUALITY = 1280, 80
"""Longest side and JPEG's quality of the empty view."""


@dataclass(frozen=True, eq=False)
class Footage:
    """What a page can show of a run: ``video`` (MP4 with H.264, whose times are those of the rows)
    or None with a ``note`` why not, and the ``view`` (JPEG) without who moves.
    """

    video: bytes | None
    view: bytes | None
    note: str | None = None


def footage_for_page(
    place: Path | NoFootage, image_size: tuple[int, int], budget_bytes: int
) -> Footage:
    """The footage at ``place`` in at most ``budget_bytes``; with 0 the empty view alone."""
    if isinstance(place, NoFootage):
        return Footage(None, None, place.reason)
    try:
        with open_source(place) as source:
            check_size(source, image_size)
            view = view_of(source)
            if not budget_bytes:
                return Footage(None, view, "The footage was left out of this page.")
            if source.duration_s is None:
                return Footage(None, view, "These are pictures without times: the view is shown.")
            for side, crf in _ATTEMPTS:
                video = encoded(source, side, crf, budget_bytes)
                if video is not None:
                    return Footage(video, view)
    except InputError as error:
        return Footage(None, None, f"The footage cannot be shown: {error}.")
    return Footage(
        None,
        view,
        f"The footage of {source.duration_s:.0f} s does not fit into {budget_bytes / 1e6:.0f} MB.",
    )


def check_size(source: Source, image_size: tuple[int, int]) -> None:
    """Raise :class:`InputError` where the camera was calibrated for pictures of another size."""
    if source.image_size != image_size:
        (w, h), (cw, ch) = source.image_size, image_size
        raise InputError(f"{source.name} is {w}x{h}, but the camera was {cw}x{ch}")


def view_of(source: Source) -> bytes | None:
    """The median of a few frames as JPEG."""
    count = source.frame_count or 1
    chosen = np.unique(np.linspace(0, count - 1, min(count, 15)).astype(int))
    background = Background(source.image_size, len(chosen))
    for frame in source.frames(chosen.tolist()):
        background.add(frame)
    image = background.image()
    if image is None:
        return None
    return jpeg(image, _VIEW_QUALITY, _VIEW_PX / max(image.shape[:2]))


def encoded(
    source: Source,
    side_px: int,
    crf: int,
    budget_bytes: int | None = None,
    *,
    indices: Sequence[int] | None = None,
    begin_s: float = 0.0,
) -> bytes | None:
    """Frames as MP4 with H.264, at their own times from ``begin_s`` on; None as soon as it is over
    the budget. A piece, of the frames of some ``indices``, is in fragments.
    """
    import av

    width, height = source.image_size
    scale = min(1.0, side_px / max(width, height))
    size = tuple(2 * max(1, round(scale * side / 2)) for side in (width, height))
    out = io.BytesIO()
    options = {} if indices is None else FRAGMENTS
    with av.open(out, "w", format="mp4", options=options) as container:
        fps = min(source.fps or 25.0, _MOST_FPS)
        stream = container.add_stream("libx264", rate=Fraction(fps).limit_denominator(1000))
        stream.width, stream.height = size
        stream.pix_fmt = "yuv420p"
        stream.codec_context.time_base = Fraction(1, _TICKS)
        key = str(max(1, round(fps * _KEY_S)))
        stream.options = {"crf": str(crf), "preset": "veryfast", "g": key, "bf": "0"}
        next_s = -np.inf
        for frame in source.frames(indices):
            if frame.time_s < next_s:
                continue
            next_s = frame.time_s + 0.9 / _MOST_FPS
            image = cv2.resize(frame.image_bgr, size, interpolation=cv2.INTER_AREA)
            picture = av.VideoFrame.from_ndarray(image, format="bgr24")
            picture.pts = round((frame.time_s - begin_s) * _TICKS)
            picture.time_base = Fraction(1, _TICKS)
            container.mux(stream.encode(picture))
            if budget_bytes is not None and out.tell() > budget_bytes:
                return None
        container.mux(stream.encode(None))
    video = out.getvalue()
    return video if budget_bytes is None or len(video) <= budget_bytes else None


def plays(path: Path) -> bool:
    """Whether browsers play this file as it is: H.264 in MP4, or VP8, VP9 and AV1 in WebM."""
    import av

    if path.suffix.lower() not in (".mp4", ".m4v", ".mov", ".webm"):
        return False
    try:
        with av.open(str(path), metadata_errors="replace") as container:
            stream = container.streams.video[0]
            codec = stream.codec_context.name
            return stream.codec_context.pix_fmt == "yuv420p" and codec in _PLAYED
    except (av.error.FFmpegError, IndexError):
        return False
