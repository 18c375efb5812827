"""The probability that a track shows a person or a vehicle, and not a mistake of the detector.

A detector takes signposts, trees and reflections for people, again and again at one place, and now
and then it takes anything for anybody. So three explanations of a track compete: it is *real*; it
is *clutter*, a thing that stays and is often mistaken; it is a *flicker*, a mistake that does not
last. Each gives a likelihood to what was seen, and Bayes' rule the probability (the track score of
Blackman and Popoli, "Design and Analysis of Modern Tracking Systems", 1999, section 6.2, with the
clutter as a third hypothesis):

- scores of the detector and of keypoints. Errors of one track are alike, however often it is seen,
  so a track's mean varies about that of its kind, and many sightings only make the mean precise;
- movement in the image, in the object's own heights. Things do not move, and people do not stand
  for long without swaying. Vehicles park: theirs says nothing;
- hits against misses, where nothing hid the object;
- how long the track lasts;
- what else stood there: stillness counts from when the place was first taken by something still.
"""

import numpy as np
from jaxtyping import Float, Int
from scipy.special import betaln, logsumexp

from scene4d.core.boxes import covered, iou
from scene4d.core.people import Detections
from scene4d.perception.likeness import (
    body_score,
    people_log_likelihood,
    vehicles_log_likelihood,
)
from scene4d.tracking._hidden import LONGEST_S
from scene4d.tracking._motion_model import LASTING_S

FEWEST_SIGHTINGS = 3
"""A track with fewer is not published, whatever its probability: most are parts of people who have
another track (chosen by hand on PETS 2009)."""
LEAST_REAL = 0.5
"""Tracks less probable than this are not published: more likely a mistake than not."""
_MEMORY_S = 3.0
"""A track unseen for this long counts as ended."""
_COVERED = 0.5
"""A box with a larger share covered by one nearer box may be missed for that reason."""
_SAME_PLACE_IOU = 0.6
"""Things whose mean boxes overlap by this stand at one place."""
_STILL = 0.15
"""Movement, in heights, up to which a track may be a thing."""
_WALK, _SWAY, _JITTER = 0.2, 0.06, 0.015
"""In heights: spread of a walker's places per second of the track, what a standing person's grows
by, and that of a thing's boxes, with which both begin."""
_SWAY_S = 10.0
"""By then a standing person has swayed, turned and shifted most of what he does in minutes."""
_PIXEL = 1.0
"""What is added to that of boxes, in pixels."""
_MOST_WALK = 2.0
"""The picture ends: most of a walker's spread, in heights."""
_WALK_SPREAD, _STAND_SPREAD = 1.0, 0.7
"""Standard deviations of the logarithms of these."""
_STANDS, _STANDS_S, _SITS = 0.25, 30.0, 0.04
"""Share of people who stand when first seen, for how long, and of those who stay for hours."""
_LEAVES = ((0.3, 1.0), (0.7, 15.0))
"""Share and mean length, in seconds, of the tracks of parts and of whole walks."""
_FLICKER_S = 0.4
"""Mean length of a flicker's track."""
_HIT = {True: (3.0, 1.0), False: (1.5, 1.5)}
"""Beta distributions of the share of sightings, by whether the track is real."""
_PRIOR = {True: (0.5, 0.15, 0.35), False: (0.6, 0.1, 0.3)}
"""Of new tracks: real, clutter, flicker; of people and of vehicles. All chosen by hand."""


