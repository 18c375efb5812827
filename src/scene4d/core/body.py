"""Body model of people: heights, radii, keypoints, and the score from which a point is seen."""

PERSON_HEIGHT_M = 1.70
"""Default mean height (m) of adults, including shoes (about 2.5 cm). Chosen between the means of
men and women; populations differ by 0.1 m and more (docs/method.md)."""
HEIGHT_SIGMA_M = 0.09
"""Standard deviation (m) of adults' heights, men and women together: about 0.07 m within each, and
0.13 m between their means."""
FOOT_HEIGHT_M = 0.04
"""Height (m) of the foot keypoints (mean of toes and heel) above the ground: inside the shoe, not
under it. Chosen by hand; the bottom of a box is on the ground."""
BODY_RADIUS_M = 0.25
"""Distance (m) from the axis of a walking body to the rim that a box's bottom edge touches
(docs/method.md; chosen by hand on the tuning cameras)."""
HEAD_RADIUS_M = 0.10
"""Radius (m) of the sphere that models the head, which a box's top edge touches (as above)."""

MIN_KEYPOINT_SCORE = 0.3
"""A keypoint with a lower score is not visible. Chosen by hand: truncated feet score about 0.1,
visible ones above 0.5 (RTMPose's score)."""
BORDER_PX = 2.0
"""A box this near (px) to the image border may be cut by it: detectors clip at the border and
round. Chosen by hand."""

HALPE26: tuple[str, ...] = (
    "nose", "left_eye", "right_eye", "left_ear", "right_ear",
    "left_shoulder", "right_shoulder", "left_elbow", "right_elbow", "left_wrist", "right_wrist",
    "left_hip", "right_hip", "left_knee", "right_knee", "left_ankle", "right_ankle",
    "head_top", "neck", "pelvis",
    "left_big_toe", "right_big_toe", "left_small_toe", "right_small_toe",
    "left_heel", "right_heel",
)  # fmt: skip
"""Names of the 26 keypoints of Halpe (Fang et al. 2022), in order."""
COCO17: tuple[str, ...] = HALPE26[:17]
"""Names of the 17 keypoints of COCO, in order."""
HEAD_TOP = "head_top"
LEFT_FOOT: tuple[str, ...] = ("left_big_toe", "left_small_toe", "left_heel")
RIGHT_FOOT: tuple[str, ...] = ("right_big_toe", "right_small_toe", "right_heel")
"""Keypoints whose mean is the foot."""
