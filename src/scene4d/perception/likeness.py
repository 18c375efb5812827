"""Does it look like a person? By the scores of detector and keypoints.

A signpost is found again and again, with a low score, and keypoints find no body on it.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.people import Detections

_BEST_KEYPOINTS = 5
"""Number of keypoints that count: a seated person may show only head and shoulders."""
_LASTING_S = 1.2
"""Sightings of one track within this are alike: so long do a detector's errors last."""


@dataclass(frozen=True)
class _Normal:
    """Distribution of a track's mean score: Student's t with ``freedom`` degrees."""

    mean: float
    sigma: float
    freedom: float

    def log_density(self, found: np.ndarray, n: np.ndarray, drop: np.ndarray) -> np.ndarray:
        """Of means over ``n`` independent sightings, of objects seen ``drop`` worse."""
        sigma = np.hypot(self.sigma, _WITHIN / np.sqrt(n))
        z2 = ((found - self.mean + drop) / sigma) ** 2
        half = (self.freedom + 1) / 2
        out: np.ndarray = -half * np.log1p(z2 / self.freedom) - np.log(sigma)
        return out


# Means of tracks, read off PETS 2009, the lab and the crosswalk: walkers of 60 px and more have
# scores of 0.75 to 0.87 and keypoints of 0.65 to 0.87, seated people 0.42 to 0.58 and 0.45 to 0.69;
# signposts, hydrants and chairs 0.43 to 0.63 and 0.16 to 0.38, whatever their size.
_WITHIN = 0.1
"""Spread of one sighting's score about the track's mean."""
_SCORE = {True: _Normal(0.83, 0.10, 4.0), False: _Normal(0.50, 0.09, 30.0)}
_BODY = {True: _Normal(0.80, 0.12, 4.0), False: _Normal(0.27, 0.08, 30.0)}
_HIDDEN_SHARE = 0.15
_HIDDEN_SCORE, _HIDDEN_BODY = _Normal(0.52, 0.10, 30.0), _Normal(0.55, 0.12, 30.0)
"""People who sit or stand behind something: their share, and how they are seen at any size."""
_VEHICLE_SCORE = {True: _Normal(0.85, 0.12, 3.0), False: _Normal(0.42, 0.10, 30.0)}
"""By whether the track is real. Vehicles: read off PETS 2009 and the crosswalk (YOLOv4-tiny)."""
_SMALL_PX = 30.0
_SCORE_DROP, _BODY_DROP, _VEHICLE_DROP = (0.21, 15.0), (0.45, 25.0), (0.20, 15.0)
"""What is 30 px high is seen by this much worse than large ones; it falls by e over so many
pixels."""


def people_log_likelihood(
    score: np.ndarray, body: np.ndarray, height: np.ndarray, n: np.ndarray, real: bool
) -> np.ndarray:
    """Log likelihood of the mean scores of tracks, of real people or of mistakes for them.

    ``score`` is the mean of the detector, ``body`` that of :func:`body_score` (NaN: unknown),
    ``height`` the boxes' in pixels, ``n`` the number of independent sightings.
    """

    def both(scores: _Normal, bodies: _Normal, share: float) -> np.ndarray:
        """Of a share of the people, of whom those are seen worse who are far."""
        told = bodies.log_density(body, n, share * _drop(height, _BODY_DROP))
        of_score = scores.log_density(score, n, share * _drop(height, _SCORE_DROP))
        return of_score + np.where(np.isfinite(told), told, 0.0)

    if not real:
        return both(_SCORE[False], _BODY[False], 0.0)
    hidden = both(_HIDDEN_SCORE, _HIDDEN_BODY, 0.0) + np.log(_HIDDEN_SHARE)
    return np.logaddexp(both(_SCORE[True], _BODY[True], 1.0) + np.log1p(-_HIDDEN_SHARE), hidden)


def vehicles_log_likelihood(
    score: np.ndarray, height: np.ndarray, n: np.ndarray, real: bool
) -> np.ndarray:
    """The same of vehicles, which have no keypoints."""
    drop = _drop(height, _VEHICLE_DROP) if real else np.zeros(len(n))
    return _VEHICLE_SCORE[real].log_density(score, n, drop)


def _drop(height_px: np.ndarray, drop: tuple[float, float]) -> np.ndarray:
    most, scale_px = drop
    out: np.ndarray = most * np.exp(-np.maximum(height_px - _SMALL_PX, 0.0) / scale_px)
    return out


def body_score(seen: Detections) -> Float[np.ndarray, "n"]:
    """Mean score of the best keypoints; NaN without keypoints."""
    if not seen.keypoint_names:
        return np.full(len(seen), np.nan)
    best: np.ndarray = np.sort(seen.keypoint_score, axis=1)[:, -_BEST_KEYPOINTS:].mean(axis=1)
    return best


def unlike_people(people: Detections) -> Bool[np.ndarray, "n"]:
    """Which detections are of tracks that look less like people than like what passes for them;
    those without a track are judged one by one.
    """
    body = body_score(people)
    alone = -1 - np.arange(len(people))
    track, at = np.unique(np.where(people.track < 0, alone, people.track), return_inverse=True)
    count = np.bincount(at)
    score, body, height, time_s = (
        np.bincount(at, values) / count
        for values in (people.score, body, np.ptp(people.box_xyxy[:, 1::2], axis=1), people.time_s)
    )
    longest_s = np.zeros(len(track))
    np.maximum.at(longest_s, at, np.abs(np.nan_to_num(people.time_s - time_s[at])))
    n = np.fmin(count, 1 + 2 * longest_s / _LASTING_S)
    real, mistake = (people_log_likelihood(score, body, height, n, real) for real in (True, False))
    return np.asarray((real < mistake)[at])
