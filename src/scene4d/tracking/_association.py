"""Data association on the ground: which detections in successive frames are the same object.

In ground coordinates (metres) people keep apart, walk at known speeds and do not jump, whatever
the camera angle; the image adds the box size and the colours of the clothes. Each pair of track
and detection costs -2 log of its likelihood ratio against an unrelated detection, and each frame
is a minimum-cost assignment (Blackman and Popoli, "Design and Analysis of Modern Tracking
Systems", 1999, section 6.4).
"""

from dataclasses import dataclass, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.camera import Camera
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.tracking._association_rows import Held, Seen, nothing, seen_rows, started
from scene4d.tracking._hidden import Hidden, vanishes
from scene4d.tracking._motion_model import (
    ACCELERATION,
    GROUP,
    PERSON_GROUP,
    moving_noise,
    repeated,
)

# Chosen by hand with the numbers below.
_STAYS_S = 1.0
"""A slow object is assumed to keep moving for this long after it goes out of sight."""
_MEAN_S = 2.0
"""Averaging time of a track's mean place, by which a moving object's mean lags."""
_STILL_DRIFT = 0.2
"""Box heights per second up to which a standing object's drift in the image is jitter."""
_DRIFT_S = 0.5
"""Averaging time of the speed in the image: about one walking step."""
_MEAN_HIDDEN = 3.0
"""Ratio of a track's memory to the mean time for which it is hidden: e^-3 is 5 %."""
_NEW_SHARE = 0.2
"""Weight of a new detection in a track's height and colours: averages about five detections,
half a second."""
_KNOWN_S = 1.0
"""Who was seen for less is not kept while hidden: many are mistakes of the detector."""
_MISSED_S = 1.0
"""Who is missed for less is expected where he was going, whatever may hide him."""
_CUT = 0.3
"""Error of the logarithm of a box's height where somebody comes out: he is half hidden still."""

# All are round numbers chosen by hand; ``python -m benchmarks.tracking`` scores the result on PETS
# S2L1. The jitter of sizes was raised from 0.1 after a look at these scores: Faster R-CNN boxes
# jitter by that much.
MEMORY_S = 3.0
"""A track ends when it is not seen for longer than this."""
_STANDING_MEMORY_S = 600.0
"""The same for a standing vehicle, which passers-by can hide for minutes."""
_STANDING_MPS = 0.5
"""An object slower than this when last seen, and unseen for over a second, is expected where
it stopped."""
_SETTLED_S = 2.0
"""A track must have been seen for this long to count as standing."""
_UNRELATED_PER_M2 = 1e-4
"""Density of false or unrelated detections, per frame and m²."""
_GATE = 4.0
"""Largest distance from the predicted position, in standard deviations."""
_SIZE_SIGMA = 0.2
"""Jitter of the logarithm of a box's height about the track's mean."""
_SIZE_DRIFT = 0.2
"""Change of that logarithm per second."""
_COLOUR_SIGMA = 0.15
"""Hellinger distance between colours of one object."""
_OPINION_LIMIT = 9.0
"""Largest cost that size, and likewise colour, can add: obstacles cut boxes."""
_IMAGE_SIGMA = 0.1
"""Without a ground point: jitter of the box's foot, in box heights."""
_IMAGE_SPEED = 0.7
"""Without a ground point: speed of the box's foot, in box heights per second."""


