"""VIRAT ground data set, release 2.0: ``CLIP.viratdata.objects.txt``.

Eight columns of integers, separated by blanks: object id, duration of its track, current frame,
left, top, width, height, type. What the README of the annotations says is certain: the columns,
that the box counts from the frame's left top corner, that an id is unique within a file while one
object may have several, that objects may be parked, and types 1 person, 2 car (passenger cars and
trucks), 3 vehicle (construction vehicles and the like), 4 object (mostly carried), 5 bicycle
(which may have an engine). It does not say where frames begin; readers of the release count from
0, as here. Type 0 is not in it either, but in files: unknown.

The files are recognised by name alone: eight numeric columns are MOTChallenge text too.
"""

from pathlib import Path

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.text import quoted, read_text
from scene4d.formats._numbers import check_rows, numeric_table, whole
from scene4d.formats.annotations._contract import AnnotationFormat, Rows

_SUFFIX = ".viratdata.objects.txt"
_CLASSES = ("unknown", "person", "car", "vehicle", "object", "bicycle")
"""By type, under the names of COCO and KPF where they have one."""
_MARK, _COLUMNS = ".viratdata.", 8


def _sniff(path: Path, head: str) -> bool:
    # Its other files (events, mapping) are claimed too: as MOTChallenge they would make no sense.
    return _MARK in path.name.lower()


def _check_layout(path: Path, text: str) -> None:
    name = path.name.lower()
    if _MARK in name and not name.endswith(_SUFFIX):
        objects = path.name[: name.index(_MARK)] + _SUFFIX
        raise InputError(f"holds no boxes of objects; expected {objects}")
    for number, line in enumerate(text.splitlines(), start=1):
        row = line.partition("#")[0]
        if not row.strip():
            continue
        if "," in row or ";" in row:
            raise InputError(
                f"line {number}: expected columns separated by blanks, found {quoted(row)}"
            )
        if len(row.split()) != _COLUMNS:
            raise InputError(
                f"line {number}: expected {_COLUMNS} columns (id, duration, frame, left, top, "
                f"width, height, type), found {len(row.split())}"
            )
        return


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    text = read_text(path)
    _check_layout(path, text)
    table, where = numeric_table(text, _COLUMNS)
    kind = whole(table[:, 7], "the type", where)
    check_rows(
        (kind >= 0) & (kind < len(_CLASSES)),
        where,
        lambda row: f"the type must be 0 to {len(_CLASSES) - 1}, found {kind[row]}",
    )
    corner = table[:, 3:5]
    found = Detections.from_boxes(
        image_size,
        whole(table[:, 2], "the frame number", where),
        np.hstack([corner, corner + table[:, 5:7]]),
        track=whole(table[:, 0], "the object id", where),
        class_name=np.array(_CLASSES)[kind],
    )
    return Rows(found, where)


FORMAT = AnnotationFormat("virat", "VIRAT release 2.0 viratdata.objects.txt", _sniff, _read)
