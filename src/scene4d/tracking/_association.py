"""Data association on the ground: which detections in successive frames are the same object.

In ground coordinates (metres) people keep apart, walk at known speeds and do not jump, whatever
the camera angle; the image adds the box size and the colours of the clothes. Each pair of track
and detection costs -2 log of its likelihood ratio against an unrelated detection, and each frame
is a minimum-cost assignment (Blackman and Popoli, "Design and Analysis of Modern Tracking
Systems", 1999, section 6.4).
"""

from dataclasses import dataclass, fields, replace

import numpy as np
from jaxtyping import Float, Int
from scipy.optimize import linear_sum_assignment

from scene4d.core.body import PERSON_HEIGHT_M
from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.tracks import Located
from scene4d.tracking._motion_model import (
    ACCELERATION,
    GROUP,
    PERSON_GROUP,
    SPEED,
    class_numbers,
    moving_noise,
    repeated,
)

# Chosen by hand with the settings below.
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


@dataclass(frozen=True)
class AssociationSettings:
    """Assumptions of the association; costs are -2 log likelihood ratios.

    All are round numbers chosen by hand; ``python -m benchmarks.tracking`` scores the result on
    PETS S2L1. ``size_sigma`` was raised from 0.1 after a look at these scores: Faster R-CNN boxes
    jitter by that much.
    """

    memory_s: float = 3.0
    """A track ends when it is not seen for longer than this."""
    standing_memory_s: float = 600.0
    """The same for a standing vehicle, which passers-by can hide for minutes."""
    standing_mps: float = 0.5
    """An object slower than this when last seen, and unseen for over a second, is expected where
    it stopped."""
    settled_s: float = 2.0
    """A track must have been seen for this long to count as standing."""
    unrelated_per_m2: float = 1e-4
    """Density of false or unrelated detections, per frame and m²."""
    gate: float = 4.0
    """Largest distance from the predicted position, in standard deviations."""
    size_sigma: float = 0.2
    """Jitter of the logarithm of a box's height about the track's mean."""
    size_drift: float = 0.2
    """Change of that logarithm per second."""
    colour_sigma: float = 0.15
    """Hellinger distance between colours of one object."""
    opinion_limit: float = 9.0
    """Largest cost that size, and likewise colour, can add: obstacles cut boxes."""
    image_sigma: float = 0.1
    """Without a ground point: jitter of the box's foot, in box heights."""
    image_speed: float = 0.7
    """Without a ground point: speed of the box's foot, in box heights per second."""


@dataclass(frozen=True, eq=False)
class _Sightings:
    """Detections of one frame; ``colour`` is NaN where unknown."""

    kind: np.ndarray  # (n,) class number
    known: np.ndarray  # (n,) has a ground point
    xy: np.ndarray  # (n, 2)
    covariance: np.ndarray  # (n, 2, 2)
    foot: np.ndarray  # (n, 2) px
    height: np.ndarray  # (n,) px
    colour: np.ndarray  # (n, d)


@dataclass(frozen=True, eq=False)
class _Tracks:
    label: np.ndarray  # (t,)
    kind: np.ndarray  # (t,) class number when last seen
    born_s: np.ndarray
    seen_s: np.ndarray
    known: np.ndarray  # (t,) has ever had a ground point
    located_s: np.ndarray  # (t,) time of the state
    state: np.ndarray  # (t, 4) position, velocity
    covariance: np.ndarray  # (t, 4, 4)
    mean_xy: np.ndarray  # (t, 2) averaged over the last seconds
    foot: np.ndarray
    drift: np.ndarray  # (t, 2) px per second
    height: np.ndarray
    colour: np.ndarray

    def select(self, rows: np.ndarray) -> "_Tracks":
        return replace(self, **{f.name: getattr(self, f.name)[rows] for f in fields(self)})

    def joined(self, other: "_Tracks") -> "_Tracks":
        names = [f.name for f in fields(self)]
        if not len(self.label):
            return other
        return _Tracks(**{n: np.concatenate([getattr(self, n), getattr(other, n)]) for n in names})