class GroundTracker:
    """Assigns track numbers, from 0, to the detections of successive frames; streaming.

    Holds the tracks in view, the vehicles that stood there in the last ten minutes, and, with
    a ``camera``, people who went behind something (:mod:`._hidden`). ``from_hiding`` (n,) says
    which detections of the last frame are of people who came out again.
    """

    def __init__(self, camera: Camera | None = None) -> None:
        self._hidden = None if camera is None else Hidden(camera)
        self._vehicles: list[tuple[float, np.ndarray]] = []  # recent frames: time, boxes
        self.from_hiding = np.empty(0, bool)
        self._tracks = started(nothing(), np.empty(0, np.int64), 0.0)
        self._next = 0
        self._time_s = -np.inf

    def __len__(self) -> int:
        """Number of tracks held."""
        return len(self._tracks)

    def update(
        self,
        time_s: float,
        detections: Detections,
        located: Located,
        appearance: Float[np.ndarray, "n d"] | None = None,
    ) -> Int[np.ndarray, "n"]:
        """Track numbers (n,) of the detections of one frame; every row gets one.

        ``located`` holds their ground positions; rows without one are associated in the image
        alone. ``appearance`` holds histograms that each sum to 1, NaN where unknown. Frames may be
        any time apart; the order of the rows does not matter. Raises :class:`InputError` if the
        time is not finite or does not increase, tables differ in length, a box is empty or not
        finite, or a scene cannot hold a class.
        """
        if not (np.isfinite(time_s) and time_s > self._time_s):
            raise InputError(
                f"tracker: found time {time_s} s, expected a finite one after {self._time_s} s; "
                "give the frames in order"
            )
        seen = seen_rows(detections, located, appearance)
        self.from_hiding = np.zeros(len(seen.kind), bool)
        if not len(seen.kind):
            self._time_s = time_s
            if self._hidden is not None:
                self._hidden.advance(time_s, self._before(detections, seen, time_s))
            return np.empty(0, np.int64)
        tracks = self._tracks
        tracks = tracks.select(
            (time_s - tracks.seen_s <= _patience(tracks))
            & _in_picture(tracks, detections.image_size, time_s)
            | self._is_behind(tracks)
        )
        if not len(tracks):
            tracks = started(seen, np.empty(0, np.int64), time_s)
        if tracks.colour.shape[1] != seen.colour.shape[1]:
            raise InputError(
                f"tracker: found appearance of {seen.colour.shape[1]} columns after "
                f"{tracks.colour.shape[1]}; give the same for every frame, NaN where not known"
            )
        self._time_s = time_s
        label = np.full(len(seen.kind), -1)
        state, covariance = _predicted(tracks, time_s)
        behind = self._predicted_behind(tracks, state, covariance, seen, time_s)
        cost = _costs(tracks, state, covariance, seen, time_s, behind)
        rows, columns = _assigned(cost)
        label[columns] = tracks.label[rows]
        self.from_hiding[columns] = behind.rows[rows]
        self._look_behind(tracks, rows, self._before(detections, seen, time_s), time_s)
        _correct(tracks, state, covariance, seen, rows, columns, time_s)
        new = np.flatnonzero(label < 0)
        new = new[np.lexsort(seen.foot[new].T)]
        label[new] = self._next + np.arange(len(new))
        born = started(seen, new, time_s)
        born = replace(born, label=label[new])
        self._tracks = Held.joined([tracks, born]) if len(tracks) else born
        self._next += len(new)
        return label

    def _is_behind(self, t: Held) -> np.ndarray:
        if self._hidden is None:
            return np.zeros(len(t.label), bool)
        return np.array([label in self._hidden for label in t.label.tolist()], bool)

    def _predicted_behind(
        self, t: Held, state: np.ndarray, covariance: np.ndarray, seen: Seen, time_s: float
    ) -> "_Behind":
        """Puts the states of hidden people into ``state`` and ``covariance``."""
        rows = self._is_behind(t)
        found = _Behind(rows, np.ones(len(rows)), np.ones((len(rows), len(seen.height))))
        if self._hidden is not None and rows.any():
            for row in np.flatnonzero(rows):
                state[row], covariance[row], found.probability[row] = self._hidden.predicted(
                    int(t.label[row]), time_s
                )
            share = t.height[rows] / self._hidden.upright_px(t.state[rows, :2])
            found.height[rows] = share[:, None] * self._hidden.upright_px(seen.xy)
        return found

    def _before(self, detections: Detections, seen: Seen, time_s: float) -> np.ndarray:
        """Boxes of what may hide somebody: all of the frame, and vehicles that it may lack."""
        boxes = detections.box_xyxy
        recent = [(t, there) for t, there in self._vehicles if t > time_s - _STAYS_S]
        self._vehicles = [*recent, (time_s, boxes[GROUP[seen.kind] != PERSON_GROUP])]
        return np.concatenate([boxes, *(there for _, there in recent)])

    def _look_behind(
        self, t: Held, matched: np.ndarray, boxes_xyxy: np.ndarray, time_s: float
    ) -> None:
        """Who is not seen now may have gone behind something, or be there still."""
        if self._hidden is None:
            return
        missed = np.ones(len(t.label), bool)
        missed[matched] = False
        self._hidden.keep(set(t.label[missed].tolist()))
        new = missed & t.known & (GROUP[t.kind] == PERSON_GROUP) & ~self._is_behind(t)
        new &= (t.seen_s - t.born_s >= _KNOWN_S) & (time_s - t.seen_s >= _MISSED_S)
        if new.any():
            at = t.foot + t.drift * (time_s - t.seen_s)[:, None]
            new[new] = vanishes(at[new], t.height[new], boxes_xyxy)
        for row in np.flatnonzero(new):
            label = int(t.label[row])
            self._hidden.begin(label, float(t.located_s[row]), t.state[row], t.covariance[row])
        self._hidden.advance(time_s, boxes_xyxy)


