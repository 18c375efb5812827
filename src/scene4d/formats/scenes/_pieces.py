"""Pieces of a scene: in order, or all of them together."""

import dataclasses
from collections.abc import Iterator

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes._contract import SceneTable

_ONE_CLIP = ("camera", "image_size", "start_utc", "keypoint_names", "geo")
"""What pieces have in common where the format can say it only once."""


def agreeing(pieces: Iterator[SceneTable], names: tuple[str, ...]) -> Iterator[SceneTable]:
    """The same pieces. Raises :class:`InputError` at the first that differs in one of ``names``."""
    first: SceneTable | None = None
    for piece in pieces:
        first = first or piece
        for name in names:
            found, expected = getattr(piece, name), getattr(first, name)
            if found != expected:
                raise InputError(
                    f"its pieces differ in {name}: {expected} and {found}; "
                    "export each camera and clip to a file of its own"
                )
        yield piece


def by_frame(tracks: Tracks) -> Tracks:
    """The rows in the order of (frame, track)."""
    return tracks.select(np.lexsort((tracks.track, tracks.frame)))


def in_frame_order(pieces: Iterator[SceneTable]) -> Iterator[SceneTable]:
    """The pieces of one clip, each in the order of (frame, track).

    Raises :class:`InputError` where a piece begins before the one before it ended.
    """
    last = -1
    for piece in agreeing(pieces, _ONE_CLIP):
        tracks = by_frame(piece.tracks)
        if tracks.frame[0] < last:
            raise InputError(
                f"its pieces must follow one another in time, found frame {tracks.frame[0]} "
                f"after frame {last}"
            )
        last = int(tracks.frame[-1])
        yield dataclasses.replace(piece, tracks=tracks)


def gathered(pieces: Iterator[SceneTable]) -> SceneTable:
    """One clip as a whole, in the order of (track, time).

    Raises :class:`InputError` where a track is twice at the same moment.
    """
    parts = list(agreeing(pieces, _ONE_CLIP))
    tracks = Tracks.concatenate([part.tracks for part in parts])
    tracks = tracks.select(np.lexsort((tracks.time_s, tracks.track)))
    # Nanoseconds, since that is what is written.
    same = (np.diff(tracks.track) == 0) & (np.diff(np.round(tracks.time_s * 1e9)) == 0)
    if same.any():
        row = int(np.argmax(same))
        raise InputError(
            f"track {tracks.track[row]} has two rows at {tracks.time_s[row]:.9g} s; expected one"
        )
    return dataclasses.replace(parts[0], tracks=tracks)


def track_rows(tracks: Tracks) -> Iterator[np.ndarray]:
    """Indices of the rows of each track, for tables in the order of :func:`gathered`."""
    cuts = np.flatnonzero(np.diff(tracks.track)) + 1
    yield from np.split(np.arange(len(tracks)), cuts)


def main_class(tracks: Tracks) -> str:
    """The class that most rows have; of several, the first in the alphabet."""
    names, counts = np.unique(tracks.class_name, return_counts=True)
    return str(names[np.argmax(counts)])