class GroundTracker:
    """Assigns track numbers, from 0, to the detections of successive frames; streaming.

    Holds the tracks in view and the vehicles that stood there within ``standing_memory_s``.
    """

    def __init__(self, settings: AssociationSettings | None = None) -> None:
        self.settings = AssociationSettings() if settings is None else settings
        self._tracks = _start(_nothing(), np.empty(0, np.int64), 0.0)
        self._next = 0
        self._time_s = -np.inf

    def __len__(self) -> int:
        """Number of tracks held."""
        return len(self._tracks.label)

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
        seen = _sightings(detections, located, appearance)
        if not len(seen.kind):
            self._time_s = time_s
            return np.empty(0, np.int64)
        s = self.settings
        tracks = self._tracks
        tracks = tracks.select(
            (time_s - tracks.seen_s <= _patience(tracks, s))
            & _in_picture(tracks, detections.image_size, time_s, s)
        )
        if not len(tracks.label):
            tracks = _start(seen, np.empty(0, np.int64), time_s)
        if tracks.colour.shape[1] != seen.colour.shape[1]:
            raise InputError(
                f"tracker: found appearance of {seen.colour.shape[1]} columns after "
                f"{tracks.colour.shape[1]}; give the same for every frame, NaN where not known"
            )
        self._time_s = time_s
        label = np.full(len(seen.kind), -1)
        state, covariance = _predicted(tracks, time_s, s)
        cost = _costs(tracks, state, covariance, seen, time_s, s)
        rows, columns = _assigned(cost)
        label[columns] = tracks.label[rows]
        _correct(tracks, state, covariance, seen, rows, columns, time_s)
        new = np.flatnonzero(label < 0)
        new = new[np.lexsort(seen.foot[new].T)]
        label[new] = self._next + np.arange(len(new))
        born = _start(seen, new, time_s)
        self._tracks = tracks.joined(replace(born, label=label[new]))
        self._next += len(new)
        return label


def _sightings(d: Detections, located: Located, appearance: np.ndarray | None) -> _Sightings:
    n = len(d)
    if len(located) != n or (appearance is not None and len(appearance) != n):
        rows = n if appearance is None else len(appearance)
        raise InputError(
            f"tracker: found {n} detections, {len(located)} located rows and {rows} rows of "
            "appearance, expected as many of each"
        )
    box = d.box_xyxy
    empty = ~(np.isfinite(box).all(axis=1) & (box[:, 2] > box[:, 0]) & (box[:, 3] > box[:, 1]))
    if empty.any():
        row = int(np.flatnonzero(empty)[0])
        raise InputError(
            f"tracker: box of row {row} must be x1 < x2, y1 < y2, found {box[row].tolist()}"
        )
    known = located.known
    return _Sightings(
        kind=class_numbers(d.class_name),
        known=known,
        xy=np.where(known[:, None], located.xy_m, 0.0),
        covariance=np.where(known[:, None, None], located.covariance_m2, np.eye(2)),
        foot=d.box_foot_uv,
        height=box[:, 3] - box[:, 1],
        colour=np.full((n, 1), np.nan) if appearance is None else appearance,
    )


def _nothing() -> _Sightings:
    none, pairs = np.empty(0), np.empty((0, 2))
    kind, known = np.empty(0, np.int64), np.empty(0, bool)
    return _Sightings(kind, known, pairs, np.empty((0, 2, 2)), pairs, none, np.empty((0, 1)))


def _start(seen: _Sightings, rows: np.ndarray, time_s: float) -> _Tracks:
    n, kind = len(rows), seen.kind[rows]
    covariance = np.zeros((n, 4, 4))
    covariance[:, :2, :2] = seen.covariance[rows]
    covariance[:, [2, 3], [2, 3]] = SPEED[kind][:, None] ** 2
    now = np.full(n, time_s)
    return _Tracks(
        label=np.zeros(n, np.int64),
        kind=kind,
        born_s=now,
        seen_s=now.copy(),
        known=seen.known[rows],
        located_s=now.copy(),
        state=np.concatenate([seen.xy[rows], np.zeros((n, 2))], axis=1),
        covariance=covariance,
        mean_xy=seen.xy[rows].copy(),
        foot=seen.foot[rows],
        drift=np.zeros((n, 2)),
        height=seen.height[rows],
        colour=seen.colour[rows],
    )


