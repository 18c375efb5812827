"""The Oxford TownCentre data set: ``TownCentreGTHalfRes.csv`` and ``TownCentre-groundtruth.top``.

The bodies of the CSV are **circular**: they were made from the calibration and the head's
position, each 1.90 m tall, so they prove nothing about heights; their feet are good ground
positions.
"""

from itertools import compress
from pathlib import Path

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.text import read_text
from scene4d.formats._numbers import numeric_table, whole
from scene4d.formats.annotations._contract import AnnotationFormat, Rows

FULL, HALF = (1920, 1080), (960, 540)
_ASPECT_TOLERANCE = 0.01
_BODY_VALID, _BODY = 3, slice(8, 12)


def _scaled(box: np.ndarray, made_for: tuple[int, int], image_size: tuple[int, int]) -> np.ndarray:
    scale = np.array(image_size) / np.array(made_for)
    if abs(scale[0] / scale[1] - 1) > _ASPECT_TOLERANCE:
        raise InputError(
            f"the boxes are of {FULL[0]}x{FULL[1]} footage and cannot serve "
            f"{image_size[0]}x{image_size[1]}: the aspect ratio differs"
        )
    s = np.tile(scale, 2)
    return (box + 0.5) * s - 0.5


def _sniff_csv(path: Path, head: str) -> bool:
    return path.suffix.lower() == ".csv" and "halfres" in path.name.lower()


def _read_csv(path: Path, image_size: tuple[int, int]) -> Rows:
    """Columns: frame, person, left, top, width, height in pixels of 960x540, frames from 0."""
    table, where = numeric_table(read_text(path), 6)
    box = np.hstack([table[:, 2:4], table[:, 2:4] + table[:, 4:6]])
    found = Detections.from_boxes(
        image_size,
        whole(table[:, 0], "the frame number", where),
        _scaled(box, HALF, image_size),
        track=whole(table[:, 1], "the person number", where),
    )
    return Rows(found, where)


def _sniff_top(path: Path, head: str) -> bool:
    return path.suffix.lower() == ".top"


def _read_top(path: Path, image_size: tuple[int, int]) -> Rows:
    """Twelve columns: person, frame (from 0), headValid, bodyValid, head box, body box.

    Boxes are left, top, right, bottom in pixels of 1920x1080. Rows without a valid body are left
    out.
    """
    table, where = numeric_table(read_text(path), 12)
    valid = table[:, _BODY_VALID] != 0
    table, where = table[valid], list(compress(where, valid))
    found = Detections.from_boxes(
        image_size,
        whole(table[:, 1], "the frame number", where),
        _scaled(table[:, _BODY], FULL, image_size),
        track=whole(table[:, 0], "the person number", where),
    )
    return Rows(found, where)


CSV = AnnotationFormat(
    "towncentre-csv", "TownCentreGTHalfRes.csv (half resolution)", _sniff_csv, _read_csv
)
TOP = AnnotationFormat("towncentre-top", "TownCentre-groundtruth.top", _sniff_top, _read_top)
