"""KPF (KWIVER packet format), as MEVA has it: ``NAME.geom.yml`` beside ``NAME.types.yml``.

One packet per line: in ``geom`` ``id1`` the track, ``id0`` a number of its own for each box,
``ts0`` the frame from 0 and ``g0`` the box x1 y1 x2 y2 in pixels of the footage, to 1/1000 px;
in ``types`` the share of its boxes that had each class as ``cset3``. Rows without a box (bridged
gaps) are left out, and so is everything that is not in the image. Lines are ordered by frame, then
by track.
"""

import re
from collections import Counter
from collections.abc import Iterator

import numpy as np

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes._contract import SceneFormat, SceneTable
from scene4d.formats.scenes._pieces import in_frame_order
from scene4d.formats.scenes._values import PIXELS, chunks, rounded

_GEOM, _TYPES = ".geom.yml", ".types.yml"
_CLASS = re.compile(r"[\w-]+")
_BOX = "- {'geom': {'g0': '%r %r %r %r', 'id0': %d, 'id1': %d, 'ts0': %d}}\n"
_SHARE = 4


def _write(pieces: Iterator[SceneTable]) -> Iterator[tuple[str, bytes]]:
    classes: Counter[tuple[int, str]] = Counter()
    boxes = 0
    for number, piece in enumerate(in_frame_order(pieces)):
        if number == 0:
            yield from ((suffix, _meta(piece)) for suffix in (_GEOM, _TYPES))
        for part in chunks(piece.tracks.select(np.isfinite(piece.tracks.box_xyxy).all(axis=1))):
            classes.update(zip(part.track.tolist(), part.class_name.tolist(), strict=True))
            yield _GEOM, _boxes(part, boxes)
            boxes += len(part)
    if not boxes:
        raise InputError("kpf: no row has a box, and the format holds boxes; export csv instead")
    yield _TYPES, _types(classes)


def _meta(piece: SceneTable) -> bytes:
    width, height = piece.image_size
    camera = re.sub(r"[^\w.-]", "_", piece.camera)
    return f"- {{'meta': 'scene4d, camera {camera}, {width}x{height} pixels'}}\n".encode()


def _boxes(tracks: Tracks, first_id: int) -> bytes:
    numbers = np.arange(first_id, first_id + len(tracks)).tolist()
    corners = rounded(tracks.box_xyxy, PIXELS).T.tolist()
    rows = zip(*corners, numbers, tracks.track.tolist(), tracks.frame.tolist(), strict=True)
    return "".join([_BOX % row for row in rows]).encode()


def _types(classes: Counter[tuple[int, str]]) -> bytes:
    names = sorted({name for _, name in classes})
    bad = [name for name in names if not _CLASS.fullmatch(name)]
    if bad:
        raise InputError(
            f"kpf: the class {bad[0]!r} cannot be written; expected letters, digits, _ and - only"
        )
    of_track: dict[int, list[tuple[str, int]]] = {}
    for (track, name), count in sorted(classes.items()):
        of_track.setdefault(track, []).append((name, count))
    lines = []
    for track, counts in of_track.items():
        total = sum(count for _, count in counts)
        shares = ", ".join(f"'{name}': {round(n / total, _SHARE)}" for name, n in counts)
        lines.append(f"- {{'types': {{'cset3': {{{shares}}}, 'id1': {track}}}}}\n")
    return "".join(lines).encode()


FORMAT = SceneFormat("kpf", "KPF geom.yml with types.yml (MEVA)", (_GEOM, _TYPES), _write)
