"""PETS XML (CVML): frames from 0, boxes as centre and size in pixels, one id per track."""

from pathlib import Path
from xml.etree.ElementTree import Element

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.text import parse_xml, quoted, read_text
from scene4d.formats._numbers import all_numbers
from scene4d.formats.annotations._contract import AnnotationFormat, Rows

_BOX = ("xc", "yc", "w", "h")
_MOST_DIGITS = 18  # what 64 bits hold


def _sniff(path: Path, head: str) -> bool:
    return "<frame" in head and "<objectlist" in head


def _integer(element: Element, name: str, where: str) -> int:
    text = element.get(name, "")
    if not text.lstrip("-").isdecimal() or len(text) > _MOST_DIGITS:
        raise InputError(f"{where}: {name} must be a whole number, found {quoted(text)}")
    return int(text)


def _corners(box: Element, where: str) -> list[float]:
    texts = [box.get(name, "") for name in _BOX]
    if not all_numbers(texts):
        raise InputError(f"{where}: the box needs numbers xc, yc, w, h, found {quoted(box.attrib)}")
    x, y, width, height = map(float, texts)
    return [x - width / 2, y - height / 2, x + width / 2, y + height / 2]


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    frames, tracks, boxes, where = [], [], [], []
    for i, frame in enumerate(parse_xml(read_text(path)).iter("frame"), start=1):
        number = _integer(frame, "number", f"<frame> {i}")
        for one in frame.iter("object"):
            track = _integer(one, "id", f"frame {number}: <object>")
            for box in one.iter("box"):
                where.append(f"frame {number}, object {track}")
                boxes.append(_corners(box, where[-1]))
                frames.append(number)
                tracks.append(track)
    found = Detections.from_boxes(
        image_size,
        np.array(frames, dtype=np.int64),
        np.array(boxes, dtype=float).reshape(-1, 4),
        track=np.array(tracks, dtype=np.int64),
    )
    return Rows(found, where)


FORMAT = AnnotationFormat("pets", "PETS XML", _sniff, _read)
