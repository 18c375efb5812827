"""From detections to the upright segments that a camera is calibrated from."""

import numpy as np
from jaxtyping import Bool, Float

from scene4d.core.body import BORDER_PX, HEAD_TOP, LEFT_FOOT, MIN_KEYPOINT_SCORE, RIGHT_FOOT
from scene4d.core.people import Detections, Segments

MIN_LENGTH_PX = 15.0
"""Shorter people carry more noise than news."""

_TRUNK = ("left_shoulder", "right_shoulder", "left_hip", "right_hip")
_NEEDED = (HEAD_TOP, *LEFT_FOOT, *RIGHT_FOOT, *_TRUNK)


def missing_keypoints(detections: Detections) -> list[str]:
    """Names of the keypoints that segments need and these detections, which have some, lack."""
    if not detections.keypoint_names:
        return []
    return sorted(set(_NEEDED) - set(detections.keypoint_names))


def person_segments(detections: Detections) -> Segments:
    """Segments of the people who are seen whole, from keypoints where head top, heels and toes are
    among them (:func:`missing_keypoints`), else from boxes.

    Head top and the mean of both feet are points of one vertical line; a box gives its top and
    bottom centre, which the solver reads through a model of the body. Boxes that touch the
    image's border are left out: the hidden end of them is unknown.
    """
    people = detections.select(detections.class_name == "person")
    if set(_NEEDED) <= set(people.keypoint_names):
        return _from_keypoints(people)
    return _from_boxes(people)


def _segments(
    people: Detections,
    foot_uv: Float[np.ndarray, "n 2"],
    head_uv: Float[np.ndarray, "n 2"],
    keep: Bool[np.ndarray, "n"],
    *,
    from_box: bool,
) -> Segments:
    length = np.hypot(*(foot_uv - head_uv).T)
    keep = keep & (length > MIN_LENGTH_PX) & (foot_uv[:, 1] > head_uv[:, 1])
    return Segments(
        foot_uv=foot_uv,
        head_uv=head_uv,
        frame=people.frame,
        time_s=people.time_s,
        track=people.track,
        score=people.score,
        box_xyxy=people.box_xyxy,
        from_box=np.full(len(people), from_box),
    ).select(keep)


def _from_keypoints(people: Detections) -> Segments:
    index = {name: i for i, name in enumerate(people.keypoint_names)}

    def mean_of(names: tuple[str, ...]) -> np.ndarray:
        return people.keypoint_uv[:, [index[name] for name in names]].mean(axis=1)

    foot = (mean_of(LEFT_FOOT) + mean_of(RIGHT_FOOT)) / 2
    head = people.keypoint_uv[:, index[HEAD_TOP]]
    seen = people.keypoint_score[:, [index[name] for name in _NEEDED]].min(axis=1)
    keep = (seen > MIN_KEYPOINT_SCORE) & _inside(people, foot) & _inside(people, head)
    return _segments(people, foot, head, keep, from_box=False)


def _inside(people: Detections, uv: np.ndarray) -> np.ndarray:
    width, height = people.image_size
    x, y = uv[:, 0], uv[:, 1]
    inside: np.ndarray = (x >= 0) & (x <= width - 1) & (y >= 0) & (y <= height - 1)
    return inside


def _from_boxes(people: Detections) -> Segments:
    x1, y1, x2, y2 = people.box_xyxy.T
    middle = (x1 + x2) / 2
    width, height = people.image_size
    cut = (
        (x1 < BORDER_PX)
        | (y1 < BORDER_PX)
        | (x2 > width - 1 - BORDER_PX)
        | (y2 > height - 1 - BORDER_PX)
    )
    return _segments(
        people,
        np.column_stack([middle, y2]),
        np.column_stack([middle, y1]),
        ~cut,
        from_box=True,
    )
