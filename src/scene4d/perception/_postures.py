"""Keypoints of people in successive frames, taken as often as they tell something new."""

import numpy as np
import supervision as sv
from jaxtyping import Float, Int

from scene4d.perception._scene import EARLY_S

_EVERY_S, _STILL_S = 0.4, 1.0
"""A person's keypoints are taken so many seconds apart, of one who keeps still the second, and
follow the picture's motion in between. On PETS 2009 at 10 Hz the median error of positions was
12.0 cm with 0.3 s, 12.2 cm with 0.4 s (as with keypoints in every frame), 13.0 cm with 0.5 s and
13.4 cm with 0.8 s; with 0.8 s for those far from others and from vehicles alone, 12.1 cm instead of
11.5 cm on its first half."""
_STILL = 0.04
"""Who keeps still has a box whose edges stay within this share of its height: twice the jitter of a
detector's boxes."""


class Postures:
    """The keypoints of the people in the last frame, and when they were taken of which box."""

    def __init__(self) -> None:
        self._number = np.empty(0, np.int64)
        self._uv = np.empty((0, 0, 2))
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
        self._now_s, self._now_box = np.full(n, time_s), np.array(people.xyxy, float)
        if not n or not len(self._number):
            return uv, score, np.arange(n)
        _, rows, before = np.intersect1d(people.data["number"], self._number, return_indices=True)
        uv[rows] = self._uv[before] + people.data["shift_px"][rows, None]
        score[rows] = self._score[before]
        taken, box = self._taken_s[before], self._box[before]
        wait = np.where(_changed(box, self._now_box[rows]), _EVERY_S, _STILL_S)
        late = time_s - taken >= wait - EARLY_S
        late &= people.data["looked_s"][rows] > taken
        kept = rows[~late]
        self._now_s[kept], self._now_box[kept] = taken[~late], box[~late]
        return uv, score, np.setdiff1d(np.arange(n), kept)

    def keep(self, people: sv.Detections, uv: np.ndarray, score: np.ndarray) -> None:
        """Remember this frame, after what was missing has been filled in."""
        number = people.data.get("number", np.empty(0, np.int64))
        self._number = np.asarray(number)
        self._uv, self._score, self._taken_s, self._box = uv, score, self._now_s, self._now_box


def _changed(before_xyxy: np.ndarray, now_xyxy: np.ndarray) -> np.ndarray:
    """Which boxes (n,) moved, or changed their shape."""
    height = now_xyxy[:, 3] - now_xyxy[:, 1]
    moved: np.ndarray = np.abs(now_xyxy - before_xyxy).max(axis=1) > _STILL * height
    return moved
