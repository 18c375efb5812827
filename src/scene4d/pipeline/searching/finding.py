"""Events of activities in stages, with their frames."""

from collections.abc import Iterable, Iterator, Sequence
from dataclasses import dataclass

import numpy as np

from scene4d.activities.definition import Activity
from scene4d.activities.events import Event
from scene4d.activities.search import MIN_SCORE, find
from scene4d.pipeline.searching.staging import Staged


@dataclass(frozen=True, eq=False)
class Found:
    """An event, the stage that it was found in, and its first and last frame."""

    event: Event
    staged: Staged
    begin_frame: int
    end_frame: int


def found_in(
    staged: Iterable[Staged], activities: Sequence[Activity], *, min_score: float = MIN_SCORE
) -> Iterator[Found]:
    """Events with at least ``min_score``, stage by stage and activity by activity.

    A stage where a role has nobody to play it holds no event: one clip without a vehicle is no
    error.
    """
    for one in staged:
        there = set(np.unique(one.stage.tracks.class_name).tolist())
        for activity in activities:
            if not all(there & set(role.classes) for role in activity.roles):
                continue
            for event in find(one.stage, activity, min_score=min_score):
                begin, end = one.frame_at(event.begin_s), one.frame_at(event.end_s)
                yield Found(event, one, begin, end)
