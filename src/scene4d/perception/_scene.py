"""A picture of a still camera and its parts, and what changed since they were looked at."""

from typing import NamedTuple

import numpy as np
from jaxtyping import Bool, Float

from scene4d.perception._changes import GreyCopy, changed
from scene4d.perception._motion import Motion

MOVED_S = 0.3
"""What moves is looked at again after so many seconds. On PETS 2009 at 10 Hz, following people in
between for 0.3 s left HOTA within 0.3 and the median error of positions as it was; 0.4 s cost 1.0
of HOTA (both without ``_TRUST``)."""
EARLY_S = 1e-3  # times carry rounding errors
_MARGIN = 0.15
"""A box is enlarged by this share of its height for what it explains: shadow, bags, errors."""


class Scene(NamedTuple):
    """One picture of a still camera, and what has changed in it."""

    image: np.ndarray
    time_s: float
    copy: GreyCopy
    motion: Motion

    @property
    def size(self) -> tuple[int, int]:
        """Width and height."""
        return self.image.shape[1], self.image.shape[0]

    def cells_of(self, box_xyxy: Float[np.ndarray, "n 4"]) -> Bool[np.ndarray, "h w"]:
        """Cells of the grey copy whose change the things in these boxes explain."""
        mask = np.zeros(self.copy.grey.shape, bool)
        for box in box_xyxy:
            margin = _MARGIN * (box[3] - box[1])
            mask[self.copy.cells(box + margin * np.array([-1, -1, 1, 1]))] = True
        return mask

    def share(self, mask: Bool[np.ndarray, "h w"], box_xyxy: np.ndarray) -> np.ndarray:
        """Share of each box (n, 4) that a mask of cells covers."""
        return np.array([mask[self.copy.cells(box)].mean() for box in box_xyxy])


class Region:
    """A part of the picture, and how it was when it was last looked at."""

    def __init__(self, box: np.ndarray, cells: tuple[slice, slice], looks: int) -> None:
        self.box, self.cells = box, cells
        self.looks = looks
        """Looks that are still to come, whatever happens."""
        self.grey: np.ndarray | None = None
        self.explained: np.ndarray | None = None
        self.time_s = -np.inf

    def changed(self, scene: Scene) -> Bool[np.ndarray, "h w"]:
        """Cells of it that changed since it was looked at, in a mask of the whole picture."""
        mask = np.zeros(scene.copy.grey.shape, bool)
        if self.grey is not None:
            mask[self.cells] = changed(scene.copy.grey[self.cells], self.grey)
        return mask

    def rested(self, time_s: float) -> bool:
        """Whether it is time for another look, if one is wanted."""
        return time_s - self.time_s >= MOVED_S - EARLY_S

    def is_stale(self, time_s: float, every_s: float) -> bool:
        """Whether it must be looked at."""
        return time_s - self.time_s >= every_s or (self.looks > 0 and self.rested(time_s))

    def remember(self, scene: Scene, explained: np.ndarray, seen: np.ndarray | None = None) -> None:
        """How the cells that were ``seen`` (None: all) are now, and which the known explain."""
        grey, mask = scene.copy.grey[self.cells], explained[self.cells]
        if seen is None or self.grey is None or self.explained is None:
            self.grey, self.explained = grey.copy(), mask.copy()
            return
        part = seen[self.cells]
        self.grey[part], self.explained[part] = grey[part], mask[part]
