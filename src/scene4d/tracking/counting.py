"""How many objects of each class went by, without remembering them all."""

from collections import Counter

import numpy as np

from scene4d.core.tracks import Tracks

FORGET_S = 1800.0
"""A track that comes back later counts again."""


class TrackCount:
    """Counts tracks as their rows come, in about the order of time."""

    def __init__(self) -> None:
        self._last_s: dict[int, float] = {}
        self._classes: Counter[str] = Counter()

    def add(self, tracks: Tracks) -> None:
        """Count the tracks that were not seen of late, under the class of their first rows."""
        number, first, inverse = np.unique(tracks.track, return_index=True, return_inverse=True)
        last_s = np.full(len(number), -np.inf)
        np.maximum.at(last_s, inverse, tracks.time_s)
        for track, row, time_s in zip(number.tolist(), first, last_s.tolist(), strict=True):
            if track not in self._last_s:
                self._classes[str(tracks.class_name[row])] += 1
            self._last_s[track] = time_s
        if len(number):
            oldest = last_s.max() - FORGET_S
            self._last_s = {t: s for t, s in self._last_s.items() if s >= oldest}

    def by_class(self) -> dict[str, int]:
        """Numbers of tracks, the most frequent class first."""
        return dict(self._classes.most_common())
