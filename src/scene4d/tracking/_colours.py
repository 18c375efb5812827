"""Colours of tracked objects, look by look.

Logarithms of likelihoods are added up. Looks err alike (one light, one shade, one camera, one place
on the body), so all looks at a track together count as one and a quarter at most.
"""

from dataclasses import dataclass, field

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.colours import CLOTHES, PALETTE, PARTS, VEHICLES, log_likelihood
from scene4d.core.people import Detections

_ALIKE = 0.8
"""Correlation of the errors of two looks at one track: what a camera adds to all it shows."""
_STEP_S = 1.0
"""Looks within a stride are one. Chosen by hand, as for sizes."""
_FEWEST = 1.0
"""Less looks determine nothing."""


@dataclass
class _Told:
    """What looks at a track have said so far: how many, and the sum, of each part."""

    seen_s: float
    read_s: list[float] = field(default_factory=lambda: [-np.inf] * len(PARTS))
    looks: np.ndarray = field(default_factory=lambda: np.zeros(len(PARTS)))
    log: np.ndarray = field(default_factory=lambda: np.zeros((len(PARTS), len(PALETTE))))


class Colours:
    """Colours of tracks, row by row."""

    def __init__(self) -> None:
        self._told: dict[int, _Told] = {}

    def add(
        self,
        detections: Detections,
        track: Int[np.ndarray, "n"],
        readings: Float[np.ndarray, "n 8"],
    ) -> None:
        """Add rows in order of time, as :class:`.ColourReader` reads them."""
        for part, some in enumerate(np.split(readings, len(PARTS), axis=1)):
            rows = np.flatnonzero(np.isfinite(some).all(axis=1))
            likely = log_likelihood(some[rows, :3], some[rows, 3])
            for log, row in zip(likely, rows.tolist(), strict=True):
                time_s = float(detections.time_s[row])
                told = self._told.setdefault(int(track[row]), _Told(time_s))
                weight = min(1.0, (time_s - told.read_s[part]) / _STEP_S)
                told.looks[part] += weight
                told.log[part] += weight * log
                told.read_s[part] = told.seen_s = time_s

    def forget(self, until_s: float) -> None:
        """Drop the tracks that were last read before."""
        self._told = {t: told for t, told in self._told.items() if told.seen_s >= until_s}

    def of(self, track: Int[np.ndarray, "n"], class_name: np.ndarray) -> Float[np.ndarray, "n c"]:
        """Probabilities for the tracks of rows (``Tracks.colours``)."""
        number, first, rows_of = np.unique(track, return_index=True, return_inverse=True)
        found = np.zeros((len(number), len(PARTS), len(PALETTE)), np.float32)
        for place, (one, row) in enumerate(zip(number.tolist(), first.tolist(), strict=True)):
            told = self._told.get(one)
            if told is not None:
                common = CLOTHES if class_name[row] == "person" else VEHICLES
                found[place] = _probability(told, common)
        return found.reshape(len(number), len(PARTS) * len(PALETTE))[rows_of]  # also of nobody


def _probability(told: _Told, common: Float[np.ndarray, "k"]) -> Float[np.ndarray, "2 k"]:
    looks = np.maximum(told.looks, _FEWEST)
    share = 1 / (1 + (looks - 1) * _ALIKE)
    log = share[:, None] * told.log + np.log(common)
    weight = np.exp(log - log.max(axis=1, keepdims=True))
    weight /= weight.sum(axis=1, keepdims=True)
    weight[told.looks < _FEWEST] = 0.0
    return np.asarray(weight)
