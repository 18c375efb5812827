"""What detectors with a small input share: the whole frame, tiles of it, and one list of boxes."""

import copy
from abc import ABC, abstractmethod
from typing import NamedTuple

import numpy as np
import supervision as sv
from jaxtyping import UInt8

from scene4d.perception.detectors.base import require_bgr
from scene4d.perception.detectors.tiles import ExpectedPersonPx, Sight, choose_tiles, cut_by_tile

_NMS_IOU = 0.5


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

    Boxes are pixels of the image given, pixel centres at integers. ``tiles`` None decides by the
    image's size: tiles are used where they show things clearly larger than the whole frame does.
    ``expected_person_px`` restricts them to where people (and vehicles, which are about as high)
    would be too small in the whole frame. Thresholds are scores in [0, 1].
    """

    def __init__(
        self,
        *,
        class_names: tuple[str, ...],
        sight: Sight,
        whole_threshold: float,
        tile_threshold: float,
        tiles: bool | None,
        expected_person_px: ExpectedPersonPx | None,
    ) -> None:
        self.class_names = class_names
        self.sight = sight
        self.whole_threshold = whole_threshold
        self.tile_threshold = tile_threshold
        self.tiles = tiles
        self.expected_person_px = expected_person_px

    @abstractmethod
    def infer(self, image_bgr: np.ndarray, threshold: float) -> Boxes:
        """What the network says of one picture: boxes end at its borders, duplicates are left."""

    def detect(self, image_bgr: UInt8[np.ndarray, "h w 3"]) -> sv.Detections:
        """Objects of one image, best first, with ``data["class_name"]``; one box per object."""
        require_bgr(image_bgr)
        parts = [self.infer(image_bgr, self.whole_threshold)]
        size = (image_bgr.shape[1], image_bgr.shape[0])
        wanted = choose_tiles(size, self.expected_person_px, use=self.tiles, sight=self.sight)
        for tile in wanted:
            x1, y1, x2, y2 = tile
            part = self.infer(image_bgr[y1:y2, x1:x2], self.tile_threshold)
            part = part._replace(xyxy=part.xyxy + np.array([x1, y1, x1, y1]))
            parts.append(part.select(~cut_by_tile(part.xyxy, tile, size)))
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
