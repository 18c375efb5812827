"""Where a detector of small input should look twice: tiles of the picture."""

from collections.abc import Callable
from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float, Int

from scene4d.core.errors import InputError

ExpectedPersonPx = Callable[[np.ndarray], np.ndarray] | Float[np.ndarray, "h"]
"""Height in pixels of a person whose feet are at an image row: a function of rows, or one per row.

NaN (or a value not above 0) where nobody can stand, such as above the horizon.
"""

INPUT_PX = 416
"""Side of YOLOX-tiny's square input."""
_TILE_PX = 640
_OVERLAP_SHARE = 0.2
_REFERENCE_PX = 1920
"""Images longer than this get tiles larger in proportion, so their number stays at most 4 x 4."""
_SMALL_PX = 20.0
"""Height in the network's input from which recall is whole: PETS frames shrunk step by step gave
0.95-0.97 from 20 px on, 0.84 at 18 px, 0.66 at 14 px and 0.35 at 10 px."""
_HOPELESS_PX = 10.0
_MIN_GAIN = 1.3
"""Tiles that would show people less than this much larger than the whole frame are not worth it."""

_CUT_PX = 3.0
_CUT_SHARE = 0.03


@dataclass(frozen=True)
class Sight:
    """What a network sees: its input's longer side, a tile's side, and how small things may be.

    Recall is whole for things ``small_px`` high in the network's input; below ``hopeless_px``
    a tile does not help either. The defaults are those of YOLOX-tiny.
    """

    input_px: int = INPUT_PX
    tile_px: int = _TILE_PX
    small_px: float = _SMALL_PX
    hopeless_px: float = _HOPELESS_PX

    @classmethod
    def of_input(cls, input_px: int) -> "Sight":
        """The same enlargement in the tiles for a network with another input."""
        return cls(input_px=input_px, tile_px=round(_TILE_PX * input_px / INPUT_PX))


_YOLOX_TINY = Sight()


def tile_grid(image_size: tuple[int, int], tile_px: int = _TILE_PX) -> Int[np.ndarray, "n 4"]:
    """Tiles (x1, y1, x2, y2), last pixel excluded, that cover an image (width, height).

    Neighbours share a fifth of their side at least (128 of 640 px); none reaches outside.
    """
    step = tile_px - round(tile_px * _OVERLAP_SHARE)
    starts = []
    for length in image_size:
        size = min(tile_px, length)
        count = 1 + -(-(length - size) // step)
        starts.append((size, np.linspace(0, length - size, count).round().astype(np.int64)))
    (width, xs), (height, ys) = starts
    x, y = (a.ravel() for a in np.meshgrid(xs, ys))
    return np.column_stack([x, y, x + width, y + height])


def cut_by_tile(
    box_xyxy: Float[np.ndarray, "n 4"], tile: Int[np.ndarray, "4"], image_size: tuple[int, int]
) -> Bool[np.ndarray, "n"]:
    """Boxes (n,) that end at a border of the tile which is not a border of the image."""
    side = np.maximum(box_xyxy[:, 2] - box_xyxy[:, 0], box_xyxy[:, 3] - box_xyxy[:, 1])
    margin = np.maximum(_CUT_PX, _CUT_SHARE * side)[:, None]
    inner = np.array([tile[0] > 0, tile[1] > 0, tile[2] < image_size[0], tile[3] < image_size[1]])
    near = np.abs(box_xyxy - (tile - 0.5)) < margin
    return (near & inner).any(axis=1)


def choose_tiles(
    image_size: tuple[int, int],
    expected_person_px: ExpectedPersonPx | None = None,
    *,
    use: bool | None = None,
    sight: Sight = _YOLOX_TINY,
) -> Int[np.ndarray, "n 4"]:
    """Tiles to look at besides the whole frame of (width, height); none where it shows enough.

    ``use`` None decides by the image's size and the network's ``sight``. With
    ``expected_person_px``, only those tiles are left in which a whole person too small for the
    whole frame fits, and their side follows the smallest such person. Raises :class:`InputError`
    where it has not one value per row.
    """
    none = np.empty((0, 4), np.int64)
    longest = max(image_size)
    if not (longest >= _MIN_GAIN * sight.tile_px if use is None else use):
        return none
    tile_px = round(sight.tile_px * max(1.0, longest / _REFERENCE_PX))
    if longest <= tile_px:
        return none
    if expected_person_px is None:
        return tile_grid(image_size, tile_px)
    height = _expected_heights(expected_person_px, image_size[1])
    with np.errstate(invalid="ignore"):
        small = height * sight.input_px < sight.small_px * longest
        needs_tile = small & (height * sight.input_px >= sight.hopeless_px * sight.tile_px)
    if not needs_tile.any():
        return none
    wanted_px = height[needs_tile].min() * sight.input_px / sight.small_px
    tiles = tile_grid(image_size, round(float(np.clip(wanted_px, sight.tile_px, tile_px))))
    foot = np.flatnonzero(needs_tile)
    head = np.maximum(foot - height[needs_tile], 0)
    useful = (foot < tiles[:, 3, None]) & (head >= tiles[:, 1, None])
    return tiles[useful.any(axis=1)]


def _expected_heights(expected: ExpectedPersonPx, rows: int) -> np.ndarray:
    values = expected(np.arange(rows, dtype=float)) if callable(expected) else expected
    height = np.asarray(values, float)
    if height.shape != (rows,):
        raise InputError(
            f"expected_person_px: found shape {height.shape}, expected one height per image row "
            f"({rows},)"
        )
    return height
