"""KITTI tracking labels, ``label_02/NNNN.txt``: one line per object and frame.

``frame track type truncated occluded alpha left top right bottom height width length x y z
rotation_y``, and a score in results; frames and pixels count from 0 (readme of the development
kit). The 3-D part is not read. ``DontCare`` regions are left out, and so are the files of the
object benchmark, which say nothing about their frame.
"""

import re
from pathlib import Path

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.text import floats, quoted, read_text
from scene4d.formats._numbers import lines_of, whole
from scene4d.formats.annotations._contract import AnnotationFormat, Rows

_CLASSES = {
    "Pedestrian": "person", "Person_sitting": "person", "Cyclist": "bicycle", "Car": "car",
    "Van": "car", "Truck": "truck", "Tram": "train", "Misc": "misc",
}  # fmt: skip
"""By type, under the names of COCO where they have one; a cyclist's box holds the bicycle too."""
_IGNORED = "DontCare"
_ROW = re.compile(rf"\s*\d+ -?\d+ ({'|'.join(_CLASSES)}|{_IGNORED}) ")
_TYPE = 2


def _sniff(path: Path, head: str) -> bool:
    return _ROW.match(head) is not None


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    where, names, rows = [], [], []
    for at, line in lines_of(read_text(path)):
        words = line.split()
        if words[_TYPE : _TYPE + 1] == [_IGNORED]:
            continue
        if len(words) not in (17, 18) or words[_TYPE] not in _CLASSES:
            raise InputError(
                f"{at}: expected 17 or 18 words, the third one of {', '.join(_CLASSES)}, "
                f"found {quoted(line)}"
            )
        where.append(at)
        names.append(_CLASSES[words.pop(_TYPE)])
        rows.append(floats([*words, "1"][:17], at))
    table = np.array(rows).reshape(-1, 17)
    found = Detections.from_boxes(
        image_size,
        whole(table[:, 0], "the frame number", where),
        table[:, 5:9],
        score=table[:, 16],
        track=whole(table[:, 1], "the track", where),
        class_name=np.array(names, dtype=str),
    )
    return Rows(found, where)


FORMAT = AnnotationFormat("kitti", "KITTI tracking labels", _sniff, _read)
