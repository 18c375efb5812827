"""Detects camera motion from the background, while people walk in front of it.

Each frame is compared with one reference frame. Corners of the reference are tracked by
Lucas-Kanade; a match counts only if tracking it back returns to its start and the patches look
alike, and RANSAC fits a similarity transform to the matches. People hide corners or move them in
many ways; the background moves as one. Local brightness and contrast are normalised first, so that
a change of light does not appear as motion.
"""

from collections import deque
from collections.abc import Iterable
from dataclasses import dataclass

import cv2
import numpy as np
from jaxtyping import Float32, UInt8

# Chosen by hand on the tuning cameras and on synthetic pans, zooms, rolls, trucks and light
# (tests/video/test_motion.py). "Still" below: 24 frames of each of 16 recordings by fixed cameras,
# in towns, car parks, rooms and by night, where every frame was found at rest.
_WORK_WIDTH = 480
"""Frames are compared at this width: a shift of one part in a thousand is still half a pixel."""
CELLS = (8, 5)
"""Cells of the image, each with its own corners, so that one building does not have them all."""
_CORNERS_PER_CELL = 6
_MIN_CORNERS = 24
"""A background with fewer corners than this gives no verdict."""
_MIN_SHIFT = 0.006
"""Movement, as a share of the width, from which a frame counts as moved (root mean square); still:
at most 0.0017."""
_MIN_SHARE = 0.2
"""Share of the frames that must have moved; fewer may be a passing truck or a hand on the lens."""
_DRIFT_FRAMES = 5
_DRIFT_CORRELATION = 0.9
"""A shift whose ranks follow time this closely, over so many frames, is a pan or zoom: by chance
that happens to five frames once in 24 times, and it only chooses the words."""
_STILL_PX = 1.0
_STILL_SHARE = 0.25
_STILL_CELLS = 5
"""The camera is at rest if this share of all corners, over this many cells, moved less than this.
Still: a share of at least 0.42."""
_MIN_LIKENESS = 0.7
"""Correlation of a corner's patch with the matched patch."""
_STILL_CORRELATION = 0.12
"""Correlation of whole frames above which the view is the same. Still: at least 0.62; two different
cameras: below 0.035 in 95 % of the pairs."""
_PATCH_PX = 13
"""Side of a corner's patch."""
_EVEN_PX = 31
"""Side of the neighbourhood over which brightness and contrast are normalised."""
_EVEN_CONTRAST = 40.0
"""Standard deviation of the grey levels afterwards."""
_NOISE_GREY = 6.0
"""Contrast, in grey levels, that is not amplified, so that sensor noise gives no corners."""
_MIN_STRENGTH = 0.004
"""Smaller eigenvalue of the gradient (OpenCV's scale) from which a point counts as a corner."""
_MIN_AGREEING = 12
_AGREEING_SHARE = 0.15
"""Number of matches, and share of all corners, that must agree on a movement."""
_WINDOW_PX = (21, 21)
_PYRAMID_LEVELS = 4
_ENOUGH = (cv2.TERM_CRITERIA_COUNT | cv2.TERM_CRITERIA_EPS, 10, 0.03)
"""Of Lucas-Kanade."""
_NO_STRUCTURE = (
    "whether the camera moves cannot be told: fewer than two frames have a background with enough "
    "structure"
)


@dataclass(frozen=True)
class MotionVerdict:
    """Whether the camera moved, and the evidence.

    ``max_shift_px`` is the largest movement of the view in pixels of the footage (root mean
    square over the image), NaN if the moved frames show another view altogether. ``reason`` is one
    sentence if the camera moved or there is no verdict, else None. ``moved_at_s`` is the time of
    the first moved frame, None if none moved or there is no clock.
    """

    moved: bool
    frames_moved: int
    frames_checked: int
    max_shift_px: float
    reason: str | None
    moved_at_s: float | None = None


