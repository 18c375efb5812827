"""The lower end (feet) and upper end (head) that a detection shows of a person, with spreads.

Spreads of image points are standard deviations, as shares of the person's length in the image.
``benchmarks/people_positions.py`` measures them on PETS 2009, the only available clip with true
positions. They include the errors of the hand-drawn boxes used as truth, so they are upper bounds.
"""

from dataclasses import dataclass

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.body import (
    BODY_RADIUS_M,
    BORDER_PX,
    HEAD_RADIUS_M,
    HEAD_TOP,
    LEFT_FOOT,
    MIN_KEYPOINT_SCORE,
    RIGHT_FOOT,
)
from scene4d.core.columns import Columns
from scene4d.core.people import Detections

_FEET_SHARE = 0.025
"""Both feet, in any direction."""
_HEAD_SHARE = 0.025
"""The top of the head, in any direction. Taken from the feet, because unknown heights mask it."""
BOX_SHARE = 0.08
"""Upper and lower edges of Faster R-CNN's boxes."""
DRAWN_BOX_SHARE = 0.03
"""The same for boxes drawn as carefully as those of PETS. (YOLOX's are within 0.02.)"""
_ACROSS_SHARE = 0.03
"""The middle of a box, horizontally."""
_CUT_SHARE = 0.10
"""The same where the left or right image border cuts the box: half a person may be missing."""
_STEP_SIGMA_M = 0.17
"""One foot relative to the middle of both, on the ground."""

BOTH_FEET, ONE_FOOT, BOX_BOTTOM = "both feet", "one foot", "box bottom"
HEAD, BOX_TOP = "head", "box top"


@dataclass(frozen=True, eq=False)
class Ends(Columns):
    """One end of each person in the image, (n, 2) pixels of the footage.

    ``by`` names the evidence, ``""`` where there is none and ``uv`` is NaN. ``share`` is the
    spread along u and v, ``spread_m`` an additional spread on the ground, and ``radius_m`` the
    radius of the body or head that the box edge touches, 0 for keypoints.
    """

    by: np.ndarray
    uv: Float[np.ndarray, "n 2"]
    share: Float[np.ndarray, "n 2"]
    spread_m: Float[np.ndarray, "n"]
    radius_m: Float[np.ndarray, "n"]

    @classmethod
    def unseen(cls, n: int) -> "Ends":
        """No end is seen."""
        nan = np.full((n, 2), np.nan)
        return cls(np.full(n, "", dtype="<U12"), nan, nan.copy(), np.zeros(n), np.zeros(n))

    def fill(
        self,
        rows: Bool[np.ndarray, "n"],
        by: str,
        uv: Float[np.ndarray, "n 2"],
        share: Float[np.ndarray, "n 2"] | float,
        *,
        spread_m: float = 0.0,
        radius_m: float = 0.0,
    ) -> None:
        """Set the end from ``by`` in those of the given rows that have none yet."""
        rows = rows & (self.by == "") & np.isfinite(uv).all(axis=1)
        self.by[rows] = by
        self.uv[rows] = uv[rows]
        self.share[rows] = np.broadcast_to(share, uv.shape)[rows]
        self.spread_m[rows] = spread_m
        self.radius_m[rows] = radius_m


def body_point(
    detections: Detections, names: tuple[str, ...]
) -> tuple[Float[np.ndarray, "n 2"], Bool[np.ndarray, "n"]]:
    """Mean of the named keypoints (n, 2), and where all of them are seen inside the image."""
    if not set(names) <= set(detections.keypoint_names):
        return np.full((len(detections), 2), np.nan), np.zeros(len(detections), bool)
    columns = [detections.keypoint_names.index(name) for name in names]
    uv = detections.keypoint_uv[:, columns].mean(axis=1)
    last = np.array(detections.image_size) - 1
    inside = ((uv >= 0) & (uv <= last)).all(axis=1)
    return uv, inside & (detections.keypoint_score[:, columns].min(axis=1) > MIN_KEYPOINT_SCORE)


def lower_ends(detections: Detections, box_share: float) -> Ends:
    """Both feet, else one, else the bottom of a box that the image border does not cut.

    Where the keypoints show a head but no foot, the legs are hidden and the box ends too high.
    """
    left, left_seen = body_point(detections, LEFT_FOOT)
    right, right_seen = body_point(detections, RIGHT_FOOT)
    ends = Ends.unseen(len(detections))
    ends.fill(left_seen & right_seen, BOTH_FEET, (left + right) / 2, _FEET_SHARE)
    for foot, seen in ((left, left_seen), (right, right_seen)):
        ends.fill(seen, ONE_FOOT, foot, _FEET_SHARE, spread_m=_STEP_SIGMA_M)
    uncut = detections.box_xyxy[:, 3] <= detections.image_size[1] - 1 - BORDER_PX
    if set(LEFT_FOOT + RIGHT_FOOT) <= set(detections.keypoint_names):
        uncut &= ~body_point(detections, (HEAD_TOP,))[1]
    ends.fill(
        uncut,
        BOX_BOTTOM,
        detections.box_foot_uv,
        _box_share(detections, box_share),
        radius_m=BODY_RADIUS_M,
    )
    return ends


def upper_ends(detections: Detections, box_share: float) -> Ends:
    """The top of the head, else the top of a box that the image border does not cut."""
    head, seen = body_point(detections, (HEAD_TOP,))
    ends = Ends.unseen(len(detections))
    ends.fill(seen, HEAD, head, _HEAD_SHARE)
    x1, y1, x2, _ = detections.box_xyxy.T
    ends.fill(
        y1 >= BORDER_PX,
        BOX_TOP,
        np.column_stack([(x1 + x2) / 2, y1]),
        _box_share(detections, box_share),
        radius_m=HEAD_RADIUS_M,
    )
    return ends


def _box_share(detections: Detections, along: float) -> np.ndarray:
    x1, x2 = detections.box_xyxy[:, 0], detections.box_xyxy[:, 2]
    cut = (x1 < BORDER_PX) | (x2 > detections.image_size[0] - 1 - BORDER_PX)
    return np.column_stack([np.where(cut, _CUT_SHARE, _ACROSS_SHARE), np.full(len(cut), along)])
