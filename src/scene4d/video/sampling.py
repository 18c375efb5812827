"""Which frames to look at, so that little is decoded that nobody looks at."""

import math
from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.errors import InputError
from scene4d.video.frames import Frame, Source, Timeline

_DEFAULT_FRAMES = (100, 200)
"""Without a wish: one frame a second, but not fewer and not more than these."""
STRAIGHT_PIXELS = 1.5e9
"""Up to this much footage (frames times pixels) is decoded whole: a few seconds on two cores."""
_APART_S = 1.0
"""People a second apart are in another pose and place; nearer frames tell little new."""


def sample_frames(
    source: Source, n: int | None = None, *, start_s: float = 0.0, end_s: float | None = None
) -> Iterator[Frame]:
    """``n`` distinct frames in order, spread evenly over ``[start_s, end_s)``.

    None takes one frame a second, within 100 to 200 frames. All frames are given where the clip
    has no more than that. Which frames are taken says :func:`choose_frames`; a stream gives its
    frames one second apart as they come. Raises :class:`InputError` for a time span without
    frames, for a time span of images (they have no clock) and for ``n < 1``.
    """
    if n is not None and n < 1:
        raise InputError(f"the number of frames must be at least 1, found {n}")
    if math.isnan(start_s) or start_s < 0 or (end_s is not None and not end_s > start_s):
        raise InputError(f"the time span must be 0 <= start < end, found {start_s} to {end_s}")
    if source.timeline is None:
        return _from_stream(source, n, start_s, end_s)
    inside = _inside(source, source.timeline, start_s, end_s)
    pixels = source.image_size[0] * source.image_size[1]
    return source.frames(choose_frames(source.timeline, inside, n, pixels).tolist())


def expected_count(source: Source, n: int | None = None) -> int:
    """How many frames :func:`sample_frames` will give; a stream may end before."""
    if source.timeline is None:
        return _DEFAULT_FRAMES[0] if n is None else n
    everything = np.arange(len(source.timeline))
    wanted = _default_count(source.timeline, everything) if n is None else n
    return min(wanted, len(everything))


def choose_frames(
    timeline: Timeline, inside: Int[np.ndarray, "m"], n: int | None, pixels: int
) -> Int[np.ndarray, "k"]:
    """Indices of about the cheapest ``n`` frames that spread evenly over those ``inside``.

    ``inside`` are consecutive indices, ``pixels`` is the size of a frame. A short clip is decoded
    straight through, so its frames are exactly even. On a long one only key frames are taken
    where there are enough of them; else also the frames at one, two, ... steps behind a key
    frame, of at least a second where n allows, and no further behind than it takes to have n.
    """
    n = _default_count(timeline, inside) if n is None else n
    if n >= len(inside):
        return inside
    times = timeline.time_s[inside] if timeline.has_clock else inside.astype(float)
    if len(inside) * pixels <= STRAIGHT_PIXELS:
        return inside[spread(times, n)]
    step = len(inside) // n
    if timeline.has_clock and timeline.frame_s > 0:
        step = max(1, min(step, round(_APART_S / timeline.frame_s)))
    behind = inside - timeline.key_before[inside]
    rounds = np.where(behind % step == 0, behind // step, len(timeline))
    furthest = np.partition(rounds, n - 1)[n - 1]
    cheap = np.flatnonzero(rounds <= furthest)
    return inside[cheap[spread(times[cheap], n)]]


def spread(time_s: Float[np.ndarray, "m"], n: int) -> Int[np.ndarray, "n"]:
    """Positions of ``n <= m`` distinct ascending times, each nearest to the middle of its share.

    Where times lie so unevenly that one would be nearest twice, the next free one is taken.
    """
    count = len(time_s)
    middles = time_s[0] + (np.arange(n) + 0.5) * (time_s[-1] - time_s[0]) / n
    right = np.clip(np.searchsorted(time_s, middles), 1, max(1, count - 1))
    left = right - 1
    right = np.minimum(right, count - 1)
    nearest = np.where(middles - time_s[left] <= time_s[right] - middles, left, right)
    order = np.arange(n)
    distinct = np.maximum.accumulate(nearest - order) + order
    return np.minimum(distinct, count - n + order)


def _default_count(timeline: Timeline, inside: np.ndarray) -> int:
    fewest, most = _DEFAULT_FRAMES
    if not timeline.has_clock:
        return most
    span_s = timeline.time_s[inside[-1]] - timeline.time_s[inside[0]]
    return int(np.clip(round(span_s), fewest, most))


def _inside(source: Source, timeline: Timeline, start_s: float, end_s: float | None) -> np.ndarray:
    if start_s == 0 and end_s is None:
        return np.arange(len(timeline))
    if not timeline.has_clock:
        raise InputError(
            f"{source.name}: images have no times, so no time span can be cut out of them; "
            "give only the images that are meant"
        )
    end_s = math.inf if end_s is None else end_s
    inside = np.flatnonzero((timeline.time_s >= start_s) & (timeline.time_s < end_s))
    if not len(inside):
        raise InputError(
            f"{source.name}: has no frame from {start_s:g} s to {end_s:g} s; its last frame is at "
            f"{timeline.time_s[-1]:.3f} s"
        )
    return inside


def _from_stream(
    source: Source, n: int | None, start_s: float, end_s: float | None
) -> Iterator[Frame]:
    n = _DEFAULT_FRAMES[0] if n is None else n
    rate = source.fps or 25.0
    first, step = math.ceil(start_s * rate), max(1, round(_APART_S * rate))
    for frame in source.frames(range(first, first + n * step, step)):
        if end_s is not None and frame.time_s >= end_s:
            return
        yield frame