class MotionMonitor:
    """Takes sampled frames in any order and decides whether all show the same view.

    Takes about 5 ms per frame. The reference is the first frame with enough structure. A scene
    without structure, or darkness, gives no verdict (``frames_checked`` 0), not "moved". Only the
    last ``keep`` frames count (None: all).
    """

    def __init__(self, image_size: tuple[int, int], *, keep: int | None = None) -> None:
        width, height = image_size
        self._scale = min(1.0, _WORK_WIDTH / width)
        self._size = (max(16, round(width * self._scale)), max(16, round(height * self._scale)))
        self._reference: np.ndarray | None = None
        self._corners = np.empty((0, 2), np.float32)
        self._checked: deque[_Checked] = deque(maxlen=keep)

    def add(self, image_bgr: UInt8[np.ndarray, "h w 3"], time_s: float) -> bool:
        """Compare one frame of the footage; false if it shows another view than the first.

        ``time_s`` is only reported.
        """
        grey = cv2.cvtColor(image_bgr, cv2.COLOR_BGR2GRAY)
        even = _even(cv2.resize(grey, self._size, interpolation=cv2.INTER_AREA))
        if self._reference is None:
            corners = _corners(even)
            if len(corners) >= _MIN_CORNERS:
                self._reference, self._corners = even, corners
            return True
        shift = self._shift(even)
        if shift is None:
            return True
        moved = not shift < _MIN_SHIFT * self._size[0]
        self._checked.append(_Checked(time_s, moved, shift / self._scale))
        return not moved

    def verdict(self) -> MotionVerdict:
        """The verdict from the frames so far."""
        moved = [frame for frame in self._checked if frame.moved]
        known = [frame.shift_px for frame in moved if np.isfinite(frame.shift_px)]
        largest = max(known) if known else (float("nan") if moved else 0.0)
        times = [frame.time_s for frame in moved if np.isfinite(frame.time_s)]
        since = min(times) if times else None
        checked = len(self._checked)
        reason = None if checked else _NO_STRUCTURE
        has_moved = len(moved) > 0 and len(moved) >= _MIN_SHARE * checked
        if has_moved:
            when = "" if since is None else f", from {since:.1f} s on"
            how = (
                f"are shifted by up to {largest:.0f} px against the first"
                if known
                else "show another view than the first"
            )
            course = _course(self._checked)
            reason = f"the camera moves: {len(moved)} of {checked} frames {how}{when}{course}"
        return MotionVerdict(has_moved, len(moved), checked, largest, reason, since)

    def _shift(self, even: np.ndarray) -> float | None:
        """Movement in work pixels: 0 at rest, NaN for another view, None if undecided."""
        assert self._reference is not None
        here, there = _follow(self._reference, even, self._corners)
        if self._is_at_rest(here, there):
            return 0.0
        transform = _similarity(here, there, len(self._corners))
        if transform is not None:
            return _rms_shift(transform, self._size)
        if len(_corners(even)) < _MIN_CORNERS:
            return None
        alike = _correlation(self._reference, even) > _STILL_CORRELATION
        return 0.0 if alike else float("nan")

    def _is_at_rest(self, here: np.ndarray, there: np.ndarray) -> bool:
        still = here[np.linalg.norm(there - here, axis=1) < _STILL_PX]
        cells = {tuple(c) for c in (still * CELLS // self._size).astype(int).tolist()}
        return len(still) >= _STILL_SHARE * len(self._corners) and len(cells) >= _STILL_CELLS


@dataclass(frozen=True)
class _Checked:
    """A frame that was compared: whether it shows another view, and the shift (NaN: unknown)."""

    time_s: float
    moved: bool
    shift_px: float


def _course(checked: Iterable[_Checked]) -> str:
    """How the movement goes on over time, and what helps."""
    in_order = sorted(checked, key=lambda frame: frame.time_s)  # stable where there is no clock
    moved = np.array([frame.moved for frame in in_order])
    changes = np.flatnonzero(np.diff(moved)) + 1
    if len(changes) > 2:
        return (
            f", and the view changes {len(changes)} times; split the footage where it changes, and "
            "use pictures of one camera only"
        )
    shift_px = np.array([frame.shift_px for frame in in_order if frame.moved])
    if len(shift_px) >= _DRIFT_FRAMES and _is_growing(shift_px):
        return ", more and more; use a stretch of footage in which it stands still"
    at_s = in_order[changes[0]].time_s if len(changes) == 1 else np.nan
    if np.isfinite(at_s):
        return f"; use the footage before or after {at_s:.1f} s alone"
    return "; use a stretch of footage in which it stands still, or pictures of one camera only"


def _is_growing(shift_px: np.ndarray) -> bool:
    ranks = np.argsort(np.argsort(shift_px))
    return bool(
        np.isfinite(shift_px).all()
        and shift_px[-1] > 1.5 * shift_px[0]
        and np.corrcoef(ranks, np.arange(len(ranks)))[0, 1] > _DRIFT_CORRELATION
    )


def _even(grey: UInt8[np.ndarray, "h w"]) -> UInt8[np.ndarray, "h w"]:
    """Local mean and contrast normalised, so that a change of light has no effect."""
    values = cv2.GaussianBlur(grey, (0, 0), 1).astype(np.float32)
    values -= cv2.blur(values, (_EVEN_PX, _EVEN_PX))
    # The running sums of a box filter may leave a variance just below zero.
    contrast = np.sqrt(np.maximum(cv2.blur(values * values, (_EVEN_PX, _EVEN_PX)), 0))
    scaled = values * (_EVEN_CONTRAST / (contrast + _NOISE_GREY))
    return np.clip(scaled + 128, 0, 255).astype(np.uint8)


def _corners(even: UInt8[np.ndarray, "h w"]) -> Float32[np.ndarray, "n 2"]:
    """Corners (u, v), at most a few in each cell of the image."""
    strength = cv2.cornerMinEigenVal(even, 5)
    peaks = (strength == cv2.dilate(strength, np.ones((9, 9)))) & (strength > _MIN_STRENGTH)
    v, u = np.nonzero(peaks)
    height, width = even.shape
    inside = (u > _PATCH_PX) & (v > _PATCH_PX) & (u < width - _PATCH_PX) & (v < height - _PATCH_PX)
    u, v = u[inside], v[inside]
    strongest = np.argsort(-strength[v, u], kind="stable")
    u, v = u[strongest], v[strongest]
    cell = u * CELLS[0] // width * CELLS[1] + v * CELLS[1] // height
    kept = [np.flatnonzero(cell == c)[:_CORNERS_PER_CELL] for c in range(CELLS[0] * CELLS[1])]
    chosen = np.concatenate(kept)
    return np.column_stack([u[chosen], v[chosen]]).astype(np.float32)


def _follow(
    reference: np.ndarray, even: np.ndarray, corners: Float32[np.ndarray, "n 2"]
) -> tuple[Float32[np.ndarray, "m 2"], Float32[np.ndarray, "m 2"]]:
    """Corners of the reference that were reliably matched, and their current positions."""
    there, found = _flow(reference, even, corners)
    back, found_back = _flow(even, reference, there)
    sure = found & found_back
    sure &= np.linalg.norm(back - corners, axis=1) < _STILL_PX
    here, there = corners[sure], there[sure]
    if not len(here):
        return here, there
    a, b = _patches(reference, here), _patches(even, there)
    likeness = (a * b).sum(1) / np.sqrt((a * a).sum(1) * (b * b).sum(1) + 1e-6)
    alike = likeness > _MIN_LIKENESS
    return here[alike], there[alike]


def _flow(a: np.ndarray, b: np.ndarray, uv: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    there, found, _ = cv2.calcOpticalFlowPyrLK(
        a, b, uv, None, winSize=_WINDOW_PX, maxLevel=_PYRAMID_LEVELS, criteria=_ENOUGH
    )
    return there, found[:, 0] > 0


def _patches(image: np.ndarray, uv: np.ndarray) -> Float32[np.ndarray, "m p"]:
    """Zero-mean patches around the points, one row each."""
    offsets = np.arange(_PATCH_PX, dtype=np.float32) - _PATCH_PX // 2
    du, dv = np.meshgrid(offsets, offsets)
    values = cv2.remap(
        image, uv[:, :1] + du.reshape(1, -1), uv[:, 1:] + dv.reshape(1, -1), cv2.INTER_LINEAR
    ).astype(np.float32)
    return values - values.mean(1, keepdims=True)


def _similarity(here: np.ndarray, there: np.ndarray, corners: int) -> np.ndarray | None:
    """The (2, 3) similarity transform of most matches, None if too few agree."""
    if len(here) < _MIN_AGREEING:
        return None
    transform, agree = cv2.estimateAffinePartial2D(here, there, ransacReprojThreshold=2.0)
    if transform is None:
        return None
    agreeing = int(agree.sum())
    enough = agreeing >= max(_MIN_AGREEING, _AGREEING_SHARE * corners, 0.5 * len(here))
    return transform if enough else None


def _rms_shift(transform: np.ndarray, size: tuple[int, int]) -> float:
    """Root mean square movement over the image, in pixels."""
    u, v = np.meshgrid(np.linspace(0, size[0], 9), np.linspace(0, size[1], 9))
    uv = np.column_stack([u.ravel(), v.ravel()])
    moved = uv @ transform[:, :2].T + transform[:, 2] - uv
    return float(np.sqrt((moved**2).sum(1).mean()))


def _correlation(a: UInt8[np.ndarray, "h w"], b: UInt8[np.ndarray, "h w"]) -> float:
    return float(np.corrcoef(a.ravel()[::3], b.ravel()[::3])[0, 1])
