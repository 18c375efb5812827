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
from scene4d.core.text import read_text
from scene4d.formats.annotations.boxes import Rows
from scene4d.formats.annotations.contract import AnnotationFormat

_PACKET = re.compile(r"""^\s*-\s*\{\s*['"]?(\w+)['"]?\s*:""")
_TRACK = re.compile(r"""\bid1['"]?\s*:\s*['"]?(\d{1,18})\b""")
_FRAME = re.compile(r"""\bts0['"]?\s*:\s*['"]?(\d{1,18})\b""")
_BOX = re.compile(r"""\bg0['"]?\s*:\s*['"]?\s*([^'",}]*)""")
_CLASSES = re.compile(r"""\bcset3['"]?\s*:\s*\{([^}]*)\}""")
_CLASS = re.compile(r"""([\w-]+)['"]?\s*:\s*([\d.eE+-]+)""")
_GEOM, _TYPES = ".geom.yml", ".types.yml"


def _sniff(path: Path, head: str) -> bool:
    return path.name.endswith(_GEOM) or re.search(r"\bg0['\"]?\s*:", head) is not None


def _packets(text: str, kind: str) -> list[tuple[int, str]]:
    """The numbered lines that hold a packet of this kind; ``meta`` and comments are let pass."""
    found = []
    for number, line in enumerate(text.splitlines(), start=1):
        if not line.strip() or line.lstrip().startswith(("#", "---")):
            continue
        packet = _PACKET.match(line)
        if packet is None:
            raise InputError(f"line {number}: expected one KPF packet, found {line.strip()[:60]!r}")
        if packet[1] == kind:
            found.append((number, line))
    return found


def _match(pattern: re.Pattern[str], field: str, number: int, line: str) -> str:
    match = pattern.search(line)
    if match is None:
        raise InputError(f"line {number}: field {field!r} is missing or is no number")
    return match[1]


def _types(path: Path) -> dict[int, str]:
    if not path.is_file():
        raise InputError(f"the classes of its tracks are missing: expected {path.name} beside it")
    names = {}
    for number, line in _packets(read_text(path), "types"):
        scores = _CLASS.findall(_match(_CLASSES, "cset3", number, line))
        if not scores:
            raise InputError(f"{path.name} line {number}: no class in 'cset3'")
        track = int(_match(_TRACK, "id1", number, line))
        names[track] = max(scores, key=lambda pair: float(pair[1]))[0]
    return names


def _corners(packets: list[tuple[int, str]]) -> np.ndarray:
    texts = [_match(_BOX, "g0", number, line) for number, line in packets]
    rows = [text.split() for text in texts]
    try:
        return np.array(rows, dtype=float).reshape(len(rows), 4)
    except ValueError as error:
        for (number, _), row in zip(packets, rows, strict=True):
            try:
                np.array(row, dtype=float).reshape(4)
            except ValueError:
                raise InputError(
                    f"line {number}: field 'g0' must be four numbers x1 y1 x2 y2, "
                    f"found {' '.join(row)!r}"
                ) from error
        raise


def _read(path: Path, image_size: tuple[int, int]) -> Rows:
    packets = _packets(read_text(path), "geom")
    names = _types(path.with_name(path.name.removesuffix(_GEOM) + _TYPES))
    track = np.array([int(_match(_TRACK, "id1", *p)) for p in packets], dtype=np.int64)
    unknown = [i for i, t in enumerate(track.tolist()) if t not in names]
    if unknown:
        number = packets[unknown[0]][0]
        raise InputError(f"line {number}: track {track[unknown[0]]} has no class in the types file")
    found = Detections.from_boxes(
        image_size,
        np.array([int(_match(_FRAME, "ts0", *p)) for p in packets], dtype=np.int64),
        _corners(packets),
        track=track,
        class_name=np.array([names[t] for t in track.tolist()], dtype=str),
    )
    return Rows(found, lambda i: f"line {packets[i][0]}")


FORMAT = AnnotationFormat(
    name="kpf",
    description="KPF geom.yml with types.yml (MEVA)",
    patterns=("*.geom.yml",),
    sniff=_sniff,
    read=_read,
)
