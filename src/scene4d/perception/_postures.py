"""Keypoints of people in successive frames, taken as often as they tell something new."""

import numpy as np
import supervision as sv
from jaxtyping import Float, Int

from scene4d.perception._scene import EARLY_S

_EVERY_S, _STILL_S = 0.7, 1.0
"""A person's keypoints are taken so many seconds apart, of one who keeps still the second, and move
and grow with the box in between. On the first half of PETS 2009 at 10 Hz the median error of
positions is 11.2 cm with 0.4 s, 11.4 cm with 0.7 s and 12.1 cm with 0.9 s; moved with the optical
flow of the trunk instead, 11.2, 12.2 and 12.7 cm."""
_STILL = 0.04
"""Who keeps still has a box whose edges stay within this share of its height: twice the jitter of a
detector's boxes."""


class Postures:
    """The keypoints of the people in the last frame, and when they were taken of which box."""

    def __init__(self) -> None:
        self._number = np.empty(0, np.int64)
        self._shape = np.empty((0, 0, 2))  # from the foot of the box, in its heights
        self._score = np.empty((0, 0))
        self._taken_s = np.empty(0)
        self._box = np.empty((0, 4))

    def carried(
        self, people: sv.Detections, time_s: float, columns: int
    ) -> tuple[Float[np.ndarray, "n k 2"], Float[np.ndarray, "n k"], Int[np.ndarray, "m"]]:
        """Keypoints and scores in this frame, and the rows (m,) whose keypoints must be taken:
        those of people who are new, or were looked at since.
        """
        n = len(people)
        uv, score = np.full((n, columns, 2), np.nan), np.zeros((n, columns))
        now_xyxy = np.array(people.xyxy, float)
        self._now_s, self._now_box = np.full(n, time_s), now_xyxy.copy()
        if not n or not len(self._number):
            return uv, score, np.arange(n)
        _, rows, before = np.intersect1d(people.data["number"], self._number, return_indices=True)
        foot, height = _foot_and_height(now_xyxy[rows])
        uv[rows] = foot + self._shape[before] * height
        score[rows] = self._score[before]
        taken, box = self._taken_s[before], self._box[before]
        wait = np.where(_changed(box, now_xyxy[rows]), _EVERY_S, _STILL_S)
        late = time_s - taken >= wait - EARLY_S
        late &= people.data["looked_s"][rows] > taken
        kept = rows[~late]
        self._now_s[kept], self._now_box[kept] = taken[~late], box[~late]
        return uv, score, np.setdiff1d(np.arange(n), kept)

    def keep(self, people: sv.Detections, uv: np.ndarray, score: np.ndarray) -> None:
        """Remember this frame, after what was missing has been filled in."""
        number = people.data.get("number", np.empty(0, np.int64))
        self._number = np.asarray(number)
        foot, height = _foot_and_height(np.asarray(people.xyxy, float))
        self._shape, self._score = (uv - foot) / height, score
        self._taken_s, self._box = self._now_s, self._now_box


def _foot_and_height(box_xyxy: np.ndarray) -> tuple[np.ndarray, np.ndarray]:
    """The middle of each box's lower edge (n, 1, 2), and its height (n, 1, 1)."""
    x1, y1, x2, y2 = box_xyxy.T
    foot = np.column_stack([(x1 + x2) / 2, y2])
    return foot[:, None], np.maximum(y2 - y1, 1.0)[:, None, None]


def _changed(before_xyxy: np.ndarray, now_xyxy: np.ndarray) -> np.ndarray:
    """Which boxes (n,) moved, or changed their shape."""
    height = now_xyxy[:, 3] - now_xyxy[:, 1]
    moved: np.ndarray = np.abs(now_xyxy - before_xyxy).max(axis=1) > _STILL * height
    return moved
