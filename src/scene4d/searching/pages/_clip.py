"""Short clips and stills around those who take part, small enough to live inside a page."""

import io
from collections.abc import Iterable, Mapping, Sequence
from dataclasses import dataclass
from fractions import Fraction

import cv2
import numpy as np
from jaxtyping import Float, UInt8

from scene4d.core.pictures import jpeg
from scene4d.core.tracks import Tracks
from scene4d.searching.activities._events import Event
from scene4d.searching.pages._plan import role_colours
from scene4d.searching.pages._rings import Ring

CLIP_PX = 400
"""Longest side of a clip."""
_LEAST_PX = 96
"""A clip shows at least this much of the footage: who is small is shown with what is near."""
_MARGIN = 0.35
"""Share of the boxes' size around them; chosen by hand so that a car shows beside its driver."""
_QUALITY, _STILL_QUALITY = "27", 80
"""x264's CRF and JPEG's quality, chosen by hand: ten events take about 3 MB."""
_DARK, _TEXT, _FAR_PX = (24, 20, 20), 0.42, 1e4
"""Outline of what is drawn, size of texts, and how far off the clip a line may go on."""
_Region = tuple[int, int, int, int]
"""x1, y1, x2, y2 in pixels of the footage; x2 and y2 are outside."""


@dataclass(frozen=True, eq=False)
class Crop:
    """A picture cut out of the footage, ``time_s`` after its event began."""

    time_s: float
    image_bgr: UInt8[np.ndarray, "h w 3"]


@dataclass(frozen=True, eq=False)
class Clip:
    """Pictures of one size in their order, ``rate_hz`` of them a second; ``faster`` than life."""

    crops: tuple[Crop, ...]
    rate_hz: float
    faster: float = 1.0


def crop_region(around: Tracks | None, event: Event, image_size: tuple[int, int]) -> _Region | None:
    """What of the picture holds every role during an event, with a margin; all of it where nobody
    takes part, None where none has a box.
    """
    if not event.roles:
        return 0, 0, *image_size
    if around is None:
        return None
    during = (around.time_s >= event.begin_s - 1e-6) & (around.time_s <= event.end_s + 1e-6)
    playing = np.isin(around.track, list(event.roles.values()))
    boxes = around.box_xyxy[during & playing]
    boxes = boxes[np.isfinite(boxes).all(axis=1)]
    if not len(boxes):
        return None
    low, high = boxes[:, :2].min(axis=0), boxes[:, 2:].max(axis=0)
    middle, size = (low + high) / 2, (high - low) * (1 + 2 * _MARGIN)
    size = np.maximum(size, _LEAST_PX)
    # Neither a ribbon nor a column: the shorter side is at least 0.6 of the longer.
    size = np.minimum(np.maximum(size, 0.6 * size.max()), image_size)
    corner = np.clip(middle - size / 2, 0, np.array(image_size) - size)
    x1, y1 = np.floor(corner).astype(int).tolist()
    x2, y2 = np.ceil(corner + size).astype(int).tolist()
    return x1, y1, min(x2, image_size[0]), min(y2, image_size[1])


