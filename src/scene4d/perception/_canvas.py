"""Parts of a picture side by side in one small input of a network, instead of all of it."""

from typing import NamedTuple

import cv2
import numpy as np
from jaxtyping import Float, Int

from scene4d.perception.detectors.tiles import Boxes

_PAD = 114.0
"""Grey between the parts: as around the pictures that YOLOX was trained on."""


class Canvas(NamedTuple):
    """Parts (n, 4) of a picture, where each lies on the canvas (n, 2), and its scale (n,)."""

    size: tuple[int, int]
    part_xyxy: Int[np.ndarray, "n 4"]
    corner: Int[np.ndarray, "n 2"]
    scale: Float[np.ndarray, "n"]

    @classmethod
    def smallest(
        cls,
        sizes: tuple[tuple[int, int], ...],
        part_xyxy: Int[np.ndarray, "n 4"],
        scale: Float[np.ndarray, "n"],
    ) -> "Canvas | None":
        """On the first of the sizes (width, height) that holds all parts, None if none does."""
        side = _sides(part_xyxy, scale)
        for size in sizes:
            corner = _shelved(side, size)
            if corner is not None:
                return cls(size, part_xyxy, corner, scale)
        return None

    def drawn(self, image_bgr: np.ndarray) -> Float[np.ndarray, "h w 3"]:
        """The network's input."""
        canvas = np.full((self.size[1], self.size[0], 3), _PAD, np.float32)
        sides = _sides(self.part_xyxy, self.scale)
        for part, (x, y), (w, h) in zip(self.part_xyxy, self.corner, sides, strict=True):
            piece = image_bgr[part[1] : part[3], part[0] : part[2]]
            size = (int(w), int(h))
            canvas[y : y + h, x : x + w] = cv2.resize(piece, size, interpolation=cv2.INTER_LINEAR)
        return canvas

    def read(self, found: Boxes) -> tuple[Boxes, Int[np.ndarray, "m"]]:
        """What was found, in pixels of the picture, and in which part; edges as for detectors."""
        middle = (found.xyxy[:, :2] + found.xyxy[:, 2:]) / 2
        end = self.corner + _sides(self.part_xyxy, self.scale)
        inside = (middle[:, None] >= self.corner) & (middle[:, None] < end)
        rows, part = np.nonzero(inside.all(axis=2))
        found = found.select(rows)
        low, high = np.tile(self.corner[part], 2), np.tile(end[part], 2)
        first, last = np.tile(self.part_xyxy[part, :2], 2), np.tile(self.part_xyxy[part, 2:], 2)
        xyxy = (np.clip(found.xyxy, low, high) - low) / (high - low) * (last - first)
        return found._replace(xyxy=xyxy + first - 0.5), part


def _sides(part_xyxy: np.ndarray, scale: np.ndarray) -> np.ndarray:
    side = (part_xyxy[:, 2:] - part_xyxy[:, :2]) * scale[:, None]
    sides: np.ndarray = np.maximum(1, np.round(side)).astype(np.int64)
    return sides


def _shelved(side: np.ndarray, size: tuple[int, int]) -> np.ndarray | None:
    """Corners of parts put beside each other on shelves, tall ones first; None: no room."""
    corner = np.empty_like(side)
    x = y = shelf = 0
    for k in np.argsort(-side[:, 1], kind="stable"):
        if x + side[k, 0] > size[0]:
            x, y, shelf = 0, y + shelf, 0
        shelf = max(shelf, int(side[k, 1]))
        if x + side[k, 0] > size[0] or y + shelf > size[1]:
            return None
        corner[k] = x, y
        x += int(side[k, 0])
    return corner


def merged(
    part_xyxy: Int[np.ndarray, "n 4"], scale: Float[np.ndarray, "n"]
) -> tuple[Int[np.ndarray, "m 4"], Float[np.ndarray, "m"]]:
    """Parts, and their scales; those are one that take less room together than apart."""
    parts = [(part, s) for part, s in zip(part_xyxy, scale, strict=True)]
    k = 0
    while k < len(parts):
        for j in range(k):
            (a, sa), (b, sb) = parts[j], parts[k]
            both = np.concatenate([np.minimum(a[:2], b[:2]), np.maximum(a[2:], b[2:])])
            if _area(both) * max(sa, sb) ** 2 <= _area(a) * sa**2 + _area(b) * sb**2:
                parts[j] = (both, max(sa, sb))
                del parts[k]
                k = 0  # the larger part may take in another
                break
        k += 1
    return np.array([p for p, _ in parts]).reshape(-1, 4), np.array([s for _, s in parts])


def _area(part: np.ndarray) -> float:
    return float((part[2] - part[0]) * (part[3] - part[1]))
