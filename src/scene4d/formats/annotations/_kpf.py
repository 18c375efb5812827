"""KPF (KWIVER packet format), as MEVA has it: ``NAME.geom.yml`` beside ``NAME.types.yml``.

One packet per line: ``id1`` the track, ``ts0`` the frame from 0, ``g0: x1 y1 x2 y2``, with or
without quotes around keys and values. The class of a track is the most probable one of ``cset3``.
Files reach hundreds of thousands of lines, so they are read by patterns and not by a YAML parser.
"""

import re
from pathlib import Path

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.people import Detections
from scene4d.core.text import floats, quoted, read_text
from scene4d.formats._numbers import all_numbers, lines_of
from scene4d.formats.annotations._contract import AnnotationFormat, Rows

_PACKET = re.compile(r"""^\s*-\s*\{\s*['"]?(\w+)['"]?\s*:""")
_TRACK = re.compile(r"""\bid1['"]?\s*:\s*['"]?(\d{1,18})\b""")
_FRAME = re.compile(r"""\bts0['"]?\s*:\s*['"]?(\d{1,18})\b""")
_BOX = re.compile(r"""\bg0['"]?\s*:\s*['"]?\s*([^'",}]*)""")
_CLASSES = re.compile(r"""\bcset3['"]?\s*:\s*\{([^}]*)\}""")
_CLASS = re.compile(r"""([\w-]+)['"]?\s*:\s*([^,\s]+)""")
_GEOM, _TYPES = ".geom.yml", ".types.yml"


def _sniff(path: Path, head: str) -> bool:
    return path.name.endswith(_GEOM) or re.search(r"\bg0['\"]?\s*:", head) is not None


def _packets(text: str, kind: str) -> list[tuple[str, str]]:
    """The lines that hold a packet of this kind; ``meta`` and comments are let pass."""
    found = []
    for where, line in lines_of(text, ("#", "---")):
        packet = _PACKET.match(line)
        if packet is None:
            raise InputError(f"{where}: expected one KPF packet, found {quoted(line.strip())}")
        if packet[1] == kind:
            found.append((where, line))
    return found


def _match(pattern: re.Pattern[str], field: str, where: str, line: str) -> str:
    match = pattern.search(line)
    if match is None:
        raise InputError(f"{where}: field {field!r} is missing or is no number")
    return match[1]


def _types(path: Path) -> dict[int, str]:
    """The most probable class of each track."""
    if not path.is_file():
        raise InputError(f"the classes of its tracks are missing: expected {path.name} beside it")
    classes = {}
    for at, line in _packets(read_text(path), "types"):
        found = _CLASS.findall(_match(_CLASSES, "cset3", at, line))
        where = f"{path.name} {at}"
        if not found:
            raise InputError(f"{where}: no class in 'cset3'")
        names, scores = zip(*found, strict=True)
        best = int(np.argmax(floats(scores, f"{where}: field 'cset3'")))
        classes[int(_match(_TRACK, "id1", at, line))] = names[best]
    return classes


def _corners(text: str, where: str) -> np.ndarray:
    corners = text.split()
    if len(corners) != 4 or not all_numbers(corners):
        raise InputError(
            f"{where}: field 'g0' must be four numbers x1 y1 x2 y2, found {quoted(text)}"
        )
    return np.array(corners, dtype=float)


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    packets = _packets(read_text(path), "geom")
    names = _types(path.with_name(path.name.removesuffix(_GEOM) + _TYPES))
    where = [at for at, _ in packets]
    boxes = [_corners(_match(_BOX, "g0", *p), at) for p, at in zip(packets, where, strict=True)]
    track = [int(_match(_TRACK, "id1", *p)) for p in packets]
    unknown = next((i for i, t in enumerate(track) if t not in names), None)
    if unknown is not None:
        raise InputError(f"{where[unknown]}: track {track[unknown]} has no class in the types file")
    found = Detections.from_boxes(
        image_size,
        np.array([int(_match(_FRAME, "ts0", *p)) for p in packets], dtype=np.int64),
        np.array(boxes).reshape(-1, 4),
        track=np.array(track, dtype=np.int64),
        class_name=np.array([names[t] for t in track], dtype=str),
    )
    return Rows(found, where)


FORMAT = AnnotationFormat("kpf", "KPF geom.yml with types.yml (MEVA)", _sniff, _read)