@dataclass(frozen=True, eq=False)
class _Behind:
    """Which tracks are of hidden people: the probability that they still are, and the heights of
    their boxes, were they detected where each detection is.
    """

    rows: np.ndarray  # (t,)
    probability: np.ndarray  # (t,)
    height: np.ndarray  # (t, n)


def _standing(t: Held) -> np.ndarray:
    """Which tracks were slow when last seen; a vehicle also by its mean place, because the speed of
    a distant one is uncertain.
    """
    slow = np.hypot(t.state[:, 2], t.state[:, 3]) < _STANDING_MPS
    moved = np.hypot(*(t.state[:, :2] - t.mean_xy).T)
    slow |= (GROUP[t.kind] != PERSON_GROUP) & (moved < _STANDING_MPS * _MEAN_S)
    standing: np.ndarray = t.known & slow & (t.seen_s - t.born_s >= _SETTLED_S)
    return standing


def _patience(t: Held) -> np.ndarray:
    parked = _standing(t) & (GROUP[t.kind] != PERSON_GROUP)
    return np.where(parked, _STANDING_MEMORY_S, MEMORY_S)


def _in_picture(t: Held, image_size: tuple[int, int], time_s: float) -> np.ndarray:
    """Whether the predicted middle of the box is still inside the image."""
    dt = time_s - t.seen_s
    still = _standing(t) & (np.hypot(t.drift[:, 0], t.drift[:, 1]) < _STILL_DRIFT * t.height)
    dt = np.where(still, np.minimum(dt, _STAYS_S), dt)[:, None]
    middle = t.foot - np.column_stack([np.zeros(len(t.height)), t.height / 2])
    middle = middle + t.drift * dt
    size = np.array(image_size)
    kept: np.ndarray = np.all((middle >= 0) & (middle <= size - 1), axis=1)
    return kept


def _predicted(t: Held, time_s: float) -> tuple[np.ndarray, np.ndarray]:
    """States and covariances predicted for ``time_s``."""
    dt = time_s - t.located_s
    waits = _standing(t) & (dt > _STAYS_S)
    dt = np.where(waits, _STAYS_S, dt)
    step = np.tile(np.eye(4), (len(dt), 1, 1))
    step[:, 0, 2] = step[:, 1, 3] = dt
    before = t.state.copy()
    before[waits, 2:] = 0.0
    state = (step @ before[:, :, None])[:, :, 0]
    covariance = step @ t.covariance @ step.swapaxes(1, 2)
    noise = moving_noise(dt, ACCELERATION[t.kind])
    for axis in range(2):
        covariance[:, axis::2, axis::2] += noise
    return state, covariance


def _costs(
    t: Held,
    state: np.ndarray,
    covariance: np.ndarray,
    seen: Seen,
    time_s: float,
    behind: _Behind,
) -> Float[np.ndarray, "t n"]:
    """-2 log likelihood ratios; infinite where a match is impossible."""
    hidden = behind.rows[:, None]
    dt = (time_s - t.seen_s)[:, None]
    ground, image = _on_ground(state, covariance, seen), _in_image(t, seen, dt)
    both = t.known[:, None] & seen.known
    away, log_det = (np.where(both, g, i) for g, i in zip(ground, image, strict=True))
    ratio = np.log(seen.height / np.where(hidden, behind.height, t.height[:, None]))
    size = ratio**2 / (_SIZE_SIGMA**2 + np.where(hidden, _CUT, _SIZE_DRIFT * dt) ** 2)
    colour = _hellinger2(t.colour[:, None], seen.colour) / _COLOUR_SIGMA**2
    cost = away + log_det + 2 * np.log(2 * np.pi * _UNRELATED_PER_M2)
    cost += np.minimum(size, _OPINION_LIMIT) + np.minimum(colour, _OPINION_LIMIT)
    lost = 2 * _MEAN_HIDDEN * dt / _patience(t)[:, None]
    cost += np.where(hidden, -2 * np.log(behind.probability)[:, None], lost)
    other = GROUP[t.kind][:, None] != GROUP[seen.kind]
    cost[other | (away > _GATE**2) | (hidden & ~seen.known)] = np.inf
    return cost


