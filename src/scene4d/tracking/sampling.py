"""Which frames are looked at, in chunks that a killed run can resume after."""

from collections.abc import Iterator

import numpy as np
from jaxtyping import Int

from scene4d.core.errors import InputError
from scene4d.video.frames import Frame, Source

CHUNK_S = 10.0
"""Footage in one chunk: what is lost at most when a run is killed."""


def chosen_frames(source: Source, rate_hz: float) -> Int[np.ndarray, "n"]:
    """Indices of the frames looked at: in each 1/rate of a second the first one.

    Raises :class:`InputError` where the source has no clock.
    """
    timeline = source.timeline
    assert timeline is not None
    if not timeline.has_clock:
        raise InputError(
            f"{source.name}: images have no times, and a track needs them: make a video of them, "
            "or give annotations with --fps"
        )
    slot = np.floor(timeline.time_s * rate_hz + 1e-6).astype(np.int64)
    return np.flatnonzero(np.diff(slot, prepend=-1) > 0)


def chunks_of(source: Source, indices: Int[np.ndarray, "n"]) -> list[Int[np.ndarray, "m"]]:
    """The chosen frames by chunk, without empty chunks."""
    assert source.timeline is not None
    number = np.floor(source.timeline.time_s[indices] / CHUNK_S).astype(np.int64)
    _, starts = np.unique(number, return_index=True)
    return np.split(indices, starts[1:])


def numbered_frames(
    source: Source, rate_hz: float, first_chunk: int = 0
) -> Iterator[tuple[int, Frame]]:
    """The frames looked at, each with the number of its chunk, from ``first_chunk`` on.

    A stream has no past: it begins anew, as chunk ``first_chunk``.
    """
    if source.timeline is None:
        yield from _from_stream(source, rate_hz, first_chunk)
        return
    chunks = chunks_of(source, chosen_frames(source, rate_hz))[first_chunk:]
    if not chunks:
        return
    ends = np.array([chunk[-1] for chunk in chunks])
    for frame in source.frames(np.concatenate(chunks).tolist()):
        yield first_chunk + int(np.searchsorted(ends, frame.index)), frame


def _from_stream(source: Source, rate_hz: float, chunk: int) -> Iterator[tuple[int, Frame]]:
    slot, ends_s = -1, CHUNK_S
    for frame in source.frames():
        now = int(np.floor(frame.time_s * rate_hz + 1e-6))
        if now <= slot:
            continue
        slot = now
        while frame.time_s >= ends_s:
            chunk, ends_s = chunk + 1, ends_s + CHUNK_S
        yield chunk, frame
