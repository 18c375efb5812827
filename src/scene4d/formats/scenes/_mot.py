"""MOTChallenge text: ``frame, id, left, top, width, height, conf, x, y, z``, in that order.

The ten columns of Leal-Taixé et al. (2015), table 2: frames count from 1, x and y are metres on
the ground of the scene's world, z is the height of that (0 where unknown), and -1, -1, -1 stands
where there is no position. Pixels are those of the footage, counted from 0 as everywhere in this
package, to 1/1000 px. Rows without a box (bridged gaps) are left out; a box whose score nobody
knows gets 1. Classes have no column. Lines are ordered by frame, then by id.
Readers take conf for a flag where the file is called ``gt.txt``, so better call it otherwise.
"""

from collections.abc import Iterator

import numpy as np
from arro3.core import Array

from scene4d.core.errors import InputError
from scene4d.core.tracks import Tracks
from scene4d.formats.scenes._contract import SceneFormat, SceneTable
from scene4d.formats.scenes._pieces import in_frame_order
from scene4d.formats.scenes._values import METRES, PIXELS, SCORE, chunks, column, csv_lines

_SUFFIX = ".txt"


def _write(pieces: Iterator[SceneTable]) -> Iterator[tuple[str, bytes]]:
    boxes = 0
    for piece in in_frame_order(pieces):
        tracks = piece.tracks.select(np.isfinite(piece.tracks.box_xyxy).all(axis=1))
        boxes += len(tracks)
        for part in chunks(tracks):
            yield _SUFFIX, csv_lines(_columns(part), header=False)
    if not boxes:
        raise InputError("mot: no row has a box, and the format holds boxes; export csv instead")


def _columns(tracks: Tracks) -> dict[str, Array]:
    box = tracks.box_xyxy
    left_top_size = np.hstack([box[:, :2], box[:, 2:] - box[:, :2]])
    placed = np.isfinite(tracks.xy_m).all(axis=1)
    xyz = np.column_stack([tracks.xy_m, np.nan_to_num(tracks.z_m)])
    world = np.where(placed[:, None], xyz, -1.0)
    score = np.where(np.isfinite(tracks.score), tracks.score, 1.0)
    numbers = {
        **{f"box{i}": column(left_top_size[:, i], PIXELS) for i in range(4)},
        "conf": column(score, SCORE),
        **{f"world{i}": column(world[:, i], METRES) for i in range(3)},
    }
    return {
        "frame": Array.from_numpy(tracks.frame + 1),
        "id": Array.from_numpy(np.ascontiguousarray(tracks.track)),
        **numbers,
    }


FORMAT = SceneFormat(
    "mot",
    "MOTChallenge text, world coordinates in the last three columns",
    (_SUFFIX,),
    _write,
)
