"""Evaluations of activity search with made-up outcomes."""

import numpy as np

from scene4d.evaluation.measures._events import ClipEvents
from scene4d.evaluation.trials._ways import Method
from scene4d.evaluation.trials.activities import ActivityEvaluation, ActivityOutcome
from scene4d.searching.activities.calibrated import ScoreCalibration

METHODS = (Method("metres", "on the ground"), Method("pixels", "a < b"), Method("near", "P(near)"))
NOTES = ("Tracks are annotated, not detected.", "Only actors of labelled activities are boxed.")
CALIBRATION = ScoreCalibration(
    np.array([0.0, 2.0]), np.array([0.1, 0.9]), ("G1", "G2"), 50, 150, 0.04, 0.3, "annotated"
)


def found(labels: int, seed: int, skill: float) -> tuple[ClipEvents, ...]:
    """Found events of which about ``skill`` are right, the better ones first: half of the labels in
    a clip of either camera, one each 100 s, and false events between them.
    """
    rng = np.random.default_rng(seed)
    clips = []
    for camera, count in (("G3", labels // 2), ("G4", labels - labels // 2)):
        n = 3 * count
        correct = np.zeros(n, bool)
        correct[: int(skill * count)] = True
        begin = 100.0 * np.arange(n) + np.where(correct, 0.0, 50.0)
        spans = np.column_stack([begin, begin + 5.0])
        label = 100.0 * np.arange(count)
        clips.append(
            ClipEvents(
                camera,
                120.0,
                np.column_stack([label, label + 5.0]),
                spans,
                rng.random(n) + 0.5 * skill * correct,
                np.ones((count, n), bool),
            )
        )
    return tuple(clips)


def made(activities: dict[str, int]) -> ActivityEvaluation:
    outcomes = []
    for k, (name, labels) in enumerate(activities.items()):
        for j, method in enumerate(METHODS):
            blind = method.name == "near" and name.startswith("vehicle")
            events = None if blind else found(labels, 10 * k + j, 0.9 - 0.25 * j)
            known = CALIBRATION if j == 0 and name != "vehicle_stops" else None
            outcomes.append(ActivityOutcome(method.name, name, events, {}, known))
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
