"""How tall somebody is seen, against how tall the same one stands.

Constants were chosen on the tuning cameras (MEVA G341 and G424).
"""

import numpy as np
from jaxtyping import Float, Int

from scene4d.core.body import BORDER_PX
from scene4d.searching.predicates._gaussian import ndtr
from scene4d.searching.predicates._meeting import expand
from scene4d.searching.predicates.stage import Stage, StageRows

_STOOPING_SHARE = 0.9
_SOFTNESS = 0.05
"""How vague the word is, as a share of the standing height."""
_EDGE_SHARE = 0.02
"""How far an edge of a box is off, as a share of the box."""
_EDGE_PX = 1.0
"""And at least by so many pixels."""
_STANDING = 0.75
"""Quantile of a track's heights that counts as its standing height: people stoop for a while."""


def stooping(a: StageRows, *, share: float = _STOOPING_SHARE) -> Float[np.ndarray, "m"]:
    """P(a is seen less tall than ``share`` of its own standing height): it bends, sits down, climbs
    into something, or something low hides its feet.

    The height is that of the box over what a metre of an upright thing measures in the picture at
    a's place, so that walking away is no stooping; the standing height is the upper quartile over
    the track. With the ratio q, ``Φ((share - q) / √(σ² + 2 s²))``: σ is :data:`_SOFTNESS`, s the
    error of a box's edge (2 % of the box, at least a pixel), for each of two edges. Errors of the
    position that last along a track cancel in the ratio; others are not counted. Without a camera
    heights in the picture are compared as they are. NaN where a was not seen, has no position, or
    the picture's upper or lower border may cut the box.
    """
    rows, track = _tracks_of(a)
    height_m = _heights_m(a.stage, rows)
    standing_m = _upper_quartile(height_m, track)
    position = np.searchsorted(rows, a.index)
    box = a.box_xyxy
    with np.errstate(divide="ignore", invalid="ignore"):
        ratio = height_m[position] / standing_m[track[position]]
        edge = np.maximum(_EDGE_SHARE, _EDGE_PX / (box[:, 3] - box[:, 1]))
    return np.asarray(ndtr((share - ratio) / np.sqrt(_SOFTNESS**2 + 2 * edge**2)))


def _tracks_of(a: StageRows) -> tuple[Int[np.ndarray, "n"], Int[np.ndarray, "n"]]:
    """All rows of the tracks that ``a`` speaks of, ascending, and whose they are, from 0 on."""
    stage = a.stage
    tracks = np.unique(stage.track_of_row[a.index])
    first, count = stage.first_row[tracks], (stage.last_row - stage.first_row + 1)[tracks]
    track, rows = expand(first, count)
    return rows, track


def _heights_m(stage: Stage, rows: Int[np.ndarray, "n"]) -> Float[np.ndarray, "n"]:
    box = stage.tracks.box_xyxy[rows]
    whole = (box[:, 1] > BORDER_PX) & (box[:, 3] < stage.image_size[1] - 1 - BORDER_PX)
    seen = stage.tracks.observed[rows] & whole
    height = np.where(seen, box[:, 3] - box[:, 1], np.nan)
    px_per_m = stage.px_per_m(rows)  # 0 of somebody who stands right below the camera
    return np.asarray(height / np.where(px_per_m > 0, px_per_m, np.nan))


def _upper_quartile(
    values: Float[np.ndarray, "n"], track: Int[np.ndarray, "n"]
) -> Float[np.ndarray, "t"]:
    """Of the known values of each track, the upper one between two; NaN where there is none."""
    known = np.flatnonzero(np.isfinite(values))
    order = known[np.lexsort([values[known], track[known]])]
    count = np.bincount(track[known], minlength=int(track.max(initial=-1)) + 1)
    at = np.cumsum(count) - count + np.ceil(_STANDING * (count - 1)).astype(int)
    found = np.full(len(count), np.nan)
    found[count > 0] = values[order[at[count > 0]]]
    return found
