"""ActEV JSON: a system's output for NIST's ActEV_Scorer (protocols ActEV19_AD, ActEV_SDL_V2).

``filesProcessed`` names every file that was searched, ``processingReport`` says of each that it
succeeded, ``activities`` are the instances: ``activity``, ``activityID`` from 1, ``presenceConf``,
and ``localization``, which maps the file to a signal over its frames: 1 from the first frame on, 0
from the frame behind the last one.
"""

from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any


@dataclass(frozen=True)
class ActevInstance:
    """One thing that happened in one file, from its first to its last frame, both included."""

    activity: str
    file: str
    begin_frame: int
    end_frame: int
    confidence: float


def actev_json(instances: Iterable[ActevInstance], files: Sequence[str]) -> dict[str, Any]:
    """What the scorer reads, ready for ``json.dumps``; ``files`` are all that were searched.

    The scorer takes letters, digits, ``_``, ``-`` and ``.`` in the names of files.
    """
    activities = [
        {
            "activity": one.activity,
            "activityID": number,
            "presenceConf": float(one.confidence),
            "localization": {one.file: {str(one.begin_frame): 1, str(one.end_frame + 1): 0}},
        }
        for number, one in enumerate(instances, start=1)
    ]
    statuses = {file: {"status": "success", "message": ""} for file in files}
    return {
        "filesProcessed": list(files),
        "processingReport": {"fileStatuses": statuses},
        "activities": activities,
    }