def _on_ground(
    state: np.ndarray, covariance: np.ndarray, seen: Seen
) -> tuple[np.ndarray, np.ndarray]:
    """Squared distance in standard deviations (t, n), and log determinant of the covariance."""
    away = seen.xy - state[:, None, :2]
    spread = covariance[:, None, :2, :2] + seen.covariance
    a, b, d = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    det = a * d - b * b
    x, y = away[..., 0], away[..., 1]
    return (d * x * x - 2 * b * x * y + a * y * y) / det, np.log(det)


def _in_image(t: Held, seen: Seen, dt: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The same from the foot of the box; a box height counts as a person's height in metres."""
    expected = t.foot[:, None] + t.drift[:, None] * dt[..., None]
    away = (seen.foot - expected) / t.height[:, None, None]
    variance = _IMAGE_SIGMA**2 + (_IMAGE_SPEED * dt) ** 2
    squared = (away**2).sum(axis=2) / variance
    log_det = np.broadcast_to(2 * np.log(variance * PERSON_HEIGHT_M**2), squared.shape)
    return squared, log_det


def _hellinger2(a: np.ndarray, b: np.ndarray) -> np.ndarray:
    """Squared Hellinger distance; 0 where a histogram is unknown."""
    apart: np.ndarray = 1 - np.sqrt(a * b).sum(axis=-1)
    return np.clip(np.nan_to_num(apart, nan=0.0), 0, 1)


def _assigned(cost: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """Rows and columns of the minimum-cost assignment; pairs that do not lower the cost stay
    unmatched.
    """
    gain = np.minimum(cost, 0.0)
    rows, columns = linear_sum_assignment(gain)
    good = gain[rows, columns] < 0
    return rows[good], columns[good]


def _correct(
    t: Held,
    state: np.ndarray,
    covariance: np.ndarray,
    seen: Seen,
    rows: np.ndarray,
    columns: np.ndarray,
    time_s: float,
) -> None:
    """Update the tracks in place with the matched detections."""
    dt = (time_s - t.seen_s[rows])[:, None]
    share = -np.expm1(-dt / _DRIFT_S)
    moved = (seen.foot[columns] - t.foot[rows]) / dt
    t.drift[rows] += share * (moved - t.drift[rows])
    t.foot[rows] = seen.foot[columns]
    t.height[rows] *= (seen.height[columns] / t.height[rows]) ** _NEW_SHARE
    t.kind[rows], t.seen_s[rows] = seen.kind[columns], time_s
    now, before = seen.colour[columns], t.colour[rows]
    mixed = before + _NEW_SHARE * (now - before)
    t.colour[rows] = np.where(np.isnan(before), now, np.where(np.isnan(now), before, mixed))
    known = seen.known[columns]
    rows, columns = rows[known], columns[known]
    fresh = ~t.known[rows]
    born = started(seen, columns[fresh], time_s)
    t.state[rows[fresh]], t.covariance[rows[fresh]] = born.state, born.covariance
    t.mean_xy[rows[fresh]] = born.mean_xy
    late_s = (time_s - t.located_s[rows])[~fresh]
    t.known[rows], t.located_s[rows] = True, time_s
    rows, columns = rows[~fresh], columns[~fresh]
    alike = repeated(dt[known][~fresh][:, 0])[:, None, None]
    spread = covariance[rows][:, :2, :2] + alike * seen.covariance[columns]
    gain = covariance[rows][:, :, :2] @ np.linalg.inv(spread)
    away = seen.xy[columns] - state[rows][:, :2]
    t.state[rows] = state[rows] + (gain @ away[:, :, None])[:, :, 0]
    t.covariance[rows] = covariance[rows] - gain @ covariance[rows][:, :2, :]
    t.mean_xy[rows] += -np.expm1(-late_s / _MEAN_S)[:, None] * (t.state[rows, :2] - t.mean_xy[rows])