def _standing(t: _Tracks, s: AssociationSettings) -> np.ndarray:
    """Which tracks were slow when last seen; a vehicle also by its mean place, because the speed of
    a distant one is uncertain.
    """
    slow = np.hypot(t.state[:, 2], t.state[:, 3]) < s.standing_mps
    moved = np.hypot(*(t.state[:, :2] - t.mean_xy).T)
    slow |= (GROUP[t.kind] != PERSON_GROUP) & (moved < s.standing_mps * _MEAN_S)
    standing: np.ndarray = t.known & slow & (t.seen_s - t.born_s >= s.settled_s)
    return standing


def _patience(t: _Tracks, s: AssociationSettings) -> np.ndarray:
    parked = _standing(t, s) & (GROUP[t.kind] != PERSON_GROUP)
    return np.where(parked, s.standing_memory_s, s.memory_s)


def _in_picture(
    t: _Tracks, image_size: tuple[int, int], time_s: float, s: AssociationSettings
) -> np.ndarray:
    """Whether the predicted middle of the box is still inside the image."""
    dt = time_s - t.seen_s
    still = _standing(t, s) & (np.hypot(t.drift[:, 0], t.drift[:, 1]) < _STILL_DRIFT * t.height)
    dt = np.where(still, np.minimum(dt, _STAYS_S), dt)[:, None]
    middle = t.foot - np.column_stack([np.zeros(len(t.height)), t.height / 2])
    middle = middle + t.drift * dt
    size = np.array(image_size)
    kept: np.ndarray = np.all((middle >= 0) & (middle <= size - 1), axis=1)
    return kept


def _predicted(t: _Tracks, time_s: float, s: AssociationSettings) -> tuple[np.ndarray, np.ndarray]:
    """States and covariances predicted for ``time_s``."""
    dt = time_s - t.located_s
    waits = _standing(t, s) & (dt > _STAYS_S)
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
    t: _Tracks,
    state: np.ndarray,
    covariance: np.ndarray,
    seen: _Sightings,
    time_s: float,
    s: AssociationSettings,
) -> Float[np.ndarray, "t n"]:
    """-2 log likelihood ratios; infinite where a match is impossible."""
    dt = (time_s - t.seen_s)[:, None]
    ground, image = _on_ground(state, covariance, seen), _in_image(t, seen, dt, s)
    both = t.known[:, None] & seen.known
    away, log_det = (np.where(both, g, i) for g, i in zip(ground, image, strict=True))
    ratio = np.log(seen.height / t.height[:, None])
    size = ratio**2 / (s.size_sigma**2 + (s.size_drift * dt) ** 2)
    colour = _hellinger2(t.colour[:, None], seen.colour) / s.colour_sigma**2
    cost = away + log_det + 2 * np.log(2 * np.pi * s.unrelated_per_m2)
    cost += np.minimum(size, s.opinion_limit) + np.minimum(colour, s.opinion_limit)
    cost += 2 * _MEAN_HIDDEN * dt / _patience(t, s)[:, None]
    other = GROUP[t.kind][:, None] != GROUP[seen.kind]
    cost[other | (away > s.gate**2)] = np.inf
    return cost


def _on_ground(
    state: np.ndarray, covariance: np.ndarray, seen: _Sightings
) -> tuple[np.ndarray, np.ndarray]:
    """Squared distance in standard deviations (t, n), and log determinant of the covariance."""
    away = seen.xy - state[:, None, :2]
    spread = covariance[:, None, :2, :2] + seen.covariance
    a, b, d = spread[..., 0, 0], spread[..., 0, 1], spread[..., 1, 1]
    det = a * d - b * b
    x, y = away[..., 0], away[..., 1]
    return (d * x * x - 2 * b * x * y + a * y * y) / det, np.log(det)


def _in_image(
    t: _Tracks, seen: _Sightings, dt: np.ndarray, s: AssociationSettings
) -> tuple[np.ndarray, np.ndarray]:
    """The same from the foot of the box; a box height counts as a person's height in metres."""
    expected = t.foot[:, None] + t.drift[:, None] * dt[..., None]
    away = (seen.foot - expected) / t.height[:, None, None]
    variance = s.image_sigma**2 + (s.image_speed * dt) ** 2
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
    t: _Tracks,
    state: np.ndarray,
    covariance: np.ndarray,
    seen: _Sightings,
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
    born = _start(seen, columns[fresh], time_s)
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