def cut_out(
    image_bgr: UInt8[np.ndarray, "h w 3"],
    region: _Region,
    boxes: Mapping[str, Float[np.ndarray, "4"] | None],
    rings: Iterable[Ring] = (),
) -> UInt8[np.ndarray, "i j 3"]:
    """A region of a frame at the size of a clip (even sides), with the roles' boxes drawn, and the
    rings in which others are near them.
    """
    x1, y1, x2, y2 = region
    scale = CLIP_PX / max(x2 - x1, y2 - y1)
    width, height = (2 * max(1, round(scale * side / 2)) for side in (x2 - x1, y2 - y1))
    method = cv2.INTER_AREA if scale < 1 else cv2.INTER_CUBIC
    picture = cv2.resize(image_bgr[y1:y2, x1:x2], (width, height), interpolation=method)
    colours = role_colours(boxes)
    rings = list(rings)
    for ring in rings:
        _draw_ring(picture, (ring.outline_uv - [x1, y1]) * scale, _bgr(colours[ring.role]))
    for role, box in boxes.items():
        if box is None:
            continue
        ends = np.rint((box - [x1, y1, x1, y1]) * scale).astype(int)
        first, last = tuple(ends[:2].tolist()), tuple(ends[2:].tolist())
        cv2.rectangle(picture, first, last, _DARK, 4, cv2.LINE_AA)
        cv2.rectangle(picture, first, last, _bgr(colours[role]), 2, cv2.LINE_AA)
    for ring in rings:
        for foot, p in zip((ring.feet_uv - [x1, y1]) * scale, ring.probability, strict=True):
            if np.isfinite([*foot, p]).all():
                _write(picture, f"{p:.2f}", np.rint(foot).astype(int))
    return picture


def _draw_ring(
    picture: UInt8[np.ndarray, "i j 3"],
    outline: Float[np.ndarray, "k 2"],
    colour: tuple[int, int, int],
) -> None:
    """The ring on the ground, in pixels of the clip; NaN where it is not visible."""
    gone = np.flatnonzero(~np.isfinite(outline).all(axis=1))
    for part in np.split(outline, gone):
        points = part[np.isfinite(part).all(axis=1)].clip(-_FAR_PX, _FAR_PX)
        whole = [np.rint(points).astype(np.int32)]
        cv2.polylines(picture, whole, False, _DARK, 3, cv2.LINE_AA)
        cv2.polylines(picture, whole, False, colour, 1, cv2.LINE_AA)


def _write(picture: UInt8[np.ndarray, "i j 3"], text: str, at: np.ndarray) -> None:
    """A text under a point, moved into the picture."""
    (width, height), _ = cv2.getTextSize(text, cv2.FONT_HERSHEY_SIMPLEX, _TEXT, 1)
    room = np.array([picture.shape[1] - width - 2, picture.shape[0] - 3])
    below = np.array([-width // 2, height + 7])
    where = np.clip(at + below, [2, height + 2], room)
    for colour, thick in ((_DARK, 3), ((255, 255, 255), 1)):
        cv2.putText(
            picture, text, tuple(where.tolist()), cv2.FONT_HERSHEY_SIMPLEX, _TEXT, colour, thick,
            cv2.LINE_AA,
        )  # fmt: skip


def stills(clip: Clip, count: int = 4) -> list[Crop]:
    """Some of the pictures, evenly spread, the first and the last among them."""
    chosen = np.unique(np.linspace(0, len(clip.crops) - 1, count).round().astype(int))
    return [clip.crops[number] for number in chosen]


def still(crop: Crop, width: int) -> bytes:
    """A still of some width, never enlarged."""
    return jpeg(crop.image_bgr, _STILL_QUALITY, width / crop.image_bgr.shape[1])


def mp4(crops: Sequence[Crop], rate_hz: float) -> bytes | None:
    """H.264 in MP4, which browsers play; None where this FFmpeg has no encoder for it."""
    import av

    try:
        av.codec.Codec("libx264", "w")
    except ValueError:
        return None
    out = io.BytesIO()
    with av.open(out, "w", format="mp4") as container:
        rate = Fraction(rate_hz).limit_denominator(1000)
        stream = container.add_stream("libx264", rate=rate)
        stream.height, stream.width = crops[0].image_bgr.shape[:2]
        stream.pix_fmt = "yuv420p"
        stream.options = {"crf": _QUALITY, "preset": "medium"}
        for crop in crops:
            frame = av.VideoFrame.from_ndarray(crop.image_bgr, format="bgr24")
            container.mux(stream.encode(frame))
        container.mux(stream.encode(None))
    return out.getvalue()


def _bgr(colour: str) -> tuple[int, int, int]:
    red, green, blue = (int(colour[at : at + 2], 16) for at in (1, 3, 5))
    return blue, green, red
