"""The interface of all footage sources: frames, their times, and warnings."""

from abc import ABC, abstractmethod
from collections.abc import Iterable, Iterator
from dataclasses import dataclass
from functools import cached_property

import numpy as np
from jaxtyping import Bool, Float, Int, UInt8

from scene4d.core.errors import InputError

MOST_PIXELS = 175_000_000
"""Largest image: 0.5 GB as BGR. The largest camera sensors have 150 megapixels."""
_MOST_SIDE_PX = 32_766
"""OpenCV cannot remap or warp longer sides (SHRT_MAX)."""
_LEAST_SIDE_PX = 8
"""Smaller images show nothing, and scaling them leaves no pixel."""
VIDEO_SUFFIXES = frozenset({".avi", ".m4v", ".mkv", ".mov", ".mp4", ".mpg", ".ts", ".webm"})
"""What counts as a video in a folder; a file that is named may be called anything."""
FRAGMENTS = {"movflags": "frag_keyframe+empty_moov+default_base_moof"}
"""Options of FFmpeg for an MP4 that browsers can append to what they have."""


@dataclass(frozen=True, eq=False)
class Frame:
    """One image. ``index`` counts from 0 in display order; ``time_s`` is seconds from the first
    frame, NaN if the source has no clock (separate images).
    """

    index: int
    time_s: float
    image_bgr: UInt8[np.ndarray, "h w 3"]


@dataclass(frozen=True, eq=False)
class Timeline:
    """The times of all frames of a source in display order, known without decoding.

    ``time_s`` in seconds from the first frame (NaN without a clock); ``is_key`` marks frames
    that decode on their own.
    """

    time_s: Float[np.ndarray, "n"]
    is_key: Bool[np.ndarray, "n"]

    def __len__(self) -> int:
        return len(self.time_s)

    @property
    def has_clock(self) -> bool:
        """Whether the times are known."""
        return bool(np.isfinite(self.time_s).all())

    @property
    def frame_s(self) -> float:
        """Mean time from one frame to the next; NaN if unknown."""
        if len(self) < 2:
            return float("nan")
        return float(self.time_s[-1] - self.time_s[0]) / (len(self) - 1)

    @cached_property
    def key_before(self) -> Int[np.ndarray, "n"]:
        """For each frame, the index of the last key frame up to it (0 before the first one)."""
        indices = np.arange(len(self))
        return np.maximum.accumulate(np.where(self.is_key, indices, 0))


class Source(ABC):
    """Opened footage; use it as a context manager, or call :meth:`close`.

    ``name`` identifies it in messages, ``image_size`` is (width, height) in pixels after rotation,
    ``timeline`` is None for a stream, whose end is unknown.
    """

    name: str
    image_size: tuple[int, int]
    timeline: Timeline | None
    fps: float | None

    @abstractmethod
    def frames(self, indices: Iterable[int] | None = None) -> Iterator[Frame]:
        """Frames of the given indices in ascending order, each once; all of them for None.

        A frame that cannot be decoded is left out and counted in :attr:`warnings`. Raises
        :class:`InputError` for an index that does not exist, a frame of another size, or if no
        frame decodes.
        """

    @property
    @abstractmethod
    def warnings(self) -> tuple[str, ...]:
        """Problems so far, in sentences; complete when all frames have been read."""

    @property
    def frame_count(self) -> int | None:
        """Number of frames; None for a stream."""
        return None if self.timeline is None else len(self.timeline)

    @property
    def duration_s(self) -> float | None:
        """Time from the first frame to the end of the last; None without a clock."""
        if self.timeline is None or not self.timeline.has_clock or len(self.timeline) < 2:
            return None
        return len(self.timeline) * self.timeline.frame_s

    def copied(self, first: int, end: int) -> tuple[bytes, float] | None:
        """The frames from a key frame to before another one (or the end) as an MP4 in fragments,
        not encoded again, and what to add to its times (s). None where that cannot be.
        """
        return None

    def close(self) -> None:  # noqa: B027
        """Release resources; most sources hold none."""

    def __enter__(self) -> "Source":
        return self

    def __exit__(self, *_: object) -> None:
        self.close()

    def _wanted(self, indices: Iterable[int] | None) -> list[int]:
        """Ascending distinct indices, checked; needs a timeline."""
        count = self.frame_count
        assert count is not None
        if indices is None:
            return list(range(count))
        wanted = sorted({int(i) for i in indices})
        if wanted and not 0 <= wanted[0] <= wanted[-1] < count:
            bad = wanted[0] if wanted[0] < 0 else wanted[-1]
            raise InputError(f"{self.name}: has no frame {bad}; its frames are 0 to {count - 1}")
        return wanted

    def _check_size(self, image_bgr: np.ndarray, where: str) -> None:
        height, width = image_bgr.shape[:2]
        if (width, height) != self.image_size:
            raise InputError(
                f"{self.name}: {where} is {width}x{height} but the first frame is "
                f"{self.image_size[0]}x{self.image_size[1]}; one camera needs frames of one size: "
                "cut the footage where the size changes, or scale it to one size"
            )


def check_picture_size(width: int, height: int, name: str) -> None:
    """Raise :class:`InputError` for an image that is too small or too large to process."""
    short, long = sorted((width, height))
    if short < _LEAST_SIDE_PX or long > _MOST_SIDE_PX or width * height > MOST_PIXELS:
        raise InputError(
            f"{name}: found a picture of {width}x{height} pixels, expected sides of "
            f"{_LEAST_SIDE_PX} to {_MOST_SIDE_PX} and at most {MOST_PIXELS:,} pixels: scale it"
        )
