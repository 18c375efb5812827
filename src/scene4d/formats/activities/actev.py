"""ActEV JSON: a system's output for NIST's ActEV_Scorer (protocols ActEV19_AD, ActEV_SDL_V2).

``filesProcessed`` names every file that was searched, ``processingReport`` says of each that it
succeeded, ``activities`` are the instances: ``activity``,
``activityID`` from 1, ``presenceConf``, and ``localization``, which maps the file to a signal over
its frames: 1 from the first frame on, 0 from the frame behind the last one.
"""

import re
from collections.abc import Iterable, Sequence
from dataclasses import dataclass
from typing import Any

import numpy as np

from scene4d.core.errors import InputError

_FILE = re.compile(r"[A-Za-z0-9_\-.]+")


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

    Raises :class:`InputError` for names of files that the scorer refuses (it takes letters, digits,
    ``_ - .``), for an instance in another file, one that ends before it begins, and a confidence
    that is no number.
    """
    for file in files:
        if not _FILE.fullmatch(file):
            raise InputError(
                f"actev: file {file!r}: the scorer takes letters, digits, '_', '-' and '.' only"
            )
    known = set(files)
    activities = []
    for number, one in enumerate(instances, start=1):
        if one.file not in known:
            raise InputError(f"actev: {one.activity} is in file {one.file!r}, which is not named")
        if one.end_frame < one.begin_frame:
            raise InputError(
                f"actev: {one.activity} ends at frame {one.end_frame}, before it begins at "
                f"{one.begin_frame}"
            )
        if not np.isfinite(one.confidence):
            raise InputError(f"actev: {one.activity} has the confidence {one.confidence}")
        signal = {str(one.begin_frame): 1, str(one.end_frame + 1): 0}
        activities.append(
            {
                "activity": one.activity,
                "activityID": number,
                "presenceConf": float(one.confidence),
                "localization": {one.file: signal},
            }
        )
    statuses = {file: {"status": "success", "message": ""} for file in files}
    return {
        "filesProcessed": list(files),
        "processingReport": {"fileStatuses": statuses},
        "activities": activities,
    }
