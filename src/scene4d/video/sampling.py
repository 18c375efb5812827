"""Chooses the frames to analyse, so that few others need decoding."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.errors import InputError
from scene4d.video.frames import Frame, Source, Timeline

_DEFAULT_FRAMES = (100, 200)
"""By default one frame per second, within these limits. Chosen by hand: docs/ablation.md shows the
cost of fewer."""
STRAIGHT_PIXELS = 1.5e9
"""Footage up to this size (frames times pixels) is decoded whole: a few seconds on two cores."""
_FALLBACK_RATE = 25.0
"""Frames per second of a stream that states no rate."""
_APART_S = 1.0
"""After a second people have another pose and place; closer frames add little information."""


def sample_frames(source: Source, n: int | None = None) -> Iterator[Frame]:
    """``n`` distinct frames in order, spread evenly over the footage.

    None takes one frame per second, within 100 to 200 frames. A shorter clip yields all its frames.
    :func:`choose_frames` selects them; a stream yields frames one second apart as they arrive.
    Raises :class:`InputError` for ``n < 1``.
    """
    if n is not None and n < 1:
        raise InputError(f"the number of frames must be at least 1, found {n}")
    if source.timeline is None:
        step = max(1, round(_APART_S * (source.fps or _FALLBACK_RATE)))
        return source.frames(range(0, expected_count(source, n) * step, step))
    return source.frames(choose_frames(source.timeline, n, source.image_size).tolist())


def expected_count(source: Source, n: int | None = None) -> int:
    """Number of frames that :func:`sample_frames` will yield; a stream may end earlier."""
    if source.timeline is None:
        return _DEFAULT_FRAMES[0] if n is None else n
    wanted = _default_count(source.timeline) if n is None else n
    return min(wanted, len(source.timeline))


def choose_frames(
    timeline: Timeline, n: int | None, image_size: tuple[int, int]
) -> Int[np.ndarray, "k"]:
    """Indices of about the cheapest ``n`` frames that are spread evenly over the footage.

    A short clip is decoded whole, so its frames are exactly even. A long one uses only key frames
    if there are enough. Otherwise it also uses frames one, two, ... steps after a key frame, as few
    steps as needed for ``n`` frames. A step is one second, or less if ``n`` requires it.
    """
    n = _default_count(timeline) if n is None else n
    count = len(timeline)
    if n >= count:
        return np.arange(count)
    times = timeline.time_s if timeline.has_clock else np.arange(count, dtype=float)
    if count * image_size[0] * image_size[1] <= STRAIGHT_PIXELS:
        return spread(times, n)
    step = count // n
    if timeline.has_clock and timeline.frame_s > 0:
        step = max(1, min(step, round(_APART_S / timeline.frame_s)))
    behind = np.arange(count) - timeline.key_before
    rounds = np.where(behind % step == 0, behind // step, count)
    furthest = np.partition(rounds, n - 1)[n - 1]
    cheap = np.flatnonzero(rounds <= furthest)
    return cheap[spread(times[cheap], n)]


def spread(time_s: Float[np.ndarray, "m"], n: int) -> Int[np.ndarray, "n"]:
    """Indices of ``n <= m`` distinct ascending times, each nearest to the middle of its interval.

    If a time would be nearest twice, the next free one is taken.
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


def _default_count(timeline: Timeline) -> int:
    fewest, most = _DEFAULT_FRAMES
    if not timeline.has_clock:
        return most
    span_s = timeline.time_s[-1] - timeline.time_s[0]
    return int(np.clip(round(span_s), fewest, most))
