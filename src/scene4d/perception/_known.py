"""Things that a detector saw, as they are known between its looks."""

from dataclasses import dataclass

import numpy as np
import supervision as sv
from jaxtyping import Bool, Float, Int

from scene4d.core.columns import Columns

_SAME_IOU = 0.6
_OTHER_IOU = 0.3
"""Two boxes certainly show one thing if they overlap by more than the first, and neither overlaps
any other by more than the second; chosen by hand."""
TWICE_IOU = 0.5
"""Boxes that overlap more are one thing, seen twice: the customary threshold."""


@dataclass(frozen=True, eq=False)
class Known(Columns):
    """Things (n,) where they are now: ``origin`` is the region that shows them, ``looked_s`` when
    they were last looked at and ``seen_xyxy`` where, ``number`` says which is which from frame to
    frame, and ``sure`` is what several looks have shown.
    """

    xyxy: Float[np.ndarray, "n 4"]
    score: Float[np.ndarray, "n"]
    label: Int[np.ndarray, "n"]
    origin: Int[np.ndarray, "n"]
    looked_s: Float[np.ndarray, "n"]
    seen_xyxy: Float[np.ndarray, "n 4"]
    number: Int[np.ndarray, "n"]
    sure: Bool[np.ndarray, "n"]

    @classmethod
    def nothing(cls) -> "Known":
        """No thing."""
        none, box = np.empty(0, np.int64), np.empty((0, 4))
        return cls(box, np.empty(0), none, none, np.empty(0), box, none, none > 0)

    @property
    def travelled(self) -> Float[np.ndarray, "n"]:
        """How far things came since they were looked at, in longer sides of their boxes."""
        side = (self.xyxy[:, 2:] - self.xyxy[:, :2]).max(axis=1)
        far: np.ndarray = np.abs(self.xyxy - self.seen_xyxy).max(axis=1) / np.maximum(side, 1.0)
        return far

    def crossing(self, iou: float) -> Bool[np.ndarray, "n"]:
        """What overlaps something else by more than ``iou``: one hides the other."""
        if not len(self):
            return np.zeros(0, bool)
        overlap = sv.box_iou_batch(self.xyxy, self.xyxy)
        np.fill_diagonal(overlap, 0.0)
        found: np.ndarray = overlap.max(axis=1) > iou
        return found

    def once(self) -> tuple["Known", Int[np.ndarray, "m"]]:
        """One row (m,) per thing: the newest, of several as new the best; best first."""
        rank = np.empty(len(self))
        rank[np.lexsort((self.score, self.looked_s))] = np.arange(len(self))
        table = np.column_stack([self.xyxy, rank, self.label])
        kept = sv.box_non_max_suppression(table, TWICE_IOU) if len(self) else rank > 0
        rows = np.flatnonzero(kept)
        rows = rows[np.argsort(-self.score[rows], kind="stable")]
        return self.select(rows), rows

    def same(
        self, box_xyxy: Float[np.ndarray, "m 4"], label: Int[np.ndarray, "m"]
    ) -> tuple[Int[np.ndarray, "k"], Int[np.ndarray, "k"]]:
        """Rows and the boxes that certainly show the same thing."""
        if not len(self) or not len(box_xyxy):
            return np.empty(0, np.int64), np.empty(0, np.int64)
        iou = sv.box_iou_batch(self.xyxy, box_xyxy) * (self.label[:, None] == label)
        near = iou > _OTHER_IOU
        alone = (near.sum(axis=1) == 1)[:, None] & (near.sum(axis=0) == 1)
        rows, boxes = np.nonzero(alone & (iou > _SAME_IOU))
        return rows, boxes

    def detections(self, class_names: tuple[str, ...]) -> sv.Detections:
        """As detectors give them, with what tells when keypoints are due."""
        return sv.Detections(
            xyxy=self.xyxy,
            confidence=self.score,
            class_id=self.label,
            data={
                "class_name": np.array(class_names)[self.label],
                "number": self.number,
                "looked_s": self.looked_s,
            },
        )
