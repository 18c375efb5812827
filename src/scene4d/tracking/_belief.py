"""Separates tracks of people and vehicles from false positives of the detector.

A detector mistakes signposts, statues and reflections for people, repeatedly at one place. A real
person differs in at least one of three ways: the track moves, its detection scores are high, or
its body keypoints are found. The last keeps people who sit still.
"""

import numpy as np
from jaxtyping import Bool, Int

from scene4d.core.people import Detections
from scene4d.core.tracks import Located

_FEWEST_SIGHTINGS = 3
"""Tracks with fewer detections are mostly false (chosen by hand on PETS 2009)."""
_STILL_SIGMA = 2.0
"""A track has not moved if its positions scatter by less than this many standard deviations of one
position, whatever their errors are due to."""
_SURE_SCORE = 0.7
"""Mean score from which a detection counts as certain. Walking people have 0.75 and more on PETS
2009 and in the lab footage; signposts have 0.43 to 0.46, chairs 0.44 to 0.62, and a person seated
behind a screen 0.57."""
_BEST_KEYPOINTS = 5
"""Number of keypoints that count: a seated person may show only head and shoulders."""
_BODY_SCORE = 0.42
"""Mean score of the best keypoints from which there is a body (chosen by hand between 0.17 to 0.39
for those signposts and chairs, and 0.45 for the seated person; walkers have 0.47 to 0.87)."""


class Belief:
    """Collects evidence for each track; memory is bounded by the recent tracks."""

    def __init__(self) -> None:
        self._sums: dict[int, np.ndarray] = {}
        self._seen_s: dict[int, float] = {}

    def add(self, track: Int[np.ndarray, "n"], seen: Detections, located: Located) -> None:
        """Add more detections."""
        sums = np.zeros((len(track), 8))
        known, xy = located.known, located.xy_m
        best = np.sort(seen.keypoint_score, axis=1)[:, -_BEST_KEYPOINTS:]
        body = best.mean(axis=1) if seen.keypoint_names else np.ones(len(seen))
        sums[:, 0] = 1
        sums[:, 1] = seen.class_name == "person"
        sums[:, 2], sums[:, 3] = seen.score, body
        sums[known, 4] = 1
        sums[known, 5:7] = xy[known]
        sums[known, 7] = (xy[known] ** 2).sum(axis=1)
        variance = np.trace(located.covariance_m2, axis1=1, axis2=2)
        sums = np.column_stack([sums, np.where(known, variance, 0.0)])
        for row, number in enumerate(track.tolist()):
            self._sums[number] = self._sums.get(number, 0.0) + sums[row]
            self._seen_s[number] = float(seen.time_s[row])

    def holds(self, track: Int[np.ndarray, "n"]) -> Bool[np.ndarray, "n"]:
        """Which rows belong to accepted tracks, judged by the detections so far."""
        names, at = np.unique(track, return_inverse=True)
        nothing = np.zeros(9)
        n, person, score, body, located, x, y, squares, variance = np.array(
            [self._sums.get(name, nothing) for name in names.tolist()]
        ).T.reshape(9, -1)
        with np.errstate(all="ignore"):  # tracks that were never located
            scatter = squares / located - (x / located) ** 2 - (y / located) ** 2
            still = scatter < _STILL_SIGMA**2 * variance / located
        bodiless = (score < _SURE_SCORE * n) & (body < _BODY_SCORE * n)
        mistaken = (person > n / 2) & bodiless & still
        believed: np.ndarray = ((n >= _FEWEST_SIGHTINGS) & ~mistaken)[at]
        return believed

    def forget(self, until_s: float) -> None:
        """Drop the tracks that were last seen before ``until_s``."""
        self._seen_s = {track: s for track, s in self._seen_s.items() if s >= until_s}
        self._sums = {track: self._sums[track] for track in self._seen_s}
