"""Footage of a camera that hangs upside down or lies on its side.

Detectors hardly see people who are not upright in the picture, so such footage looks empty. Where
few people are found, some frames are looked at again with the picture turned.
"""

from collections.abc import Sequence
from dataclasses import replace
from typing import TYPE_CHECKING

import numpy as np

from scene4d.calibration._segments import person_segments
from scene4d.core.people import Detections

if TYPE_CHECKING:
    from scene4d.perception.people import PeopleDetector

_TURNS = {1: "90° anticlockwise", 2: "180°", 3: "90° clockwise"}
"""Quarter turns of :func:`numpy.rot90`."""
_MOST_FRAMES = 16
_FEW_PER_FRAME = 0.5
"""With fewer whole people per frame the frames are looked at again. Ten recordings show 0.7 to 16
upright, and 0 to 0.2 turned."""
_TIMES = 4
_LEAST = 4
"""A turned picture must show at least so many whole people, and so many times those that it shows
unturned: in an empty street chance finds one or two either way."""


def turned_footage(
    people: "PeopleDetector", images_bgr: Sequence[np.ndarray], whole: int, frames: int
) -> str | None:
    """Why the footage must be turned, as a sentence with the remedy; None if it is upright.

    ``whole`` people were seen from head to foot in ``frames``; ``images_bgr`` are some of these.
    """
    if whole >= _FEW_PER_FRAME * frames or not images_bgr:
        return None
    step = -(-len(images_bgr) // _MOST_FRAMES)
    shown = images_bgr[::step]
    untracked = replace(people, tracker=None)
    found = {turn: _whole(untracked, [np.rot90(i, turn) for i in shown]) for turn in (0, *_TURNS)}
    best = max(_TURNS, key=lambda turn: found[turn])
    if found[best] < max(_LEAST, _TIMES * found[0]):
        return None
    other = " (top to bottom if writing is mirrored then)" if best == 2 else ""
    return (
        f"turned by {_TURNS[best]}, {len(shown)} frames show {found[best]} people from head to "
        f"foot, and {found[0]} as they are; turn the footage, or the picture in the camera's "
        f"settings, by {_TURNS[best]}{other}"
    )


def _whole(people: "PeopleDetector", images_bgr: list[np.ndarray]) -> int:
    from scene4d.video.frames import Frame

    looks = [
        people.look(Frame(index, float("nan"), np.ascontiguousarray(image)))
        for index, image in enumerate(images_bgr)
    ]
    return len(person_segments(Detections.concatenate(looks)))
