"""Footage that browsers cannot play as it is, in pieces of a few seconds, made when asked for.

So what is looked at is there at once, wherever in hours of footage it lies. H.264 in another
container is copied, anything else encoded.
"""

import threading
from collections import OrderedDict
from pathlib import Path
from typing import Any

import numpy as np

from scene4d.app._footage import check_size, encoded
from scene4d.core.errors import InputError
from scene4d.video.reader import Source, open_source

_PIECE_S = 4.0
"""Encoded in about a second on one core."""
_LONGEST_S = 20.0
"""H.264 is copied where key frames come at least as often, since pieces begin with one."""
_SIDE_PX, _CRF = 1280, 24
"""Longest side and x264's CRF of what is encoded. Chosen by eye."""
_TYPE = 'video/mp4; codecs="avc1.640028"'
_MOST_BYTES = 200_000_000
_MOST_OPEN = 8
"""Files whose times are kept: a day of them is 17 MB."""


class Pieces:
    """The pieces of one file. Raises :class:`InputError` where it has no times, and for footage of
    another size than the camera's.
    """

    def __init__(self, path: Path, image_size: tuple[int, int]) -> None:
        with open_source(path) as source:
            check_size(source, image_size)
        if source.duration_s is None or source.timeline is None:
            raise InputError(f"{path}: pictures without times cannot be played")
        self._source: Source = source
        self._time_s = source.timeline.time_s
        keys = _every(np.flatnonzero(source.timeline.is_key), self._time_s)
        longest_s = float(np.diff(self._time_s[[*keys, -1]]).max())
        self._copies = longest_s <= _LONGEST_S and source.copied(*self._span(keys, 0)) is not None
        self._first = keys if self._copies else _every(np.arange(len(self._time_s)), self._time_s)

    def about(self) -> dict[str, Any]:
        """When pieces begin and the last one ends (s), and the type for ``MediaSource``."""
        starts = [round(float(s), 3) for s in self._time_s[self._first]]
        return {"starts_s": starts, "end_s": self._source.duration_s, "type": _TYPE}

    def piece(self, number: int) -> tuple[bytes, float]:
        """A piece as MP4, and what to add to its times (s); raises :class:`LookupError`."""
        if not 0 <= number < len(self._first):
            raise LookupError(f"no piece {number}")
        first, end = self._span(self._first, number)
        copy = self._source.copied(first, end) if self._copies else None
        if copy is not None:
            return copy
        begin_s = float(self._time_s[first])
        piece = encoded(self._source, _SIDE_PX, _CRF, indices=range(first, end), begin_s=begin_s)
        assert piece is not None
        return piece, begin_s

    def _span(self, firsts: np.ndarray, number: int) -> tuple[int, int]:
        ends = [*firsts[1:].tolist(), len(self._time_s)]
        return int(firsts[number]), ends[number]


def _every(frames: np.ndarray, time_s: np.ndarray) -> np.ndarray:
    """The first of these frames in each :data:`_PIECE_S`."""
    _, first = np.unique(time_s[frames] // _PIECE_S, return_index=True)
    return frames[first]


class PieceStore:
    """Pieces of several files, one made at a time; the last ones that were asked for are kept."""

    def __init__(self) -> None:
        self._lock = threading.Lock()
        self._files: OrderedDict[Path, Pieces] = OrderedDict()
        self._made: OrderedDict[tuple[Path, int], tuple[bytes, float]] = OrderedDict()

    def of(self, path: Path, image_size: tuple[int, int]) -> Pieces:
        """The pieces of a file; raises as :class:`Pieces`."""
        with self._lock:
            return self._of(path, image_size)

    def _of(self, path: Path, image_size: tuple[int, int]) -> Pieces:
        if path not in self._files:
            self._files[path] = Pieces(path, image_size)
        self._files.move_to_end(path)
        while len(self._files) > _MOST_OPEN:
            self._files.popitem(last=False)
        return self._files[path]

    def piece(self, path: Path, image_size: tuple[int, int], number: int) -> tuple[bytes, float]:
        """One piece; raises as :class:`Pieces` and :meth:`Pieces.piece`."""
        with self._lock:
            key = path, number
            if key not in self._made:
                self._made[key] = self._of(path, image_size).piece(number)
            self._made.move_to_end(key)
            made = self._made[key]
            while sum(len(data) for data, _ in self._made.values()) > _MOST_BYTES:
                self._made.popitem(last=False)
            return made
