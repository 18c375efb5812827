"""Drawing a few people from single frames: is the orientation network worth having then?"""

from collections.abc import Iterator

import numpy as np

from scene4d.calibration import person_segments
from scene4d.calibration.guess import solve_guided
from scene4d.calibration.options import CalibrateOptions
from scene4d.core.people import Segments
from scene4d.core.progress import Advance
from scene4d.evaluation import FewPeople, Reference, few_error_m
from scene4d.evaluation.trials.methods import Input

PEOPLE = (3, 5, 10)
"""So many people are drawn."""
DRAWS = 24
"""So many times; all different."""
WAYS = ("", ", no edges")
"""What is left out: nothing, and the straight edges of the scene, which tell of the camera much as
the network does."""
_ALONE = CalibrateOptions(orientation="people")
_GUIDED = CalibrateOptions(orientation="auto")


def few_people(
    given: Input, reference: Reference, notes: list[str], step: Advance
) -> Iterator[FewPeople]:
    """The joint method on :data:`PEOPLE` people of one frame, by themselves and with the network's
    reading of that very frame, as ``scene4d calibrate`` would.

    Both are tried in all :data:`WAYS`, on the same people. Only frames that the network looked at
    are drawn from; where none shows enough people a sentence is added to ``notes``. ``step`` is
    called after each draw.
    """
    segments = person_segments(given.seen.detections)
    reading = given.seen.reading
    if reading is None:
        return
    looked_at = {index for index, _ in reading.by_frame}
    drawn = {people: _draws(segments, people, looked_at) for people in PEOPLE}
    notes.extend(
        f"{given.footage}: no frame shows {people} people whole, so they are not drawn."
        for people, draws in drawn.items()
        if not draws
    )
    ways = WAYS if given.seen.edges_xyxy is not None else WAYS[:1]
    size = given.seen.detections.image_size
    for way in ways:
        edges = given.seen.edges_xyxy if way == "" else None
        for people, draws in drawn.items():
            errors = []
            for rows in draws:
                chosen = segments.select(rows)
                read = reading.of_frame(int(chosen.frame[0]))
                alone = solve_guided(chosen, size, _ALONE, None, edges_xyxy=edges)
                guided = solve_guided(chosen, size, _GUIDED, read, edges_xyxy=edges, alone=alone)
                errors.append([few_error_m(found, reference) for found in (alone, guided)])
                step(1)
            if errors:
                alone_m, guided_m = np.array(errors, float).T
                yield FewPeople(f"{given.footage}{way}", people, alone_m, guided_m)


def _draws(segments: Segments, people: int, frames: set[int]) -> list[np.ndarray]:
    """Rows of so many people of one frame, :data:`DRAWS` times or as often as they differ."""
    rng = np.random.default_rng(people)
    numbers, counts = np.unique(segments.frame, return_counts=True)
    enough = [n for n, count in zip(numbers, counts, strict=True) if count >= people]
    enough = [n for n in enough if int(n) in frames]
    drawn: dict[tuple[int, ...], np.ndarray] = {}
    for _ in range(4 * DRAWS if enough else 0):
        of_frame = np.flatnonzero(segments.frame == rng.choice(enough))
        rows = np.sort(rng.choice(of_frame, people, replace=False))
        drawn.setdefault(tuple(rows.tolist()), rows)
        if len(drawn) == DRAWS:
            break
    return list(drawn.values())
