"""Evaluations of activity search with made-up outcomes."""

import numpy as np

from scene4d.evaluation.measures._events import Ranked
from scene4d.evaluation.trials.activities import ActivityEvaluation, ActivityOutcome, Method

METHODS = (Method("metres", "on the ground"), Method("pixels", "a < b"), Method("near", "P(near)"))
NOTES = ("Tracks are annotated, not detected.", "Only actors of labelled activities are boxed.")


def ranked(labels: int, seed: int, skill: float) -> Ranked:
    """Found events of which about ``skill`` are right, the better ones first."""
    rng = np.random.default_rng(seed)
    n = 3 * labels
    correct = np.zeros(n, bool)
    correct[rng.permutation(n)[: int(skill * labels)]] = True
    return Ranked(rng.random(n) + 0.5 * skill * correct, correct, labels, 240.0)


def made(activities: dict[str, int]) -> ActivityEvaluation:
    outcomes = []
    for k, (name, labels) in enumerate(activities.items()):
        for j, method in enumerate(METHODS):
            blind = method.name == "near" and name.startswith("vehicle")
            found = None if blind else ranked(labels, 10 * k + j, 0.9 - 0.25 * j)
            outcomes.append(ActivityOutcome(method.name, name, found))
    return ActivityEvaluation(
        name="meva",
        methods=METHODS,
        activities={name: (f"{name}_label",) for name in activities},
        labels=dict(activities),
        outcomes=tuple(outcomes),
        tuned=("G1", "G2"),
        reported=("G3", "G4"),
        clips=48,
        minutes=240.0,
        notes=NOTES,
        timings={"tracks": 12.0},
    )


def whole() -> ActivityEvaluation:
    return made(
        {
            "person_enters_vehicle": 73,
            "person_exits_vehicle": 86,
            "vehicle_stops": 141,
            "vehicle_turns_left": 129,
            "nothing_of_it": 0,
        }
    )
