"""Scores as probabilities: what share of the events of a score were labelled, where it is known.

``calibrated.json`` holds it for each activity with enough labels, written by
``python -m benchmarks.score_calibration --write`` from the tuning cameras: for annotated tracks,
and for those that our tracker makes of the same boxes as a detector would see them, simulated. It
belongs to the activity's phases: where anything of them is said differently, nothing is known.
"""

import hashlib
import json
from dataclasses import dataclass
from functools import cache
from importlib import resources
from typing import Any

import numpy as np
from jaxtyping import Float

from scene4d.searching.activities._terms import term_text
from scene4d.searching.activities.definition import Activity

FILE = "calibrated.json"
ANNOTATED, DETECTED = "annotated", "detected"
"""Whose tracks are searched; each is a table of the file."""


@dataclass(frozen=True, eq=False)
class ScoreCalibration:
    """The share of right events by score: linear between ascending ``score``, (k,).

    ``labels`` and ``events`` are how many it was counted over, ``cameras`` where;
    ``expected_error`` is the expected calibration error on cameras left out, one by one, and
    ``precision`` the share of right events among those that a search shows by default. ``tracks``
    are :data:`ANNOTATED` or :data:`DETECTED`.
    """

    score: Float[np.ndarray, "k"]
    probability: Float[np.ndarray, "k"]
    cameras: tuple[str, ...]
    labels: int
    events: int
    expected_error: float
    precision: float
    tracks: str

    def at(self, score: Float[np.ndarray, "*n"]) -> Float[np.ndarray, "*n"]:
        """Probabilities of events with these scores."""
        return np.asarray(np.interp(score, self.score, self.probability))

    def least_score(self, probability: float) -> float:
        """The lowest score of so probable an event; infinite where none is."""
        reached = np.flatnonzero(self.probability >= probability)
        if not len(reached):
            return float("inf")
        at = slice(max(int(reached[0]) - 1, 0), int(reached[0]) + 1)
        return float(np.interp(probability, self.probability[at], self.score[at]))

    @property
    def note(self) -> str:
        """What the probability is of, and how good."""
        where = f"MEVA's {' and '.join(self.cameras)}"
        whose = f"annotated tracks, those of {where}"
        if self.tracks == DETECTED:
            whose = (
                f"tracks of a simulated detector that errs as ours does on PETS 2009, at {where}, "
                "where only who acts was annotated: of a street with others about fewer are right"
            )
        return (
            f"probability: the share of right events at this score on {whose} ({self.labels} "
            f"labels; off by {self.expected_error:.2f} on a camera left out)"
        )


def calibration_of(activity: Activity, tracks: str) -> ScoreCalibration | None:
    """That of the scores of an activity on such tracks; None where nothing was counted for its
    phases.
    """
    return _all()[tracks].get(fingerprint(activity))


def fingerprint(activity: Activity) -> str:
    """A short hash of everything that an activity's scores depend on, but not of who may play."""
    said: list[Any] = [
        [phase.min_s, phase.max_s, phase.gap_s, sorted(map(term_text, phase.terms))]
        for phase in activity.phases
    ]
    said += [[r.first, r.relation, r.second] for r in activity.relations]
    said += [(role.count, role.exactly) for role in activity.roles if role.is_counted]
    return hashlib.sha256(json.dumps(said).encode()).hexdigest()[:16]


@cache
def _all() -> dict[str, dict[str, ScoreCalibration]]:
    text = resources.files(__package__).joinpath(FILE).read_text("utf-8")
    tables = json.loads(text)
    return {tracks: _table(tables[tracks], tracks) for tracks in (ANNOTATED, DETECTED)}


def _table(found: dict[str, Any], tracks: str) -> dict[str, ScoreCalibration]:
    return {
        one["fingerprint"]: ScoreCalibration(
            np.array(one["score"]),
            np.array(one["probability"]),
            tuple(one["cameras"]),
            one["labels"],
            one["events"],
            one["expected_error"],
            one["precision"],
            tracks,
        )
        for one in found.values()
    }
