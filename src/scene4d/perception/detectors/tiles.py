"""Detectors of small input look twice: at the whole picture, and at tiles where it shows little."""

import copy
from abc import ABC, abstractmethod
from collections.abc import Callable
from dataclasses import dataclass
from typing import NamedTuple

import numpy as np
import supervision as sv
from jaxtyping import Bool, Float, Float32, Int, UInt8

from scene4d.core.errors import InputError
from scene4d.perception.detectors._base import require_bgr

ExpectedPersonPx = Callable[[np.ndarray], np.ndarray] | Float[np.ndarray, "h"]
"""Height in pixels of a person whose feet are at an image row: a function of rows, or one per row.

NaN (or a value not above 0) where nobody can stand, such as above the horizon.
"""

INPUT_PX = 416
"""Side of YOLOX-tiny's square input."""
_TILE_PX = 640
"""Side of a tile for that input, chosen by hand: eight tiles cover full HD."""
_OVERLAP_SHARE = 0.2
"""Share of a tile's side that neighbours have in common: chosen by hand."""
_REFERENCE_PX = 1920
"""Images longer than this get tiles larger in proportion, so their number stays at most 4 x 4."""
_SMALL_PX = 20.0
"""Height in the network's input from which recall is whole: PETS frames shrunk step by step gave
0.95-0.97 from 20 px on, 0.84 at 18 px, 0.66 at 14 px and 0.35 at 10 px."""
_HOPELESS_PX = 10.0
"""Height below which a tile does not help either: recall 0.35 in the same series."""
_MIN_GAIN = 1.3
"""Tiles that would show people less than this much larger than the whole frame are not worth it:
chosen by hand."""
_CUT_PX = 3.0
_CUT_SHARE = 0.03
"""A box ends at a border if it comes so near (pixels, and share of its longer side): chosen by
hand above the jitter of YOLOX-tiny's boxes."""
_NMS_IOU = 0.5
"""Boxes that overlap more are one object, seen twice: the customary threshold."""


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
    sight: Sight = _YOLOX_TINY,
) -> Int[np.ndarray, "n 4"]:
    """Tiles to look at besides the whole frame of (width, height); none where it shows enough.

    With ``expected_person_px``, only those tiles are left in which a whole person too small for
    the whole frame fits, and their side follows the smallest such person. Raises
    :class:`InputError` where it has not one value per row.
    """
    none = np.empty((0, 4), np.int64)
    longest = max(image_size)
    if longest < _MIN_GAIN * sight.tile_px:
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


class Boxes(NamedTuple):
    """What a network says of one picture: boxes (n, 4), scores (n,) and class numbers (n,)."""

    xyxy: np.ndarray
    score: np.ndarray
    label: np.ndarray

    def select(self, rows: np.ndarray) -> "Boxes":
        """The given rows, as a mask or as indices."""
        return Boxes(self.xyxy[rows], self.score[rows], self.label[rows])

    def clipped(self, width: int, height: int) -> "Boxes":
        """Boxes cut at the borders of the picture; those with nothing inside are left out."""
        xyxy = self.xyxy.copy()
        xyxy[:, 0::2] = xyxy[:, 0::2].clip(-0.5, width - 0.5)
        xyxy[:, 1::2] = xyxy[:, 1::2].clip(-0.5, height - 0.5)
        some = (xyxy[:, 2] > xyxy[:, 0]) & (xyxy[:, 3] > xyxy[:, 1])
        return Boxes(xyxy, self.score, self.label).select(some)


class TiledDetector(ABC):
    """Looks at the whole frame and, where it shows things too small, at tiles of it.

    Boxes are pixels of the image given, pixel centres at integers. Tiles are used where they show
    things clearly larger than the whole frame does; ``expected_person_px`` restricts them to where
    people (and vehicles, which are about as high) would be too small in the whole frame.
    Thresholds are scores in [0, 1].
    """

    expected_person_px: ExpectedPersonPx | None = None
    canvases: tuple[tuple[int, int], ...] = ()
    """Widths and heights of inputs that the network takes as they are, small ones first."""

    def __init__(
        self,
        *,
        class_names: tuple[str, ...],
        sight: Sight,
        whole_threshold: float,
        tile_threshold: float,
    ) -> None:
        self.class_names = class_names
        self.sight = sight
        self.whole_threshold = whole_threshold
        self.tile_threshold = tile_threshold

    @abstractmethod
    def infer(self, image_bgr: np.ndarray, threshold: float) -> Boxes:
        """What the network says of one picture: boxes end at its borders, duplicates are left."""

    def infer_canvas(self, canvas: Float32[np.ndarray, "h w 3"], threshold: float) -> Boxes:
        """What the network says of an input of one of ``canvases``, in its pixels from edge 0."""
        raise NotImplementedError

    def person_px(self, rows: int) -> Float[np.ndarray, "h"]:
        """Height of a person with feet at each image row, NaN where unknown."""
        if self.expected_person_px is None:
            return np.full(rows, np.nan)
        return _expected_heights(self.expected_person_px, rows)

    def detect(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> sv.Detections:
        """Objects of one image, best first, with ``data["class_name"]``; one box per object."""
        require_bgr(image_bgr)
        regions = self.regions((image_bgr.shape[1], image_bgr.shape[0]))
        return self.joined([self.look_at(image_bgr, region) for region in regions])

    def regions(self, image_size: tuple[int, int]) -> Int[np.ndarray, "n 4"]:
        """What is looked at in an image of (width, height): all of it, then tiles."""
        tiles = choose_tiles(image_size, self.expected_person_px, self.sight)
        return np.concatenate([[[0, 0, *image_size]], tiles])

    def look_at(self, image_bgr: np.ndarray, region: Int[np.ndarray, "4"]) -> Boxes:
        """What is seen in one of the regions; a box that a tile cuts is left to its neighbour."""
        size = (image_bgr.shape[1], image_bgr.shape[0])
        x1, y1, x2, y2 = region
        whole = (x2 - x1, y2 - y1) == size
        threshold = self.whole_threshold if whole else self.tile_threshold
        found = self.infer(image_bgr[y1:y2, x1:x2], threshold)
        found = found._replace(xyxy=found.xyxy + np.array([x1, y1, x1, y1]))
        return found.select(~cut_by_tile(found.xyxy, region, size))

    def joined(self, parts: list[Boxes]) -> sv.Detections:
        """What was seen in all regions, best first; one box per object."""
        found = Boxes(*(np.concatenate(column) for column in zip(*parts, strict=True)))
        found = found.select(np.argsort(-found.score))
        names = np.array(self.class_names)[found.label]
        return sv.Detections(
            xyxy=found.xyxy,
            confidence=found.score,
            class_id=found.label,
            data={"class_name": names},
        ).with_nms(_NMS_IOU)

    def expecting(self, expected_person_px: ExpectedPersonPx | None) -> "TiledDetector":
        """The same detector for a scene where the size of people is known; shares the network."""
        other = copy.copy(self)
        other.expected_person_px = expected_person_px
        return other