class _Track:
    """Sums over the sightings of one track."""

    def __init__(self, time_s: float, frame: int) -> None:
        self.begun_s = time_s
        self.begun = frame
        self.sums = np.zeros(11)
        self.hidden = self.maybe_hidden = 0

    def add(self, time_s: float, frame: int, box: np.ndarray, values: tuple[float, ...]) -> None:
        if not self.sums[0]:
            self.origin = np.array([(box[0] + box[2]) / 2, box[1], box[3]])
        place = np.array([(box[0] + box[2]) / 2, box[1], box[3]]) - self.origin
        self.sums[:4] += (1.0, *values)
        self.sums[4:7] += place
        self.sums[7:10] += place**2
        self.sums[10] += box[2] - box[0]
        self.box, self.seen_s, self.seen = box, time_s, frame
        self.hidden += self.maybe_hidden
        self.maybe_hidden = 0

    @property
    def mean_box(self) -> np.ndarray:
        middle, top, bottom = self.origin + self.sums[4:7] / self.sums[0]
        half = self.sums[10] / self.sums[0] / 2
        return np.array([middle - half, top, middle + half, bottom])

    def columns(self) -> Float[np.ndarray, "9"]:
        """What the likelihoods need of it."""
        n = self.sums[0]
        box = self.mean_box
        height = max(box[3] - box[1], 1.0)
        variance = self.sums[7:10] / n - (self.sums[4:7] / n) ** 2
        move = np.sqrt(np.clip(variance, 0.0, None).sum()) / height
        chances = max(self.seen - self.begun + 1 - self.hidden, n)
        person, score, body = self.sums[1:4] / n
        length = self.seen_s - self.begun_s
        values = n, person > 0.5, score, body, height, move, chances, length, self.seen_s
        return np.array(values, float)


