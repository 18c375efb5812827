"""MOTChallenge text: ``frame, id, left, top, width, height, confidence, ...``, frames from 1.

Two layouts. *Detections and tracks*: 6 to 10 columns, id -1 where unknown, the seventh column is
the score; pixels are taken as written, since programs count them from 0. *Ground truth*: nine
columns, or a file named ``gt*``: the seventh column is a flag, and rows with 0 (objects that the
benchmark ignores) are left out; with nine columns the eighth is the class, and pixels count from
1, as the benchmark defines (Leal-Taixé et al. 2015, section 3).
"""

import re
from itertools import compress
from pathlib import Path

import numpy as np

from scene4d.core.people import Detections
from scene4d.core.text import read_text
from scene4d.formats._numbers import check_rows, numeric_table, whole
from scene4d.formats.annotations._contract import AnnotationFormat, Rows

# Milan et al. (2016), MOT16, table of classes; the first ones under the names of COCO.
_CLASSES = (
    "person", "person_on_vehicle", "car", "bicycle", "motorcycle", "non_motorized_vehicle",
    "static_person", "distractor", "occluder", "occluder_on_ground", "occluder_full",
    "reflection", "crowd",
)  # fmt: skip
_ROW = re.compile(r"\s*[\d.+-][\d.eE+-]*(\s*[,;\s]\s*[\d.eE+-]+){5,9}\s*$")


def _sniff(path: Path, head: str) -> bool:
    first = next((line for line in head.splitlines() if line.partition("#")[0].strip()), "")
    return _ROW.match(first.partition("#")[0]) is not None


def _class_names(codes: np.ndarray, where: list[str]) -> np.ndarray:
    good = (codes >= 1) & (codes <= len(_CLASSES))
    last = len(_CLASSES)
    check_rows(good, where, lambda row: f"class must be 1 to {last}, found {codes[row]}")
    return np.array(_CLASSES)[codes - 1]


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    table, where = numeric_table(read_text(path), 6)
    columns = table.shape[1]
    truth = columns == 9 or (columns > 6 and path.stem.lower().startswith("gt"))
    if truth:
        considered = table[:, 6] != 0
        table, where = table[considered], list(compress(where, considered))
    frame = whole(table[:, 0], "the frame number", where)
    check_rows(frame >= 1, where, lambda row: f"frames count from 1, found {frame[row]}")
    corner = table[:, 2:4] - (1.0 if columns == 9 else 0.0)
    score = np.ones(len(table)) if truth or columns == 6 else table[:, 6]
    check_rows(np.isfinite(score), where, lambda _: "confidence is not finite")
    names = None
    if columns == 9:
        names = _class_names(whole(table[:, 7], "the class", where), where)
    found = Detections.from_boxes(
        image_size,
        frame - 1,
        np.hstack([corner, corner + table[:, 4:6]]),
        score=score,
        track=np.maximum(whole(table[:, 1], "the id", where), -1),
        class_name=names,
    )
    return Rows(found, where)


FORMAT = AnnotationFormat("mot", "MOTChallenge text", _sniff, _read)
