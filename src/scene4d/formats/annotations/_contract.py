"""What an annotation format is, and the checks that every annotation must pass."""

from collections.abc import Callable, Sequence
from dataclasses import dataclass
from pathlib import Path

import numpy as np
from jaxtyping import Bool

from scene4d.core.people import Detections
from scene4d.formats._choosing import ReadableFormat

_MOST_FRAMES = 20_000_000
"""Frames count below this: a week at 30 frames per second has 18,144,000. A larger number is a
time or an identifier, and stages that go through the frames would never end."""


@dataclass(frozen=True)
class Rows:
    """Every box of a file, before it is checked; ``where[row]`` says where in the file it is."""

    detections: Detections
    where: Sequence[str]


@dataclass(frozen=True)
class AnnotationFormat(ReadableFormat):
    """One annotation file format; an instance of it in the registry is all that a format needs.

    ``read(path, image_size)`` returns every box of the file in pixels of the footage, which
    :func:`first_fault` checks, with unknown times. Readers raise
    :class:`~scene4d.core.errors.InputError` naming the line; the registry adds the file.
    """

    read: Callable[[Path, tuple[int, int]], Rows]


def first_fault(rows: Rows) -> tuple[Bool[np.ndarray, "n"], str | None]:
    """Which rows are good, and what is wrong with the first that is not.

    Bad are boxes that are not finite, are empty or swapped, or lie wholly outside the image, and
    frames below 0 or beyond every recording. Boxes that the border cuts are good.
    """
    box, frame = rows.detections.box_xyxy, rows.detections.frame
    width, height = rows.detections.image_size
    with np.errstate(invalid="ignore"):
        ordered = (box[:, 2] > box[:, 0]) & (box[:, 3] > box[:, 1])
        # Pixel centres lie at integers: the image reaches from -0.5 to width - 0.5.
        inside = (box[:, 2] > -0.5) & (box[:, 3] > -0.5)
        inside &= (box[:, 0] < width - 0.5) & (box[:, 1] < height - 0.5)
    rules = (
        (np.isfinite(box).all(axis=1), "is not finite; expected four numbers"),
        (ordered, "is empty or swapped; expected x1 < x2 and y1 < y2"),
        (inside, f"lies wholly outside the {width}x{height} image; is the image size right?"),
        (frame >= 0, "has a negative frame number; expected 0 or more"),
        (frame < _MOST_FRAMES, f"has a frame number of {_MOST_FRAMES} or more"),
    )
    good = np.logical_and.reduce([rule for rule, _ in rules])
    if good.all():
        return good, None
    first = int(np.argmin(good))
    reason = next(text for rule, text in rules if not rule[first])
    corners = ", ".join(f"{x:g}" for x in box[first])
    return good, f"{rows.where[first]}: box (x1, y1, x2, y2) = ({corners}) {reason}"