class Belief:
    """Collects evidence frame by frame; memory is bounded by the recent tracks and places."""

    def __init__(self) -> None:
        self._tracks: dict[int, _Track] = {}
        self._recent: set[int] = set()
        self._places: list[tuple[np.ndarray, float, float]] = []  # box, taken from, until
        self._time_s = -np.inf
        self._frames = 0

    def add(self, time_s: float, track: Int[np.ndarray, "n"], seen: Detections) -> None:
        """Add a frame, with all that was seen in it."""
        body = body_score(seen)
        person = (seen.class_name == "person").astype(float)
        values = np.column_stack([person, seen.score, body]).tolist()
        self._time_s, self._frames = time_s, self._frames + 1
        self._miss(set(track.tolist()), seen.box_xyxy)
        for row, number in enumerate(track.tolist()):
            if number not in self._tracks:
                self._tracks[number] = _Track(time_s, self._frames)
            self._tracks[number].add(time_s, self._frames, seen.box_xyxy[row], tuple(values[row]))
            self._recent.add(number)

    def _miss(self, there: set[int], box_xyxy: np.ndarray) -> None:
        """Note which tracks that are missing now may be hidden."""
        for number in sorted(self._recent - there):
            one = self._tracks[number]
            away_s = self._time_s - one.seen_s
            covered = len(box_xyxy) > 0 and _hidden(one.box, box_xyxy) > _COVERED
            if away_s > (LONGEST_S if covered else _MEMORY_S):
                self._recent.discard(number)
                self._remember(one)
            elif covered:
                one.maybe_hidden += 1

    def _remember(self, one: _Track) -> None:
        """Keep the place where an ended track stood still."""
        n, person, *_, move, _, _, seen_s = one.columns()
        if not person or n < FEWEST_SIGHTINGS or move > _STILL:
            return
        box, since = one.mean_box, one.begun_s
        for k, (other, begun, _) in enumerate(self._places):
            if iou(box, other) >= _SAME_PLACE_IOU:
                self._places[k] = other, min(begun, since), seen_s
                return
        self._places.append((box, since, seen_s))

    def _still_s(self, one: _Track) -> float:
        """For how long its place has been taken by something still."""
        box = one.mean_box
        since = [begun for other, begun, _ in self._places if iou(box, other) >= _SAME_PLACE_IOU]
        return one.seen_s - min([one.begun_s, *since])

    def probability(self, track: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """That each of these tracks is real, judged by the frames so far; 0 if never seen."""
        names, at = np.unique(track, return_inverse=True)
        known = np.array([name in self._tracks for name in names.tolist()], bool)
        found = np.zeros(len(names))
        if known.any():
            some = [self._tracks[name] for name in names[known].tolist()]
            columns = np.array([one.columns() for one in some], float).T
            still_s = np.array([self._still_s(one) for one in some])
            found[known] = _real(columns, still_s, self._time_s)
        return found[at]

    def sightings(self, track: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
        """How often each of these tracks was seen."""
        names, at = np.unique(track, return_inverse=True)
        n = [self._tracks[name].sums[0] if name in self._tracks else 0.0 for name in names.tolist()]
        return np.array(n, float)[at]

    def forget(self, until_s: float) -> None:
        """Drop tracks and places that were last seen before ``until_s``."""
        self._tracks = {name: one for name, one in self._tracks.items() if one.seen_s >= until_s}
        self._recent &= self._tracks.keys()
        self._places = [place for place in self._places if place[2] >= until_s]


def _real(columns: np.ndarray, still_s: np.ndarray, now_s: float) -> np.ndarray:
    """Probability of being real, given :meth:`_Track.columns` as rows."""
    n, person, score, body, height, move, chances, length_s, seen_s = columns
    person = person > 0
    effective = np.minimum(n, 1 + length_s / LASTING_S)
    real, mistake = (
        np.where(
            person,
            people_log_likelihood(score, body, height, effective, real),
            vehicles_log_likelihood(score, height, effective, real),
        )
        + _hits(n, chances, effective, real)
        for real in (True, False)
    )
    moves = np.where(person & (n > 1), _moves(move, height, length_s, still_s), 0.0)
    lasts = _lasts(length_s, now_s - seen_s > _MEMORY_S)
    prior = np.log(np.where(person[:, None], _PRIOR[True], _PRIOR[False])).T
    total = prior + np.stack([real, mistake, mistake]) + moves + lasts
    found: np.ndarray = np.exp(total[0] - logsumexp(total, axis=0))
    return found


def _hits(n: np.ndarray, chances: np.ndarray, effective: np.ndarray, real: bool) -> np.ndarray:
    """Log likelihood of seeing it ``n`` times of ``chances``: beta-binomial. The first and the
    last time are given; misses follow each other, so only independent chances count.
    """
    a, b = _HIT[real]
    share = np.where(chances > 2, (n - 2) / np.maximum(chances - 2, 1), 1.0)
    tries = np.where(chances > 2, np.minimum(chances - 2, effective), 0.0)
    out: np.ndarray = betaln(a + share * tries, b + (1 - share) * tries) - betaln(a, b)
    return out


def _moves(
    move: np.ndarray, height: np.ndarray, length_s: np.ndarray, still_s: np.ndarray
) -> np.ndarray:
    """Log likelihood of the movement of people: real, clutter, flicker."""
    log_move = np.log(np.maximum(move, 0.002))
    stands = _STANDS * np.exp(-still_s / _STANDS_S) + _SITS

    def bell(middle: np.ndarray, spread: float) -> np.ndarray:
        return np.exp(-0.5 * ((log_move - np.log(middle)) / spread) ** 2) / spread + 1e-6

    jitter = _JITTER + _PIXEL / height
    sway = jitter - _SWAY * np.expm1(-length_s / _SWAY_S)
    walk = np.clip(_WALK * length_s, sway, _MOST_WALK)
    real = (1 - stands) * bell(walk, _WALK_SPREAD) + stands * bell(sway, _STAND_SPREAD)
    jumps = 0.9 * bell(2 * jitter, _WALK_SPREAD) + 0.1 * bell(np.ones_like(sway), _WALK_SPREAD)
    return np.log([real, bell(jitter, _STAND_SPREAD), jumps])


def _lasts(length_s: np.ndarray, ended: np.ndarray) -> np.ndarray:
    """Log likelihood of a track's length, or of having lasted so far: real, clutter, flicker."""
    parts = np.array([w * np.exp(-length_s / s) / np.where(ended, s, 1.0) for w, s in _LEAVES])
    long = np.log(parts.sum(axis=0))
    short = -length_s / _FLICKER_S - np.where(ended, np.log(_FLICKER_S), 0.0)
    return np.stack([long, long, short])


def _hidden(box: np.ndarray, others: np.ndarray) -> float:
    """Largest share of a box that one of the boxes nearer to the camera covers."""
    return float(covered(box, others[others[:, 3] > box[3]]).max(initial=0.0))
